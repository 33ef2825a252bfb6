"""Instruments: what a real sensor makes of the exact quantity that it should measure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from trackprofile.errors import DataError, ModelError
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Sensor, sensor_noise_density
from trackprofile.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

ANTI_ALIAS_SHARE = 0.25
"""Bandwidth of an anti-alias filter as a share of the sampling rate; digital parts such as ADXL355 keep it."""

MULTIPLE_TOLERANCE = 1e-6
"""How far from a whole number of steps a sampling interval may be, as a share of one step."""


@dataclass(frozen=True)
class Instrument:
    """A sensor with what else a data sheet says of it.

    White noise, flicker, drift, offset and bandwidth are those of its :class:`Sensor`, so that who simulates it and
    who infers from it speak of the same numbers. All are of the reading: neither gain nor misalignment scales noise.

    Parameters
    ----------
    sensor : what is measured, where, with which noise, drift, offset and bandwidth
    resolution : step of the reading, m/s² or rad/s; 0: it has none
    range : the largest reading of either sign, gravity not counted, m/s² or rad/s; None: any
    misalignment : ε, between the sensor's axis and the vehicle's, rad
    gain : reading per quantity
    source : where the numbers come from

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=2.5e-4)
    >>> Instrument(floor, resolution=1.5e-4, range=78.5).gain
    1.0
    """

    sensor: Sensor
    resolution: float = 0.0
    range: float | None = None
    misalignment: float = 0.0
    gain: float = 1.0
    source: str = ""

    def __post_init__(self) -> None:
        numbers = {
            "a resolution of at least 0": (self.resolution, 0 <= self.resolution < np.inf),
            "a range above 0, or none at all": (self.range, self.range is None or self.range > 0),
            "a misalignment within π/2 rad": (
                self.misalignment,
                abs(self.misalignment) < np.pi / 2,
            ),
            "a finite gain other than 0": (self.gain, np.isfinite(self.gain) and self.gain != 0),
        }
        for expected, (found, holds) in numbers.items():
            if not holds:
                raise ModelError(f"sensor {self.sensor.name!r} needs {expected}, got {found}")


def measure(
    instrument: Instrument,
    exact: Array,
    interval: float,
    sampling_interval: float,
    generator: np.random.Generator,
) -> tuple[Array, NDArray[np.bool_]]:
    """What the instrument reads of an exact quantity, and which of its samples can be used.

    y_k = quantised(clipped(h * u(t_k) + noise_k)), u = gain · a cos ε, for a vertical acceleration
    gain · (a cos ε + g (cos ε - 1)), and h the Butterworth low-pass of the sensor's bandwidth. A stated offset of
    the sensor is drawn once and is where its drift starts. All noise is drawn whatever its size, so that one
    seed gives instruments that differ in a number the same noise but for that number.

    Parameters
    ----------
    exact : (steps,), m/s² or rad/s, from the first sample on
    interval : between its steps, s
    sampling_interval : a whole multiple of it, s
    generator : of the noise

    Returns
    -------
    values (samples,), m/s² or rad/s, and valid (samples,), False where the range was exceeded;
    samples = ⌈steps / multiple⌉

    Raises
    ------
    DataError : the sampling interval is no whole multiple, or the quantity no row of finite numbers.

    Examples
    --------
    >>> coarse = Instrument(Sensor("rate", "pitch rate", "body"), resolution=0.25, range=1.0)
    >>> exact = np.array([0.0, 0.1, 0.3, 0.6, 1.2])
    >>> measure(coarse, exact, 0.001, 0.002, np.random.default_rng(1))
    (array([0.  , 0.25, 1.  ]), array([ True,  True, False]))
    """
    every = _multiple(interval, sampling_interval)
    felt = _felt(instrument, _row(exact))
    sampled = _low_passed(felt, instrument.sensor.bandwidth, interval)[::every]
    reading = sampled + instrument_noise(instrument, len(sampled), sampling_interval, generator)
    largest = np.inf if instrument.range is None else instrument.range
    values = _quantised(np.clip(reading, -largest, largest), instrument.resolution)
    return values, np.abs(reading) <= largest


def instrument_noise(
    instrument: Instrument, count: int, sampling_interval: float, generator: np.random.Generator
) -> Array:
    """What the instrument adds to ``count`` samples: white noise, flicker, and a drifting offset, sensor's unit.

    Examples
    --------
    >>> quiet = Instrument(Sensor("rate", "pitch rate", "body"))
    >>> instrument_noise(quiet, 2, 0.004, np.random.default_rng(1))
    array([0., 0.])
    """
    sensor = instrument.sensor
    # Half the sampling rate times the one-sided density is the variance of white samples.
    white = np.sqrt(0.5 / sampling_interval) * generator.standard_normal(count)
    pink = _pink(count, sampling_interval, generator)
    steps = generator.standard_normal(count)
    steps[:1] *= sensor.offset or 0.0
    steps[1:] *= (sensor.drift or 0.0) * np.sqrt(sampling_interval)
    return (sensor.noise_density or 0.0) * white + (sensor.flicker or 0.0) * pink + np.cumsum(steps)


def instrument_noise_density(
    instrument: Instrument, frequency: Array, sampling_interval: float
) -> Array:
    """The one-sided power spectral density of what `measure` adds to the exact quantity.

    S(f) = N² + F²/f + 2 D²/(2πf)² + (q²/12) 2 Δt, with the white noise N, flicker F, drift D and resolution q. The
    last holds where the reading crosses many steps (Widrow, Kollár 2008); offset and what is aliased are left out.

    Parameters
    ----------
    frequency : any shape, above 0 and well below 1/(2 Δt), Hz
    sampling_interval : Δt, s

    Returns
    -------
    of that shape, (m/s²)²/Hz or (rad/s)²/Hz

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=3e-4, flicker=4e-4)
    >>> np.sqrt(instrument_noise_density(Instrument(floor), np.array([1.0]), 0.004))
    array([0.0005])
    """
    f = np.asarray(frequency, np.float64)
    if not np.all(f > 0):
        raise DataError(
            f"Noise density: expected frequencies above 0 Hz, got {np.min(f):g}; leave that one out."
        )
    return (
        sensor_noise_density(instrument.sensor, f)
        + instrument.resolution**2 / 6 * sampling_interval
    )


def with_anti_alias_filter(instrument: Instrument, sampling_interval: float) -> Instrument:
    """The same instrument, with a bandwidth of at most a quarter of its sampling rate.

    It stands in the sensor, where the inference sees it too.

    Examples
    --------
    >>> rate = Instrument(Sensor("rate", "pitch rate", "body"))
    >>> with_anti_alias_filter(rate, 0.004).sensor.bandwidth
    62.5
    """
    widest = ANTI_ALIAS_SHARE / sampling_interval
    bandwidth = min(instrument.sensor.bandwidth or np.inf, widest)
    return replace(instrument, sensor=replace(instrument.sensor, bandwidth=bandwidth))


def _multiple(interval: float, sampling_interval: float) -> int:
    """How many steps there are from one sample to the next."""
    ratio = sampling_interval / interval if interval > 0 else np.nan
    if not (0.5 < ratio < np.inf and abs(ratio - round(ratio)) <= MULTIPLE_TOLERANCE):
        raise DataError(
            f"Sampling: expected a whole multiple of the interval of {interval:g} s, got "
            f"{sampling_interval:g} s; choose an interval that divides it."
        )
    return round(ratio)


def _row(exact: Array) -> Array:
    row = np.asarray(exact, np.float64)
    if row.ndim != 1 or not row.size or not np.all(np.isfinite(row)):
        raise DataError(
            f"Exact quantity: expected a row of finite numbers, got shape {row.shape} with "
            f"{np.count_nonzero(~np.isfinite(row))} that are not; give one sensor's at a time."
        )
    return row


def _felt(instrument: Instrument, exact: Array) -> Array:
    """What acts along the sensor's own axis; gravity is taken out as if that axis were upright."""
    cosine = np.cos(instrument.misalignment)
    upright = instrument.sensor.quantity == VERTICAL_ACCELERATION
    gravity = STANDARD_GRAVITY if upright else 0.0
    return instrument.gain * (exact * cosine + gravity * (cosine - 1.0))


def _low_passed(signal: Array, bandwidth: float | None, interval: float) -> Array:
    """Behind ω²/(s² + √2 ω s + ω²), exactly for a signal straight between its steps, settled at its start."""
    if bandwidth is None:
        return signal
    rate = 2 * np.pi * bandwidth
    analog = ([rate**2], [1.0, np.sqrt(2) * rate, rate**2])
    discrete: Any = cont2discrete(analog, interval, method="foh")
    b, a = np.ravel(discrete[0]), np.ravel(discrete[1])
    filtered, _ = lfilter(b, a, signal, zi=lfilter_zi(b, a) * signal[0])
    return np.asarray(filtered, np.float64)


def _pink(count: int, sampling_interval: float, generator: np.random.Generator) -> Array:
    """Noise of the one-sided density 1/f, 1/Hz, from half the lowest frequency of that duration on, without mean.

    The first half of a series twice as long: one drawn to length would end where it began.
    """
    drawn = next_fast_len(2 * count, real=True)
    white = np.sqrt(0.5 / sampling_interval) * generator.standard_normal(drawn)
    frequency = rfftfreq(drawn, sampling_interval)
    waves = np.asarray(rfft(white))
    waves[0] = 0.0
    waves[1:] /= np.sqrt(frequency[1:])
    return np.asarray(irfft(waves, drawn), np.float64)[:count]


def _quantised(values: Array, step: float) -> Array:
    return step * np.round(values / step) if step > 0 else values

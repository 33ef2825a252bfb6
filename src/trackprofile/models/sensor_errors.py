"""Sensor errors: the reading of a real sensor, given the exact quantity."""

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
"""Bandwidth of an anti-alias filter as a share of the sampling rate, as in digital sensors such as the ADXL355."""

MULTIPLE_TOLERANCE = 1e-6
"""Maximum deviation of a sampling interval from a whole number of steps, as a share of one step."""


@dataclass(frozen=True)
class Instrument:
    """A sensor with the further properties of its data sheet, for simulation.

    White noise, flicker, drift, offset and bandwidth are those of its :class:`Sensor`, so that simulation and
    inference use the same numbers. All refer to the reading: neither gain nor misalignment scales the noise.

    Parameters
    ----------
    sensor : quantity, location, noise, drift, offset and bandwidth
    resolution : quantisation step of the reading, m/s² or rad/s; 0: not quantised
    range : maximum absolute reading, without gravity, m/s² or rad/s; None: unlimited
    misalignment : ε, angle between the sensor's axis and the vehicle's, rad
    gain : reading per quantity
    source : source of the numbers

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
            "a range above 0, or no range": (self.range, self.range is None or self.range > 0),
            "a misalignment within π/2 rad": (
                self.misalignment,
                abs(self.misalignment) < np.pi / 2,
            ),
            "a finite gain other than 0": (self.gain, np.isfinite(self.gain) and self.gain != 0),
        }
        for expected, (value, valid) in numbers.items():
            if not valid:
                raise ModelError(f"sensor {self.sensor.name!r} needs {expected}, got {value}")


def measure(
    instrument: Instrument,
    exact: Array,
    interval: float,
    sampling_interval: float,
    generator: np.random.Generator,
) -> tuple[Array, NDArray[np.bool_]]:
    """Readings of an instrument for an exact quantity, and their validity.

    y_k = quantised(clipped(h * u(t_k) + noise_k)) with u = gain · a cos ε, or gain · (a cos ε + g (cos ε - 1)) for a
    vertical acceleration, and h the Butterworth low-pass of the sensor's bandwidth. A stated offset of the sensor is
    drawn once; the drift starts from it. Every kind of noise is drawn even if its size is 0, so that one seed gives
    the same random numbers to instruments that differ in a parameter.

    Parameters
    ----------
    exact : (steps,), m/s² or rad/s, starting at the first sample
    interval : time between the steps of ``exact``, s
    sampling_interval : time between samples, a whole multiple of ``interval``, s
    generator : random generator of the noise

    Returns
    -------
    values (samples,), m/s² or rad/s, and valid (samples,), False where the range is exceeded;
    samples = ⌈steps / multiple⌉

    Raises
    ------
    DataError : the sampling interval is not a whole multiple, or ``exact`` is not a row of finite numbers.

    Examples
    --------
    >>> coarse = Instrument(Sensor("rate", "pitch rate", "body"), resolution=0.25, range=1.0)
    >>> exact = np.array([0.0, 0.1, 0.3, 0.6, 1.2])
    >>> measure(coarse, exact, 0.001, 0.002, np.random.default_rng(1))
    (array([0.  , 0.25, 1.  ]), array([ True,  True, False]))
    """
    every = _multiple(interval, sampling_interval)
    along_axis = _along_sensor_axis(instrument, _checked_row(exact))
    sampled = _low_passed(along_axis, instrument.sensor.bandwidth, interval)[::every]
    reading = sampled + instrument_noise(instrument, len(sampled), sampling_interval, generator)
    largest = np.inf if instrument.range is None else instrument.range
    values = _quantised(np.clip(reading, -largest, largest), instrument.resolution)
    return values, np.abs(reading) <= largest


def instrument_noise(
    instrument: Instrument, count: int, sampling_interval: float, generator: np.random.Generator
) -> Array:
    """Noise of ``count`` samples: white noise, flicker and an offset with drift, (count,), m/s² or rad/s.

    Examples
    --------
    >>> quiet = Instrument(Sensor("rate", "pitch rate", "body"))
    >>> instrument_noise(quiet, 2, 0.004, np.random.default_rng(1))
    array([0., 0.])
    """
    sensor = instrument.sensor
    # The variance of white samples is half the sampling rate times the one-sided density.
    white = np.sqrt(0.5 / sampling_interval) * generator.standard_normal(count)
    pink = _pink(count, sampling_interval, generator)
    steps = generator.standard_normal(count)
    steps[:1] *= sensor.offset or 0.0
    steps[1:] *= (sensor.drift or 0.0) * np.sqrt(sampling_interval)
    return (sensor.noise_density or 0.0) * white + (sensor.flicker or 0.0) * pink + np.cumsum(steps)


def instrument_noise_density(
    instrument: Instrument, frequency: Array, sampling_interval: float
) -> Array:
    """One-sided power spectral density of the noise that `measure` adds to the exact quantity.

    S(f) = N² + F²/f + 2 D²/(2πf)² + (q²/12) 2 Δt, with the white noise N, flicker F, drift D and resolution q. The
    last term holds where the reading crosses many steps (Widrow, Kollár 2008). The offset and aliasing are neglected.

    Parameters
    ----------
    frequency : any shape, above 0 and well below 1/(2 Δt), Hz
    sampling_interval : Δt, s

    Returns
    -------
    same shape, (m/s²)²/Hz or (rad/s)²/Hz

    Raises
    ------
    DataError : a frequency is not above 0.

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=3e-4, flicker=4e-4)
    >>> np.sqrt(instrument_noise_density(Instrument(floor), np.array([1.0]), 0.004))
    array([0.0005])
    """
    f = np.asarray(frequency, np.float64)
    if not np.all(f > 0):
        raise DataError(
            f"Noise density: expected frequencies above 0 Hz, got {np.min(f):g} Hz; remove that frequency."
        )
    return (
        sensor_noise_density(instrument.sensor, f)
        + instrument.resolution**2 / 6 * sampling_interval
    )


def with_anti_alias_filter(instrument: Instrument, sampling_interval: float) -> Instrument:
    """The same instrument with a bandwidth of at most a quarter of the sampling rate.

    The bandwidth is set in the sensor, so that the inference takes it into account too.

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
    """Number of steps per sampling interval."""
    ratio = sampling_interval / interval if interval > 0 else np.nan
    if not (0.5 < ratio < np.inf and abs(ratio - round(ratio)) <= MULTIPLE_TOLERANCE):
        raise DataError(
            f"Sampling interval: expected a whole multiple of the step of {interval:g} s, got "
            f"{sampling_interval:g} s; choose a step that divides it."
        )
    return round(ratio)


def _checked_row(exact: Array) -> Array:
    row = np.asarray(exact, np.float64)
    if row.ndim != 1 or not row.size or not np.all(np.isfinite(row)):
        raise DataError(
            f"Exact quantity: expected a row of finite numbers, got shape {row.shape} with "
            f"{np.count_nonzero(~np.isfinite(row))} values that are not finite; give the values of one sensor."
        )
    return row


def _along_sensor_axis(instrument: Instrument, exact: Array) -> Array:
    """The quantity along the sensor's own axis; gravity is subtracted as if that axis were vertical."""
    cosine = np.cos(instrument.misalignment)
    upright = instrument.sensor.quantity == VERTICAL_ACCELERATION
    gravity = STANDARD_GRAVITY if upright else 0.0
    return instrument.gain * (exact * cosine + gravity * (cosine - 1.0))


def _low_passed(signal: Array, bandwidth: float | None, interval: float) -> Array:
    """The signal after ω²/(s² + √2 ω s + ω²): exact for linear interpolation, in steady state at the start."""
    if bandwidth is None:
        return signal
    rate = 2 * np.pi * bandwidth
    analog = ([rate**2], [1.0, np.sqrt(2) * rate, rate**2])
    discrete: Any = cont2discrete(analog, interval, method="foh")
    b, a = np.ravel(discrete[0]), np.ravel(discrete[1])
    filtered, _ = lfilter(b, a, signal, zi=lfilter_zi(b, a) * signal[0])
    return np.asarray(filtered, np.float64)


def _pink(count: int, sampling_interval: float, generator: np.random.Generator) -> Array:
    """Zero-mean noise of the one-sided density 1/f, 1/Hz, down to half the lowest frequency of the duration.

    It is the first half of a periodic series of twice the length, which need not end where it begins.
    """
    length = next_fast_len(2 * count, real=True)
    white = np.sqrt(0.5 / sampling_interval) * generator.standard_normal(length)
    frequency = rfftfreq(length, sampling_interval)
    waves = np.asarray(rfft(white))
    waves[0] = 0.0
    waves[1:] /= np.sqrt(frequency[1:])
    return np.asarray(irfft(waves, length), np.float64)[:count]


def _quantised(values: Array, step: float) -> Array:
    return step * np.round(values / step) if step > 0 else values

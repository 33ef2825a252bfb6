"""The band of frequencies in which the track explains the signals; signals cut to it, and thinned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.signal import butter, fftconvolve, kaiserord, sosfilt, welch

from trackprofile.errors import DataError
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import Model, leading_wheel_motion
from trackprofile.models.receptance import MAXIMUM_FIT_FREQUENCY
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum, scale_density
from trackprofile.models.statespace import state_space, transfer_function

Array = NDArray[np.float64]

SAMPLES_PER_PERIOD = 2.5
"""Kept of the fastest wave that is left."""

RIPPLE = 60.0
"""dB by which the cut leaves less than this of what is above, and changes what is below by less."""

LOW_PASS = 0.5 * MAXIMUM_FIT_FREQUENCY
"""Hz, of the gentle low-pass: a sixteenth of the amplitude is left at twice the highest frequency used."""

FINER = 8
"""Points per sample, at which the low-pass is run: it then is what it is in continuous time."""

FORGOTTEN = 9.2
"""Decay times of the low-pass, after which 1e-4 is left."""

INSIDE = 0.995
"""Weight of valid samples in a kept one."""

SEGMENT = 10.0
"""s of a periodogram: two waves of the slowest bounce of a body, several times over."""

SHORTEST = 3.0
"""s of a run, below which it shows not even the slowest bounce of a body."""

PIECES = 3
"""Into which a short run is cut."""

SPEEDS = 12
"""Speeds that stand for a recording's."""

MOVING = 3.0
"""m/s: what is slower says nothing of the band."""


@dataclass(frozen=True)
class SpectralFit:
    """What the track explains of one sensor's signal.

    Parameters
    ----------
    frequency : (m,), Hz
    measured : (m,), one-sided density of the signal, unit²/Hz
    track : (m,), of what the profile makes of it through the vehicle
    noise : (m,), white but for the sensor's own filter, unit²/Hz
    stated : noise density that the recording states, unit/√Hz
    """

    frequency: Array
    measured: Array
    track: Array
    noise: Array
    stated: float | None

    @property
    def highest(self) -> float:
        """Hz, up to which the track stands above the noise; at most what the point track holds for."""
        above = self.frequency[self.track > self.noise]
        return float(min(above[-1], MAXIMUM_FIT_FREQUENCY)) if above.size else 0.0


def spectral_fit(data: Sequence[Observations], model: Model) -> tuple[list[SpectralFit], Spectrum]:
    """For each sensor what a profile of the model's spectrum explains, and the spectrum at the level that fits.

    The level a, one for all sensors, and the white noises w maximise Whittle's likelihood of the periodograms P,
    -Σ log(a G + w) + P / (a G + w), with G(f) = |H(Ω)|² S(Ω) 2π/v at Ω = 2πf/v, averaged over the speeds v.
    """
    spectra = [_spectra(data, model, i) for i in range(len(model.sensors))]
    start = [np.log(np.sum(P[1:]) / np.sum(G[1:])) for _, P, G in spectra]
    noise = [np.log(0.1 * np.median(P[1:])) for _, P, _ in spectra]

    passed = [_passed(one, f) for one, (f, _, _) in zip(model.sensors, spectra, strict=True)]

    def improbability(at: Array) -> float:
        total = 0.0
        for (f, P, G), L, logarithm in zip(spectra, passed, at[1:], strict=True):
            S = np.exp(at[0]) * G[1:] + np.exp(logarithm) * L[1:]
            total += float(np.sum((np.log(S) + P[1:] / S) / f[1:]))
        return total

    found = minimize(improbability, [float(np.median(start)), *noise], method="Nelder-Mead",
                     options={"xatol": 1e-3, "fatol": 1e-3, "maxiter": 4000}).x  # fmt: skip
    level = float(np.exp(found[0]))
    parts = [
        SpectralFit(f, P, level * G, float(np.exp(w)) * L, one.noise_density)
        for (f, P, G), L, w, one in zip(spectra, passed, found[1:], data[0].sensors, strict=True)
    ]
    return parts, scale_density(model.spectrum, level)


def _going(
    one: Observations, model: Model, i: int, interval: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A signal at even times, the speed there, and where both are good."""
    time, signal, weight = _even(one, i, interval)
    going = np.interp(time, one.motion.time, leading_wheel_motion(one, model).speed)
    return signal, going, (weight > INSIDE) & (going > MOVING)


def _segment(data: Sequence[Observations], model: Model, i: int, interval: float) -> int:
    """Samples in a periodogram: fewer where no piece is long."""
    pieces = [piece for one in data for piece in _pieces(_going(one, model, i, interval)[2], 1)]
    longest = interval * max((piece.stop - piece.start for piece in pieces), default=0)
    if longest < SHORTEST:
        raise DataError(
            f"Sensor {model.sensors[i].name}: expected {SHORTEST:g} s without a gap above {MOVING:g} m/s, got "
            f"{longest:.3g} s: too short or too slow to tell the vehicle; record a kilometre or more at line speed."
        )
    return round(min(SEGMENT, longest / PIECES) / interval)


def _passed(sensor: Sensor, frequency: Array) -> Array:
    """What of a noise's density its sensor's own filter passes."""
    if sensor.bandwidth is None:
        return np.ones(len(frequency))
    return 1 / (1 + (frequency / sensor.bandwidth) ** 4)


def _spectra(data: Sequence[Observations], model: Model, i: int) -> tuple[Array, Array, Array]:
    """Frequencies, periodogram and what a profile of the model's spectrum would make of one sensor's signal."""
    interval = min(float(np.median(np.diff(one.motion.time))) for one in data)
    count = _segment(data, model, i, interval)
    total, seconds, speeds = np.zeros(count // 2 + 1), 0.0, []
    f = np.asarray(np.fft.rfftfreq(count, interval), np.float64)
    for one in data:
        signal, going, good = _going(one, model, i, interval)
        for piece in _pieces(good, count):
            _, P = welch(signal[piece], 1 / interval, "hann", count, detrend="linear")
            total += P * (piece.stop - piece.start)
            seconds += piece.stop - piece.start
            speeds.append(going[piece])
    system = state_space(model.vehicle, model.track, model.sensors)
    quantiles = np.quantile(np.concatenate(speeds), (np.arange(SPEEDS) + 0.5) / SPEEDS)
    made = np.zeros(len(f))
    for speed in quantiles:
        Ω = 2 * np.pi * f[1:] / speed
        H = transfer_function(system, Ω, float(speed))[:, i]
        made[1:] += np.abs(H) ** 2 * model.spectrum.density(Ω) * 2 * np.pi / speed / SPEEDS
    return f, total / seconds, made


def _pieces(good: NDArray[np.bool_], least: int) -> list[slice]:
    """Runs of good samples of at least that length."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    return [slice(a, b) for a, b in edges.reshape(-1, 2) if b - a >= least]


def _even(data: Observations, i: int, interval: float) -> tuple[Array, Array, Array]:
    """Even times, one signal at them, 0 where it is invalid, and how valid it is there, 0 to 1."""
    time = data.motion.time
    even = np.arange(time[0], time[-1], interval)
    valid = data.valid[:, i].astype(np.float64)
    return even, np.interp(even, time, data.signals[:, i] * valid), np.interp(even, time, valid)


def limit_bandwidth(data: Observations, highest: Sequence[float]) -> Observations:
    """The signals without what lies above some frequency each, at as many samples as that takes.

    Where noise is all that lies above, it is cut off sharply. Where the track still speaks there, but its model
    fails (``MAXIMUM_FIT_FREQUENCY``), a sharp cut would leave a hole that the model does not expect, and the vehicle
    would be bent to make one: there the signal goes through a gentle low-pass that the model goes through too.

    Parameters
    ----------
    highest : (sensors,), Hz
    """
    time = data.motion.time
    interval = float(np.median(np.diff(time)))
    signals, valid = data.signals.copy(), data.valid.copy()
    step, limits = data.step.copy(), np.full(len(highest), np.inf)
    kept = np.zeros(len(time), bool)
    low_pass: list[float | None] = [None] * len(highest)
    for i, frequency in enumerate(highest):
        apart = 1 / (SAMPLES_PER_PERIOD * frequency)
        if apart < 1.5 * interval:
            kept |= valid[:, i]
            continue
        chosen = np.zeros(len(time), bool)
        chosen[_apart(time, apart)] = True
        if frequency < MAXIMUM_FIT_FREQUENCY:
            signals[:, i], clean = _cut(data, i, interval, frequency)
            limits[i] = 1.25 * frequency
        elif data.sensors[i].bandwidth is None:
            signals[:, i], clean = _low_passed(data, i, interval)
            low_pass[i] = LOW_PASS
        else:
            clean = valid[:, i]
        valid[:, i] = clean & chosen & valid[:, i]
        step[:, i] *= np.sqrt(interval / apart)
        kept |= chosen
    changed = replace(
        data,
        signals=signals,
        valid=valid,
        step=step,
        usable_bandwidth=limits,
        low_pass=tuple(low_pass),
    )
    return changed.part(kept)


def _apart(time: Array, least: float) -> NDArray[np.intp]:
    """Indices of samples at least about that long apart."""
    return np.unique(np.searchsorted(time, np.arange(time[0], time[-1], least) - 1e-9))


def _cut(
    data: Observations, i: int, interval: float, highest: float
) -> tuple[Array, NDArray[np.bool_]]:
    """A signal through a linear-phase low-pass, and where no invalid sample has a part in it."""
    even, signal, weight = _even(data, i, interval)
    nyquist = 0.5 / interval
    taps, beta = kaiserord(RIPPLE, 0.25 * highest / nyquist)
    kernel = _sinc(taps | 1, beta, 1.125 * highest / nyquist)
    mean = np.sum(signal) / max(np.sum(weight), 1.0)
    size = np.abs(kernel)  # as a kernel of both signs cancels what is missing
    share = fftconvolve(weight, size / np.sum(size), mode="same")
    through = fftconvolve(signal - mean * weight, kernel, mode="same") + mean
    time = data.motion.time
    return np.interp(time, even, through), np.interp(time, even, share) > INSIDE


def _low_passed(data: Observations, i: int, interval: float) -> tuple[Array, NDArray[np.bool_]]:
    """A signal through the model's own low-pass, l̈ + √2 ω l̇ + ω² l = ω² y, and where it has forgotten the invalid."""
    even, signal, weight = _even(data, i, interval)
    fine = np.linspace(even[0], even[-1], FINER * (len(even) - 1) + 1)
    mean = np.sum(signal) / max(np.sum(weight), 1.0)
    sections = butter(2, LOW_PASS, fs=1 / (fine[1] - fine[0]), output="sos")
    moving = CubicSpline(even, signal - mean * weight)(fine)
    through = np.asarray(sosfilt(sections, moving), np.float64)[::FINER] + mean
    memory = FORGOTTEN / (2 * np.pi * LOW_PASS / np.sqrt(2))
    # Before the first sample nothing is known either.
    bad = np.concatenate([[even[0]], even[weight <= INSIDE]])
    time = data.motion.time
    since = time - bad[np.searchsorted(bad, time, side="right") - 1]
    return np.interp(time, even, through), since > memory


def _sinc(taps: int, beta: float, cut: float) -> Array:
    """A low-pass of unit sum that cuts at a share of the Nyquist frequency, windowed by Kaiser."""
    at = np.arange(taps) - taps // 2
    kernel = np.sinc(cut * at) * np.kaiser(taps, beta)
    return kernel / np.sum(kernel)

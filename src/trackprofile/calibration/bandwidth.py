"""Usable bandwidth: the frequencies at which the track explains the signals; signals low-passed and decimated to it."""

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
"""Samples per period of the highest frequency after decimation."""

RIPPLE = 60.0
"""Stopband attenuation and passband ripple of the sharp low-pass, dB."""

LOW_PASS = 0.5 * MAXIMUM_FIT_FREQUENCY
"""Corner of the second-order low-pass, Hz: a sixteenth of the amplitude passes at twice the highest frequency used."""

OVERSAMPLING = 8
"""Points per sample at which the low-pass runs, so that it approximates continuous time."""

SETTLING = 9.2
"""Decay times of the low-pass after which 1e-4 of a transient remains."""

MIN_VALID_WEIGHT = 0.995
"""Minimum weight of valid samples in a filtered one."""

SEGMENT = 10.0
"""Length of a periodogram, s: several periods of the slowest body bounce."""

MIN_DURATION = 3.0
"""Minimum duration of a run, s: it must contain the slowest body bounce."""

MIN_SEGMENTS = 3
"""Minimum number of periodograms of a short run."""

SPEEDS = 12
"""Number of speeds that represent a recording."""

MIN_SPEED = 3.0
"""Minimum speed, m/s: slower samples do not show the band."""


@dataclass(frozen=True)
class SpectralFit:
    """The part of one sensor's spectrum that the track explains.

    Parameters
    ----------
    frequency : (m,), Hz
    measured : (m,), one-sided density of the signal, unit²/Hz
    track : (m,), density of the response to the profile, unit²/Hz
    noise : (m,), density of white noise behind the sensor's own filter, unit²/Hz
    stated : noise density that the recording states, unit/√Hz; None where it states none
    """

    frequency: Array
    measured: Array
    track: Array
    noise: Array
    stated: float | None

    @property
    def highest(self) -> float:
        """Highest frequency at which the track exceeds the noise, Hz; limited by the validity of the point track."""
        above = self.frequency[self.track > self.noise]
        return float(min(above[-1], MAXIMUM_FIT_FREQUENCY)) if above.size else 0.0


def spectral_fit(data: Sequence[Observations], model: Model) -> tuple[list[SpectralFit], Spectrum]:
    """The spectral fit of each sensor, and the model's profile spectrum at the level that fits.

    The common level a and the white noise densities w of the sensors maximise Whittle's likelihood of the periodograms
    P, -Σ log(a G + w) + P / (a G + w), with G(f) = |H(Ω)|² S(Ω) 2π/v at Ω = 2πf/v, averaged over the speeds v.
    """
    spectra = [_spectra(data, model, i) for i in range(len(model.sensors))]
    start = [np.log(np.sum(P[1:]) / np.sum(G[1:])) for _, P, G in spectra]
    noise = [np.log(0.1 * np.median(P[1:])) for _, P, _ in spectra]

    filters = [
        _filter_response(one, f) for one, (f, _, _) in zip(model.sensors, spectra, strict=True)
    ]

    def negative_log_likelihood(at: Array) -> float:
        total = 0.0
        for (f, P, G), L, logarithm in zip(spectra, filters, at[1:], strict=True):
            S = np.exp(at[0]) * G[1:] + np.exp(logarithm) * L[1:]
            total += float(np.sum((np.log(S) + P[1:] / S) / f[1:]))
        return total

    maximum = minimize(negative_log_likelihood, [float(np.median(start)), *noise], method="Nelder-Mead",
                     options={"xatol": 1e-3, "fatol": 1e-3, "maxiter": 4000}).x  # fmt: skip
    level = float(np.exp(maximum[0]))
    parts = [
        SpectralFit(f, P, level * G, float(np.exp(w)) * L, one.noise_density)
        for (f, P, G), L, w, one in zip(spectra, filters, maximum[1:], data[0].sensors, strict=True)
    ]
    return parts, scale_density(model.spectrum, level)


def _signal_and_speed(
    one: Observations, model: Model, i: int, interval: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A signal at even times, the speed (m/s) at them, and where both are usable."""
    time, signal, weight = _resampled(one, i, interval)
    speed = np.interp(time, one.motion.time, leading_wheel_motion(one, model).speed)
    return signal, speed, (weight > MIN_VALID_WEIGHT) & (speed > MIN_SPEED)


def _segment_length(data: Sequence[Observations], model: Model, i: int, interval: float) -> int:
    """Number of samples of a periodogram: fewer where every continuous piece is short."""
    pieces = [
        piece for one in data for piece in _pieces(_signal_and_speed(one, model, i, interval)[2], 1)
    ]
    longest = interval * max((piece.stop - piece.start for piece in pieces), default=0)
    if longest < MIN_DURATION:
        raise DataError(
            f"Sensor {model.sensors[i].name}: expected {MIN_DURATION:g} s without a gap above {MIN_SPEED:g} m/s, got "
            f"{longest:.3g} s: too short or too slow to determine the vehicle; record a kilometre or more at line "
            "speed."
        )
    return round(min(SEGMENT, longest / MIN_SEGMENTS) / interval)


def _filter_response(sensor: Sensor, frequency: Array) -> Array:
    """Power response of the sensor's own filter."""
    if sensor.bandwidth is None:
        return np.ones(len(frequency))
    return 1 / (1 + (frequency / sensor.bandwidth) ** 4)


def _spectra(data: Sequence[Observations], model: Model, i: int) -> tuple[Array, Array, Array]:
    """Frequencies (Hz), periodogram, and expected response of one sensor to the model's spectrum."""
    interval = min(float(np.median(np.diff(one.motion.time))) for one in data)
    count = _segment_length(data, model, i, interval)
    total, count_used, speeds = np.zeros(count // 2 + 1), 0.0, []
    f = np.asarray(np.fft.rfftfreq(count, interval), np.float64)
    for one in data:
        signal, speed, good = _signal_and_speed(one, model, i, interval)
        for piece in _pieces(good, count):
            _, P = welch(signal[piece], 1 / interval, "hann", count, detrend="linear")
            total += P * (piece.stop - piece.start)
            count_used += piece.stop - piece.start
            speeds.append(speed[piece])
    system = state_space(model.vehicle, model.track, model.sensors)
    quantiles = np.quantile(np.concatenate(speeds), (np.arange(SPEEDS) + 0.5) / SPEEDS)
    response = np.zeros(len(f))
    for v in quantiles:
        Ω = 2 * np.pi * f[1:] / v
        H = transfer_function(system, Ω, float(v))[:, i]
        response[1:] += np.abs(H) ** 2 * model.spectrum.density(Ω) * 2 * np.pi / v / SPEEDS
    return f, total / count_used, response


def _pieces(good: NDArray[np.bool_], min_length: int) -> list[slice]:
    """Runs of usable samples of at least ``min_length`` samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    return [slice(a, b) for a, b in edges.reshape(-1, 2) if b - a >= min_length]


def _resampled(data: Observations, i: int, interval: float) -> tuple[Array, Array, Array]:
    """Even times (s), one signal at them (0 where invalid), and its validity, 0 to 1."""
    time = data.motion.time
    even = np.arange(time[0], time[-1], interval)
    valid = data.valid[:, i].astype(np.float64)
    return even, np.interp(even, time, data.signals[:, i] * valid), np.interp(even, time, valid)


def limit_bandwidth(data: Observations, highest: Sequence[float]) -> Observations:
    """The signals limited to a highest frequency each, decimated accordingly.

    Where only noise lies above it, a sharp low-pass removes it. Where the track still contributes above it, but the
    point track is not valid (``MAXIMUM_FIT_FREQUENCY``), a sharp cut would bias the vehicle, since the model does not
    contain it: there the signal passes a second-order low-pass that the model contains too.

    Parameters
    ----------
    highest : (sensors,), Hz
    """
    time = data.motion.time
    interval = float(np.median(np.diff(time)))
    signals, valid = data.signals.copy(), data.valid.copy()
    step, bandwidth = data.step.copy(), np.full(len(highest), np.inf)
    kept = np.zeros(len(time), bool)
    low_pass: list[float | None] = [None] * len(highest)
    for i, frequency in enumerate(highest):
        period = 1 / (SAMPLES_PER_PERIOD * frequency)
        if period < 1.5 * interval:
            kept |= valid[:, i]
            continue
        selected = np.zeros(len(time), bool)
        selected[_decimated(time, period)] = True
        if frequency < MAXIMUM_FIT_FREQUENCY:
            signals[:, i], clean = _sharp_low_pass(data, i, interval, frequency)
            bandwidth[i] = 1.25 * frequency
        elif data.sensors[i].bandwidth is None:
            signals[:, i], clean = _second_order_low_pass(data, i, interval)
            low_pass[i] = LOW_PASS
        else:
            clean = valid[:, i]
        valid[:, i] = clean & selected & valid[:, i]
        step[:, i] *= np.sqrt(interval / period)
        kept |= selected
    limited = replace(
        data,
        signals=signals,
        valid=valid,
        step=step,
        usable_bandwidth=bandwidth,
        low_pass=tuple(low_pass),
    )
    return limited.part(kept)


def _decimated(time: Array, period: float) -> NDArray[np.intp]:
    """Indices of samples about one period (s) apart."""
    return np.unique(np.searchsorted(time, np.arange(time[0], time[-1], period) - 1e-9))


def _sharp_low_pass(
    data: Observations, i: int, interval: float, highest: float
) -> tuple[Array, NDArray[np.bool_]]:
    """A signal after a linear-phase low-pass, and where no invalid sample contributes to it."""
    even, signal, weight = _resampled(data, i, interval)
    nyquist = 0.5 / interval
    taps, beta = kaiserord(RIPPLE, 0.25 * highest / nyquist)
    kernel = _sinc(taps | 1, beta, 1.125 * highest / nyquist)
    mean = np.sum(signal) / max(np.sum(weight), 1.0)
    size = np.abs(kernel)  # in a kernel of both signs missing samples would cancel
    share = fftconvolve(weight, size / np.sum(size), mode="same")
    filtered = fftconvolve(signal - mean * weight, kernel, mode="same") + mean
    time = data.motion.time
    return np.interp(time, even, filtered), np.interp(time, even, share) > MIN_VALID_WEIGHT


def _second_order_low_pass(
    data: Observations, i: int, interval: float
) -> tuple[Array, NDArray[np.bool_]]:
    """A signal after the model's low-pass, l̈ + √2 ω l̇ + ω² l = ω² y, and where invalid samples have decayed."""
    even, signal, weight = _resampled(data, i, interval)
    fine = np.linspace(even[0], even[-1], OVERSAMPLING * (len(even) - 1) + 1)
    mean = np.sum(signal) / max(np.sum(weight), 1.0)
    sections = butter(2, LOW_PASS, fs=1 / (fine[1] - fine[0]), output="sos")
    centred = CubicSpline(even, signal - mean * weight)(fine)
    filtered = np.asarray(sosfilt(sections, centred), np.float64)[::OVERSAMPLING] + mean
    memory = SETTLING / (2 * np.pi * LOW_PASS / np.sqrt(2))
    # The samples before the first one are unknown too.
    bad = np.concatenate([[even[0]], even[weight <= MIN_VALID_WEIGHT]])
    time = data.motion.time
    since = time - bad[np.searchsorted(bad, time, side="right") - 1]
    return np.interp(time, even, filtered), since > memory


def _sinc(taps: int, beta: float, cut: float) -> Array:
    """Kernel of a low-pass of unit sum, cut off at a share of the Nyquist frequency, with a Kaiser window."""
    at = np.arange(taps) - taps // 2
    kernel = np.sinc(cut * at) * np.kaiser(taps, beta)
    return kernel / np.sum(kernel)

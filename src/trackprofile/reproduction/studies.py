"""Computations for the figures: searches, smoothers, accuracy bounds, and the growth of errors."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.bands import BANDS, band_pass
from trackprofile.inference.accuracy_bound import accuracy_bound
from trackprofile.inference.infer import Estimate, estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.methods.cross_entropy.estimator import (
    CrossEntropyResult,
    cross_entropy,
    sensor_weights,
)
from trackprofile.methods.cross_entropy.forward_model import forward_model
from trackprofile.methods.cross_entropy.search_settings import CrossEntropySettings, SearchSettings
from trackprofile.models.integrate import Scheme
from trackprofile.models.sensor_errors import Instrument
from trackprofile.models.spectrum import Spectrum
from trackprofile.reproduction.cases import (
    Case,
    case_recording,
    fine_signals,
    search_grid_signals,
    with_lead,
)

Array = NDArray[np.float64]

GRID = 0.25
"""Spacing of the points at which profiles are compared, m."""


@dataclass(frozen=True)
class SearchStudy:
    """Result of the cross-entropy search of a case.

    Parameters
    ----------
    result : result of the method
    position : (n,), m
    error : (n,), elevation minus truth, m
    rate : computing time, s/m
    """

    result: CrossEntropyResult
    position: Array
    error: Array
    rate: float


@dataclass(frozen=True)
class SmootherStudy:
    """Result of the smoother for a case.

    Parameters
    ----------
    estimate : result of the smoother
    position : (n,), m
    error : (n,), elevation minus truth, without its best-fit parabola, m
    """

    estimate: Estimate
    position: Array
    error: Array


def run_search(
    case: Case, signals: Array, settings: SearchSettings, instruments: Sequence[Instrument] = (), seed: int = 0
) -> SearchStudy:  # fmt: skip
    """Search the profile of a case from exact signals, or from those that instruments read.

    Parameters
    ----------
    signals : (scans + 1, sensors), m/s² or rad/s
    instruments : one per sensor; empty: exact signals
    seed : seed of the search and of the noise
    """
    recording = case_recording(case, signals, instruments, seed)
    start = time.perf_counter()
    result = cross_entropy(
        recording, case.vehicle, CrossEntropySettings(track=case.track, search=settings, seed=seed)
    )
    duration = time.perf_counter() - start
    position = result.profile["distance"].to_numpy()
    truth = case.irregularity.at(position)[0]
    error = result.profile["elevation"].to_numpy() - truth
    return SearchStudy(result, position, error, duration / (position[-1] - position[0]))


def fine_signals_with_lead(case: Case) -> Array:
    """Signals of the fine simulation for the smoother, with the lead, (scans + 1, sensors), m/s² or rad/s."""
    return fine_signals(with_lead(case))


def run_smoother(
    case: Case, signals: Array, instruments: Sequence[Instrument] = (), seed: int = 0
) -> SmootherStudy:
    """Estimate the profile of a case with the smoother, from exact signals or from those that instruments read.

    Parameters
    ----------
    signals : result of `fine_signals_with_lead`
    instruments : one per sensor; empty: exact signals
    seed : seed of the noise
    """
    recording = case_recording(with_lead(case), signals, instruments, seed)
    settings = InferenceSettings(case.installation, case.track, samples=16)
    result = estimate(recording, case.vehicle, settings)
    position = result.profile["distance"].to_numpy()
    error = result.profile["elevation"].to_numpy() - case.irregularity.at(position)[0]
    inside = (position >= case.start) & (position <= case.position[-1])
    flat = without_parabola(position[inside], error[inside])
    return SmootherStudy(result, position[inside], flat)


def band_rms(position: Array, error: Array) -> dict[str, float | None]:
    """Root mean square error in D1 and D2, mm; points closer to an end than the longest wavelength are excluded.

    The value is None where no point remains.
    """
    at = np.arange(position[0], position[-1], GRID)
    values = np.interp(at, position, error)
    rms: dict[str, float | None] = {}
    for band in BANDS[:2]:
        inside = (at > at[0] + band.longest) & (at < at[-1] - band.longest)
        rms[band.name] = None
        if np.any(inside):
            filtered = band_pass(values, GRID, band)[inside]
            rms[band.name] = 1e3 * float(np.sqrt(np.mean(filtered**2)))
    return rms


def without_parabola(position: Array, error: Array) -> Array:
    """The error without offset, slope and curvature, which sensors with unknown offset cannot determine, (n,), m."""
    x = (position - position.mean()) / np.ptp(position)
    return error - np.polynomial.Polynomial.fit(x, error, 2)(x)


def accuracy_bounds(
    case: Case, prior: Spectrum, instruments: Sequence[Instrument] = ()
) -> dict[str, float]:
    """Lower bound of the root mean square error in D1 and D2 for the stated noise of the sensors, mm."""
    sensors = tuple(one.sensor for one in instruments) or case.sensors
    bounds = accuracy_bound(case.vehicle, case.track, sensors, case.speed, prior, BANDS[:2])
    return {band: 1e3 * value for band, value in bounds.items()}


def error_growth(case: Case, scheme: Scheme, unknowns: int, power: float = 1.0) -> float:
    """Growth factor of an error in 10 m when each window is solved exactly and the state is carried over.

    It depends on the model only: a disturbance of 1 µm in the first windows, with the signals of level track. Its
    short waves (second differences) are compared, up to the end or to where the model diverges.

    Parameters
    ----------
    scheme : integration scheme
    unknowns : number of elevations per window
    power : exponent of the root mean squares in the weights of the sensors; 1 as in equation 12
    """
    signals = search_grid_signals(case)
    weight = sensor_weights(signals[1:]) ** power
    model = forward_model(
        case.vehicle, case.track, case.sensors, scheme, case.position, np.full(case.scans + 1, case.speed)
    )  # fmt: skip
    elevation, generator = np.zeros(len(model.position)), np.random.default_rng(0)
    first, kept = 0, unknowns // 2
    while first + unknowns <= case.scans:
        free = model.free_response(elevation, first, unknowns)
        gain = model.gain_matrix(elevation, first, unknowns)
        rows = np.sqrt(weight)[:, None, None] * gain
        target = -np.sqrt(weight)[:, None] * free.T
        x = np.linalg.lstsq(rows.reshape(-1, unknowns), target.ravel())[0]
        if first < 4 * kept:
            x = x + 1e-6 * generator.standard_normal(unknowns)
        elevation[model.before + first : model.before + first + kept] = x[:kept]
        if np.abs(x[:kept]).max() > 0.1:
            break
        model = model.advance(elevation, first, kept)
        first += kept
    second_differences = np.abs(np.diff(elevation[model.before : model.before + first], 2))
    tenth = max(first // 10, 1)
    early = second_differences[3 * tenth : 5 * tenth].max()
    late = second_differences[-2 * tenth :].max()
    distance = 5 * tenth * case.speed * case.step
    return float((late / early) ** (10.0 / distance))


def shortened(case: Case, length: float) -> Case:
    """The same case over its first ``length`` m."""
    return replace(case, length=length)

"""What each figure needs to be computed: searches, smoothers, limits, and how errors grow."""

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
"""m between the points at which profiles are compared."""


@dataclass(frozen=True)
class SearchStudy:
    """A case searched by cross-entropy: elevation minus truth (m) at ``place`` (m), and s per metre."""

    found: CrossEntropyResult
    place: Array
    error: Array
    rate: float


@dataclass(frozen=True)
class SmootherStudy:
    """The smoother's estimate, and elevation minus truth (m) at ``place`` (m), less a parabola."""

    found: Estimate
    place: Array
    error: Array


def run_search(
    case: Case, signals: Array, settings: SearchSettings, instruments: Sequence[Instrument] = (), seed: int = 0
) -> SearchStudy:  # fmt: skip
    """Search a case that was ridden, as exact signals or as instruments read them; the seed is of both."""
    recording = case_recording(case, signals, instruments, seed)
    began = time.perf_counter()
    found = cross_entropy(
        recording, case.vehicle, CrossEntropySettings(track=case.track, search=settings, seed=seed)
    )
    taken = time.perf_counter() - began
    place = found.profile["distance"].to_numpy()
    truth = case.irregularity.at(place)[0]
    error = found.profile["elevation"].to_numpy() - truth
    return SearchStudy(found, place, error, taken / (place[-1] - place[0]))


def fine_signals_with_lead(case: Case) -> Array:
    """Signals of the fine simulation for the smoother, with a lead."""
    return fine_signals(with_lead(case))


def run_smoother(
    case: Case, signals: Array, instruments: Sequence[Instrument] = (), seed: int = 0
) -> SmootherStudy:
    """The smoother on what the fine simulation gives (of `finely_led`) and the instruments make of it."""
    recording = case_recording(with_lead(case), signals, instruments, seed)
    settings = InferenceSettings(case.installation, case.track, samples=16)
    found = estimate(recording, case.vehicle, settings)
    place = found.profile["distance"].to_numpy()
    error = found.profile["elevation"].to_numpy() - case.irregularity.at(place)[0]
    inside = (place >= case.start) & (place <= case.position[-1])
    return SmootherStudy(found, place[inside], without_parabola(place[inside], error[inside]))


def band_rms(place: Array, error: Array) -> dict[str, float | None]:
    """Root mean square in D1 and D2, mm, where it lies a band's longest wave from both ends; None: nowhere."""
    at = np.arange(place[0], place[-1], GRID)
    values = np.interp(at, place, error)
    found: dict[str, float | None] = {}
    for band in BANDS[:2]:
        inside = (at > at[0] + band.longest) & (at < at[-1] - band.longest)
        found[band.name] = None
        if np.any(inside):
            passed = band_pass(values, GRID, band)[inside]
            found[band.name] = 1e3 * float(np.sqrt(np.mean(passed**2)))
    return found


def without_parabola(place: Array, error: Array) -> Array:
    """Less offset, slope and curvature, which no sensor with an unknown offset can tell."""
    x = (place - place.mean()) / np.ptp(place)
    return error - np.polynomial.Polynomial.fit(x, error, 2)(x)


def accuracy_bounds(
    case: Case, prior: Spectrum, instruments: Sequence[Instrument] = ()
) -> dict[str, float]:
    """The least possible error in D1 and D2, mm, with what noise the sensors state."""
    sensors = tuple(one.sensor for one in instruments) or case.sensors
    found = accuracy_bound(case.vehicle, case.track, sensors, case.speed, prior, BANDS[:2])
    return {band: 1e3 * value for band, value in found.items()}


def error_growth(case: Case, scheme: Scheme, unknowns: int, power: float = 1.0) -> float:
    """By what an error grows in 10 m, when each window is solved exactly and the state carried over.

    Of the model alone, no measurement: a disturbance of 1 µm in the first windows, and signals of level track. Its
    short waves (second differences) are compared; where the model diverges before the end, there.

    Parameters
    ----------
    power : of the sensors' root mean squares in the weights, 1 as in equation 12
    """
    signals = search_grid_signals(case)
    weight = sensor_weights(signals[1:]) ** power
    car = forward_model(
        case.vehicle, case.track, case.sensors, scheme, case.position, np.full(case.scans + 1, case.speed)
    )  # fmt: skip
    elevation, generator = np.zeros(len(car.position)), np.random.default_rng(0)
    first, kept = 0, unknowns // 2
    while first + unknowns <= case.scans:
        free = car.free_response(elevation, first, unknowns)
        gain = car.gain_matrix(elevation, first, unknowns)
        rows = np.sqrt(weight)[:, None, None] * gain
        due = -np.sqrt(weight)[:, None] * free.T
        x = np.linalg.lstsq(rows.reshape(-1, unknowns), due.ravel())[0]
        if first < 4 * kept:
            x = x + 1e-6 * generator.standard_normal(unknowns)
        elevation[car.before + first : car.before + first + kept] = x[:kept]
        if np.abs(x[:kept]).max() > 0.1:
            break
        car = car.advance(elevation, first, kept)
        first += kept
    bent = np.abs(np.diff(elevation[car.before : car.before + first], 2))
    tenth = max(first // 10, 1)
    early, late = bent[3 * tenth : 5 * tenth].max(), bent[-2 * tenth :].max()
    distance = 5 * tenth * case.speed * case.step
    return float((late / early) ** (10.0 / distance))


def shortened(case: Case, length: float) -> Case:
    """The same case over its first ``length`` m."""
    return replace(case, length=length)

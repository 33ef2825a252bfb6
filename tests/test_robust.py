"""A smoother that keeps its head: damage of every kind, beside the same recording undamaged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import xarray as xr

from trackprofile.bands import BANDS, band_pass
from trackprofile.contracts import Quality, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.inference.infer import Estimate, estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.preprocessing.faults import FaultKind

Array = np.ndarray

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
PRIOR = read_spectrum("german-low")
LENGTH = 700.0  # m
ENDS = 60.0  # m, within which the bands' filters know too little


@dataclass(frozen=True)
class Case:
    recording: xr.Dataset
    truth: xr.Dataset
    clean: Estimate


@pytest.fixture(scope="module")
def case() -> Case:
    recording, truth = simulated(VELARO, ZHAI, read_sensors("bogie-25ug"), PRIOR, LENGTH, 1)
    return Case(recording, truth, found_in(recording))


def found_in(recording: xr.Dataset) -> Estimate:
    return estimate(recording, VELARO, InferenceSettings(track=ZHAI, prior=PRIOR, samples=16))


def with_acceleration(recording: xr.Dataset, change: Callable[[Array], Array]) -> xr.Dataset:
    first, second = channels(recording)
    return build_recording(
        [replace(first, values=change(first.values.copy())), second],
        time=recording["time"].to_numpy(),
        speed=recording["speed"].to_numpy(),
    )


def errors(case: Case, found: Estimate) -> dict[str, Array]:
    """Error by band at each point, m."""
    at = found.profile["distance"].to_numpy()
    error = found.profile["elevation"].to_numpy() - np.interp(
        at, case.truth["distance"], case.truth["elevation"]
    )
    return {band.name: band_pass(error, 0.25, band) for band in BANDS}


def inside(found: Estimate) -> Array:
    at = found.profile["distance"].to_numpy()
    return (at > ENDS) & (at < LENGTH - ENDS)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def check_as_good_as_clean(case: Case, found: Estimate, most: dict[str, float]) -> None:
    """Root mean square errors, as multiples of those of the undamaged recording; intervals that hold."""
    part = inside(found)
    clean, damaged = errors(case, case.clean), errors(case, found)
    for band, factor in most.items():
        assert rms(damaged[band][part]) < factor * rms(clean[band][part]), band
        stated = found.profile[f"standard_deviation_{band}"].to_numpy()[part]
        assert np.mean(np.abs(damaged[band][part]) < 1.96 * stated) > 0.85, band


def kinds(found: Estimate) -> set[FaultKind]:
    return {fault.kind for fault in found.faults}


def test_good_recording_is_smoothed_once_and_nothing_is_found(case: Case) -> None:
    assert not case.clean.faults
    assert not np.any(case.clean.profile["quality"] & Quality.FAULTY)


def test_spikes_cost_next_to_nothing(case: Case) -> None:
    def spiked(values: Array) -> Array:
        generator = np.random.default_rng(2)
        at = generator.choice(len(values), len(values) // 100, replace=False)
        values[at] += 20.0 * generator.standard_normal(len(at))
        return values

    found = found_in(with_acceleration(case.recording, spiked))
    check_as_good_as_clean(case, found, {"D1": 1.1, "D2": 1.1, "D3": 1.1})
    assert kinds(found) <= {FaultKind.SPIKE, FaultKind.OUTLIER}
    true = np.flatnonzero(
        spiked(channels(case.recording)[0].values.copy()) != channels(case.recording)[0].values
    )
    told = np.concatenate([np.arange(one.first, one.last + 1) for one in found.faults])
    assert set(told) <= set(true)
    assert len(told) > 0.9 * len(true)


def test_bursts_are_weighted_down(case: Case) -> None:
    def burst(values: Array) -> Array:
        generator = np.random.default_rng(3)
        for start in generator.choice(len(values) - 20, 8):
            values[start : start + 8] += 20.0 * generator.standard_normal(8)
        return values

    found = found_in(with_acceleration(case.recording, burst))
    check_as_good_as_clean(case, found, {"D1": 1.15, "D2": 1.15})
    assert FaultKind.OUTLIER in kinds(found)


def test_offset_that_jumps_is_found_where_it_does(case: Case) -> None:
    middle = case.recording.sizes["sample"] // 2

    def jumped(values: Array) -> Array:
        values[middle:] += 0.3
        return values

    found = found_in(with_acceleration(case.recording, jumped))
    check_as_good_as_clean(case, found, {"D1": 1.1, "D2": 1.1})
    (jump,) = (one for one in found.faults if one.kind is FaultKind.JUMP)
    assert abs(jump.first - middle) < 8  # half a metre


def test_offset_that_drifts_is_followed(case: Case) -> None:
    def drifting(values: Array) -> Array:
        return values + 0.05 * np.sin(np.linspace(0, 2 * np.pi, len(values)))

    found = found_in(with_acceleration(case.recording, drifting))
    check_as_good_as_clean(case, found, {"D1": 2.5})
    part = inside(found)
    assert 1e3 * rms(errors(case, found)["D2"][part]) < 0.05  # without, 1.1 mm
    assert FaultKind.DRIFT in kinds(found)


def test_noise_that_grows_for_a_while_is_not_taken_for_track(case: Case) -> None:
    count = case.recording.sizes["sample"]
    loud = slice(count // 3, count // 2)

    def noisy(values: Array) -> Array:
        generator = np.random.default_rng(4)
        values[loud] += 0.1 * generator.standard_normal(loud.stop - loud.start)
        return values

    found = found_in(with_acceleration(case.recording, noisy))
    check_as_good_as_clean(case, found, {"D1": 10.0})
    told = [one for one in found.faults if one.kind is FaultKind.NOISY]
    covered = sum(one.last - one.first + 1 for one in told)
    assert covered > 0.8 * (loud.stop - loud.start)
    at = found.profile["distance"].to_numpy()
    quiet = inside(found) & (at > found.sample_distance[loud.stop] + 40.0)
    clean = errors(case, case.clean)["D1"][quiet]
    assert rms(errors(case, found)["D1"][quiet]) < 1.1 * rms(clean)


@pytest.mark.acceptance
def test_level_of_the_track_is_found_among_spikes_and_bursts(case: Case) -> None:
    def spoiled(values: Array) -> Array:
        generator = np.random.default_rng(5)
        where = generator.choice(len(values) - 6, len(values) // 100, replace=False)
        values[where] += 30 * rms(values) * generator.choice([-1, 1], len(where))
        values[2000:2006] += 20 * rms(values) * generator.standard_normal(6)
        return values

    def level(recording: xr.Dataset) -> float:
        return estimate(
            recording, VELARO, InferenceSettings(track=ZHAI, samples=2)
        ).model.spectrum.amplitude

    clean = level(case.recording)
    assert level(with_acceleration(case.recording, spoiled)) == pytest.approx(clean, rel=0.05)

"""Robust smoother: recordings with faults compared with the same recording without."""

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
ENDS = 60.0  # m at each end, excluded: the filters of the bands have transients there


@dataclass(frozen=True)
class Case:
    recording: xr.Dataset
    truth: xr.Dataset
    clean: Estimate


@pytest.fixture(scope="module")
def case() -> Case:
    recording, truth = simulated(VELARO, ZHAI, read_sensors("bogie-25ug"), PRIOR, LENGTH, 1)
    return Case(recording, truth, estimated(recording))


def estimated(recording: xr.Dataset) -> Estimate:
    return estimate(recording, VELARO, InferenceSettings(track=ZHAI, prior=PRIOR, samples=16))


def with_acceleration(recording: xr.Dataset, change: Callable[[Array], Array]) -> xr.Dataset:
    first, second = channels(recording)
    return build_recording(
        [replace(first, values=change(first.values.copy())), second],
        time=recording["time"].to_numpy(),
        speed=recording["speed"].to_numpy(),
    )


def errors(case: Case, result: Estimate) -> dict[str, Array]:
    """Error by band at each point, m."""
    at = result.profile["distance"].to_numpy()
    error = result.profile["elevation"].to_numpy() - np.interp(
        at, case.truth["distance"], case.truth["elevation"]
    )
    return {band.name: band_pass(error, 0.25, band) for band in BANDS}


def inside(result: Estimate) -> Array:
    at = result.profile["distance"].to_numpy()
    return (at > ENDS) & (at < LENGTH - ENDS)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def check_errors(case: Case, result: Estimate, bounds: dict[str, float]) -> None:
    """RMS errors are within bounds, relative to those without faults, and the stated intervals cover the errors."""
    used = inside(result)
    clean, damaged = errors(case, case.clean), errors(case, result)
    for band, factor in bounds.items():
        assert rms(damaged[band][used]) < factor * rms(clean[band][used]), band
        stated = result.profile[f"standard_deviation_{band}"].to_numpy()[used]
        assert np.mean(np.abs(damaged[band][used]) < 1.96 * stated) > 0.85, band


def kinds(result: Estimate) -> set[FaultKind]:
    return {fault.kind for fault in result.faults}


def test_recording_without_faults_has_none_detected(case: Case) -> None:
    assert not case.clean.faults
    assert not np.any(case.clean.profile["quality"] & Quality.FAULTY)


def test_spikes_hardly_increase_the_error_and_are_detected(case: Case) -> None:
    def spiked(values: Array) -> Array:
        generator = np.random.default_rng(2)
        at = generator.choice(len(values), len(values) // 100, replace=False)
        values[at] += 20.0 * generator.standard_normal(len(at))
        return values

    result = estimated(with_acceleration(case.recording, spiked))
    check_errors(case, result, {"D1": 1.1, "D2": 1.1, "D3": 1.1})
    assert kinds(result) <= {FaultKind.SPIKE, FaultKind.OUTLIER}
    true = np.flatnonzero(
        spiked(channels(case.recording)[0].values.copy()) != channels(case.recording)[0].values
    )
    detected = np.concatenate([np.arange(one.first, one.last + 1) for one in result.faults])
    assert set(detected) <= set(true)
    assert len(detected) > 0.9 * len(true)


def test_bursts_are_down_weighted(case: Case) -> None:
    def burst(values: Array) -> Array:
        generator = np.random.default_rng(3)
        for start in generator.choice(len(values) - 20, 8):
            values[start : start + 8] += 20.0 * generator.standard_normal(8)
        return values

    result = estimated(with_acceleration(case.recording, burst))
    check_errors(case, result, {"D1": 1.15, "D2": 1.15})
    assert FaultKind.OUTLIER in kinds(result)


def test_offset_jump_is_located(case: Case) -> None:
    middle = case.recording.sizes["sample"] // 2

    def jumped(values: Array) -> Array:
        values[middle:] += 0.3
        return values

    result = estimated(with_acceleration(case.recording, jumped))
    check_errors(case, result, {"D1": 1.1, "D2": 1.1})
    (jump,) = (one for one in result.faults if one.kind is FaultKind.JUMP)
    assert abs(jump.first - middle) < 8  # half a metre


def test_offset_drift_is_followed(case: Case) -> None:
    def drifting(values: Array) -> Array:
        return values + 0.05 * np.sin(np.linspace(0, 2 * np.pi, len(values)))

    result = estimated(with_acceleration(case.recording, drifting))
    check_errors(case, result, {"D1": 2.5})
    used = inside(result)
    assert 1e3 * rms(errors(case, result)["D2"][used]) < 0.05  # without, 1.1 mm
    assert FaultKind.DRIFT in kinds(result)


def test_noisy_stretch_is_detected_and_does_not_affect_the_rest(case: Case) -> None:
    count = case.recording.sizes["sample"]
    noisy_samples = slice(count // 3, count // 2)

    def noisy(values: Array) -> Array:
        generator = np.random.default_rng(4)
        values[noisy_samples] += 0.1 * generator.standard_normal(
            noisy_samples.stop - noisy_samples.start
        )
        return values

    result = estimated(with_acceleration(case.recording, noisy))
    check_errors(case, result, {"D1": 10.0})
    stretches = [one for one in result.faults if one.kind is FaultKind.NOISY]
    covered = sum(one.last - one.first + 1 for one in stretches)
    assert covered > 0.8 * (noisy_samples.stop - noisy_samples.start)
    at = result.profile["distance"].to_numpy()
    behind = inside(result) & (at > result.sample_distance[noisy_samples.stop] + 40.0)
    clean = errors(case, case.clean)["D1"][behind]
    assert rms(errors(case, result)["D1"][behind]) < 1.1 * rms(clean)


@pytest.mark.acceptance
def test_level_of_the_prior_is_estimated_despite_spikes_and_bursts(case: Case) -> None:
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

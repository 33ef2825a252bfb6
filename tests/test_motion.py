"""Motion of the train from time, distance and speed."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from trackprofile.arrays import recorded_step
from trackprofile.errors import DataError
from trackprofile.preprocessing.motion import (
    dead_reckoning_std,
    motion,
    smoothed_speed_over_distance,
    smoothed_speed_over_time,
)


def example_run(seconds: float = 120.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, distance and speed of a train that brakes and speeds up again."""
    time = np.arange(0.0, seconds, 0.02)
    speed = 15.0 + 4.0 * np.cos(2 * np.pi * time / 80.0)
    return time, np.concatenate([[0.0], np.cumsum(0.02 * 0.5 * (speed[1:] + speed[:-1]))]), speed


def dataset(**variables: np.ndarray) -> xr.Dataset:
    return xr.Dataset({name: ("sample", values) for name, values in variables.items()})


def test_smoothing_of_whole_km_h_halves_their_error() -> None:
    time, distance, speed = example_run()
    steps = np.round(3.6 * speed) / 3.6
    raw = np.std(steps - speed)
    assert np.std(smoothed_speed_over_time(steps, time) - speed) < raw / 2
    positions = np.arange(0.0, distance[-1], 0.25)
    true = np.interp(positions, distance, speed)
    coarse = np.round(3.6 * true) / 3.6
    assert np.std(smoothed_speed_over_distance(coarse, positions) - true) < raw / 2


QUANTISATION_STD = 1.0 / 3.6 / np.sqrt(12.0)
"""m/s, standard std of the quantisation error of whole km/h."""


@pytest.mark.parametrize(("noise", "within"), [(0.0, 0.3), (0.05, 0.25), (0.5, 0.3)])
def test_changes_of_whole_km_h_determine_the_speed(noise: float, within: float) -> None:
    time, _, speed = example_run(400.0)
    noisy = 3.6 * speed + noise * np.random.default_rng(4).standard_normal(len(speed))
    smoothed = smoothed_speed_over_time(np.round(noisy) / 3.6, time)
    assert np.std(smoothed - speed) < within * QUANTISATION_STD


@given(start=st.floats(1.0, 20.0), slope=st.floats(0.1, 1.0))
def test_speed_of_an_accelerating_train_is_recovered_from_whole_km_h(
    start: float, slope: float
) -> None:
    time = np.arange(0.0, 30.0, 0.01)
    speed = start + slope * time
    smoothed = smoothed_speed_over_time(np.round(3.6 * speed) / 3.6, time)
    error = (smoothed - speed)[500:-500]
    assert np.max(np.abs(error)) < 0.2 * QUANTISATION_STD
    assert np.max(np.abs(np.cumsum(error))) * 0.01 < 0.1


@pytest.mark.parametrize(("steps_per_unit", "remaining"), [(3.6, 0.4), (36.0, 0.07)])
def test_delay_of_a_speed_that_is_updated_every_second_is_removed(
    steps_per_unit: float, remaining: float
) -> None:
    time, _, speed = example_run(400.0)
    updated = speed[np.arange(len(time)) // 50 * 50]
    recorded = np.round(steps_per_unit * updated) / steps_per_unit
    smoothed = smoothed_speed_over_time(recorded, time)
    delayed = np.std(recorded - speed)
    assert np.std(smoothed - speed) < remaining * delayed


def driven_run(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Time and speed of a train whose driver keeps 108 km/h: the acceleration is a first-order Gauss-Markov process."""
    generator, step = np.random.default_rng(seed), 0.02
    time = np.arange(0.0, 300.0, step)
    walk = 0.015 * np.sqrt(step) * generator.standard_normal(len(time))
    acceleration = lfilter([1.0], [1.0, step / 5.0 - 1.0], walk)
    return time, 30.0 + step * np.cumsum(acceleration)


@pytest.mark.parametrize("update_samples", [1, 50])
def test_dead_reckoning_std_covers_the_error_of_a_distance_integrated_from_whole_km_h(
    update_samples: int,
) -> None:
    inside, errors, stated = [], [], []
    for seed in range(20):
        time, speed = driven_run(seed)
        steps = np.round(3.6 * speed[np.arange(len(time)) // update_samples * update_samples]) / 3.6
        error = 0.02 * np.cumsum(smoothed_speed_over_time(steps, time) - speed)
        std = dead_reckoning_std(steps, time)
        assert std is not None
        inside.append(np.abs(error[500:]) < 1.96 * std[500:])
        errors.append(error)
        stated.append(std)
    assert np.mean(inside) > 0.9
    assert np.sqrt(np.mean(np.square(stated))) < 3.0 * np.sqrt(np.mean(np.square(errors)))


def test_position_error_does_not_grow_at_standstill() -> None:
    time = np.arange(0.0, 100.0, 0.1)
    speed = np.round(3.6 * np.clip(np.abs(time - 50.0) - 20.0, 0.0, 10.0)) / 3.6
    std = dead_reckoning_std(speed, time)
    assert std is not None
    standing = np.abs(time - 50.0) < 19.0
    assert np.ptp(std[standing]) == 0.0
    assert std[-1] > std[500] > 0.0


def test_continuous_speed_has_no_dead_reckoning_std() -> None:
    time, _, speed = example_run()
    assert dead_reckoning_std(speed, time) is None


def test_continuous_speed_is_not_changed() -> None:
    time, distance, speed = example_run()
    result = motion(dataset(time=time, speed=speed))
    np.testing.assert_array_equal(result.speed, speed)
    np.testing.assert_allclose(result.distance, distance, rtol=1e-12)


def test_time_is_integrated_from_distance_and_speed() -> None:
    time, distance, speed = example_run()
    result = motion(dataset(distance=distance, speed=speed))
    np.testing.assert_allclose(result.time, time, atol=1e-3)


def test_speed_is_the_derivative_of_distance() -> None:
    time, distance, speed = example_run()
    result = motion(dataset(time=time, distance=distance))
    np.testing.assert_allclose(result.speed[5:-5], speed[5:-5], rtol=1e-3)


def test_train_at_standstill_does_not_move() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    speed = np.clip(np.abs(time - 30.0) - 10.0, 0.0, None)
    result = motion(dataset(time=time, speed=speed))
    standing = np.abs(time - 30.0) < 9.0
    assert np.ptp(result.distance[standing]) == 0.0
    assert np.all(np.diff(result.distance) >= 0)
    assert np.all(np.isfinite(result.acceleration))


@given(st.floats(-1e4, 1e4))
def test_motion_does_not_depend_on_the_origin_of_distance(shift: float) -> None:
    _, distance, speed = example_run(20.0)
    steps = np.round(speed, 1)
    original, shifted = (
        motion(dataset(distance=distance + by, speed=steps)) for by in (0.0, shift)
    )
    np.testing.assert_allclose(shifted.time, original.time, atol=1e-6)
    np.testing.assert_allclose(shifted.speed, original.speed, atol=1e-6)


def test_recorded_step_is_that_of_quantised_values_and_0_for_continuous_ones() -> None:
    generator = np.random.default_rng(0)
    assert recorded_step(np.round(generator.normal(size=500), 1)) == pytest.approx(0.1)
    assert recorded_step(generator.normal(size=500)) == 0.0


def test_distance_without_time_and_speed_is_refused() -> None:
    with pytest.raises(DataError, match="add a second one"):
        motion(dataset(distance=np.arange(5.0)))

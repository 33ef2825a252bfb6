"""The train's motion from what was recorded."""

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
    speed_over_distance,
    speed_over_time,
)


def run(seconds: float = 120.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, distance and speed of a train that brakes and speeds up again."""
    time = np.arange(0.0, seconds, 0.02)
    speed = 15.0 + 4.0 * np.cos(2 * np.pi * time / 80.0)
    return time, np.concatenate([[0.0], np.cumsum(0.02 * 0.5 * (speed[1:] + speed[:-1]))]), speed


def dataset(**variables: np.ndarray) -> xr.Dataset:
    return xr.Dataset({name: ("sample", values) for name, values in variables.items()})


def test_whole_km_h_are_smoothed_towards_the_true_speed() -> None:
    time, distance, speed = run()
    steps = np.round(3.6 * speed) / 3.6
    raw = np.std(steps - speed)
    assert np.std(speed_over_time(steps, time) - speed) < raw / 2
    places = np.arange(0.0, distance[-1], 0.25)
    true = np.interp(places, distance, speed)
    coarse = np.round(3.6 * true) / 3.6
    assert np.std(speed_over_distance(coarse, places) - true) < raw / 2


OF_ROUNDING = 1.0 / 3.6 / np.sqrt(12.0)
"""m/s, standard deviation of what whole km/h leave open."""


@pytest.mark.parametrize(("noise", "within"), [(0.0, 0.3), (0.05, 0.25), (0.5, 0.3)])
def test_whole_km_h_tell_the_speed_by_where_they_change(noise: float, within: float) -> None:
    time, _, speed = run(400.0)
    said = 3.6 * speed + noise * np.random.default_rng(4).standard_normal(len(speed))
    found = speed_over_time(np.round(said) / 3.6, time)
    assert np.std(found - speed) < within * OF_ROUNDING


@given(start=st.floats(1.0, 20.0), slope=st.floats(0.1, 1.0))
def test_whole_km_h_of_a_train_that_speeds_up_leave_nothing_open(
    start: float, slope: float
) -> None:
    time = np.arange(0.0, 30.0, 0.01)
    speed = start + slope * time
    found = speed_over_time(np.round(3.6 * speed) / 3.6, time)
    off = (found - speed)[500:-500]
    assert np.max(np.abs(off)) < 0.2 * OF_ROUNDING
    assert np.max(np.abs(np.cumsum(off))) * 0.01 < 0.1


@pytest.mark.parametrize(("rounded", "left"), [(3.6, 0.4), (36.0, 0.07)])
def test_a_speed_that_is_renewed_every_second_is_late_no_more(rounded: float, left: float) -> None:
    time, _, speed = run(400.0)
    renewed = speed[np.arange(len(time)) // 50 * 50]
    steps = np.round(rounded * renewed) / rounded
    found = speed_over_time(steps, time)
    late = np.std(steps - speed)
    assert np.std(found - speed) < left * late


def wandering(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Time and speed of a train that keeps to 108 km/h as a driver does: its acceleration wanders and is forgotten."""
    generator, step = np.random.default_rng(seed), 0.02
    time = np.arange(0.0, 300.0, step)
    walk = 0.015 * np.sqrt(step) * generator.standard_normal(len(time))
    acceleration = lfilter([1.0], [1.0, step / 5.0 - 1.0], walk)
    return time, 30.0 + step * np.cumsum(acceleration)


@pytest.mark.parametrize("renewed", [1, 50])
def test_how_far_a_distance_counted_from_whole_km_h_is_off_is_said(renewed: int) -> None:
    inside, errors, said = [], [], []
    for seed in range(20):
        time, speed = wandering(seed)
        steps = np.round(3.6 * speed[np.arange(len(time)) // renewed * renewed]) / 3.6
        error = 0.02 * np.cumsum(speed_over_time(steps, time) - speed)
        deviation = dead_reckoning_std(steps, time)
        assert deviation is not None
        inside.append(np.abs(error[500:]) < 1.96 * deviation[500:])
        errors.append(error)
        said.append(deviation)
    assert np.mean(inside) > 0.9
    assert np.sqrt(np.mean(np.square(said))) < 3.0 * np.sqrt(np.mean(np.square(errors)))


def test_while_a_train_stands_its_place_does_not_become_less_known() -> None:
    time = np.arange(0.0, 100.0, 0.1)
    speed = np.round(3.6 * np.clip(np.abs(time - 50.0) - 20.0, 0.0, 10.0)) / 3.6
    deviation = dead_reckoning_std(speed, time)
    assert deviation is not None
    standing = np.abs(time - 50.0) < 19.0
    assert np.ptp(deviation[standing]) == 0.0
    assert deviation[-1] > deviation[500] > 0.0


def test_of_a_continuous_speed_nothing_is_said() -> None:
    time, _, speed = run()
    assert dead_reckoning_std(speed, time) is None


def test_continuous_speed_is_left_as_it_is() -> None:
    time, distance, speed = run()
    found = motion(dataset(time=time, speed=speed))
    np.testing.assert_array_equal(found.speed, speed)
    np.testing.assert_allclose(found.distance, distance, rtol=1e-12)


def test_distance_and_speed_give_the_time_that_passed() -> None:
    time, distance, speed = run()
    found = motion(dataset(distance=distance, speed=speed))
    np.testing.assert_allclose(found.time, time, atol=1e-3)


def test_time_and_distance_give_the_speed() -> None:
    time, distance, speed = run()
    found = motion(dataset(time=time, distance=distance))
    np.testing.assert_allclose(found.speed[5:-5], speed[5:-5], rtol=1e-3)


def test_train_that_stops_stays_where_it_is() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    speed = np.clip(np.abs(time - 30.0) - 10.0, 0.0, None)
    found = motion(dataset(time=time, speed=speed))
    standing = np.abs(time - 30.0) < 9.0
    assert np.ptp(found.distance[standing]) == 0.0
    assert np.all(np.diff(found.distance) >= 0)
    assert np.all(np.isfinite(found.acceleration))


@given(st.floats(-1e4, 1e4))
def test_motion_does_not_depend_on_where_distance_counts_from(shift: float) -> None:
    _, distance, speed = run(20.0)
    steps = np.round(speed, 1)
    here, there = (motion(dataset(distance=distance + by, speed=steps)) for by in (0.0, shift))
    np.testing.assert_allclose(there.time, here.time, atol=1e-6)
    np.testing.assert_allclose(there.speed, here.speed, atol=1e-6)


def test_recorded_step_is_found_and_continuous_values_have_none() -> None:
    generator = np.random.default_rng(0)
    assert recorded_step(np.round(generator.normal(size=500), 1)) == pytest.approx(0.1)
    assert recorded_step(generator.normal(size=500)) == 0.0


def test_distance_alone_is_refused() -> None:
    with pytest.raises(DataError, match="add a second one"):
        motion(dataset(distance=np.arange(5.0)))

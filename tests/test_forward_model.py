"""Affine map of a window, compared with the direct simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.methods.cross_entropy.forward_model import (
    ForwardModel,
    backward_derivatives,
    forward_model,
)
from trackprofile.models.integrate import newmark, wilson
from trackprofile.models.irregularity import Bell
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import SpeedSchedule

Array = NDArray[np.float64]

BELL = Bell(depth=2e-3, width=0.5, centre=6.0)


def rough_profile(place: Array) -> Array:
    """A random profile of some millimetres that starts at 0."""
    waves = np.random.default_rng(3).normal(0.0, 5e-4, (2, 40))
    angle = np.multiply.outer(place, np.linspace(0.5, 12.0, 40))
    return np.sin(angle) @ waves[0] + (np.cos(angle) - 1.0) @ waves[1]


def quarter_car(steps: int, speed: float = 30.0) -> ForwardModel:
    vehicle, _ = read_vehicle("quarter-car")
    position = np.linspace(0.0, 0.025 * steps, steps + 1)
    sensors = (Sensor("bogie", VERTICAL_ACCELERATION, "bogie"),)
    scheme = wilson(0.025 / speed)
    return forward_model(
        vehicle, read_track("rigid"), sensors, scheme, position, np.full(steps + 1, speed)
    )


def whole_car(steps: int, acceleration: float = 0.0) -> ForwardModel:
    vehicle, _ = read_vehicle("velaro")
    time = 2e-3 * np.arange(steps + 1)
    sensors = (
        Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie"),
        Sensor("pitch", PITCH_RATE, "leading bogie"),
    )
    speed = np.asarray(150 / 3.6 + acceleration * time, np.float64)
    position = np.asarray(150 / 3.6 * time + 0.5 * acceleration * time**2, np.float64)
    return forward_model(
        vehicle, read_track("zhai-layered"), sensors, wilson(2e-3), position, speed
    )


@pytest.mark.parametrize(
    "car", [quarter_car(300), whole_car(150), whole_car(150, acceleration=-1.0)],
    ids=["quarter car", "whole car", "braking"],
)  # fmt: skip
@pytest.mark.parametrize("first", [0, 85])
def test_the_affine_map_equals_the_simulation(car: ForwardModel, first: int) -> None:
    r = rough_profile(car.position)
    r[: car.before] = 0.0
    signals = car.signals(r, 0, first + 10)[first:]
    advanced = car.advance(r, 0, first) if first else car
    x = r[car.before + first : car.before + first + 10]
    mapped = advanced.free_response(r, first, 10) + (advanced.gain_matrix(r, first, 10) @ x).T
    assert np.all(np.abs(mapped - signals).max(axis=0) < 1e-10 * np.abs(signals).max(axis=0))


def test_no_scan_depends_on_elevations_ahead() -> None:
    gain = whole_car(40).gain_matrix(np.zeros(1000), 0, 10)
    assert np.all(np.triu(gain, k=1) == 0.0)
    assert np.all(np.abs(np.diagonal(gain, axis1=1, axis2=2)) > 0.0)


def test_signals_depend_on_elevations_behind_and_not_on_those_ahead() -> None:
    car = whole_car(60)
    r = np.random.default_rng(0).normal(0.0, 1e-3, len(car.position))
    ahead = r.copy()
    ahead[car.before + 20 :] = 0.0
    np.testing.assert_array_equal(car.signals(r, 0, 20), car.signals(ahead, 0, 20))
    assert np.any(car.signals(r, 0, 30) != car.signals(ahead, 0, 30))


def test_evaluating_a_model_does_not_change_it() -> None:
    car = whole_car(60)
    r = BELL.at(car.position)[0]
    first = car.signals(r, 0, 40)
    car.gain_matrix(r, 0, 10)
    car.advance(r, 0, 10)
    np.testing.assert_array_equal(car.signals(r, 0, 40), first)


def test_forward_model_agrees_with_the_simulation_of_a_smooth_profile() -> None:
    vehicle, _ = read_vehicle("quarter-car")
    sensor = Sensor("bogie", VERTICAL_ACCELERATION, "bogie")
    run = RunSettings(0.0, 12.0, SpeedSchedule((0.0,), (30.0,)), run_in=1.0)
    fine = simulate(vehicle, read_track("rigid"), BELL, run, newmark(1e-5))
    expected = np.interp(
        0.025 * np.arange(1, 401), fine.position, sensor_signal(fine, vehicle, sensor)
    )
    car = quarter_car(400)
    signal = car.signals(BELL.at(car.position)[0], 0, 400)[:, 0]
    # Second order: with 20 scans per wavelength of 0.5 m the relative error is (2π/20)²/3 = 3 %.
    assert np.linalg.norm(signal - expected) < 0.05 * np.linalg.norm(expected)


def test_backward_derivatives_are_exact_for_their_order() -> None:
    place = np.cumsum(np.random.default_rng(1).uniform(0.05, 0.1, 30))
    r, slope, _ = backward_derivatives(place, 3 * place**2 - place)
    np.testing.assert_allclose(slope[2:], 6 * place[2:] - 1, rtol=1e-10)
    r, _, curvature = backward_derivatives(place, place**3)
    np.testing.assert_allclose(curvature[3:], 6 * place[3:], rtol=1e-8)
    np.testing.assert_array_equal(r, place**3)

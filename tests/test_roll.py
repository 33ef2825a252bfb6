"""The rolling car against a car of which every spring and rail stands by itself, and against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from narrowing import not_none
from trackprofile.bands import D1
from trackprofile.contracts import Rail
from trackprofile.errors import ModelError
from trackprofile.inference.accuracy_bound import accuracy_bound_per_rail
from trackprofile.io.model_toml import presets, read_spectrum, read_vehicle, write_vehicle
from trackprofile.models.modal import roll_modes
from trackprofile.models.roll import (
    missing_roll_parameters,
    noise_correlation,
    rail_modes,
    roll_track,
    roll_vehicle,
    roll_wheelsets,
    sensor_pairs,
)
from trackprofile.models.sensor import Installation, Sensor
from trackprofile.models.statespace import state_space, transfer_function
from trackprofile.models.track import ElasticTrack, RigidTrack
from trackprofile.models.vehicle import ROLL_FIELDS, Vehicle, parameter_values, with_parameters
from two_rails import WAGON, response

OMEGA = 2 * np.pi / np.array([200.0, 70.0, 25.0, 11.0, 5.5, 3.1])
TRACKS = (RigidTrack(), ElasticTrack(87.8e6, 36e3, mass=374.0))
SPEED = 40.0


def accelerometer(name: str, body: str, lateral: float, position: float = 0.0) -> Sensor:
    return Sensor(
        name, "vertical acceleration", body, position, lateral=lateral, noise_density=1e-3
    )


def on_board(vehicle: Vehicle) -> list[Sensor]:
    """Accelerometers left and right of each part, as far from the middle as they please, and gyroscopes."""
    found = []
    for body in (*vehicle.bodies, *vehicle.wheels):
        found.append(accelerometer(f"left of {body.name}", body.name, 0.9, 0.7))
        found.append(accelerometer(f"right of {body.name}", body.name, -1.3, 0.7))
        found.append(Sensor(f"roll of {body.name}", "roll rate", body.name, noise_density=1e-4))
    pitch = Sensor("pitch", "pitch rate", vehicle.bodies[0].name, noise_density=1e-4)
    return [*found, pitch]


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize("name", ["velaro", "manchester-benchmark", "wagon"])
def test_mean_and_difference_are_those_of_a_car_on_two_rails(name: str, track) -> None:
    car = WAGON if name == "wagon" else read_vehicle(name)[0]
    sensors = on_board(car)
    mean, difference = rail_modes(sensors, sensor_pairs(sensors), car.contact_spacing)
    apart = response(car, track, sensors, OMEGA, SPEED)
    both, across = apart @ np.array([1.0, 1.0]), apart @ np.array([0.5, -0.5])
    heave = transfer_function(state_space(car, track, mean.sensors), OMEGA, SPEED)
    roll = transfer_function(
        state_space(roll_vehicle(car), roll_track(track), difference.sensors), OMEGA, SPEED
    )
    np.testing.assert_allclose(both @ mean.weights, heave, rtol=1e-8)
    np.testing.assert_allclose(across @ difference.weights, roll, rtol=1e-8)
    scale = np.abs(apart).max(axis=(0, 2))
    assert np.all(np.abs(across @ mean.weights) < 1e-9 * scale.max())
    assert np.all(np.abs(both @ difference.weights) < 1e-9 * scale.max())


def test_what_either_side_reads_comes_back_from_mean_and_difference() -> None:
    sensors = on_board(WAGON)
    mean, difference = rail_modes(sensors, sensor_pairs(sensors), WAGON.contact_spacing)
    apart = response(WAGON, RigidTrack(), sensors, OMEGA, SPEED)[:, :, 0]
    again = apart @ mean.weights @ mean.shares + apart @ difference.weights @ difference.shares
    np.testing.assert_allclose(again, apart, rtol=1e-9)


def test_on_a_rigid_path_wheels_need_nothing_of_the_car_above() -> None:
    boxes = [accelerometer("left", "wheel 2", 0.9), accelerometer("right", "wheel 2", -0.9)]
    _, difference = rail_modes(boxes, sensor_pairs(boxes), WAGON.contact_spacing)
    found = [
        transfer_function(state_space(car, RigidTrack(), difference.sensors), OMEGA, SPEED)
        for car in (roll_vehicle(WAGON), roll_wheelsets(WAGON))
    ]
    np.testing.assert_allclose(*found, rtol=1e-12)
    # Analytic: a_L - a_R = (y_L - y_R)/w c̈, under the second wheel.
    exact = -((OMEGA * SPEED) ** 2) * 1.8 / 1.5 * np.exp(-6j * OMEGA)
    np.testing.assert_allclose(found[1][:, 0], exact, rtol=1e-12)


def test_limit_of_axle_boxes_is_that_of_white_noise_integrated_twice() -> None:
    # Analytic: S_post = 1 / (1/S_prior + (Ωv)⁴ g²/S_noise), with g = 1 for the mean and 2y/w for the difference.
    boxes = [accelerometer("left", "wheel 1", 0.9), accelerometer("right", "wheel 1", -0.9)]
    prior = read_spectrum("german-low")
    found = accuracy_bound_per_rail(WAGON, RigidTrack(), boxes, SPEED, prior, [D1])

    def least(gain: float, density: float) -> float:
        def posterior(omega: float) -> float:
            told = (omega * SPEED) ** 4 * gain**2 / (density**2 * SPEED / (2 * np.pi))
            return float(1 / (1 / prior.density(np.array([omega]))[0] + told))

        return np.sqrt(quad(posterior, 2 * np.pi / 25.0, 2 * np.pi / 3.0, epsrel=1e-9)[0])

    mean, difference = least(1.0, 1e-3 / np.sqrt(2)), least(1.8 / 1.5, 1e-3 * np.sqrt(2))
    assert found[Rail.MEAN]["D1"] == pytest.approx(mean, rel=1e-4)
    assert found[Rail.DIFFERENCE]["D1"] == pytest.approx(difference, rel=1e-4)
    assert found[Rail.LEFT]["D1"] == pytest.approx(np.hypot(mean, difference / 2), rel=1e-4)


def test_a_parameter_acts_on_the_rolling_car_as_on_the_car() -> None:
    car, _ = read_vehicle("manchester-benchmark")
    there = parameter_values(roll_vehicle(car))
    for name in there:
        more = with_parameters(car, {name: 1.1 * parameter_values(car)[name]})
        moved = with_parameters(roll_vehicle(car), {name: 1.1 * there[name]})
        for one, other in zip(
            (*roll_vehicle(more).bodies, *roll_vehicle(more).wheels, *roll_vehicle(more).links),
            (*moved.bodies, *moved.wheels, *moved.links),
            strict=True,
        ):
            for field in ("mass", "stiffness", "damping"):
                if hasattr(one, field):
                    assert getattr(one, field) == pytest.approx(getattr(other, field), rel=1e-12)
    assert not {"body mass", "body pitch inertia"} & there.keys()


def test_links_of_different_semi_spacing_may_not_share_a_parameter() -> None:
    car, _ = read_vehicle("velaro")
    links = (replace(car.links[0], semi_spacing=0.9), *car.links[1:])
    with pytest.raises(ModelError, match="different semi-spacings share a parameter"):
        roll_vehicle(replace(car, links=links))


def test_what_is_missing_for_roll_is_named() -> None:
    quarter, _ = read_vehicle("quarter-car")
    with pytest.raises(ModelError, match=r"does not state roll_inertia of 'body', .*semi_spacing"):
        roll_vehicle(quarter)
    assert roll_modes(quarter) == ()
    assert "roll_inertia of 'wheel'" in missing_roll_parameters(quarter, TRACKS[1])
    assert "roll_inertia of 'wheel'" not in missing_roll_parameters(quarter, TRACKS[0])


@pytest.mark.parametrize("name", [one for one in presets("vehicle") if one != "quarter-car"])
def test_built_in_cars_roll_as_cars_do(name: str) -> None:
    slowest, *others = roll_modes(read_vehicle(name)[0])
    assert slowest.motions[0] == ("body", "roll")
    assert 0.4 < slowest.frequency < 1.6
    assert all(4.0 < one.frequency < 20.0 for one in others)


@pytest.mark.parametrize("name", [one for one in presets("vehicle") if one != "quarter-car"])
def test_what_a_built_in_car_states_of_roll_is_not_verified(name: str) -> None:
    car, _ = read_vehicle(name)
    of_roll = [one for one in car.parameters if {field for _, field in one.used_by} <= ROLL_FIELDS]
    assert len(of_roll) >= 5
    assert all("not verified" in one.source for one in of_roll)


def test_a_vehicle_with_roll_is_written_and_read_back(tmp_path) -> None:
    car = replace(read_vehicle("manchester-benchmark")[0], contact_spacing=1.13)
    write_vehicle(car, Installation(), tmp_path / "car.toml")
    assert read_vehicle(tmp_path / "car.toml")[0] == car


def test_roll_is_refused_where_nothing_rolls() -> None:
    gyroscope = Sensor("gyroscope", "roll rate", "body", noise_density=1e-4)
    with pytest.raises(
        ModelError, match="measures roll, which a model of heave and pitch does not contain"
    ):
        state_space(WAGON, RigidTrack(), [gyroscope])


@pytest.mark.parametrize(
    "change",
    [
        {"body": "wheel 2"},
        {"lateral": 0.9},
        {"position": 0.3},
        {"bandwidth": 30.0},
        {"quantity": "pitch rate"},
    ],
)
def test_sensors_of_other_places_or_kinds_are_no_pair(change: dict) -> None:
    left = accelerometer("left", "wheel 1", 0.9)
    right = replace(accelerometer("right", "wheel 1", -0.9), **change)
    assert sensor_pairs([left, right]) == ()


@settings(deadline=None)
@given(st.floats(0.1, 1.5), st.floats(0.1, 1.5), st.floats(1e-5, 1e-1), st.floats(1e-5, 1e-1))
def test_noise_of_mean_and_difference_is_that_of_weighted_sums(
    y_left: float, y_right: float, n_left: float, n_right: float
) -> None:
    left = replace(accelerometer("left", "wheel 1", y_left), noise_density=n_left)
    right = replace(accelerometer("right", "wheel 1", -y_right), noise_density=n_right)
    (pair,) = sensor_pairs([left, right])
    mean, difference = rail_modes([left, right], [pair], 1.5)
    weights = np.hstack([mean.weights, difference.weights])
    covariance = weights.T @ np.diag([n_left**2, n_right**2]) @ weights
    expected = np.sqrt(np.diag(covariance))
    found = [not_none(one.sensors[0].noise_density) for one in (mean, difference)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    correlation = covariance[0, 1] / np.prod(expected)
    assert noise_correlation(left, right, pair) == pytest.approx(correlation, abs=1e-12)

"""Which end of a vehicle leads."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import xarray as xr

from trackprofile.bands import D1, band_pass
from trackprofile.contracts import Channel, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.errors import DataError
from trackprofile.inference.infer import estimate
from trackprofile.inference.observations import Observations, observations
from trackprofile.inference.orientation import orient
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_spectrum, read_track, read_vehicle
from trackprofile.methods.cross_entropy.estimator import cross_entropy
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.models.vehicle import Vehicle, reversed_vehicle
from trackprofile.preprocessing.faults import FaultKind
from trackprofile.units import STANDARD_GRAVITY

ZHAI, ROUGH = point_track(read_track("zhai")), read_spectrum("german-low")
VELARO = read_vehicle("velaro")[0]
FRONT, REAR = "leading bogie", "trailing bogie"
LOPSIDED = replace(
    VELARO,
    bodies=tuple(
        replace(one, mass=1.3 * one.mass) if one.name == REAR else one for one in VELARO.bodies
    ),
)
ACCELERATION = Sensor("acceleration", VERTICAL_ACCELERATION, FRONT, 0.4, noise_density=2.5e-4)
PITCH = Sensor("pitch", PITCH_RATE, FRONT, noise_density=2e-5)
BEHIND = Sensor("behind", VERTICAL_ACCELERATION, REAR, noise_density=2.5e-4)


@lru_cache
def forwards(vehicle: Vehicle, sensors: tuple[Sensor, ...]) -> tuple[xr.Dataset, xr.Dataset]:
    return simulated(vehicle, ZHAI, sensors, ROUGH, 500.0, 1)


def backwards(vehicle: Vehicle, sensors: tuple[Sensor, ...]) -> tuple[xr.Dataset, xr.Dataset]:
    """A ride with the vehicle's last wheel leading, recorded by sensors as they are described on it; and the truth."""
    turned = tuple(replace(one, position=-one.position) for one in sensors)
    recording, truth = forwards(reversed_vehicle(vehicle), turned)
    parts = [
        replace(one, values=-one.values if one.quantity == PITCH_RATE else one.values, position=sensor.position)
        for one, sensor in zip(channels(recording), sensors, strict=True)
    ]  # fmt: skip
    return with_channels(recording, parts), truth


def with_channels(recording: xr.Dataset, parts: list[Channel], end: str = "") -> xr.Dataset:
    time, speed = recording["time"].to_numpy(), recording["speed"].to_numpy()
    distance = recording["distance"].to_numpy() if "distance" in recording else None
    return build_recording(parts, time=time, speed=speed, distance=distance, leading_end=end)


def faced(recording: xr.Dataset, vehicle: Vehicle) -> tuple[Observations, Vehicle]:
    installation = Installation()
    sides, car = orient(
        observations(recording, installation), recording, vehicle, ZHAI, installation
    )
    return sides.mean, car


@pytest.mark.parametrize("vehicle", [VELARO, LOPSIDED], ids=["symmetric", "lopsided"])
def test_vehicle_that_runs_the_other_way_round_is_told_by_three_sensors(vehicle: Vehicle) -> None:
    recording, _ = backwards(vehicle, (ACCELERATION, PITCH, BEHIND))
    found, car = faced(recording, vehicle)
    assert found.turned
    assert car == reversed_vehicle(vehicle)
    assert [fault.kind for fault in found.faults] == [FaultKind.REVERSED]
    assert "its last wheel leads" in found.notes[0]
    assert "is turned" not in found.notes[0]


def test_vehicle_that_runs_as_described_is_left_as_it_is() -> None:
    recording, _ = forwards(LOPSIDED, (ACCELERATION, PITCH, BEHIND))
    found, car = faced(recording, LOPSIDED)
    assert not found.turned
    assert car is LOPSIDED
    assert not found.notes


def test_end_that_is_stated_is_believed_and_says_nothing() -> None:
    recording, _ = backwards(VELARO, (ACCELERATION, PITCH, BEHIND))
    found, car = faced(with_channels(recording, list(channels(recording)), "last"), VELARO)
    assert found.turned
    assert car == reversed_vehicle(VELARO)
    assert not found.faults


def test_end_that_is_stated_wrongly_is_put_right() -> None:
    recording, _ = forwards(VELARO, (ACCELERATION, PITCH, BEHIND))
    found, car = faced(with_channels(recording, list(channels(recording)), "last"), VELARO)
    assert not found.turned
    assert car is VELARO
    np.testing.assert_array_equal(found.signals, observations(recording, Installation()).signals)
    assert [one.position for one in found.sensors] == [0.4, 0.0, 0.0]


@pytest.mark.parametrize("ahead", [0.0, 0.4])
def test_two_sensors_of_which_gravity_tells_one_tell_the_end(ahead: float) -> None:
    recording, _ = backwards(VELARO, (replace(ACCELERATION, position=ahead), PITCH))
    first, second = channels(recording)
    heavy = replace(first, values=first.values + STANDARD_GRAVITY)
    found, _ = faced(with_channels(recording, [heavy, second]), VELARO)
    assert found.turned
    # At the bogie's centre the other end feels the same; ahead of it, it does not.
    assert ("or the sign of 'pitch' is wrong" in found.notes[-1]) == (ahead == 0.0)


def test_two_sensors_alone_do_not_tell_the_end() -> None:
    recording, _ = backwards(VELARO, (replace(ACCELERATION, position=0.0), PITCH))
    with pytest.raises(DataError, match="or the last wheel leads"):
        faced(recording, VELARO)


@pytest.mark.acceptance
def test_profile_of_a_ride_backwards_is_as_good_as_forwards() -> None:
    sensors = (ACCELERATION, PITCH, BEHIND)
    rides = (backwards(LOPSIDED, sensors), forwards(LOPSIDED, sensors))
    errors = []
    for recording, truth in rides:
        found = estimate(recording, LOPSIDED, InferenceSettings(track=ZHAI, prior=ROUGH, samples=8))
        at = found.profile["distance"].to_numpy()
        level = np.interp(at, truth["distance"], truth["elevation"])
        error = band_pass(found.profile["elevation"].to_numpy() - level, 0.25, D1)
        errors.append(np.std(error[(at > at[0] + 60) & (at < at[-1] - 60)]))
    assert errors[0] == pytest.approx(errors[1], rel=0.2)


def test_methods_that_know_the_vehicle_as_described_only_refuse_another_end() -> None:
    recording, _ = backwards(VELARO, (ACCELERATION,))
    stated = with_channels(recording, list(channels(recording)), "last")
    with pytest.raises(DataError, match="does not support; expected the first"):
        cross_entropy(stated, VELARO)


def test_end_has_two_names() -> None:
    recording, _ = backwards(VELARO, (ACCELERATION,))
    with pytest.raises(DataError, match="leading_end: expected one of first, last, got 'front'"):
        with_channels(recording, list(channels(recording)), "front")

"""Channels that were exchanged or turned round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
import xarray as xr

from trackprofile.contracts import Channel, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.errors import DataError
from trackprofile.inference.channel_assignment import assign_channels
from trackprofile.inference.observations import Observations, observations
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.models.vehicle import parameter_values, with_parameters
from trackprofile.preprocessing.faults import FaultKind

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
THREE = tuple(
    Sensor(body, VERTICAL_ACCELERATION, body, noise_density=1e-3)
    for body in ("leading bogie", "trailing bogie", "body")
)


def recorded(sensors: Sequence[Sensor]) -> xr.Dataset:
    return simulated(VELARO, ZHAI, tuple(sensors), read_spectrum("german-low"), 600.0, 1)[0]


def as_wired(recording: xr.Dataset, parts: Sequence[Channel]) -> Observations:
    made = build_recording(
        parts, time=recording["time"].to_numpy(), speed=recording["speed"].to_numpy()
    )
    return assign_channels(observations(made, Installation()), VELARO, ZHAI)


def test_good_recording_is_left_as_it_is_even_with_a_vehicle_that_is_30_percent_off() -> None:
    data = observations(recorded(THREE), Installation())
    values = zip(parameter_values(VELARO).items(), cycle([1.3, 0.7]), strict=False)
    off = with_parameters(VELARO, {name: factor * value for (name, value), factor in values})
    for car in (VELARO, off):
        assert assign_channels(data, car, ZHAI) is data


@pytest.mark.parametrize("exchanged", [(0, 1), (0, 2), (1, 2)])
def test_exchanged_channels_are_put_right_and_said(exchanged: tuple[int, int]) -> None:
    recording = recorded(THREE)
    parts = list(channels(recording))
    i, j = exchanged
    parts[i], parts[j] = (
        replace(parts[i], values=parts[j].values),
        replace(parts[j], values=parts[i].values),
    )
    found = as_wired(recording, parts)
    true = observations(recording, Installation())
    np.testing.assert_array_equal(found.signals, true.signals)
    assert {one.kind for one in found.faults} == {FaultKind.EXCHANGED}
    assert "are exchanged" in found.notes[0]


@pytest.mark.parametrize("turned", [0, 1, 2])
def test_turned_sign_of_one_of_three_is_put_right_and_said(turned: int) -> None:
    recording = recorded(THREE)
    parts = list(channels(recording))
    parts[turned] = replace(parts[turned], values=-parts[turned].values)
    found = as_wired(recording, parts)
    np.testing.assert_array_equal(found.signals, observations(recording, Installation()).signals)
    assert [one.channel for one in found.faults] == [parts[turned].name]


def test_two_signs_that_contradict_each_other_are_refused() -> None:
    recording = recorded(read_sensors("bogie-100ug"))
    first, second = channels(recording)
    with pytest.raises(DataError, match="one of them is wrong"):
        as_wired(recording, [first, replace(second, values=-second.values)])


def test_accelerometer_and_gyro_that_are_exchanged_are_put_right() -> None:
    recording = recorded(read_sensors("bogie-100ug"))
    first, second = channels(recording)
    parts = [replace(first, values=second.values), replace(second, values=first.values)]
    found = as_wired(recording, parts)
    np.testing.assert_array_equal(found.signals, observations(recording, Installation()).signals)


def test_one_channel_alone_tells_nothing() -> None:
    recording = recorded(THREE[:1])
    data = observations(recording, Installation())
    assert assign_channels(data, VELARO, ZHAI) is data

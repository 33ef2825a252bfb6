"""What of an inferred profile is not to be trusted, and says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from trackprofile.contracts import Quality, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.inference.infer import estimate
from trackprofile.inference.quality import reached
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.preprocessing.fault_detectors import saturated
from trackprofile.preprocessing.motion import motion

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
SENSORS, SPECTRUM = read_sensors("bogie-100ug"), read_spectrum("fra-5")


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    return simulated(VELARO, ZHAI, SENSORS, SPECTRUM, 400.0, 4)[0]


def with_acceleration(recording: xr.Dataset, change) -> xr.Dataset:
    first, second = channels(recording)
    at = motion(recording).distance
    return build_recording(
        [replace(first, values=change(at, first.values)), second],
        time=recording["time"].to_numpy(),
        speed=recording["speed"].to_numpy(),
    )


def flagged(recording: xr.Dataset, flag: Quality) -> np.ndarray:
    profile = estimate(
        recording, VELARO, InferenceSettings(track=ZHAI, prior=SPECTRUM, samples=2)
    ).profile
    return profile["distance"].to_numpy()[profile["quality"].to_numpy() & flag != 0]


def test_good_recording_is_explained_everywhere(recording: xr.Dataset) -> None:
    assert flagged(recording, Quality.UNEXPLAINED).size == 0
    assert flagged(recording, Quality.SATURATED).size == 0


def test_blow_that_no_track_gives_is_flagged_where_its_bogie_stood(recording: xr.Dataset) -> None:
    struck = with_acceleration(
        recording, lambda at, values: values + np.where(np.abs(at - 250.0) < 0.3, 40.0, 0.0)
    )
    places = flagged(struck, Quality.UNEXPLAINED)
    assert places.size
    # The wheels of the leading bogie stand at 250 m and 2.5 m behind.
    assert places.min() > 250.0 - 2.5 - 5.0
    # It throws the filter off for a while, and what it took for track there is wrong.
    assert places.max() < 250.0 + 40.0


def test_sensor_at_the_end_of_its_range_is_left_out_and_flagged(recording: xr.Dataset) -> None:
    end = 0.7 * float(np.abs(channels(recording)[0].values).max())
    clipped = with_acceleration(recording, lambda at, values: np.clip(values, -end, end))
    values = channels(clipped)[0].values
    beyond = saturated(values)
    assert 3 <= beyond.sum() <= np.sum(np.abs(values) == end)
    at = motion(clipped).distance[beyond]
    places = flagged(clipped, Quality.SATURATED)
    assert all(np.abs(places - one).min() < 0.5 for one in at if one < 395.0)


def test_coarse_steps_are_no_end_of_a_range() -> None:
    slow = np.round(3.0 * np.sin(np.arange(4000) / 150.0)) / 3.0
    assert not saturated(slow).any()


def test_a_sensor_feels_the_wheels_under_what_it_stands_on() -> None:
    place = np.arange(0.0, 60.0, 0.25)
    sample = np.array([40.0])
    leading = place[reached(place, sample, VELARO, "leading bogie")]
    body = place[reached(place, sample, VELARO, "body")]
    near = [40.0 - wheel.position for wheel in VELARO.wheels]
    assert leading.min() == pytest.approx(near[1] - 1.0, abs=0.25)
    assert leading.max() == pytest.approx(41.0, abs=0.25)
    assert body.min() == pytest.approx(near[3] - 1.0, abs=0.25)
    np.testing.assert_array_equal(body, place[reached(place, sample, VELARO, None)])
    assert not reached(place, np.empty(0), VELARO, None).any()

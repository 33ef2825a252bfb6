from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import xarray as xr

from trackprofile.contracts import (
    Channel,
    Quality,
    append_provenance,
    build_profile,
    build_recording,
    channels,
    select_stretch,
    validate,
    validate_profile,
    validate_recording,
    with_rate,
)
from trackprofile.errors import DataError, RowError

RAMP = np.arange(5.0)
STEADY = np.full(5, 20.0)


def floor(**changed: Any) -> Channel:
    described = {
        "name": "floor",
        "values": 0.1 * RAMP,
        "quantity": "vertical acceleration",
        "body": "body",
        "position": 6.9,
    }
    return Channel(**(described | changed))


def with_one(values: np.ndarray, row: int, value: float) -> np.ndarray:
    changed = values.astype(float)
    changed[row - 1] = value
    return changed


def test_a_recording_returns_the_channels_it_was_built_from() -> None:
    valid = RAMP != 2.0
    gyro = floor(name="gyro", quantity="pitch rate", position=-1.0, noise_density=1e-4, valid=valid)
    recording = build_recording([floor(), gyro], time=RAMP, distance=20 * RAMP, speed=STEADY)
    first, second = channels(recording)
    assert (first.name, first.noise_density, first.position) == ("floor", None, 6.9)
    assert first.valid is not None
    assert first.valid.all()
    assert (second.quantity, second.body, second.noise_density) == ("pitch rate", "body", 1e-4)
    np.testing.assert_array_equal(second.valid, valid)
    np.testing.assert_array_equal(second.values, gyro.values)


def test_every_variable_states_its_si_unit() -> None:
    gyro = floor(name="gyro", quantity="pitch rate")
    recording = build_recording([floor(), gyro], time=RAMP, distance=RAMP, speed=STEADY)
    units = {name: recording[name].attrs["units"] for name in ("time", "distance", "speed")}
    assert units == {"time": "s", "distance": "m", "speed": "m/s"}
    assert recording["floor"].attrs["units"] == "m/s2"
    assert recording["gyro"].attrs["units"] == "rad/s"


@pytest.mark.parametrize("known", [("time", "speed"), ("distance", "speed"), ("time", "distance")])
def test_two_of_time_distance_and_speed_are_required(known: tuple[str, str]) -> None:
    moved: dict[str, Any] = {"time": RAMP, "distance": 20 * RAMP, "speed": STEADY}
    recording = build_recording([floor()], **{name: moved[name] for name in known})
    assert {name for name in moved if name in recording} == set(known)
    for alone in known:
        with pytest.raises(DataError, match=r"two of time|needs a time or a distance"):
            build_recording([floor()], **{alone: moved[alone]})


def test_speed_may_be_zero_in_a_recording_with_time() -> None:
    stop = np.array([5.0, 0.0, 0.0, 0.0, 5.0])
    metres = np.array([0.0, 5.0, 5.0, 5.0, 10.0])
    recording = build_recording([floor()], time=RAMP, distance=metres, speed=stop)
    assert validate_recording(recording) is recording
    with pytest.raises(RowError, match=r"speed, data row 2: .*how long it stood"):
        build_recording([floor()], distance=RAMP, speed=stop)


def test_speed_below_the_recorded_step_may_be_zero() -> None:
    creep = np.array([3.0, 2.0, 0.0, 1.0, 2.0]) / 3.6
    recording = build_recording([floor()], distance=0.25 * np.arange(5), speed=creep)
    assert recording["speed"].to_numpy()[2] == 0.0


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"time": with_one(RAMP, 3, np.nan)}, "time, data row 3"),
        ({"time": with_one(RAMP, 4, 1.5)}, "time, data row 4"),
        ({"time": with_one(RAMP, 4, 2.0)}, "time, data row 4"),
        ({"speed": with_one(STEADY, 2, -1.0)}, "speed, data row 2"),
        ({"speed": with_one(STEADY, 5, np.inf)}, "speed, data row 5"),
        ({"distance": with_one(RAMP, 2, -0.1)}, "distance, data row 2"),
        ({"distance": with_one(RAMP, 1, np.nan)}, "distance, data row 1"),
    ],
)
def test_an_impossible_row_is_named(changed: dict[str, np.ndarray], place: str) -> None:
    moved: dict[str, Any] = {"time": RAMP, "distance": RAMP, "speed": STEADY} | changed
    with pytest.raises(RowError) as caught:
        build_recording([floor()], **moved)
    assert str(caught.value).startswith(f"{place}: ")


def test_distance_must_increase_in_a_recording_without_time() -> None:
    twice = with_one(RAMP, 3, 1.0)
    build_recording([floor()], time=RAMP, distance=twice)
    with pytest.raises(RowError, match=r"distance, data row 3: .* 1 m follows 1 m"):
        build_recording([floor()], distance=twice, speed=STEADY)


@pytest.mark.parametrize(
    "moved",
    [{"time": RAMP, "speed": 0 * RAMP}, {"time": RAMP, "distance": 0 * RAMP}],
    ids=["speed", "distance"],
)
def test_a_recording_without_motion_is_refused(moved: dict[str, Any]) -> None:
    with pytest.raises(DataError, match="did not move"):
        build_recording([floor()], **moved)


def test_a_missing_value_is_accepted_only_if_marked_invalid() -> None:
    holed = with_one(RAMP, 3, np.nan)
    with pytest.raises(RowError, match=r"floor, data row 3: .*mark such samples invalid"):
        build_recording([floor(values=holed)], time=RAMP, speed=STEADY)
    marked = floor(values=holed, valid=np.isfinite(holed))
    (kept,) = channels(build_recording([marked], time=RAMP, speed=STEADY))
    np.testing.assert_array_equal(kept.values, holed)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"valid": np.zeros(5, bool)}, "no sample is marked valid"),
        ({"values": RAMP[:4]}, "array of 5 values"),
        ({"quantity": "lateral acceleration"}, "vertical acceleration, pitch rate"),
        ({"body": ""}, "expected the name of its body"),
        ({"position": np.nan}, "its position on it"),
        ({"noise_density": 0.0}, "above zero, got 0"),
        ({"flicker": -1.0}, "flicker above zero, got -1"),
        ({"name": "a/b"}, "without '/'"),
        ({"name": "speed"}, "expected a unique name"),
        ({"name": "good_valid"}, "does not end in '_valid'"),
    ],
)
def test_an_incompletely_described_channel_is_refused(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message) as caught:
        build_recording([floor(**changed)], time=RAMP, speed=STEADY)
    assert changed.get("name", "floor") in str(caught.value)


def test_a_recording_needs_unique_channels_and_two_samples() -> None:
    with pytest.raises(DataError, match="at least one sensor channel"):
        build_recording([], time=RAMP, speed=STEADY)
    with pytest.raises(DataError, match="a unique name"):
        build_recording([floor(), floor()], time=RAMP, speed=STEADY)
    with pytest.raises(DataError, match="at least 2 samples, got 1"):
        build_recording([floor(values=RAMP[:1])], time=RAMP[:1], speed=STEADY[:1])


def test_a_profile_has_standard_deviations_and_flags() -> None:
    flags = np.array([Quality.EDGE, 0, Quality.SLOW | Quality.UNCERTAIN, 0, Quality.EDGE])
    profile = build_profile(
        RAMP,
        1e-3 * RAMP,
        kind="posterior",
        standard_deviation=np.full(5, 1e-4),
        band_standard_deviations={"D1": np.full(5, 1e-5)},
        quality=flags,
    )
    assert profile["standard_deviation_D1"].attrs["units"] == "m"
    assert profile["quality"].dtype == np.int16
    np.testing.assert_array_equal(profile["quality"], flags)
    assert profile["quality"].attrs["flag_meanings"] == (
        "gap uncertain edge slow unconverged saturated unexplained faulty"
    )
    np.testing.assert_array_equal(profile["quality"].attrs["flag_masks"], 2 ** np.arange(8))


def test_an_elevation_may_be_missing_only_in_a_gap() -> None:
    holed = with_one(RAMP, 4, np.nan)
    gap = np.where(np.isnan(holed), int(Quality.GAP), 0)
    profile = build_profile(RAMP, holed, kind="point", quality=gap)
    assert validate_profile(profile) is profile
    with pytest.raises(RowError, match=r"elevation, data row 4: .*gap"):
        build_profile(RAMP, holed, kind="point")
    with pytest.raises(RowError, match=r"elevation, data row 4: .*gap"):
        build_profile(RAMP, with_one(RAMP, 4, np.inf), kind="point", quality=gap)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"distance": with_one(RAMP, 2, 0.0)}, "distance, data row 2"),
        ({"distance": with_one(RAMP, 2, np.nan)}, "distance, data row 2"),
        ({"standard_deviation": with_one(RAMP, 3, -1e-9)}, "standard_deviation, data row 3"),
        ({"standard_deviation": with_one(RAMP, 3, np.nan)}, "standard_deviation, data row 3"),
        ({"kind": "guess"}, "kind: expected one of posterior, point, truth"),
        ({"kind": "posterior"}, "needs the variable standard_deviation"),
        ({"loading": "full"}, "loading: expected one of unloaded, loaded"),
        ({"elevation": RAMP[:3]}, "array of 5 values"),
    ],
)
def test_an_inconsistent_profile_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        build_profile(**({"distance": RAMP, "elevation": RAMP, "kind": "point"} | changed))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate_deviation_D1": [0.0, -1e-6]}, "rate_deviation_D1, data row 2: expected a finite"),
        ({"rate": [np.nan, 0.0]}, "rate, data row 1: expected a finite number"),
        ({"rate_deviation": None}, "expected both rate and rate_deviation"),
        ({"rate": None}, "expected both rate and rate_deviation"),
    ],
)
def test_an_inconsistent_rate_is_refused(changed: dict[str, Any], message: str) -> None:
    level = build_profile([0.0, 0.25], [1e-3, 2e-3], kind="point")
    line = with_rate(level, [0.0, -1e-5], [1e-6, 1e-6], {"D1": [1e-6, 1e-6]})
    for name, values in changed.items():
        line = line.drop_vars(name)
        if values is not None:
            line[name] = ("distance", values, {"units": "m/day"})
    with pytest.raises(DataError, match=message):
        validate(line)


def test_a_dataset_of_the_other_contract_is_refused() -> None:
    profile = build_profile(RAMP, RAMP, kind="truth")
    with pytest.raises(DataError, match=r"expected 'recording', got 'profile'"):
        validate_recording(profile)
    with pytest.raises(DataError, match="got None"):
        validate_profile(xr.Dataset())


@pytest.mark.parametrize("wrong", [{"units": "mm"}, {}])
def test_a_variable_in_another_unit_is_refused(wrong: dict[str, str]) -> None:
    profile = build_profile(RAMP, RAMP, kind="truth")
    profile["elevation"].attrs = wrong
    with pytest.raises(DataError, match="elevation: expected one value per distance in m"):
        validate_profile(profile)
    recording = build_recording([floor()], time=RAMP, speed=STEADY)
    for name in ("time", "speed", "floor"):
        changed = recording.copy()
        changed[name].attrs = {**recording[name].attrs, "units": wrong.get("units")}
        with pytest.raises(DataError, match=f"{name}: expected one value per sample in"):
            validate_recording(changed)


def test_provenance_is_appended_without_changing_the_original() -> None:
    profile = build_profile(RAMP, RAMP, kind="truth", provenance=["levelled"])
    after = append_provenance(profile, "cut at 50 Ω")
    assert json.loads(after.attrs["provenance"]) == ["levelled", "cut at 50 Ω"]
    assert json.loads(profile.attrs["provenance"]) == ["levelled"]


def test_a_stretch_keeps_its_distance_and_is_recorded_in_the_provenance() -> None:
    profile = select_stretch(build_profile(RAMP, RAMP**2, kind="truth"), 1.0, 3.0)
    np.testing.assert_array_equal(profile["elevation"], [1.0, 4.0, 9.0])
    assert json.loads(profile.attrs["provenance"]) == ["between 1 m and 3 m"]


def test_a_stretch_of_a_recording_without_distance_uses_the_integrated_speed() -> None:
    speeding_up = 2.0 * RAMP  # distance t² m
    recording = build_recording([floor()], time=RAMP, speed=speeding_up)
    piece = select_stretch(recording, 3.5, None)
    np.testing.assert_array_equal(piece["distance"], [4.0, 9.0, 16.0])
    np.testing.assert_array_equal(piece["time"], [2.0, 3.0, 4.0])
    assert select_stretch(recording, None, None) is recording


def test_a_stretch_outside_the_data_is_refused_with_the_extent_of_the_data() -> None:
    profile = build_profile(RAMP, RAMP, kind="truth")
    with pytest.raises(DataError, match="extends from 0 m to 4 m, choose a stretch inside"):
        select_stretch(profile, 10.0, None)

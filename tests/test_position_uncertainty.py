"""Recordings that say where the train was by anything but a distance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.assessment.tables import defect_table
from trackprofile.contracts import Channel, build_profile, build_recording
from trackprofile.contracts.validation import provenance_steps
from trackprofile.demo import simulated
from trackprofile.errors import DataError, FileError, RowError
from trackprofile.inference.infer import estimate
from trackprofile.inference.position_uncertainty import (
    correct_wheel_scale,
    position_standard_deviation,
)
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io import write
from trackprofile.io.inspection import write_toml
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.io.table import write_columns
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.preprocessing.faults import FaultKind, find_faults
from trackprofile.reader import inspect, read
from train_rides import DIAMETER, PULSE, PULSES, World, ride, sources

Array = np.ndarray

RIDE = ride(1, 120.0, stop=1e9)
GIVEN = sources(RIDE, "gdosp", World(scatter=1.0, wander=0.0, outlying=0.0, tunnel=(0.0, 0.0)))
SENSOR = '[[sensor]]\ncolumn = "acc"\nunit = "m/s²"\nquantity = "vertical acceleration"\nbody = "body"\nposition = 0\n'
TIME = 'time = { column = "t", unit = "s" }\n'
GNSS = '[recording.gnss]\nlatitude = { column = "lat", unit = "°" }\nlongitude = { column = "lon", unit = "°" }\n'
DIAMETERS = f"per_revolution = {PULSES}\nwheel_diameter = {DIAMETER}\n"
ODOMETER = f'[recording.odometer]\ncolumn = "count"\nunit = "pulses"\n{DIAMETERS}'
POSTS = '[recording.posts]\ncolumn = "km"\nunit = "km"\n'


def columns() -> dict[str, Array]:
    fixes, rolled, shown, posts = GIVEN.fixes, GIVEN.rolled, GIVEN.shown, GIVEN.posts
    assert fixes is not None
    assert rolled is not None
    assert shown is not None
    assert posts is not None
    passed = np.full(len(RIDE.time), np.nan)
    passed[np.searchsorted(RIDE.time, posts.time)] = posts.kilometre
    acceleration = 0.1 * np.random.default_rng(1).standard_normal(len(RIDE.time))
    counted = np.round(rolled.distance / PULSE)
    return {
        "t": RIDE.time,
        "acc": acceleration,
        "lat": fixes.latitude,
        "lon": fixes.longitude,
        "doppler": 3.6 * np.asarray(fixes.speed),
        "count": counted,
        "pulses": np.diff(counted, prepend=counted[0]),
        "v": 3.6 * shown.speed,
        "km": passed,
        "rolled": rolled.distance / 1e3,
    }


def recorded(folder: Path, keys: str, **changes: Array) -> xr.Dataset:
    write_columns(folder / "run.csv", columns() | changes)
    (folder / "run.toml").write_text(
        f'[recording]\ndata = "run.csv"\n{keys}\n{SENSOR}', encoding="utf-8"
    )
    return read(folder / "run.toml")


def off(found: xr.Dataset, begin: float) -> Array:
    return found["distance"].to_numpy() - (RIDE.distance - RIDE.distance[0] + begin)


@pytest.mark.parametrize(
    ("keys", "begin", "most"),
    [
        (TIME + GNSS, 0.0, 3.0),
        (TIME + GNSS + 'speed = { column = "doppler", unit = "km/h" }\n', 0.0, 3.0),
        (TIME + GNSS + ODOMETER, 0.0, 2.0),
        (TIME + ODOMETER, 0.0, 50.0),
        (TIME + POSTS + ODOMETER, 1000.0, 8.0),
        (TIME + 'speed = { column = "v", unit = "km/h" }\n' + POSTS, 1000.0, 10.0),
        (TIME + 'distance = { column = "rolled", unit = "km" }\n' + GNSS, 0.0, 2.0),
    ],
    ids=["positions", "with speed", "with pulses", "pulses", "posts", "posts and speed", "metres"],
)  # fmt: skip
def test_recording_without_a_distance_has_one_and_says_how_well(
    tmp_path: Path, keys: str, begin: float, most: float
) -> None:
    found = recorded(tmp_path, keys)
    assert np.max(np.abs(off(found, begin))) < most
    assert np.mean(np.abs(off(found, begin)) < 2.5 * found["distance_deviation"]) > 0.9
    assert any(step.startswith("placed: places come from") for step in provenance_steps(found))


def test_pulses_of_each_row_and_of_all_say_the_same(tmp_path: Path) -> None:
    whole = recorded(tmp_path, TIME + ODOMETER)
    each = recorded(
        tmp_path, TIME + ODOMETER.replace('"count"', '"pulses"') + "incremental = true\n"
    )
    np.testing.assert_allclose(each["distance"], whole["distance"], atol=1e-6)


def test_posts_may_be_held_until_the_next_or_stand_in_a_table_of_their_own(tmp_path: Path) -> None:
    marked = recorded(tmp_path, TIME + POSTS + ODOMETER)
    passed = columns()["km"]
    last = np.maximum.accumulate(np.where(np.isfinite(passed), np.arange(len(passed)), 0))
    first = int(np.argmax(np.isfinite(passed)))
    held = np.where(np.arange(len(passed)) < first, passed[first] - 1.0, passed[last])
    np.testing.assert_allclose(
        recorded(tmp_path, TIME + POSTS + ODOMETER, km=held)["distance"], marked["distance"]
    )
    at = np.isfinite(passed)
    write_columns(tmp_path / "posts.csv", {"s": RIDE.time[at][::-1], "m": 1e3 * passed[at][::-1]})
    listed = '[recording.posts]\ndata = "posts.csv"\ncolumn = "m"\nunit = "m"\ntime = { column = "s", unit = "s" }\n'
    np.testing.assert_allclose(
        recorded(tmp_path, TIME + listed + ODOMETER)["distance"], marked["distance"]
    )


def test_units_are_those_that_are_stated(tmp_path: Path) -> None:
    here = recorded(tmp_path, TIME + GNSS + ODOMETER)
    radians = GNSS.replace("°", "rad")
    values = columns()
    there = recorded(
        tmp_path,
        TIME.replace('"s"', '"ms"') + radians + ODOMETER,
        t=1e3 * values["t"],
        lat=np.radians(values["lat"]),
        lon=np.radians(values["lon"]),
    )
    np.testing.assert_allclose(there["distance"], here["distance"], atol=0.01)


def test_positions_may_have_a_clock_and_flags_of_their_own(tmp_path: Path) -> None:
    good = (RIDE.time < 60.0) | (RIDE.time > 70.0)
    lat = columns()["lat"] + np.where(good, 0.0, 0.3)
    keys = GNSS + 'valid = "good"\ntime = { column = "t2", unit = "s" }\n'
    found = recorded(tmp_path, TIME + keys + ODOMETER, lat=lat, good=good, t2=RIDE.time.copy())
    assert "clocks were brought to one" in found.attrs["provenance"]
    assert np.max(np.abs(off(found, 0.0))) < 2.0


def test_way_gives_the_distance_its_beginning_and_its_direction(tmp_path: Path) -> None:
    line = RIDE.line
    table = {
        "distance_m": line.distance,
        "latitude_deg": line.latitude,
        "longitude_deg": line.longitude,
    }
    kilometre = np.full(len(line.distance), np.nan)
    kilometre[[0, -1]] = [30.0, 30.0 - line.distance[-1] / 1e3]
    write_columns(tmp_path / "way.csv", table | {"kilometre": kilometre})
    found = recorded(
        tmp_path,
        TIME + 'chainage = "way.csv"\ndirection = "with the kilometrage"\n' + GNSS + ODOMETER,
    )
    assert np.max(np.abs(off(found, RIDE.distance[0]))) < 2.0
    assert found.attrs["direction"] == "against the kilometrage"
    assert "not with the kilometrage as stated" in found.attrs["provenance"]


@pytest.mark.parametrize("name", ["again.nc", "again.toml"])
def test_what_is_known_of_places_is_written_and_read(tmp_path: Path, name: str) -> None:
    found = recorded(tmp_path, TIME + 'leading_end = "last"\n' + GNSS + ODOMETER)
    write(found, tmp_path / name)
    again = read(tmp_path / name)
    for variable in ("time", "distance", "speed", "distance_deviation"):
        np.testing.assert_allclose(again[variable], found[variable], rtol=1e-12)
    assert again.attrs["wheel_scale"] == pytest.approx(found.attrs["wheel_scale"])
    assert again.attrs["leading_end"] == "last"


@pytest.mark.parametrize("name", ["profile.nc", "profile.csv", "profile.parquet"])
def test_profile_keeps_how_well_its_places_are_known(tmp_path: Path, name: str) -> None:
    known = [0.5, 0.75, 1.0]
    profile = build_profile(
        [0.0, 0.25, 0.5], [1e-3, 2e-3, 0.0], kind="point", distance_deviation=known
    )
    write(profile, tmp_path / name)
    np.testing.assert_array_equal(read(tmp_path / name)["distance_deviation"], known)


def test_deviation_that_is_none_is_refused() -> None:
    with pytest.raises(RowError, match="distance_deviation, data row 2: expected a finite number"):
        build_profile([0.0, 0.25], [0.0, 0.0], kind="point", distance_deviation=[1.0, -1.0])
    floor = Channel("floor", np.zeros(3), "vertical acceleration", "body", 0.0)
    with pytest.raises(RowError, match="distance_deviation, data row 3: expected a finite number"):
        build_recording(
            [floor], time=[0, 1, 2], distance=[0, 1, 2], distance_deviation=[0, 1, np.nan]
        )
    with pytest.raises(DataError, match="wheel_scale is a number above zero, this one says -1"):
        build_recording([floor], time=[0, 1, 2], distance=[0, 1, 2], wheel_scale=-1.0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (TIME + ODOMETER.replace(f"wheel_diameter = {DIAMETER}\n", ""), "pulses need the keys 'per_revolution'"),
        (TIME + 'distance = { column = "rolled", unit = "km" }\n' + ODOMETER, "describe the same wheel; remove one"),
        (GNSS, "Positions cannot be assigned to samples without a time"),
        (TIME + GNSS.replace("°", "m"), "Unit 'm' is not one of angle"),
        (TIME + GNSS.replace('"lat"', '"v"'), "gnss.latitude: expected -90 to 90°, got"),
        (TIME + POSTS + 'data = "posts.csv"\n', "needs the key 'time', the column with the times at which"),
        (TIME + GNSS + 'height = 3\n', "unknown key 'height' in recording.gnss"),
        (TIME + 'chainage = "nowhere.csv"\n' + GNSS, "expected a table of the way"),
        (TIME + 'leading_end = "front"\n' + GNSS, "leading_end"),
    ],
)  # fmt: skip
def test_places_that_cannot_be_are_refused(tmp_path: Path, keys: str, message: str) -> None:
    with pytest.raises((DataError, FileError), match=message):
        recorded(tmp_path, keys)


def test_doubted_positions_and_slips_are_faults_of_the_recording(tmp_path: Path) -> None:
    values = columns()
    lat = values["lat"].copy()
    rows = np.flatnonzero(np.isfinite(lat))
    lat[rows[30]] += 200.0 / 111e3
    slip = np.round(4.0 / PULSE * np.clip((RIDE.time - 60.0) / 1.5, 0.0, 1.0))
    found = recorded(tmp_path, TIME + GNSS + ODOMETER, lat=lat, count=values["count"] + slip)
    kinds = {fault.kind for fault in find_faults(found)}
    assert kinds >= {FaultKind.SLIP}
    assert np.max(np.abs(off(found, 0.0))) < 2.5


def test_inspect_tells_positions_pulses_and_posts_and_writes_what_reads_them(
    tmp_path: Path,
) -> None:
    values = columns()
    names = {
        "t": "Zeit [s]",
        "acc": "Beschl z [m/s²]",
        "lat": "GPS_Lat",
        "lon": "GPS_Lon",
        "doppler": "GPS Speed [km/h]",
        "count": "Wegimpulse",
        "km": "km-Stein",
    }
    write_columns(tmp_path / "logger.csv", {names[key]: values[key] for key in names})
    found = inspect(tmp_path / "logger.csv")
    assert found.recording is not None, found.notes
    assert "distance_deviation" in found.recording
    path = write_toml(found, tmp_path / "logger.toml")
    for line in (
        'longitude = { column = "GPS_Lon", unit = "°" }',
        'column = "Wegimpulse"',
        'column = "km-Stein"',
        "incremental = false",
    ):
        assert line in path.read_text(encoding="utf-8")
    assert "distance" in read(path)


def test_profile_says_how_well_its_places_are_known(tmp_path: Path) -> None:
    vehicle, track = read_vehicle("velaro")[0], point_track(read_track("zhai"))
    recording, _ = simulated(
        vehicle, track, read_sensors("bogie-25ug"), read_spectrum("german-low"), 120.0, 1
    )
    count = recording.sizes["sample"]
    known = np.linspace(1.0, 9.0, count)
    located = recording.assign(distance_deviation=("sample", known, {"units": "m"}))
    found = estimate(
        located,
        vehicle,
        InferenceSettings(track=track, prior=read_spectrum("german-low"), samples=4),
    )
    assert any(
        note == "positions are known to ±10 m (95 %), at most ±18 m" for note in found.notes
    ), found.notes
    deviation = found.profile["distance_deviation"].to_numpy()
    at = found.profile["distance"].to_numpy()
    inside = (at >= found.sample_distance[0]) & (at <= found.sample_distance[-1])
    np.testing.assert_allclose(
        deviation[inside], np.interp(at[inside], found.sample_distance, known)
    )
    plain = estimate(
        recording,
        vehicle,
        InferenceSettings(track=track, prior=read_spectrum("german-low"), samples=4),
    )
    assert "distance_deviation" not in plain.profile
    np.testing.assert_array_equal(plain.profile["elevation"], found.profile["elevation"])


@pytest.mark.parametrize(
    ("calibrated", "wheel", "kept"),
    [(0.9903, 0.99, False), (1.0003, 0.99, True), (0.99, None, True), (1.0, 0.99, True)],
)
def test_distance_scale_of_the_wheel_is_applied_once(
    calibrated: float, wheel: float | None, kept: bool
) -> None:
    floor = Channel("floor", np.zeros(3), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=[0, 1, 2], distance=[0, 1, 2], wheel_scale=wheel)
    found, notes = correct_wheel_scale(Installation(distance_scale=calibrated), recording)
    assert (found.distance_scale == calibrated) == kept
    assert bool(notes) != kept
    assert position_standard_deviation(np.zeros(1), np.arange(3.0), recording) == (None, ())


def test_defect_says_how_well_its_place_is_known() -> None:
    distance = np.arange(0.0, 400.0, 0.25)
    dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    known: Mapping[str, Array] = {"distance_deviation": 0.01 * distance}
    limits = read_limits("en-13848")
    found = assess(build_profile(distance, dip, kind="truth", **known), limits, 40.0)
    defect = max(found.defects, key=lambda one: abs(one.height))
    assert defect.location_deviation == pytest.approx(2.0, abs=0.05)
    assert defect_table([defect], found, ChainageTable())["location_deviation_m"] == [
        defect.location_deviation
    ]
    plain = assess(build_profile(distance, dip, kind="truth"), limits, 40.0)
    assert plain.defects[0].location_deviation is None

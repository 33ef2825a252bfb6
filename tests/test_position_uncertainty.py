"""Recordings with position sources instead of a distance, and the uncertainty of positions in results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

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
from train_runs import DIAMETER, PULSE, PULSES, SensorErrors, sources, train_run

Array = np.ndarray

RUN = train_run(1, 120.0, stop=1e9)
SOURCES = sources(
    RUN, "gdosp", SensorErrors(fix_std=1.0, bias_std=0.0, outlier_share=0.0, tunnel=(0.0, 0.0))
)
SENSOR = '[[sensor]]\ncolumn = "acc"\nunit = "m/s²"\nquantity = "vertical acceleration"\nbody = "body"\nposition = 0\n'
TIME = 'time = { column = "t", unit = "s" }\n'
GNSS = '[recording.gnss]\nlatitude = { column = "lat", unit = "°" }\nlongitude = { column = "lon", unit = "°" }\n'
DIAMETERS = f"per_revolution = {PULSES}\nwheel_diameter = {DIAMETER}\n"
ODOMETER = f'[recording.odometer]\ncolumn = "count"\nunit = "pulses"\n{DIAMETERS}'
POSTS = '[recording.posts]\ncolumn = "km"\nunit = "km"\n'


def columns() -> dict[str, Array]:
    fixes, odometry = SOURCES.gnss, SOURCES.odometry
    displayed, posts = SOURCES.displayed_speed, SOURCES.posts
    assert fixes is not None
    assert odometry is not None
    assert displayed is not None
    assert posts is not None
    passed = np.full(len(RUN.time), np.nan)
    passed[np.searchsorted(RUN.time, posts.time)] = posts.kilometre
    acceleration = 0.1 * np.random.default_rng(1).standard_normal(len(RUN.time))
    counted = np.round(odometry.distance / PULSE)
    return {
        "t": RUN.time,
        "acc": acceleration,
        "lat": fixes.latitude,
        "lon": fixes.longitude,
        "doppler": 3.6 * np.asarray(fixes.speed),
        "count": counted,
        "pulses": np.diff(counted, prepend=counted[0]),
        "v": 3.6 * displayed.speed,
        "km": passed,
        "rolled": odometry.distance / 1e3,
    }


def read_run(folder: Path, keys: str, **changes: Array) -> xr.Dataset:
    write_columns(folder / "run.csv", columns() | changes)
    (folder / "run.toml").write_text(
        f'[recording]\ndata = "run.csv"\n{keys}\n{SENSOR}', encoding="utf-8"
    )
    return read(folder / "run.toml")


def distance_error(recording: xr.Dataset, start: float) -> Array:
    true = RUN.distance - RUN.distance[0] + start
    return recording["distance"].to_numpy() - true


@pytest.mark.parametrize(
    ("keys", "start", "largest"),
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
def test_distance_is_estimated_with_its_standard_deviation(
    tmp_path: Path, keys: str, start: float, largest: float
) -> None:
    recording = read_run(tmp_path, keys)
    assert np.max(np.abs(distance_error(recording, start))) < largest
    assert (
        np.mean(np.abs(distance_error(recording, start)) < 2.5 * recording["distance_deviation"])
        > 0.9
    )
    assert any(step.startswith("positions: sources are") for step in provenance_steps(recording))


def test_incremental_pulses_give_the_same_distance_as_a_counter(tmp_path: Path) -> None:
    counter = read_run(tmp_path, TIME + ODOMETER)
    incremental = read_run(
        tmp_path, TIME + ODOMETER.replace('"count"', '"pulses"') + "incremental = true\n"
    )
    np.testing.assert_allclose(incremental["distance"], counter["distance"], atol=1e-6)


def test_posts_may_be_held_until_the_next_one_or_be_in_a_separate_table(tmp_path: Path) -> None:
    marked = read_run(tmp_path, TIME + POSTS + ODOMETER)
    passed = columns()["km"]
    last = np.maximum.accumulate(np.where(np.isfinite(passed), np.arange(len(passed)), 0))
    first = int(np.argmax(np.isfinite(passed)))
    held = np.where(np.arange(len(passed)) < first, passed[first] - 1.0, passed[last])
    np.testing.assert_allclose(
        read_run(tmp_path, TIME + POSTS + ODOMETER, km=held)["distance"], marked["distance"]
    )
    at = np.isfinite(passed)
    write_columns(tmp_path / "posts.csv", {"s": RUN.time[at][::-1], "m": 1e3 * passed[at][::-1]})
    listed = '[recording.posts]\ndata = "posts.csv"\ncolumn = "m"\nunit = "m"\ntime = { column = "s", unit = "s" }\n'
    np.testing.assert_allclose(
        read_run(tmp_path, TIME + listed + ODOMETER)["distance"], marked["distance"]
    )


def test_stated_units_are_converted(tmp_path: Path) -> None:
    original = read_run(tmp_path, TIME + GNSS + ODOMETER)
    radians = GNSS.replace("°", "rad")
    values = columns()
    converted = read_run(
        tmp_path,
        TIME.replace('"s"', '"ms"') + radians + ODOMETER,
        t=1e3 * values["t"],
        lat=np.radians(values["lat"]),
        lon=np.radians(values["lon"]),
    )
    np.testing.assert_allclose(converted["distance"], original["distance"], atol=0.01)


def test_fixes_may_have_a_separate_clock_and_validity_flags(tmp_path: Path) -> None:
    good = (RUN.time < 60.0) | (RUN.time > 70.0)
    lat = columns()["lat"] + np.where(good, 0.0, 0.3)
    keys = GNSS + 'valid = "good"\ntime = { column = "t2", unit = "s" }\n'
    recording = read_run(tmp_path, TIME + keys + ODOMETER, lat=lat, good=good, t2=RUN.time.copy())
    assert "clocks were brought to one" in recording.attrs["provenance"]
    assert np.max(np.abs(distance_error(recording, 0.0))) < 2.0


def test_chainage_table_determines_origin_and_direction_of_distance(tmp_path: Path) -> None:
    line = RUN.line
    table = {
        "distance_m": line.distance,
        "latitude_deg": line.latitude,
        "longitude_deg": line.longitude,
    }
    kilometre = np.full(len(line.distance), np.nan)
    kilometre[[0, -1]] = [30.0, 30.0 - line.distance[-1] / 1e3]
    write_columns(tmp_path / "way.csv", table | {"kilometre": kilometre})
    recording = read_run(
        tmp_path,
        TIME + 'chainage = "way.csv"\ndirection = "with the kilometrage"\n' + GNSS + ODOMETER,
    )
    assert np.max(np.abs(distance_error(recording, RUN.distance[0]))) < 2.0
    assert recording.attrs["direction"] == "against the kilometrage"
    assert "not with the kilometrage as stated" in recording.attrs["provenance"]


@pytest.mark.parametrize("name", ["again.nc", "again.toml"])
def test_position_uncertainty_of_a_recording_is_written_and_read(tmp_path: Path, name: str) -> None:
    recording = read_run(tmp_path, TIME + 'leading_end = "last"\n' + GNSS + ODOMETER)
    write(recording, tmp_path / name)
    again = read(tmp_path / name)
    for variable in ("time", "distance", "speed", "distance_deviation"):
        np.testing.assert_allclose(again[variable], recording[variable], rtol=1e-12)
    assert again.attrs["wheel_scale"] == pytest.approx(recording.attrs["wheel_scale"])
    assert again.attrs["leading_end"] == "last"


@pytest.mark.parametrize("name", ["profile.nc", "profile.csv", "profile.parquet"])
def test_position_uncertainty_of_a_profile_is_written_and_read(tmp_path: Path, name: str) -> None:
    known = [0.5, 0.75, 1.0]
    profile = build_profile(
        [0.0, 0.25, 0.5], [1e-3, 2e-3, 0.0], kind="point", distance_deviation=known
    )
    write(profile, tmp_path / name)
    np.testing.assert_array_equal(read(tmp_path / name)["distance_deviation"], known)


def test_invalid_position_uncertainty_and_wheel_scale_are_refused() -> None:
    with pytest.raises(RowError, match="distance_deviation, data row 2: expected a finite number"):
        build_profile([0.0, 0.25], [0.0, 0.0], kind="point", distance_deviation=[1.0, -1.0])
    floor = Channel("floor", np.zeros(3), "vertical acceleration", "body", 0.0)
    with pytest.raises(RowError, match="distance_deviation, data row 3: expected a finite number"):
        build_recording(
            [floor], time=[0, 1, 2], distance=[0, 1, 2], distance_deviation=[0, 1, np.nan]
        )
    with pytest.raises(DataError, match="wheel_scale: expected a number above zero, got -1"):
        build_recording([floor], time=[0, 1, 2], distance=[0, 1, 2], wheel_scale=-1.0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (TIME + ODOMETER.replace(f"wheel_diameter = {DIAMETER}\n", ""), "pulses need the keys 'per_revolution'"),
        (TIME + 'distance = { column = "rolled", unit = "km" }\n' + ODOMETER, "describe the same wheel; remove one"),
        (GNSS, "Positions cannot be assigned to samples without a time"),
        (TIME + GNSS.replace("°", "m"), "Unit 'm' is not a unit of angle"),
        (TIME + GNSS.replace('"lat"', '"v"'), "gnss.latitude: expected -90 to 90°, got"),
        (TIME + POSTS + 'data = "posts.csv"\n', "needs the key 'time', the column with the times at which"),
        (TIME + GNSS + 'height = 3\n', "unknown key 'height' in recording.gnss"),
        (TIME + 'chainage = "nowhere.csv"\n' + GNSS, "expected a chainage table"),
        (TIME + 'leading_end = "front"\n' + GNSS, "leading_end"),
    ],
)  # fmt: skip
def test_contradictory_position_sources_are_refused(
    tmp_path: Path, keys: str, message: str
) -> None:
    with pytest.raises((DataError, FileError), match=message):
        read_run(tmp_path, keys)


def test_wheel_slip_is_a_fault_of_the_recording(tmp_path: Path) -> None:
    values = columns()
    lat = values["lat"].copy()
    rows = np.flatnonzero(np.isfinite(lat))
    lat[rows[30]] += 200.0 / 111e3
    slip = np.round(4.0 / PULSE * np.clip((RUN.time - 60.0) / 1.5, 0.0, 1.0))
    recording = read_run(tmp_path, TIME + GNSS + ODOMETER, lat=lat, count=values["count"] + slip)
    kinds = {fault.kind for fault in find_faults(recording)}
    assert kinds >= {FaultKind.SLIP}
    assert np.max(np.abs(distance_error(recording, 0.0))) < 2.5


def test_inspection_recognises_fixes_pulses_and_posts_and_writes_a_readable_description(
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
    inspection = inspect(tmp_path / "logger.csv")
    assert inspection.recording is not None, inspection.notes
    assert "distance_deviation" in inspection.recording
    path = write_toml(inspection, tmp_path / "logger.toml")
    for line in (
        'longitude = { column = "GPS_Lon", unit = "°" }',
        'column = "Wegimpulse"',
        'column = "km-Stein"',
        "incremental = false",
    ):
        assert line in path.read_text(encoding="utf-8")
    assert "distance" in read(path)


def test_profile_states_the_uncertainty_of_its_positions(tmp_path: Path) -> None:
    vehicle, track = read_vehicle("velaro")[0], point_track(read_track("zhai"))
    recording, _ = simulated(
        vehicle, track, read_sensors("bogie-25ug"), read_spectrum("german-low"), 120.0, 1
    )
    count = recording.sizes["sample"]
    known = np.linspace(1.0, 9.0, count)
    located = recording.assign(distance_deviation=("sample", known, {"units": "m"}))
    result = estimate(
        located,
        vehicle,
        InferenceSettings(track=track, prior=read_spectrum("german-low"), samples=4),
    )
    assert any(
        note == "positions are known to ±10 m (95 %), at most ±18 m" for note in result.notes
    ), result.notes
    deviation = result.profile["distance_deviation"].to_numpy()
    at = result.profile["distance"].to_numpy()
    inside = (at >= result.sample_distance[0]) & (at <= result.sample_distance[-1])
    np.testing.assert_allclose(
        deviation[inside], np.interp(at[inside], result.sample_distance, known)
    )
    plain = estimate(
        recording,
        vehicle,
        InferenceSettings(track=track, prior=read_spectrum("german-low"), samples=4),
    )
    assert "distance_deviation" not in plain.profile
    np.testing.assert_array_equal(plain.profile["elevation"], result.profile["elevation"])


@pytest.mark.parametrize(
    ("calibrated", "wheel", "kept"),
    [(0.9903, 0.99, False), (1.0003, 0.99, True), (0.99, None, True), (1.0, 0.99, True)],
)
def test_distance_scale_of_a_located_wheel_is_not_applied_twice(
    calibrated: float, wheel: float | None, kept: bool
) -> None:
    floor = Channel("floor", np.zeros(3), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=[0, 1, 2], distance=[0, 1, 2], wheel_scale=wheel)
    installation, notes = correct_wheel_scale(Installation(distance_scale=calibrated), recording)
    assert (installation.distance_scale == calibrated) == kept
    assert bool(notes) != kept
    assert position_standard_deviation(np.zeros(1), np.arange(3.0), recording) == (None, ())


def test_defect_states_the_uncertainty_of_its_location() -> None:
    distance = np.arange(0.0, 400.0, 0.25)
    dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    known: Mapping[str, Any] = {"distance_deviation": 0.01 * distance}
    limits = read_limits("en-13848")
    assessed = assess(build_profile(distance, dip, kind="truth", **known), limits, 40.0)
    defect = max(assessed.defects, key=lambda one: abs(one.height))
    assert defect.location_deviation == pytest.approx(2.0, abs=0.05)
    assert defect_table([defect], assessed, ChainageTable())["location_deviation_m"] == [
        defect.location_deviation
    ]
    plain = assess(build_profile(distance, dip, kind="truth"), limits, 40.0)
    assert plain.defects[0].location_deviation is None

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.contracts import (
    Channel,
    Quality,
    build_profile,
    build_recording,
    channels,
    recording_identity,
)
from trackprofile.errors import DataError, FileError, TrackprofileError, UnitError
from trackprofile.io import write
from trackprofile.io.atomic import whole_files
from trackprofile.reader import read

TOML = """
[recording]
data = "run.csv"
distance = { column = "distance_m", unit = "m" }
speed = { column = "speed_km_h", unit = "km/h" }
line = "Hokuriku"

[[sensor]]
column = "floor"
unit = "g"
quantity = "vertical acceleration"
body = "body"
position = 6.9
noise_density = 0.001
valid = "good"
"""
CSV = """distance_m,speed_km_h,floor,good
0,36,0.1,1
0.5,72,,0
1,36,-0.1,true
"""
PROFILE = "distance_m,elevation_m,standard_deviation_m\n0,0.001,0.0001\n1,0.002,0.0001\n"

words = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=8)
names = st.text("abcXYZ_,;[] é²#\"'", min_size=1, max_size=8).filter(
    lambda name: name == name.strip() and not name.endswith("_valid")
)
counts = st.integers(2, 6)
small = st.floats(-1e6, 1e6)


def numbers(draw: st.DrawFn, count: int, of: st.SearchStrategy[float] = small) -> np.ndarray:
    return np.array(draw(st.lists(of, min_size=count, max_size=count)), float)


def increasing(draw: st.DrawFn, count: int) -> np.ndarray:
    return draw(small) + np.cumsum(numbers(draw, count, st.floats(0.01, 100.0)))


@st.composite
def recordings(draw: st.DrawFn) -> xr.Dataset:
    count = draw(counts)
    sensors = []
    for name in draw(st.lists(names, min_size=1, max_size=3, unique=True)):
        valid = np.array(draw(st.lists(st.booleans(), min_size=count, max_size=count)))
        valid[draw(st.integers(0, count - 1))] = True
        sensors.append(
            Channel(
                name=name,
                values=np.where(valid, numbers(draw, count), np.nan),
                quantity=draw(st.sampled_from(["vertical acceleration", "pitch rate"])),
                body=draw(words.filter(bool)),
                position=draw(small),
                noise_density=draw(st.none() | st.floats(1e-9, 1e3)),
                flicker=draw(st.none() | st.floats(1e-9, 1e3)),
                valid=valid,
            )
        )
    moved: dict[str, Any] = {"time": increasing(draw, count), "distance": increasing(draw, count)}
    moved["speed"] = numbers(draw, count, st.floats(1e-3, 100.0))
    del moved[draw(st.sampled_from(["time", "distance", "speed"]))]
    return build_recording(
        sensors,
        **moved,
        line=draw(words),
        source=draw(words),
        provenance=draw(st.lists(words)),
    )


@st.composite
def profiles(draw: st.DrawFn) -> xr.Dataset:
    count = draw(counts)
    flags = numbers(draw, count, st.integers(0, 15)).astype(np.int8)
    gap = flags & Quality.GAP != 0
    spread = st.floats(0.0, 1.0)
    known = draw(st.booleans())
    return build_profile(
        increasing(draw, count),
        np.where(gap, np.nan, numbers(draw, count)),
        kind="posterior" if known else "point",
        method=draw(words),
        standard_deviation=numbers(draw, count, spread) if known else None,
        band_standard_deviations={"D1": numbers(draw, count, spread)} if known else None,
        quality=flags,
        vehicle=draw(words),
        provenance=draw(st.lists(words)),
    )


def there_and_back(dataset: xr.Dataset, name: str) -> xr.Dataset:
    with TemporaryDirectory() as folder:
        write(dataset, Path(folder) / name)
        assert not [one for one in os.listdir(folder) if one.startswith(".")]
        return read(Path(folder) / name)


@given(recordings())
@pytest.mark.parametrize("name", ["run.nc", "run.toml", "run.csv", "run.parquet"])
def test_a_recording_is_read_back_unchanged_from_every_format(
    name: str, recording: xr.Dataset
) -> None:
    back = there_and_back(recording, name)
    if name != "run.nc":
        back = back.assign_attrs(provenance=recording.attrs["provenance"])
        recording = recording.assign_attrs(identity=recording_identity(recording))
    xr.testing.assert_identical(back, recording)


@given(profiles())
def test_a_profile_is_read_back_from_netcdf_unchanged(profile: xr.Dataset) -> None:
    xr.testing.assert_identical(there_and_back(profile, "level.nc"), profile)


@given(profiles())
@pytest.mark.parametrize("name", ["level.csv", "level.parquet"])
def test_a_profile_is_read_back_from_a_table_without_its_attributes(
    name: str, profile: xr.Dataset
) -> None:
    back = there_and_back(profile, name)
    xr.testing.assert_equal(back, profile)
    assert back.attrs["kind"] == profile.attrs["kind"]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run.toml").write_text(TOML, encoding="utf-8")
    (tmp_path / "run.csv").write_text(CSV)
    return tmp_path / "run.toml"


@pytest.mark.parametrize("suffix", [".toml", ".csv"])
def test_units_are_converted_to_si_on_reading(run: Path, suffix: str) -> None:
    recording = read(run.with_suffix(suffix))
    np.testing.assert_allclose(recording["speed"], [10.0, 20.0, 10.0])
    (floor,) = channels(recording)
    np.testing.assert_allclose(floor.values, [0.980665, np.nan, -0.980665])
    np.testing.assert_array_equal(floor.valid, [True, False, True])
    assert floor.noise_density == pytest.approx(0.00980665)
    assert recording.attrs["line"] == "Hokuriku"


def test_a_stretch_of_a_real_recording_is_read(
    shared: Callable[[str], Path], tmp_path: Path
) -> None:
    lines = shared("data/hokuriku/section_a.csv").read_text().splitlines()
    (tmp_path / "run.csv").write_text("\n".join([lines[0], *lines[5601:8402]]))
    text = TOML.replace('valid = "good"\n', "").replace('"g"', '"m/s²"')
    text = text.replace('"floor"', '"body_vertical_acceleration_m_s2"')
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    recording = read(tmp_path / "run.toml")
    assert recording.sizes["sample"] == 2801
    assert recording["distance"][0] == 1400.0
    assert 52 / 3.6 <= recording["speed"].min() <= recording["speed"].max() <= 75 / 3.6


def refused(path: Path, error: type[TrackprofileError] = DataError) -> str:
    """The one sentence with which a file is refused."""
    with pytest.raises(error) as caught:
        read(path)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("speed_km_h", "v", "column 'speed_km_h' is missing; the columns are distance_m, v, floor"),
        ("0.1,1", "nan,1", "column 'floor', data row 1: expected a finite number; mark"),
        ("0.1,1", "inf,1", "column 'floor', data row 1: expected a finite number"),
        ("0.1,1", "0.1,", "column 'good', data row 1: expected 1 or 0"),
        ("0.1,1", "0.1,yes", "column 'good', data row 1: expected a number, got 'yes'"),
        ("0.1,1", "o.1,1", "column 'floor', data row 1: expected a number, got 'o.1'"),
        (",0\n1", ",1\n1", "column 'floor', data row 2: expected a finite number; mark"),
        ("0.5,72", "0.5,0", "column 'speed_km_h', data row 2: the speed is zero"),
        (
            "0.5,72",
            "0.5,-72",
            "column 'speed_km_h', data row 2: expected a speed of zero or more, got -20 m/s",
        ),
        ("0.5,72", "-0.5,72", "column 'distance_m', data row 2: distance does not increase"),
        (
            "1,36,-0.1,true\n",
            "1,3",
            "data row 3: expected 4 values, got 2; the file is cut short",
        ),
        (CSV[CSV.index("\n") :], "", "not a complete CSV table"),
        ("distance_m,", "floor,", "column 'distance_m' is missing"),
        ("good", "floor", "column 'floor' occurs twice"),
    ],
)
def test_an_unusable_table_is_refused_naming_column_and_row(
    run: Path, old: str, new: str, message: str
) -> None:
    data = run.with_name("run.csv")
    data.write_text(CSV.replace(old, new, 1))
    sentence = refused(run)
    assert sentence.startswith(str(data))
    assert message in sentence


def test_decreasing_time_is_repaired_and_reported(run: Path) -> None:
    run.write_text(
        TOML.replace('distance = { column = "distance_m", unit = "m" }',
                     'time = { column = "distance_m", unit = "min" }'),
        encoding="utf-8",
    )  # fmt: skip
    run.with_name("run.csv").write_text(CSV.replace("1,36", "0.25,36"))
    recording = read(run)
    np.testing.assert_allclose(recording["time"], [0.0, 30.0, 60.0])
    np.testing.assert_array_equal(recording["clock_fault"], [0, 0, 1])
    assert "repaired: the clock jumps once: jump removed" in recording.attrs["provenance"]


def test_missing_speed_is_filled_and_reported(run: Path) -> None:
    run.with_name("run.csv").write_text(CSV.replace("0.5,72", "0.5,"))
    recording = read(run)
    np.testing.assert_allclose(recording["speed"], [10.0, 10.0, 10.0], rtol=1e-5)
    np.testing.assert_array_equal(recording["clock_fault"], [0, 4, 0])
    assert "the speed is missing in 1 row: filled" in recording.attrs["provenance"]


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('"km/h"', '"km"', UnitError, "column 'speed_km_h': Unit 'km' is not a unit of speed"),
        ('"g"', '"°/s"', UnitError, "column 'floor': Unit '°/s' is not a unit of acceleration"),
        ("vertical", "lateral", DataError, "pitch rate, roll rate, got 'lateral"),
        (
            "body =",
            "boddy =",
            FileError,
            "unknown key 'boddy' in sensor 1 (did you mean 'body'?); the keys of this table are col",
        ),
        ("line =", "lines =", FileError, "unknown key 'lines' in recording"),
        (
            "[recording]",
            "[records]",
            FileError,
            "unknown key 'records' (did you mean 'recording'?); the keys of this table are rec",
        ),
        ('unit = "m"', 'unt = "m"', FileError, "unknown key 'unt' in recording.distance"),
        ("position = 6.9\n", "", FileError, "key 'position' is missing in sensor 1"),
        ("6.9", '"6.9"', FileError, "sensor 1.position: input should be a valid number"),
        ("0.001", "-0.001", FileError, "noise_density: input should be greater than 0, got -0.001"),
        ("6.9", "nan", FileError, "finite number, got nan"),
        (
            '{ column = "speed_km_h", unit = "km/h" }',
            '"speed_km_h"',
            FileError,
            "recording.speed: expected a table with the keys column, unit",
        ),
        ("[[sensor]]", "[[sensor]", FileError, "not valid TOML"),
        ("run.csv", "away.csv", FileError, "does not exist; correct the key 'data'"),
    ],
)
def test_a_wrong_description_is_refused_naming_the_key(
    run: Path, old: str, new: str, error: type[TrackprofileError], message: str
) -> None:
    run.write_text(TOML.replace(old, new, 1), encoding="utf-8")
    sentence = refused(run, error)
    assert sentence.startswith(str(run))
    assert message in sentence


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("distance_m", "metres", "column 'distance_m' is missing"),
        ("\n1,", "\n0,", "column 'distance_m', data row 2: distance does not increase"),
        ("0.002", "", "column 'elevation_m', data row 2: expected a finite number"),
        ("0.0001", "-1", "column 'standard_deviation_m', data row 1: expected a finite number"),
        ("1,0.002,0.0001\n", "1,0.0", "data row 2: expected 3 values, got 2"),
    ],
)
def test_an_unusable_profile_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "level.csv"
    path.write_text(PROFILE.replace(old, new, 1))
    sentence = refused(path)
    assert sentence.startswith(str(path))
    assert message in sentence


def test_a_quality_that_is_not_a_sum_of_flags_is_refused(tmp_path: Path) -> None:
    (tmp_path / "level.csv").write_text("distance_m,elevation_m,quality\n0,0,0\n1,0,256\n")
    message = "column 'quality', data row 2: expected a sum of flags, 0 to 255, got 256"
    assert message in refused(tmp_path / "level.csv")


@pytest.mark.parametrize("name", ["a.nc", "a.csv", "a.parquet", "a.toml"])
@pytest.mark.parametrize("contents", [b"", b"\x00\x9f\xff\x01" * 99, b"\x89HDF\r\n\x1a\n\x00\x00"])
def test_a_file_with_other_content_than_its_suffix_is_refused(
    tmp_path: Path, name: str, contents: bytes
) -> None:
    (tmp_path / name).write_bytes(contents)
    assert refused(tmp_path / name, FileError).startswith(str(tmp_path / name))


@pytest.mark.parametrize("name", ["run.nc", "run.parquet"])
@pytest.mark.parametrize("kept", [0.3, 0.6, 0.99])
def test_a_truncated_file_is_refused(tmp_path: Path, name: str, kept: float) -> None:
    time = np.arange(1000.0)
    floor = Channel("floor", np.sin(time), "vertical acceleration", "body", 0.0)
    path = write(build_recording([floor], time=time, speed=time + 1), tmp_path / name)[0]
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    assert refused(path, FileError).startswith(str(path))


@pytest.mark.parametrize("name", ["run.nc", "run.parquet", "run.csv", "run.toml"])
@given(st.data())
def test_a_damaged_file_is_read_or_refused_in_one_sentence(name: str, data: st.DataObject) -> None:
    time = np.arange(9.0)
    floor = Channel("floor", np.sin(time), "vertical acceleration", "body", 0.0)
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(build_recording([floor], time=time, speed=time + 1), path)
        whole = path.read_bytes()
        first = data.draw(st.integers(0, len(whole) - 1))
        damage = data.draw(st.binary(max_size=8))
        path.write_bytes(whole[:first] + damage + whole[first + len(damage) :])
        sentence = "Read."
        try:
            read(path)
        except TrackprofileError as error:
            sentence = str(error)
        assert re.fullmatch(r"[^\n]+\.", sentence)


@pytest.mark.parametrize(
    ("variable", "attribute", "value", "message"),
    [
        ("floor", "position", "middle", "its position on it"),
        ("floor", "position", [1.0, 2.0], "its position on it"),
        ("floor", "body", [1.0, 2.0], "expected the name of its body"),
        ("floor", "noise_density", "low", "noise_density above zero"),
        ("floor", "quantity", [1.0, 2.0], "expected a quantity out of"),
        ("floor", "units", "g", "in m/s2, got float64 .* units 'g'"),
        ("time", "units", [1.0, 2.0], "in s, got"),
        (None, "kind_of_data", "film", "expected 'recording' or 'profile'"),
        (None, "kind_of_data", [1.0, 2.0], "expected 'recording' or 'profile'"),
        (None, "provenance", "by hand", "list of texts in JSON, got 'by hand'"),
    ],
)
def test_netcdf_written_elsewhere_is_validated(
    tmp_path: Path, variable: str | None, attribute: str, value: object, message: str
) -> None:
    floor = Channel("floor", np.ones(3), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=np.arange(3.0), speed=np.ones(3))
    (recording if variable is None else recording[variable]).attrs[attribute] = value
    recording.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    assert re.search(message, refused(tmp_path / "run.nc"))


@pytest.mark.parametrize("name", ["time", "floor", "floor_valid"])
def test_text_instead_of_numbers_is_refused(tmp_path: Path, name: str) -> None:
    floor = Channel("floor", np.ones(3), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=np.arange(3.0), speed=np.ones(3))
    text = recording[name].astype(object)
    text[:] = "a"
    recording.assign({name: text}).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    assert f"{name}: expected one" in refused(tmp_path / "run.nc")


def test_an_unknown_file_is_refused_with_the_accepted_formats(tmp_path: Path) -> None:
    (tmp_path / "plain.csv").write_text("a,b\n1,2\n")
    assert "expected a profile as a table" in refused(tmp_path / "plain.csv", FileError)
    assert "the file does not exist" in refused(tmp_path / "none.nc", FileError)
    assert "ends in .nc, .csv, .parquet, .toml" in refused(tmp_path / "run.xlsx", FileError)


def test_a_table_is_not_read_with_the_description_of_another(run: Path) -> None:
    run.write_text(TOML.replace("run.csv", "other.csv"), encoding="utf-8")
    run.with_name("other.csv").write_text(CSV)
    assert "run.toml in the same folder describes other.csv" in refused(
        run.with_name("run.csv"), FileError
    )


def level() -> xr.Dataset:
    return build_profile([0.0, 1.0], [0.0, 0.001], kind="truth")


def test_writing_is_refused_before_any_file_changes(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"a profile is written to .* \.nc, \.csv, \.parquet;"):
        write(level(), tmp_path / "level.toml")
    with pytest.raises(FileError, match="does not exist; create it first"):
        write(level(), tmp_path / "none" / "level.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(FileError, match="got a folder"):
        write(level(), tmp_path / "folder.csv")
    with pytest.raises(DataError, match="data row 2"):
        write(level().isel(distance=[1, 1]), tmp_path / "level.csv")
    assert os.listdir(tmp_path) == ["folder.csv"]


def test_a_file_that_was_not_named_is_not_replaced(run: Path) -> None:
    recording = read(run)
    assert write(recording, run) == (run.with_name("run.csv"), run)  # these two belong together
    run.write_text('name = "a vehicle"')
    with pytest.raises(FileError, match=r"run\.toml: the file exists and does not belong to"):
        write(recording, run.with_suffix(".csv"))
    run.unlink()
    with pytest.raises(FileError, match=r"run\.csv: the file exists and does not belong to"):
        write(recording, run)


@pytest.mark.parametrize("stop", [KeyboardInterrupt, MemoryError, OSError])
def test_a_failed_write_leaves_the_existing_file_unchanged(
    tmp_path: Path, stop: type[BaseException]
) -> None:
    first, second = tmp_path / "first.txt", tmp_path / "second.txt"
    first.write_text("before")

    def interrupted() -> None:
        with whole_files(first, second) as (one, other):
            one.write_text("after")
            other.write_text("ha")
            raise stop("half way")

    with pytest.raises((stop, FileError)):
        interrupted()
    assert first.read_text() == "before"
    assert os.listdir(tmp_path) == ["first.txt"]


def test_files_get_their_names_together_at_the_end(tmp_path: Path) -> None:
    with whole_files(tmp_path / "a.csv", tmp_path / "b.png") as files:
        for file in files:
            file.write_text("whole")
        assert [file.suffix for file in files] == [".csv", ".png"]
        assert not (tmp_path / "a.csv").exists()
    assert sorted(os.listdir(tmp_path)) == ["a.csv", "b.png"]


def test_sensor_bandwidth_is_read_back_from_toml_and_netcdf(tmp_path: Path) -> None:
    floor = Channel("floor", np.zeros(3), "vertical acceleration", "body", 6.9, bandwidth=10.0)
    recording = build_recording([floor], time=[0.0, 0.1, 0.2], speed=[20.0, 20.0, 20.0])
    for name in ("run.toml", "run.nc"):
        write(recording, tmp_path / name)
        back = channels(read(tmp_path / name))[0]
        assert back.bandwidth == 10.0

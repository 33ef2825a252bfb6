"""The identity of a recording is that of its raw content and its description, whatever is estimated from them."""

from __future__ import annotations

import dataclasses
import tracemalloc
from datetime import date
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
import xarray as xr

from trackprofile import store as stores
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.contracts import (
    build_profile,
    content_digest,
    legacy_fingerprint,
    recording_identity,
    select_stretch,
)
from trackprofile.contracts.identity import (
    RECORDING,
    RECORDING_FINGERPRINT,
    canonical_json,
    digest,
    digest_array,
    stretch_identity,
)
from trackprofile.errors import DataError, FileError
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io import write
from trackprofile.io.model_toml import read_vehicle
from trackprofile.positioning import locate, map_matching, position_model, position_smoother
from trackprofile.reader import read
from trackprofile.reporting.result_files import write_estimate

HEAD = """
[recording]
data = "run.csv"
time = { column = "t", unit = "s" }
speed = { column = "v", unit = "km/h" }
line = "Main"

[recording.gnss]
latitude = { column = "lat", unit = "°" }
longitude = { column = "lon", unit = "°" }

[[sensor]]
column = "floor"
unit = "g"
quantity = "vertical acceleration"
body = "body"
position = 1.0
"""
REORDERED = """
# The same description in another order of keys, with comments.
[[sensor]]
position = 1
body = "body"
quantity = "vertical acceleration"
unit = "g"          # standard gravity
column = "floor"

[recording]
line = "Main"
speed = { unit = "km/h", column = "v" }
time = { column = "t", unit = "s" }
data = "run.csv"
gnss.longitude = { column = "lon", unit = "°" }
gnss.latitude = { column = "lat", unit = "°" }
"""
FORMATS = (".nc", ".csv", ".tsv", ".parquet", ".h5", ".mat", ".mf4", ".tdms", ".toml")


def table(count: int = 400) -> str:
    """A train at 72 km/h northwards, sampled at 20 Hz, with a position each second."""
    generator = np.random.default_rng(5)
    rows = ["t,v,lat,lon,floor"]
    for k in range(count):
        time, fix = 0.05 * k, k % 20 == 0
        north = 50.0 + 20.0 * time / 111_195.0 + 1e-5 * generator.standard_normal()
        position = f"{north:.7f},{8.0:.7f}" if fix else ","
        rows.append(f"{time:.2f},72,{position},{0.01 * generator.standard_normal():.6f}")
    return "\n".join(rows) + "\n"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run.csv").write_text(table(), encoding="utf-8")
    (tmp_path / "run.toml").write_text(HEAD, encoding="utf-8")
    return tmp_path / "run.toml"


def identity(path: Path) -> str:
    return read(path).attrs["identity"]


@pytest.mark.parametrize(
    ("module", "name", "value"),
    [
        (position_model, "GNSS_BIAS_STD", 3.0),
        (position_smoother, "KEPT_OUTLIER_THRESHOLD", 2.0),
        (map_matching, "MEDIAN_LENGTH", 31),
        (locate, "WALKING_SPEED", 2.0),
    ],
)
def test_a_changed_positioning_constant_leaves_the_identity(
    run: Path, monkeypatch: pytest.MonkeyPatch, module: object, name: str, value: float
) -> None:
    before = read(run)
    assert hasattr(module, name)
    for owner in (module, locate, position_smoother, map_matching):
        if hasattr(owner, name):
            monkeypatch.setattr(owner, name, value)
    assert identity(run) == before.attrs["identity"]


@pytest.mark.parametrize("relative", [1e-12, np.finfo(float).eps])
def test_perturbed_position_estimates_leave_the_identity(
    run: Path, monkeypatch: pytest.MonkeyPatch, relative: float
) -> None:
    before, original = read(run), locate.locate

    def perturbed(*arguments: object) -> object:
        result = original(*arguments)  # type: ignore[arg-type]
        return dataclasses.replace(result, distance=result.distance * (1 + relative))

    monkeypatch.setattr(locate, "locate", perturbed)
    after = read(run)
    assert not np.array_equal(after["distance"], before["distance"])
    assert legacy_fingerprint(after) != legacy_fingerprint(before)
    assert recording_identity(after) == recording_identity(before)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("position = 1.0", "position = 1.001"),
        ('unit = "g"', 'unit = "m/s²"'),
        ("position = 1.0", "position = 1.0\nlateral = 0.5"),
        ("[[sensor]]", "delay = 0.1\n\n[[sensor]]"),
        ("[[sensor]]", "std = 2.0\n\n[[sensor]]"),
    ],
)
def test_a_changed_description_changes_the_identity(run: Path, old: str, new: str) -> None:
    before = identity(run)
    run.write_text(HEAD.replace(old, new, 1), encoding="utf-8")
    assert identity(run) != before


@pytest.mark.parametrize("column", [1, 2, 4])
def test_a_changed_raw_value_changes_the_identity(run: Path, column: int) -> None:
    before = identity(run)
    rows = table().splitlines()
    cells = rows[21].split(",")
    cells[column] = repr(float(np.nextafter(float(cells[column]), np.inf)))
    rows[21] = ",".join(cells)
    run.with_name("run.csv").write_text("\n".join(rows), encoding="utf-8")
    assert identity(run) != before


def test_order_of_keys_comments_names_and_texts_leave_the_identity(run: Path) -> None:
    before = identity(run)
    run.write_text(REORDERED, encoding="utf-8")
    assert identity(run) == before
    run.with_name("run.csv").rename(run.with_name("renamed.csv"))
    text = REORDERED.replace("run.csv", "renamed.csv").replace("Main", "Branch")
    run.write_text(text, encoding="utf-8")
    assert identity(run) == before


def test_a_column_that_is_not_used_leaves_the_identity(run: Path) -> None:
    before = identity(run)
    rows = [f"{row},{'remark' if k == 0 else k}" for k, row in enumerate(table().splitlines())]
    run.with_name("run.csv").write_text("\n".join(rows), encoding="utf-8")
    assert identity(run) == before


@pytest.mark.parametrize("chain", [False, True])
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_recording_format_keeps_the_identity(run: Path, suffix: str, *, chain: bool) -> None:
    recording = read(run)
    folder = run.parent / "written"
    folder.mkdir()
    write(recording, folder / f"run{suffix}")
    back = read(folder / f"run{suffix}")
    assert back.attrs["identity"] == recording.attrs["identity"]
    assert "identity_content" not in back.attrs
    if chain:
        write(back, folder / "again.nc")
        write(read(folder / "again.nc"), folder / "again.csv")
        assert identity(folder / "again.csv") == recording.attrs["identity"]


def test_a_file_that_was_changed_after_writing_gets_another_identity(run: Path) -> None:
    recording, folder = read(run), run.parent
    write(recording, folder / "copy.csv")
    description = (folder / "copy.toml").read_text(encoding="utf-8")
    (folder / "copy.toml").write_text(
        description.replace("position = 1.0", "position = 2.0"), encoding="utf-8"
    )
    assert identity(folder / "copy.csv") != recording.attrs["identity"]
    write(recording, folder / "copy.nc")
    with xr.open_dataset(folder / "copy.nc", engine="h5netcdf", decode_times=False) as file:
        changed = file.load()
    changed["floor"][3] += 1e-9
    changed.to_netcdf(folder / "changed.nc", engine="h5netcdf")
    back = read(folder / "changed.nc")
    assert "identity" not in back.attrs
    assert recording_identity(back) == content_digest(back)


def test_an_identity_that_is_not_a_digest_is_refused(run: Path) -> None:
    recording = read(run).assign_attrs(identity="run 1")
    with pytest.raises(DataError, match="expected 64 hexadecimal digits, got 'run 1'"):
        recording_identity(recording)
    run.write_text(HEAD.replace("[recording]", '[recording]\nidentity = "run 1"'), encoding="utf-8")
    with pytest.raises(FileError, match=r"recording\.identity"):
        read(run)


def test_a_stretch_has_an_identity_of_its_own(run: Path) -> None:
    recording = read(run)
    whole = recording.attrs["identity"]
    piece = select_stretch(recording, 50.0, 150.0)
    assert piece.attrs["identity"] == stretch_identity(whole, 50.0, 150.0)
    moved = recording.assign(distance=recording["distance"] * (1 + 1e-12))
    assert select_stretch(moved, 50.0, 150.0).attrs["identity"] == piece.attrs["identity"]
    assert select_stretch(recording, 50.0, 160.0).attrs["identity"] != piece.attrs["identity"]
    assert select_stretch(recording, None, None).attrs["identity"] == whole
    assert select_stretch(recording, -np.inf, None).attrs["identity"] == whole


def test_a_pass_is_one_entry_of_a_store_whatever_was_estimated(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = read(run)
    profile = build_profile(np.arange(0.0, 380.0, 0.5), np.zeros(760), kind="point")
    store = stores.create(str(run.parent / "store"))
    key = stores.PassKey("Main", "up", date(2026, 5, 31))
    results = []
    for level in (position_model.GNSS_BIAS_STD, 3.0):
        monkeypatch.setattr(position_model, "GNSS_BIAS_STD", level)
        origin = stores.Origin(recording_identity(read(run)))
        assessment = assess(profile, read_limits("en-13848"), 30.0)
        results.append(stores.add(store, key, profile, assessment, origin))
    assert [one.new for one in results] == [True, False]
    assert len(stores.find(store)) == 1
    assert results[0].entry.origin.recording == recording.attrs["identity"]


def test_a_profile_names_its_recording_by_both_schemes(run: Path) -> None:
    recording = read(run)
    vehicle, installation = read_vehicle("quarter-car")
    result = estimate(recording, vehicle, InferenceSettings(installation=installation))
    path, *_ = write_estimate(result, recording, run.with_name("profile.nc"))
    profile = read(path)
    assert profile.attrs[RECORDING] == recording.attrs["identity"]
    assert profile.attrs[RECORDING_FINGERPRINT] == legacy_fingerprint(recording)


def test_digests_are_those_of_every_version_and_platform() -> None:
    assert canonical_json({"b": np.float64(0.1), "a": [True, None, np.int64(3)]}) == (
        b'{"a":[true,null,3],"b":0.1}'
    )
    assert digest({"at": np.arange(3.0), "speed": float("inf"), "day": date(2026, 5, 1)}) == (
        "6066c58704a9e55a3891722d51f3314bba0a920fe8c96c005d4025308c09db88"
    )
    texts = np.array(["12:00:00", None, "ä"], object)
    assert digest_array(texts) == "b224bd5059e32bc74acb00553a3d3342b884e51f741e5329397e3fc0205c65e3"
    nan, other_nan = np.array([np.nan]), np.array([-np.nan])
    assert digest_array(nan) == digest_array(other_nan)
    assert digest_array(np.array([0.0])) != digest_array(np.array([-0.0]))
    with pytest.raises(TypeError, match="No canonical form of object"):
        digest(object())


def test_digest_of_a_long_recording_is_cheap() -> None:
    # 500 km at 30 m/s, sampled at 500 Hz: 8.3 million samples in each of 4 columns.
    columns = {name: np.arange(8_300_000.0) for name in "abcd"}
    tracemalloc.start()
    begin = perf_counter()
    digest(columns)
    seconds, (_, peak) = perf_counter() - begin, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20e6
    assert seconds < 5.0

"""Loggers' files of every format and dialect, to the same recording."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from trackprofile.contracts import Channel, build_recording, channels, recording_identity
from trackprofile.errors import DataError, FileError
from trackprofile.io import subprocess_reader, write
from trackprofile.io.csv_dialect import find_dialect
from trackprofile.io.table import LOGGER_SUFFIXES, headings, read_columns, write_columns
from trackprofile.reader import read

HEAD = """
[recording]
data = "{data}"
time = {{ column = "{time}", unit = "{unit}" }}
speed = {{ column = "{speed}", unit = "km/h" }}

[[sensor]]
column = "{floor}"
unit = "m/s²"
quantity = "vertical acceleration"
body = "body"
position = 0
"""
FLOOR = np.array([0.1, -0.25, 1e-3, 2.0])
TIME = np.array([0.0, 0.5, 1.0, 1.5])

PLAIN = "t,v,a\n0,36,0.1\n0.5,36,-0.25\n1,36,0.001\n1.5,36,2\n"
DIALECTS = {
    "plain": PLAIN,
    "semicolon": "t;v;a\n0;36;0,1\n0,5;36;-0,25\n1;36;0,001\n1,5;36;2\n",
    "tabs": PLAIN.replace(",", "\t"),
    "bars": PLAIN.replace(",", "|"),
    "blanks": "  t   v    a\n  0   36   0.1\n  0.5 36  -0.25\n  1.0 36 1e-3 \n  1.5 36 2\n",
    "junk above": "Logger 4711;Fw 2.1\nDate;2024-05-01\n\n" + PLAIN.replace(",", ";"),
    "units below": PLAIN.replace("t,v,a\n", "t,v,a\ns,km/h,m/s²\n"),
    "units in brackets": PLAIN.replace("t,v,a\n", "t,v,a\n[s],[km/h],[m/s²]\n"),
    "windows lines": PLAIN.replace("\n", "\r\n"),
    "separator at the end": PLAIN.replace("\n", ",\n"),
    "a text beside": "t,v,a,remark\n0,36,0.1,start\n0.5,36,-0.25,\n1,36,0.001,\n1.5,36,2,end\n",
    "quoted": '"t","v","a"\n"0","36","0.1"\n"0.5","36","-0.25"\n"1","36","0.001"\n"1.5","36","2"\n',
}


def explained(folder: Path, data: str, **names: str) -> Path:
    words = {"time": "t", "unit": "s", "speed": "v", "floor": "a"} | names
    (folder / "run.toml").write_text(HEAD.format(data=data, **words), encoding="utf-8")
    return folder / "run.toml"


def check(recording: xr.Dataset) -> None:
    np.testing.assert_allclose(recording["time"], TIME, atol=1e-9)
    np.testing.assert_allclose(recording["speed"], 10.0)
    np.testing.assert_allclose(channels(recording)[0].values, FLOOR)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_csv_in_every_dialect_gives_the_same_recording(
    tmp_path: Path, dialect: str, encoding: str
) -> None:
    (tmp_path / "run.txt").write_text(DIALECTS[dialect], encoding=encoding, newline="")
    check(read(explained(tmp_path, "run.txt")))


def test_units_in_a_header_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t [s];v (km/h);Beschl. Böden [m/s²]\n0;1;2\n1;2;3\n", encoding="cp1252")
    found = find_dialect(path)
    assert found.units == ("s", "km/h", "m/s²")
    assert found.encoding == "cp1252"
    assert found.names[2] == "Beschl. Böden [m/s²]"


def test_csv_without_a_header_has_columns_by_number(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("0,36,0.1\n0.5,36,-0.25\n1,36,0.001\n1.5,36,2\n")
    check(read(explained(tmp_path, "a.csv", time="column 1", speed="column 2", floor="column 3")))


@pytest.mark.parametrize(
    ("unit", "stamps"),
    [
        ("Y-M-D", ["2024-05-01 23:59:59.5", "2024-05-02T00:00:00", "2024-05-02 00:00:00.500"]),
        ("Y-M-D", ["2024-05-01 23:59:59.5Z", "2024-05-02 01:00:00+01:00", "2024-05-02 00:00:00,5"]),
        ("D.M.Y", ["31.12.2024 23:59:59.5", "1.1.2025 00:00:00", "01/01/2025 00:00:00.5"]),
        ("M/D/Y", ["02/28/2024 23:59:59.5", "2/29/2024 0:00:00", "2/29/2024 0:00:00.5"]),
        ("h:m:s", ["23:59:59.5", "00:00:00", "0:00:00.5"]),
    ],
)
def test_timestamps_are_read(tmp_path: Path, unit: str, stamps: list[str]) -> None:
    rows = "".join(f"{stamp};36;0.1\n" for stamp in stamps)
    (tmp_path / "a.csv").write_text("t;v;a\n" + rows)
    time = read(explained(tmp_path, "a.csv", unit=unit))["time"].to_numpy()
    np.testing.assert_allclose(np.diff(time), 0.5, atol=1e-6)


def test_an_invalid_timestamp_is_refused_naming_the_row(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;v;a\n01.01.2024 00:00:00;36;1\nnoon;36;1\n")
    with pytest.raises(DataError, match=r"column .t., data row 2: expected a time as D\.M\.Y, got"):
        read(explained(tmp_path, "a.csv", unit="D.M.Y"))


def test_matlab_and_hdf5_written_elsewhere_are_read(tmp_path: Path) -> None:
    columns = {"t": TIME, "v": np.full(4, 36.0), "a": FLOOR}
    savemat(tmp_path / "a.mat", columns | {"car": {"mass": 1.0}, "names": ["a", "b"]})
    check(read(explained(tmp_path, "a.mat")))
    for name in ("b.mat", "b.h5"):
        with h5py.File(tmp_path / name, "w", userblock_size=512 if name == "b.mat" else 0) as file:
            for key, values in columns.items():
                file[f"run/{key}"] = values[:, None]
            file["run/matrix"] = np.ones((3, 3))
            file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")
        check(read(explained(tmp_path, name, time="run/t", speed="run/v", floor="run/a")))


def test_a_small_file_that_states_a_large_content_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for key in "tva":
            file.create_dataset(key, shape=(10**12,), chunks=(10**6,), dtype=float)
    with pytest.raises(FileError, match="the file states a content of"):
        read(explained(tmp_path, "a.h5"))


def test_channels_with_separate_clocks_are_brought_to_one_clock(tmp_path: Path) -> None:
    fast, slow = np.arange(0, 2, 0.01), np.arange(0.005, 2, 0.1)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["a"] = fast, np.sin(fast)
        file["t2"], file["q"] = slow, np.cos(slow)
        file["tv"], file["v"] = np.array([0.0, 3.0]), np.array([36.0, 72.0])
    text = HEAD.format(data="a.h5", time="tv", unit="s", speed="v", floor="a")
    text += """
time = { column = "t", unit = "s" }

[[sensor]]
column = "q"
unit = "rad/s"
quantity = "pitch rate"
body = "body"
position = 0
time = { column = "t2", unit = "s" }
"""
    (tmp_path / "run.toml").write_text(text)
    recording = read(tmp_path / "run.toml")
    time = recording["time"].to_numpy()
    a, q = channels(recording)
    assert a.valid is not None
    assert q.valid is not None
    assert (a.valid.sum(), q.valid.sum()) == (len(fast), len(slow))
    np.testing.assert_allclose(a.values[a.valid], np.sin(time[a.valid]), atol=1e-12)
    np.testing.assert_allclose(q.values[q.valid], np.cos(time[q.valid]), atol=1e-12)
    np.testing.assert_allclose(recording["speed"], 10.0 + time * 10.0 / 3.0)


def test_gap_is_not_filled_and_a_missing_sample_is_not_used(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,v,a\n0,36,0.1\n0.5,36,\n1,36,-\n9,36,2\n")
    recording = read(explained(tmp_path, "a.csv"))
    np.testing.assert_array_equal(channels(recording)[0].valid, [True, False, False, True])
    np.testing.assert_allclose(recording["time"], [0.0, 0.5, 1.0, 9.0])
    assert "2 samples of 'a' are missing" in recording.attrs["provenance"]


WRITABLE = [".csv", ".tsv", ".parquet", ".h5", ".mat", ".mf4", ".tdms"]
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


@pytest.mark.parametrize("suffix", WRITABLE)
@given(st.data())
def test_columns_are_read_back_bit_for_bit(suffix: str, data: st.DataObject) -> None:
    count = data.draw(st.integers(2, 6))
    row = st.lists(numbers | st.just(float("nan")), min_size=count, max_size=count)
    columns = {
        name: np.array(data.draw(row))
        for name in data.draw(st.lists(st.from_regex("[a-z]{1,9}", fullmatch=True), min_size=1,
                                       max_size=3, unique=True))
        if name != "time"
    }  # fmt: skip
    columns = {"time": np.arange(float(count))} | columns
    flags = np.array(data.draw(st.lists(st.booleans(), min_size=count, max_size=count)))
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        write_columns(path, columns | {"Good": flags}, dict.fromkeys(columns, "m/s2"))
        back = read_columns(path, list(columns), ["Good"])
        if suffix not in {".csv", ".tsv", ".mat"}:
            assert all(
                one.unit == "m/s2" for one in headings(path) if one.name not in {"Good", "time"}
            )
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)
    np.testing.assert_array_equal(back["Good"], flags)


@pytest.mark.parametrize("suffix", WRITABLE)
def test_a_recording_is_read_back_from_every_format(tmp_path: Path, suffix: str) -> None:
    valid = np.array([True, True, False, True])
    floor = Channel("floor", np.where(valid, FLOOR, np.nan), "vertical acceleration", "body", 6.9,
                    valid=valid)  # fmt: skip
    recording = build_recording([floor], time=TIME, speed=np.full(4, 10.0), line="a line")
    path = tmp_path / f"run{suffix}"
    assert write(recording, path) == (path, tmp_path / "run.toml")
    back = read(path).assign_attrs(provenance=recording.attrs["provenance"])
    expected = recording.assign_attrs(identity=recording_identity(recording))
    xr.testing.assert_identical(back, expected)


def test_a_name_invalid_in_matlab_is_refused_and_no_file_remains(tmp_path: Path) -> None:
    floor = Channel("floor acc", FLOOR, "vertical acceleration", "body", 6.9)
    recording = build_recording([floor], time=TIME, speed=np.full(4, 10.0))
    with pytest.raises(DataError, match="a name in MATLAB has up to 31 letters"):
        write(recording, tmp_path / "run.mat")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("suffix", "library"), [(".mf4", "asammdf"), (".tdms", "nptdms")])
def test_a_missing_library_is_named_with_its_installation_command(
    tmp_path: Path, suffix: str, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / f"{library}.py").write_text("raise ImportError", encoding="utf-8")
    monkeypatch.delitem(sys.modules, library, raising=False)
    monkeypatch.syspath_prepend(hidden)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(hidden), *sys.path]))
    (tmp_path / f"a{suffix}").write_bytes(b"anything")
    subprocess_reader.stop_worker()
    try:
        with pytest.raises(FileError, match=r"install it: pip install 'trackprofile\["):
            read(explained(tmp_path, f"a{suffix}"))
    finally:
        subprocess_reader.stop_worker()


@pytest.mark.parametrize("suffix", LOGGER_SUFFIXES)
@pytest.mark.parametrize("contents", [b"\x00\x9f\xff\x01" * 99, b"MDF     4.10", b"TDSm" * 20])
def test_a_file_of_another_format_is_refused_in_one_sentence(
    tmp_path: Path, suffix: str, contents: bytes
) -> None:
    (tmp_path / f"a{suffix}").write_bytes(contents)
    with pytest.raises((FileError, DataError)) as caught:
        read(explained(tmp_path, f"a{suffix}"))
    assert "\n" not in str(caught.value)

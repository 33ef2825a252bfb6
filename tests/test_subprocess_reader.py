"""A file that crashes, hangs or fills whoever reads it harms the process apart only."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from trackprofile.errors import DataError, FileError
from trackprofile.io import subprocess_reader
from trackprofile.io.column_info import ColumnInfo

BEHAVIOUR = """
import os, time
import numpy as np
from trackprofile.errors import DataError, FileError
from trackprofile.io.column_info import ColumnInfo

def headings_in_process(path):
    return [ColumnInfo("a", "m", 3, "t")]

def read_in_process(path, names):
    what = path.read_text()
    if what == "crash":
        os.abort()
    if what == "hang":
        time.sleep(1000)
    if what == "fill":
        bytearray(1 << 33)
    if what == "refuse":
        raise FileError(f"{path}: no rows of numbers; choose another file.")
    if what == "text":
        raise DataError(f"{path}: column 'a' does not hold numbers.")
    if what == "crash once" and not path.with_name("crashed").exists():
        path.with_name("crashed").write_text("")
        os.abort()
    print("what libraries print is no answer")
    long = np.arange(300_000.0)
    every = {"long": long, "none": long[:0], "odd": np.array([np.nan, -0.0, 5e-324]), "as well": -long}
    return {name: every[name] for name in names}
"""


@pytest.fixture(autouse=True)
def _behaving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "behaving.py").write_text(BEHAVIOUR, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    # A worker that another test has left does not know this module.
    subprocess_reader.stop_worker()


def tried(folder: Path, what: str, *names: str) -> dict[str, np.ndarray]:
    file = folder / "file with a\ttab\nand more"
    file.write_text(what, encoding="utf-8")
    return subprocess_reader.columns_in_subprocess(file, "behaving", names)


def test_columns_are_read_back_bit_for_bit(tmp_path: Path) -> None:
    found = tried(tmp_path, "good", "long", "none", "odd", "as well")
    assert list(found) == ["long", "none", "odd", "as well"]
    np.testing.assert_array_equal(found["long"], np.arange(300_000.0))
    np.testing.assert_array_equal(found["as well"], -found["long"])
    assert found["none"].shape == (0,)
    odd = np.array([np.nan, -0.0, 5e-324])
    np.testing.assert_array_equal(found["odd"].view(np.uint64), odd.view(np.uint64))


def test_column_information_is_returned_unchanged(tmp_path: Path) -> None:
    assert subprocess_reader.headings_in_subprocess(tmp_path, "behaving") == (
        ColumnInfo("a", "m", 3, "t"),
    )


def test_a_worker_damaged_by_an_earlier_file_is_replaced(tmp_path: Path) -> None:
    tried(tmp_path, "good")
    assert list(tried(tmp_path, "crash once", "odd")) == ["odd"]


@pytest.mark.parametrize("what", ["crash", "fill"])
def test_a_file_that_crashes_the_worker_is_refused_and_the_next_one_read(
    what: str, tmp_path: Path
) -> None:
    tried(tmp_path, "good")
    with pytest.raises(FileError, match="damaged, reading it crashed or exceeded the limits"):
        tried(tmp_path, what)
    tried(tmp_path, "good")


def test_reading_stops_at_the_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried(tmp_path, "good")
    monkeypatch.setattr(subprocess_reader, "TIME_LIMIT", 0.5)
    started = time.monotonic()
    with pytest.raises(FileError, match="damaged, reading it crashed or exceeded the limits"):
        tried(tmp_path, "hang")
    assert time.monotonic() - started < 10.0


def test_errors_of_the_worker_are_raised_in_this_process(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no rows of numbers; choose another file"):
        tried(tmp_path, "refuse")
    with pytest.raises(DataError, match="column 'a' does not hold numbers"):
        tried(tmp_path, "text")
    tried(tmp_path, "good")

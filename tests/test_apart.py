"""A file that crashes, hangs or fills whoever reads it harms the process apart only."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from trackprofile.errors import FileError
from trackprofile.io import apart

BEHAVIOUR = """
import os, time
from trackprofile.errors import FileError

def walk(path):
    what = path.read_text()
    if what == "crash":
        os.abort()
    if what == "hang":
        time.sleep(1000)
    if what == "fill":
        bytearray(1 << 33)
    if what == "refuse":
        raise FileError(f"{path}: no rows of numbers; choose another file.")
    print("what libraries print is no answer")
"""


@pytest.fixture(autouse=True)
def _behaving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "behaving.py").write_text(BEHAVIOUR, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    # A worker that another test has left does not know this module.
    for worker in list(apart._workers):
        apart._end(worker)


def tried(folder: Path, what: str) -> None:
    file = folder / "file with a space"
    file.write_text(what, encoding="utf-8")
    apart.tried_apart(file, "behaving")


@pytest.mark.parametrize("what", ["crash", "fill"])
def test_a_file_that_kills_its_reader_is_refused_and_the_next_one_read(
    what: str, tmp_path: Path
) -> None:
    tried(tmp_path, "good")
    with pytest.raises(FileError, match="damaged so that it cannot be read to its end"):
        tried(tmp_path, what)
    tried(tmp_path, "good")


def test_a_file_that_never_ends_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried(tmp_path, "good")
    monkeypatch.setattr(apart, "PATIENCE", 0.5)
    started = time.monotonic()
    with pytest.raises(FileError, match="damaged so that it cannot be read to its end"):
        tried(tmp_path, "hang")
    assert time.monotonic() - started < 10.0


def test_what_the_reader_refuses_is_said_here(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no rows of numbers; choose another file"):
        tried(tmp_path, "refuse")
    tried(tmp_path, "good")

"""`trackprofile fuse`: passes from files and from a store, and what it refuses in one sentence."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from conftest import Run
from passing_trains import FIRST, Line, Train, fleet, passing
from trackprofile import read, write
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import resample
from trackprofile.contracts import build_profile
from trackprofile.fusion.fuse import fuse

LINE = Line(length=500.0, seed=5, settled=0.002, at=250.0)
LAST = (FIRST + timedelta(days=30)).isoformat()
STORED = ("--line", "Main", "--direction", "up")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With three passes of a line, one of other track, and one that does not say how sure it is."""
    there = tmp_path_factory.mktemp("passes")
    for number, train in enumerate(fleet(3, seed=5)):
        profile = passing(LINE, train).profile
        write(profile.assign_attrs(recording=64 * str(number)), there / f"{number}.nc")
    write(passing(Line(length=500.0, seed=99), Train()).profile, there / "other.nc")
    profile = passing(LINE, fleet(3, seed=5)[-1]).profile
    point = build_profile(profile["distance"], profile["elevation"], kind="point")
    write(point, there / "vague.nc")
    return there


def dated(folder: Path) -> list[str]:
    days = [(FIRST + timedelta(days=15 * number)).isoformat() for number in range(3)]
    return [f"{folder / f'{number}.nc'}={day}" for number, day in enumerate(days)]


def test_passes_are_fused_and_what_was_found_is_one_object(
    run: Run, folder: Path, tmp_path: Path
) -> None:
    code, said, _ = run("fuse", *dated(folder), "-o", tmp_path / "line.nc", "--json")
    found = json.loads(said)
    assert code == 0
    first, *_, moves = found["summary"]
    assert first.startswith(f"Level of {LAST}, ")
    assert f"from 3 passes of 3 vehicles from {FIRST} to {LAST}." in first
    assert " m (D1, -" in moves
    assert [one["name"] for one in found["passes"]] == ["0.nc", "1.nc", "2.nc"]
    assert (found["contradictions"], found["day"]) == ([], LAST)
    written = read(tmp_path / "line.nc")
    assert written["rate"].attrs["units"] == "m/day"
    assert written.attrs["method"] == "fusion of 3 passes"


def test_one_pass_is_said_to_be_alone(run: Run, folder: Path, tmp_path: Path) -> None:
    code, said, notes = run("fuse", dated(folder)[0], "-o", tmp_path / "line.nc")
    assert code == 0
    assert said.startswith(f"Level of {FIRST}, ")
    assert f"from 1 pass of 1 vehicle of {FIRST}." in said
    assert "There is one pass only: its profile is returned unchanged, without a rate." in notes


@pytest.mark.acceptance
def test_passes_out_of_a_store_make_the_same_and_what_was_fused_is_no_pass(
    run: Run, folder: Path, tmp_path: Path
) -> None:
    store = tmp_path / "S"
    to = ("--store", store, *STORED)
    for one in dated(folder):
        path, day = one.split("=")
        code, _, said = run("store", "add", path, *to, "--date", day, "--speed", "140 km/h")
        assert code == 0, said
    run("fuse", *dated(folder), "-o", tmp_path / "files.nc")
    assert run("fuse", *to, "-o", tmp_path / "once.nc")[0] == 0
    files, once = (read(tmp_path / one) for one in ("files.nc", "once.nc"))
    # A store has its own points along the line.
    here = files["distance"].to_numpy()[40:-40]
    apart = files["elevation"][40:-40] - resample(once["distance"], once["elevation"], here)
    assert np.sqrt(np.mean(apart**2)) < 0.1 * float(files["standard_deviation_D1"].median())
    rates = [name for name in once.data_vars if str(name).startswith("rate")]
    write(once.drop_vars(rates), tmp_path / "level.nc")
    more = ("--date", LAST, "--run", "fused", "--speed", "140 km/h")
    code, _, said = run("store", "add", tmp_path / "level.nc", *to, *more)
    assert code == 0, said
    assert run("fuse", *to, "-o", tmp_path / "twice.nc")[0] == 0
    xr.testing.assert_equal(once, read(tmp_path / "twice.nc"))


@pytest.mark.parametrize("name", ["line.nc", "line.csv", "line.parquet"])
def test_a_line_keeps_its_rate_in_every_format_and_is_no_pass(
    run: Run, folder: Path, tmp_path: Path, name: str
) -> None:
    given = [read(folder / f"{number}.nc") for number in range(3)]
    days = [FIRST + timedelta(days=15 * number) for number in range(3)]
    passes = [DatedProfile(one, day, str(day)) for one, day in zip(given, days, strict=True)]
    made = fuse(passes).profile
    line = tmp_path / name
    write(made, line)
    xr.testing.assert_equal(read(line), made)
    assert read(line).attrs["method"].startswith("fusion of")
    to = ("--store", tmp_path / "S", *STORED, "--date", LAST, "--speed", "140 km/h", "--run", "1")
    code, _, said = run("store", "add", line, *to)
    assert code == 1
    assert "a store keeps single passes" in said
    code, _, said = run("fuse", dated(folder)[0], f"{line}={LAST}", "-o", tmp_path / "again.nc")
    assert code == 1
    assert "give the passes themselves" in said


def test_a_line_that_a_store_does_not_know_has_no_pass(
    run: Run, folder: Path, tmp_path: Path
) -> None:
    path, day = dated(folder)[0].split("=")
    to = ("--store", tmp_path / "S", "--direction", "up", "--line")
    run("store", "add", path, *to, "Main", "--date", day, "--speed", "140 km/h")
    code, _, said = run("fuse", *to, "Branch", "-o", tmp_path / "x.nc")
    assert code == 1
    assert "no pass of line 'Branch', direction 'up'" in said


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["gone.nc=2026-05-02"], "the file does not exist"),
        (["0.nc=2026-05-02"], "Two passes have the name '0.nc'"),
        (["0.nc"], "expected a profile and its date"),
        (["other.nc=2026-05-02"], "At most half of the 2 passes correlate with one another"),
        (["vague.nc=2026-05-02"], "the profile does not state its standard deviation"),
        (["1.nc=2026-05-16", "--date", "31.5.2026"], "expected a date such as 2026-05-31"),
        (["1.nc=2026-05-16", "--from", "5000"], "choose a stretch inside it"),
    ],
)
def test_what_cannot_be_fused_is_refused_in_one_sentence(
    run: Run, folder: Path, tmp_path: Path, more: list[str], words: str
) -> None:
    given = [str(folder / one) if ".nc" in one else one for one in more]
    code, out, said = run("fuse", dated(folder)[0], *given, "-o", tmp_path / "x.nc")
    assert (code, out) == (1, "")
    assert said.startswith("trackprofile: ")
    assert said.count("\n") == 1
    assert words in said
    assert not list(tmp_path.iterdir())


def test_a_store_that_is_not_there_is_not_begun(run: Run, tmp_path: Path) -> None:
    code, _, said = run("fuse", "--store", tmp_path / "S", *STORED, "-o", tmp_path / "x.nc")
    assert code == 1
    assert "there is no store" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [(), ("a.nc=2026-05-01", "--store", "S"), ("--store", "S")])
def test_profiles_or_a_store_are_asked_for(run: Run, tmp_path: Path, arguments: tuple[str]) -> None:
    code, _, said = run("fuse", *arguments, "-o", tmp_path / "x.nc")
    assert code == 2
    assert "Give profiles with their dates, or --store" in said

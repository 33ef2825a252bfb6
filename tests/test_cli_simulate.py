"""The command `trackprofile simulate`: what it leaves behind, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from trackprofile.cli import main
from trackprofile.io import read


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(one) for one in arguments])
    return int(left.value.code or 0)


def test_recording_truth_and_pictures_are_left_and_infer_takes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, truth, profile = tmp_path / "run.toml", tmp_path / "truth.csv", tmp_path / "p.nc"
    assert run("simulate", "fra-6-model-b", "-o", recording, "--truth", truth, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["samples"] == read(recording).sizes["sample"]
    assert said["least_contact_force_n"] > 0
    assert {Path(one).name for one in said["files"]} == {
        "run.toml",
        "truth.csv",
        "run.html",
        "run.png",
    }
    arguments = ("--vehicle", "velaro", "--track", "zhai-layered", "--prior", "fra-6", "--correct")
    assert run("infer", recording, "-o", profile, *arguments) == 0
    capsys.readouterr()
    assert run("compare", profile, truth, "--from", 50, "--to", 250, "--json") == 0
    bands = json.loads(capsys.readouterr().out)["bands"]
    # FRA 6 over 200 m: some hundredths of a millimetre (theory, section 7).
    assert bands["D1"]["rms_error_mm"] < 0.02


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("colour = 1\n", "unknown key 'colour'"),
        ('seed = "one"\n', "seed"),
        ("", "vehicle"),
    ],
)
def test_wrong_scenario_leaves_nothing_and_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: str, said: str
) -> None:
    scenario = tmp_path / "mine.toml"
    head = 'vehicle = "velaro"\nsensors = "bogie-25ug"\nsampling = "500 Hz"\n' if wrong else ""
    tail = (
        '[run]\nstart = "0 m"\nend = "9 m"\nspeed = "20 m/s"\n[integration]\nsteps_per_sample = 1\n'
    )
    scenario.write_text(head + wrong + tail)
    assert run("simulate", scenario, "-o", tmp_path / "run.nc", "--truth", tmp_path / "t.nc") == 1
    printed = capsys.readouterr()
    assert said in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert [one.name for one in tmp_path.iterdir()] == ["mine.toml"]


def test_unknown_scenario_names_those_that_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("simulate", "nowhere", "-o", tmp_path / "r.nc", "--truth", tmp_path / "t.nc") == 1
    assert "bell-model-a" in capsys.readouterr().err

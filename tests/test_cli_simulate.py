"""The command `trackprofile simulate`: what it leaves behind, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from trackprofile.cli import main
from trackprofile.reader import read
from trackprofile.scenario import PRESETS


def run(*arguments: object) -> int:
    """Exit code of a command: `main` returns where the command succeeds, and exits otherwise."""
    try:
        main([str(one) for one in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def test_recording_truth_and_pictures_are_left_and_infer_takes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, truth, profile = tmp_path / "run.toml", tmp_path / "truth.csv", tmp_path / "p.nc"
    assert run("simulate", "fra-6-model-b", "-o", recording, "--truth", truth, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["samples"] == read(recording).sizes["sample"]
    assert said["minimum_contact_force_n"] > 0
    assert {Path(one).name for one in said["files"]} == {
        "run.toml",
        "truth.csv",
        "run.html",
        "run.png",
    }
    arguments = (
        "--vehicle",
        "velaro",
        "--track",
        "zhai-layered",
        "--prior",
        "fra-6",
        "--full-track-correction",
    )
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


def test_list_names_what_is_built_in(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("simulate", "--list") == 0
    assert {"bell-model-a", "soft-spot"} <= set(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("output", "truth"), [("a.nc", "./a.nc"), ("a.toml", "a.csv"), ("a.csv", "a.csv")]
)
def test_truth_may_not_take_a_name_of_the_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], output: str, truth: str
) -> None:
    places = ("-o", tmp_path / output, "--truth", f"{tmp_path}/{truth}")
    assert run("simulate", "bell-model-a", *places) == 1
    assert "choose another for the truth" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


BELL = (PRESETS / "bell-model-b.toml").read_text()


def refused(folder: Path, text: str) -> None:
    """See that a scenario is refused with nothing left but itself and what it names."""
    (folder / "mine.toml").write_text(text)
    before = {one.name for one in folder.iterdir()}
    assert (
        run("simulate", folder / "mine.toml", "-o", folder / "r.nc", "--truth", folder / "t.nc")
        == 1
    )
    assert {one.name for one in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('width = "0.5 m"', 'widht = "0.5 m"', "unknown key 'widht'"),
        ('sampling = "500 Hz"', 'sampling = "40 Hz"', "too long for the stiffest mode, at "),
        ('vehicle = "velaro"', 'vehicle = "tram"', "tram: the file does not exist"),
        ('vehicle = "velaro"', 'vehicle = "quarter-car"', "does not have"),
        ('track = "zhai-layered"', 'track = "loose.toml"', "spacing must be above 0"),
        ('vehicle = "velaro"', 'vehicle = "light.toml"', "must be above 0"),
        ('kind = "bell"', 'kind = "file"\npath = "short.csv"', "but the run needs"),
        ('speed = "150 km/h"', 'speed = "-1 km/h"', "speeds above 0"),
    ],
)  # fmt: skip
def test_what_could_not_run_is_refused_in_one_sentence_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, said: str
) -> None:
    track, vehicle = (
        PRESETS.parent / one for one in ("track/zhai-layered.toml", "vehicle/velaro.toml")
    )
    (tmp_path / "loose.toml").write_text(track.read_text().replace("value = 0.545", "value = 0"))
    (tmp_path / "light.toml").write_text(vehicle.read_text().replace("value = 3.5", "value = -1"))
    rows = "\n".join(f"{x},0" for x in range(20))
    (tmp_path / "short.csv").write_text(f"distance_m,elevation_m\n{rows}\n")
    text = BELL.replace(old, new)
    assert text != BELL
    if "short.csv" in text:
        text = text[: text.index("depth = ")]
    refused(tmp_path, text)
    printed = capsys.readouterr()
    assert said in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not printed.out


def test_lift_off_is_a_warning_on_standard_error_and_in_the_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "deep.toml"
    scenario.write_text(BELL.replace("2 mm", "30 mm"))
    places = ("-o", tmp_path / "r.nc", "--truth", tmp_path / "t.nc")
    assert run("simulate", scenario, *places) == 0
    assert "would lift off" in capsys.readouterr().err
    assert run("simulate", scenario, *places, "--json") == 0
    printed = capsys.readouterr()
    assert "would lift off" in json.loads(printed.out)["notes"][0]
    assert not printed.err


def test_seed_of_the_command_replaces_that_of_the_scenario(tmp_path: Path) -> None:
    signals = []
    for number, seed in enumerate((1, 1, 2)):
        places = ("-o", tmp_path / f"{number}.nc", "--truth", tmp_path / "t.nc")
        assert run("simulate", "bell-model-a", *places, "--seed", seed) == 0
        signals.append(read(tmp_path / f"{number}.nc")["bogie_acceleration"].to_numpy())
    assert (signals[0] == signals[1]).all()
    assert (signals[0] != signals[2]).any()


def test_measured_recording_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measured = tmp_path / "run.csv"
    measured.write_text("time_s\n0\n")
    places = ("-o", tmp_path / "run.toml", "--truth", tmp_path / "t.nc")
    assert run("simulate", "bell-model-a", *places) == 1
    assert "was not simulated" in capsys.readouterr().err
    assert measured.read_text() == "time_s\n0\n"
    measured.unlink()
    assert run("simulate", "bell-model-a", *places) == 0
    assert run("simulate", "bell-model-a", *places) == 0  # what was simulated may be made again

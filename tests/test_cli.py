from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from conftest import Run
from trackprofile import __version__, read, write
from trackprofile.demo import simulated
from trackprofile.io.model_toml import (
    read_sensors,
    read_spectrum,
    read_track,
    read_vehicle,
    write_vehicle,
)
from trackprofile.models.receptance import point_track
from trackprofile.models.vehicle import parameter_values, with_parameters


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of 170 m, the truth, and the vehicle that the recording names."""
    folder = tmp_path_factory.mktemp("made")
    vehicle, installation = read_vehicle("velaro")
    recording, truth = simulated(
        vehicle,
        point_track(read_track("rigid")),
        read_sensors("bogie-25ug"),
        read_spectrum("german-low"),
        length=170.0,
        seed=3,
    )
    write(recording, folder / "recording.toml")
    write(truth, folder / "truth.csv")
    write_vehicle(vehicle, installation, folder / "vehicle.toml")
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of it, to spoil."""
    return Path(shutil.copytree(made, tmp_path / "copy"))


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


# --- the command itself -------------------------------------------------------------------------


def test_help_answers_within_half_a_second_and_loads_nothing_heavy() -> None:
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "trackprofile", "--help"], check=True, stdout=subprocess.DEVNULL
        )
        taken.append(time.perf_counter() - start)
    assert min(taken) < 0.5
    code = "import sys, trackprofile.cli; print(*sorted(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert not {"numpy", "xarray", "pydantic", "numba"} & set(loaded.stdout.split())


def test_the_version_is_that_of_the_package(run: Run) -> None:
    assert run("--version") == (0, f"trackprofile {__version__}\n", "")


@pytest.mark.parametrize(
    "arguments",
    [
        ("infre", "recording.toml"),
        ("infer", "recording.toml"),
        ("infer", "recording.toml", "-o", "profile.nc", "--method", "magic"),
        ("infer", "recording.toml", "-o", "profile.nc", "--from", "here"),
        ("accuracy", "--vehicle", "velaro", "--sensors", "bogie-25ug"),
        ("compare", "profile.nc"),
    ],
)
def test_wrong_usage_exits_with_2(run: Run, arguments: tuple[str, ...]) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert "Usage" in err


# --- infer and compare --------------------------------------------------------------------------


def test_infer_finds_the_profile_and_shows_it(run: Run, folder: Path) -> None:
    profile = folder / "found.nc"
    before = set(folder.iterdir())
    code, out, err = run(
        "infer", folder / "recording.toml", "-o", profile, "--samples", "8", "--json"
    )
    assert code == 0, err
    result = json.loads(out)
    assert [Path(name) for name in result["files"]] == [
        profile,
        folder / "found.html",
        folder / "found.png",
    ]
    assert set(folder.iterdir()) - before == set(map(Path, result["files"]))
    assert result["standard_deviation_mm"]["D1"] < 0.1
    assert (
        read(profile).attrs["loading"] == "loaded"
    )  # the path of the wheels, for the track is rigid
    assert (folder / "found.png").read_bytes().startswith(b"\x89PNG")
    assert "plotly" in (folder / "found.html").read_text(encoding="utf-8").lower()

    code, out, err = run("compare", profile, folder / "truth.csv", "--from", "30", "--json")
    compared = json.loads(out)
    assert code == 0
    assert set(compared) == {"bands", "from_m", "to_m"}
    assert compared["from_m"] == 30.0
    assert compared["bands"]["D1"]["correlation"] > 0.999
    assert compared["bands"]["D1"]["rms_error_mm"] < 0.05
    assert compared["bands"]["D3"] is None
    assert "D3" in err


def test_infer_keeps_to_the_stretch_and_says_what_it_did(run: Run, folder: Path) -> None:
    profile = folder / "part.csv"
    arguments = ("--from", "60", "--to", "150", "--samples", "4", "--prior", "german-low")
    code, out, _ = run("infer", folder / "recording.toml", "-o", profile, *arguments)
    assert code == 0
    assert f"Profile from 60 m to 150 m in {profile}." in out
    distance = read(profile)["distance"].to_numpy()
    assert 60.0 <= distance[0] < 61.0
    assert 149.0 < distance[-1] <= 150.0


def test_cross_entropy_is_a_method_of_infer(run: Run, tmp_path: Path) -> None:
    made, profile = tmp_path / "bell.nc", tmp_path / "profile.nc"
    assert run("simulate", "bell-model-a", "-o", made, "--truth", tmp_path / "truth.nc")[0] == 0
    asked = ("infer", made, "--method", "cross-entropy", "-o", profile, "--json")
    code, out, _ = run(*asked, "--search", "table-5", "--seed", 4)
    said = json.loads(out)
    assert code == 0
    assert said["method"] == "cross-entropy"
    assert said["standard_deviation_mm"] == {}
    assert said["phases"] == 159
    assert said["flagged_share"]["unconverged"] == 0.0
    assert read(profile).attrs["kind"] == "point"


@pytest.mark.parametrize(
    ("method", "option"),
    [
        ("smoother", "--search=table-5"),
        ("cross-entropy", "--prior=fra-4"),
        ("cross-entropy", "--full-track-correction"),
    ],
)
def test_an_option_of_the_other_method_is_refused(
    run: Run, folder: Path, method: str, option: str
) -> None:
    output = folder / "profile.nc"
    asked = ("infer", folder / "recording.toml", "-o", output, f"--method={method}", option)
    code, _, error = run(*asked)
    assert code == 1
    assert "has no effect" in error
    assert not output.exists()


def test_a_profile_agrees_with_itself(run: Run, made: Path) -> None:
    code, out, _ = run("compare", made / "truth.csv", made / "truth.csv", "--json")
    assert code == 0
    for name in ("D1", "D2"):
        band = json.loads(out)["bands"][name]
        assert band["correlation"] == pytest.approx(1.0, abs=1e-12)
        assert band["rms_error_mm"] == pytest.approx(0.0, abs=1e-9)
        assert (band["gain"], band["lag_m"]) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-6))


def test_the_table_of_compare_has_a_line_per_band(run: Run, made: Path) -> None:
    code, out, err = run("compare", made / "truth.csv", made / "truth.csv")
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "From -19 m to 170 m:"
    assert [line.split()[0] for line in lines[1:]] == ["band", "D1", "D2", "D3"]
    assert len(err.splitlines()) == 1  # D3 needs more track


# --- calibrate ----------------------------------------------------------------------------------


def test_calibrate_finds_a_wrong_parameter_and_infer_takes_what_it_writes(
    run: Run, folder: Path
) -> None:
    right, installation = read_vehicle("velaro")
    wrong = with_parameters(right, {"primary stiffness": 2.0e6})
    write_vehicle(wrong, installation, folder / "start.toml")
    code, out, err = run(
        *("calibrate", folder / "recording.toml", "--reference", folder / "truth.csv"),
        *("--vehicle", folder / "start.toml", "-o", folder / "found.toml"),
        *("--parameter", "primary stiffness", "--json"),
    )
    assert code == 0, err
    result = json.loads(out)
    found = result["parameters"]["primary stiffness"]
    assert found["value"] == pytest.approx(2.4e6, rel=0.02)
    assert found["start"] == pytest.approx(2.0e6, rel=1e-12)
    assert 0 < found["standard_error"] < 0.02 * 2.4e6
    vehicle, _ = read_vehicle(folder / "found.toml")
    assert parameter_values(vehicle)["primary stiffness"] == found["value"]
    assert parameter_values(vehicle)["body mass"] == 47_800.0
    arguments = ("--vehicle", folder / "found.toml", "-o", folder / "p.nc", "--samples", "4")
    assert run("infer", folder / "recording.toml", *arguments)[0] == 0


def test_calibrate_refuses_a_parameter_that_is_not_there(run: Run, folder: Path) -> None:
    code, out, err = run(
        *("calibrate", folder / "recording.toml", "--reference", folder / "truth.csv"),
        *("--vehicle", "velaro", "-o", folder / "found.toml", "--parameter", "colour"),
    )
    assert (code, out) == (1, "")
    assert "'colour'" in err
    assert "body mass" in err
    assert not (folder / "found.toml").exists()


# --- accuracy -----------------------------------------------------------------------------------


def test_the_limit_grows_with_the_noise_and_with_the_wavelength(run: Run) -> None:
    limits = {}
    for sensors in ("bogie-25ug", "bogie-100ug"):
        code, out, _ = run(
            *("accuracy", "--vehicle", "velaro", "--speed", "150 km/h"),
            *("--sensors", sensors, "--prior", "fra-6", "--json"),
        )
        assert code == 0
        limits[sensors] = json.loads(out)["accuracy_bound_mm"]
    fine, coarse = limits["bogie-25ug"], limits["bogie-100ug"]
    assert fine["D1"] < fine["D2"] < fine["D3"]
    assert all(fine[band] < coarse[band] for band in fine)
    # theory, section 8
    assert fine["D1"] == pytest.approx(0.0023, rel=0.15)
    assert coarse["D2"] == pytest.approx(0.029, rel=0.15)


@pytest.mark.parametrize(
    ("speed", "words"),
    [("150", "km/h"), ("150 kg", "km/h"), ("0 km/h", "above zero"), ("fast", "km/h")],
)
def test_a_speed_that_is_none_is_refused(run: Run, speed: str, words: str) -> None:
    arguments = ("--vehicle", "velaro", "--sensors", "bogie-25ug", "--speed", speed)
    code, out, err = run("accuracy", *arguments)
    assert (code, out) == (1, "")
    assert repr(speed) in err or "'kg'" in err
    assert words in err


# --- bench --------------------------------------------------------------------------------------


@pytest.mark.acceptance
def test_bench_measures_the_figures_that_the_readme_quotes(run: Run) -> None:
    code, out, _ = run("bench", "--json")
    assert code == 0
    result = json.loads(out)
    figures = {one["name"]: (one["value"], one["unit"]) for one in result["results"]}
    assert list(figures) == [
        "model_a_us_per_step",
        "model_b_us_per_step",
        "model_b_10_km_over_100_m",
        "cross_entropy_a_literal_s_per_m",
        "cross_entropy_a_covariance_s_per_m",
        "cross_entropy_b_literal_s_per_m",
        "cross_entropy_b_covariance_s_per_m",
        "smoother_ms_per_m",
        "smoother_with_variance_ms_per_m",
        "memory_mb_per_km",
        "report_50_km_s",
        "report_50_km_peak_mb",
        "report_50_km_page_mb",
        "help_s",
    ]
    assert all(value > 0 for value, _ in figures.values())
    assert figures["smoother_ms_per_m"][0] < figures["smoother_with_variance_ms_per_m"][0]
    assert result["machine"]


# --- bad input ----------------------------------------------------------------------------------


def rows(folder: Path, change: Callable[[list[str]], list[str]]) -> None:
    file = folder / "recording.csv"
    file.write_text("\n".join(change(file.read_text().splitlines())) + "\n")


def cells(folder: Path, column: int, row: int, text: str) -> None:
    def change(lines: list[str]) -> list[str]:
        parts = lines[row].split(",")
        parts[column] = text
        return [*lines[:row], ",".join(parts), *lines[row + 1 :]]

    rows(folder, change)


SPOILED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "a missing column": (
        lambda folder: replace(folder / "recording.csv", "bogie_pitch_rate", "gyro"),
        ("'bogie_pitch_rate' is missing",),
    ),
    "a unit that does not fit": (
        lambda folder: replace(folder / "recording.toml", '"rad/s"', '"m/s"'),
        ("'m/s'", "°/s"),
    ),
    "an unknown key": (
        lambda folder: replace(folder / "recording.toml", "noise_density", "noise_desnity"),
        ("'noise_desnity'", "noise_density"),
    ),
    "a word for a number": (
        lambda folder: cells(folder, 2, 7, "much"),
        ("data row 7", "expected a number, got 'much'"),
    ),
    "a clock that stands still": (
        lambda folder: rows(
            folder, lambda lines: [lines[0], *("0" + line[line.index(",") :] for line in lines[1:])]
        ),
        ("The time never increases",),
    ),
    "a negative speed": (lambda folder: cells(folder, 1, 5, "-3.0"), ("data row 5", "speed")),
    "a file cut short": (
        lambda folder: rows(folder, lambda lines: [*lines[:50], "0.2,3"]),
        ("data row 50", "cut short"),
    ),
    "an empty file": (lambda folder: (folder / "recording.csv").write_text(""), ("is empty",)),
    "no data file": (
        lambda folder: (folder / "recording.csv").unlink(),
        ("data file", "does not exist"),
    ),
    "no vehicle named": (
        lambda folder: replace(folder / "recording.toml", 'vehicle = "vehicle.toml"\n', ""),
        ("--vehicle", "velaro", "quarter-car"),
    ),
    "a vehicle that is not there": (
        lambda folder: (folder / "vehicle.toml").unlink(),
        ("vehicle.toml", "does not exist"),
    ),
    "a vehicle without the sensor's body": (
        lambda folder: replace(folder / "recording.toml", '"leading bogie"', '"tender"'),
        ("'tender'", "leading bogie"),
    ),
    "a recording shorter than the vehicle": (
        lambda folder: rows(folder, lambda lines: lines[:120]),
        ("covers 14", "longer stretch"),
    ),
}


def test_what_can_be_mended_is_mended_and_said(run: Run, folder: Path) -> None:
    cells(folder, 2, 7, "")
    cells(folder, 0, 9, "0.0")
    code, out, err = run("infer", folder / "recording.toml", "-o", folder / "p.nc", "--json")
    assert code == 0
    notes = json.loads(out)["notes"]
    assert any("samples missing" in note for note in notes)
    assert any("the clock jumps" in note for note in notes)
    assert "the clock jumps" in err or not err


@pytest.mark.parametrize("case", SPOILED)
def test_bad_input_gets_one_sentence_and_leaves_no_file(run: Run, folder: Path, case: str) -> None:
    spoil, words = SPOILED[case]
    spoil(folder)
    before = set(folder.iterdir())
    code, out, err = run("infer", folder / "recording.toml", "-o", folder / "p.nc", "--json")
    assert code == 1
    assert len(err.splitlines()) == 1
    assert err.startswith("trackprofile: ")
    assert all(word in err for word in words), err
    assert json.loads(out) == {"error": err.strip().removeprefix("trackprofile: ")}
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("p.docx", ".nc"),
        ("p.toml", ".nc"),
        ("nowhere/p.nc", "nowhere does not exist"),
        ("recording.csv", "is not a profile"),
        ("vehicle.toml", ".nc"),
    ],
)
def test_an_output_that_cannot_be_is_refused_and_nothing_replaced(
    run: Run, folder: Path, output: str, words: str
) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    code, out, err = run("infer", folder / "recording.toml", "-o", folder / output)
    assert (code, out) == (1, "")
    assert words in err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_if_the_page_cannot_be_written_neither_is_the_profile(run: Run, folder: Path) -> None:
    (folder / "p.html").mkdir()
    code, _, err = run("infer", folder / "recording.toml", "-o", folder / "p.nc")
    assert code == 1
    assert "p.html" in err
    assert not (folder / "p.nc").exists()


def test_a_profile_in_place_of_a_recording_is_refused(run: Run, folder: Path) -> None:
    code, _, err = run("infer", folder / "truth.csv", "-o", folder / "p.nc")
    assert code == 1
    assert "expected a recording, this is a profile" in err
    code, _, err = run("compare", folder / "recording.toml", folder / "truth.csv")
    assert code == 1
    assert "expected a profile, this is a recording" in err


def test_a_stop_in_the_middle_is_flagged_and_no_error(run: Run, folder: Path) -> None:
    recording = read(folder / "recording.toml")
    moving = recording["speed"].to_numpy()
    stop = np.zeros(500)
    at = len(moving) // 2
    braked = moving * np.clip(np.abs(np.arange(len(moving)) - at) / 300, 0.02, 1.0)
    speed = np.concatenate([braked[:at], stop, braked[at:]])
    spread = {"sample": np.r_[0:at, np.full(500, at), at : len(moving)]}
    stopped = recording.isel(spread).assign(
        speed=("sample", speed, recording["speed"].attrs),
        time=("sample", np.arange(len(speed)) / 250.0, recording["time"].attrs),
    )
    write(stopped, folder / "stopped.nc")
    arguments = ("--vehicle", "velaro", "-o", folder / "p.nc", "--samples", "4", "--json")
    code, out, err = run("infer", folder / "stopped.nc", *arguments)
    assert code == 0, err
    assert json.loads(out)["flagged_share"]["slow"] > 0

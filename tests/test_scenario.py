"""Scenarios: built-in scenarios run, and invalid ones are rejected before the simulation starts."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from trackprofile.errors import TrackprofileError
from trackprofile.scenario import PRESETS, SimulatedRun, read_scenario, run_scenario, scenarios

BELL = """
vehicle = "velaro"
track = "zhai-layered"
sensors = "bogie-25ug"
sampling = "500 Hz"
[run]
start = "0 m"
end = "30 m"
speed = "150 km/h"
run_in = "20 m"
[integration]
scheme = "newmark"
steps_per_sample = 1
[[irregularity]]
kind = "bell"
depth = "2 mm"
width = "0.5 m"
centre = "10 m"
"""


def put(folder: Path, text: str) -> Path:
    path = folder / "scenario.toml"
    path.write_text(text)
    return path


def run_text(folder: Path, text: str, seed: int | None = None) -> SimulatedRun:
    return run_scenario(read_scenario(put(folder, text), seed))


@pytest.mark.parametrize("name", scenarios())
def test_built_in_scenario_runs_without_lift_off(name: str) -> None:
    result = run_scenario(read_scenario(name))
    assert not result.simulation.notes
    assert result.simulation.contact_force.min() > 0
    sampled = result.recording["distance"].to_numpy()
    truth = result.truth["distance"].to_numpy()
    assert truth[0] <= sampled[0] + 0.25
    assert truth[-1] >= sampled[-1] - 0.25
    assert np.all(np.isfinite(result.truth["elevation"].to_numpy()))


def test_soft_ballast_increases_the_deflection_only_there() -> None:
    deflection = run_scenario(read_scenario("soft-spot")).simulation
    at, deflected = deflection.position, -deflection.rail_deflection[:, 0]
    # The springs of a support are in series: a third of the ballast's stiffness gives 56 % of the support's.
    assert deflected[(at > 71) & (at < 75)].mean() > 1.2 * deflected[at < 65].mean()
    assert deflected[at > 80].mean() == pytest.approx(deflected[at < 65].mean(), rel=0.02)


def test_the_seed_changes_the_noise_only(tmp_path: Path) -> None:
    first, again, other = (
        run_text(tmp_path, BELL, seed).recording["bogie_acceleration"].to_numpy()
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    # 25 µg/√Hz up to 250 Hz is a standard deviation of 3.9 mm/s²; that of the difference of two is √2 larger.
    assert np.std(first - other) == pytest.approx(
        np.sqrt(2) * 25e-6 * 9.80665 * np.sqrt(250), rel=0.1
    )


def test_steps_per_sample_do_not_change_the_sample_positions(tmp_path: Path) -> None:
    coarse, fine = (
        run_text(tmp_path, BELL.replace("steps_per_sample = 1", f"steps_per_sample = {n}"))
        for n in (1, 4)
    )
    np.testing.assert_allclose(
        coarse.recording["distance"].to_numpy(), fine.recording["distance"].to_numpy(), atol=0.09
    )


def test_profile_from_a_file_gives_the_result_of_the_formula(tmp_path: Path) -> None:
    whole = run_text(tmp_path, BELL)
    x = np.arange(-60.0, 60.0, 0.05)
    depth = 2.0 * np.exp(-0.5 * ((x - 10.0) / 0.5) ** 2)
    rows = "\n".join(f"{a:.3f},{-1e-3 * b:.12g}" for a, b in zip(x, depth, strict=True))
    (tmp_path / "level.csv").write_text("distance_m,elevation_m\n" + rows + "\n")
    i = BELL.index("[[irregularity]]")
    again = run_text(tmp_path, BELL[:i] + '[[irregularity]]\nkind = "file"\npath = "level.csv"\n')
    a, b = (one.simulation.contact_force for one in (whole, again))
    # The error of a quintic spline through values every 5 cm is (h/σ)⁴ of the curvature.
    np.testing.assert_allclose(a, b, rtol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('vehicle = "velaro"', 'vehicle = "tram"', "tram: the file does not exist"),
        ('end = "30 m"', 'end = "-1 m"', "end beyond its start"),
        ('speed = "150 km/h"', 'speed = "0 km/h"', "speeds above 0"),
        ('speed = "150 km/h"', 'speed = "150 kg"', "unit 'kg' is not a unit of speed"),
        ('run_in = "20 m"', 'run_in = "2 m"', "run-in of at least 10 m"),
        ("steps_per_sample = 1", "steps_per_sample = 0", "steps_per_sample"),
        ("steps_per_sample = 1", "steps_per_sample = 1\ncolour = 3", "colour"),
        ('scheme = "newmark"', 'scheme = "euler"', "scheme"),
        ('sampling = "500 Hz"', 'sampling = "20 Hz"', "too long for the stiffest mode"),
        ('width = "0.5 m"', 'width = "-0.5 m"', "width"),
        ('kind = "bell"', 'kind = "hole"', "kind"),
        ('width = "0.5 m"', 'widht = "0.5 m"', "irregularity 1: unknown key 'widht'; the keys of this table are"),
        ('width = "0.5 m"', 'width = "0.5 kg"', "width: unit 'kg' is not a unit of length"),
        ('width = "0.5 m"', "width = 0.5", "width: expected text with a number and a unit of length"),
        ('run_in = "20 m"', 'runin = "20 m"', "unknown key 'runin' in run"),
        ('end = "30 m"', 'end = "0.1 m"', "less than two samples"),
        ('sampling = "500 Hz"', 'sampling = "500 Hz"\nseed = -1', "seed"),
        ('sensors = "bogie-25ug"', "", "either the key sensors"),
        ('vehicle = "velaro"', 'vehicle = "quarter-car"', "'quarter-car' does not have"),
        ('"150 km/h"', '[{ time = "0 s", speed = "9 m/s" }, { time = "0 s", speed = "9 m/s" }]', "increasing times"),
    ],
)  # fmt: skip
def test_invalid_scenario_is_rejected(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = BELL.replace(old, new)
    assert text != BELL
    with pytest.raises(TrackprofileError, match=message):
        read_scenario(put(tmp_path, text))


def test_profile_shorter_than_the_run_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "level.csv").write_text(
        "distance_m,elevation_m\n" + "\n".join(f"{x},0" for x in range(20)) + "\n"
    )
    i = BELL.index("[[irregularity]]")
    short = BELL[:i] + '[[irregularity]]\nkind = "file"\npath = "level.csv"\n'
    with pytest.raises(TrackprofileError, match=r"covers 0 m to 19 m, but the run needs -39"):
        read_scenario(put(tmp_path, short))


def test_a_change_needs_a_layered_track(tmp_path: Path) -> None:
    change = '[[change]]\nfield = "pad_stiffness"\nfactor = 0.5\nstart = "0 m"\nend = "1 m"\n'
    with pytest.raises(TrackprofileError, match="needs a layered track"):
        read_scenario(put(tmp_path, BELL.replace("zhai-layered", "rigid") + change))
    with pytest.raises(TrackprofileError, match="use one of pad_stiffness, "):
        read_scenario(put(tmp_path, BELL + change.replace("pad_stiffness", "colour")))


@pytest.mark.parametrize("irregularity", ["irregularity = [3]", "[[irregularity]]\nkind = []"])
def test_invalid_irregularity_is_rejected(tmp_path: Path, irregularity: str) -> None:
    head = BELL[: BELL.index("[run]")]
    tail = BELL[BELL.index("[run]") : BELL.index("[[irregularity]]")]
    text = (
        head + irregularity + "\n" + tail
        if "[[" not in irregularity
        else head + tail + irregularity
    )
    with pytest.raises(TrackprofileError, match="irregularity 1"):
        read_scenario(put(tmp_path, text))


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("vehicle", "value = 3.5", "value = -3.5", "'leading bogie' must be above 0"),
        ("track", "value = 0.545", "value = 0", "spacing must be above 0, got 0"),
        ("track", "value = 125.5", "value = -1", "sleeper mass must be above 0, got -1"),
    ],
)
def test_error_in_a_file_of_the_scenario_names_the_file(
    tmp_path: Path, file: str, old: str, new: str, message: str
) -> None:
    preset = {"vehicle": "velaro", "track": "zhai-layered"}[file]
    whole = (PRESETS.parent / file / f"{preset}.toml").read_text()
    (tmp_path / "mine.toml").write_text(whole.replace(old, new))
    text = BELL.replace(f'{file} = "{preset}"', f'{file} = "mine.toml"')
    with pytest.raises(TrackprofileError, match=f"mine.toml: .*{message}"):
        read_scenario(put(tmp_path, text))


@pytest.mark.parametrize("scheme", ["newmark", "wilson"])
def test_a_profile_that_covers_exactly_the_needed_range_is_accepted(
    tmp_path: Path, scheme: str
) -> None:
    i = BELL.index("[[irregularity]]")
    text = BELL[:i].replace("newmark", scheme) + '[[irregularity]]\nkind = "file"\npath = "l.csv"\n'

    def levels(first: float, last: float) -> str:
        x = np.linspace(first, last, 500)
        return "distance_m,elevation_m\n" + "\n".join(f"{one!r},0" for one in x.tolist()) + "\n"

    (tmp_path / "l.csv").write_text(levels(0.0, 1.0))
    with pytest.raises(TrackprofileError, match="but the run needs") as caught:
        read_scenario(put(tmp_path, text))
    needed = re.search(r"needs (\S+) m to (\S+) m;", str(caught.value))
    assert needed is not None
    first, last = float(needed[1]), float(needed[2])
    assert first <= -20.0 - 19.875
    (tmp_path / "l.csv").write_text(levels(first - 1e-3, last + 1e-3))
    assert run_text(tmp_path, text).simulation.contact_force.min() > 0


def test_sensors_can_be_given_in_the_scenario(tmp_path: Path) -> None:
    sensor = """
[[sensor]]
name = "floor"
quantity = "vertical acceleration"
body = "body"
position = 6.0
unit = "m/s²"
range = 20
"""
    recording = run_text(tmp_path, BELL.replace('sensors = "bogie-25ug"\n', "") + sensor).recording
    assert recording["floor"].attrs["position"] == 6.0
    assert 1e-4 < np.abs(recording["floor"].to_numpy()).max() < 1.0
    with pytest.raises(TrackprofileError, match="either the key sensors"):
        read_scenario(put(tmp_path, BELL + sensor))


def test_recording_states_that_it_is_simulated_and_its_vehicle(tmp_path: Path) -> None:
    recording = run_text(tmp_path, BELL).recording
    assert "no train measured this" in recording.attrs["source"]
    assert recording.attrs["vehicle"] == "velaro"


def test_truth_begins_where_the_irregularity_has_its_full_size(tmp_path: Path) -> None:
    # The irregularity grows over the first 10 m of the run-in of 20 m; the car is longer.
    assert run_text(tmp_path, BELL).truth["distance"].to_numpy()[0] == -10.0


def test_lift_off_is_noted(tmp_path: Path) -> None:
    notes = run_text(tmp_path, BELL.replace("2 mm", "30 mm")).simulation.notes
    assert "first at 'wheel 1'" in notes[0]

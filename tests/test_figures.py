"""Figures: what they draw agrees with the profile and the recording."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from narrowing import not_none
from trackprofile.bands import D1, band_pass
from trackprofile.errors import DataError
from trackprofile.reporting.figures import (
    interactive_profile_figure,
    interactive_simulation_figure,
    static_profile_figure,
    static_simulation_figure,
    write_html,
    write_png,
)
from trackprofile.reporting.figures.chart import MAX_POINTS, extremes, profile_chart
from trackprofile.reporting.figures.simulation_figure import simulation_chart
from trackprofile.simulation.simulate import Simulation

DISTANCE = np.arange(0.0, 500.0, 0.25)
LEVEL = 2e-3 * np.sin(2 * np.pi * DISTANCE / 10) + 3e-3 * np.sin(2 * np.pi * DISTANCE / 40)
DEVIATION = 1e-3 + 1e-6 * DISTANCE


def a_profile(distance=DISTANCE, level=LEVEL, **variables):
    named = {name: ("distance", values) for name, values in variables.items()}
    return xr.Dataset(
        {"elevation": ("distance", level), **named},
        coords={"distance": distance},
        attrs={"kind_of_data": "profile", "method": "smoother", "kind": "posterior"},
    )


def a_recording():
    signal = np.cos(2 * np.pi * DISTANCE / 10)
    acceleration = {
        "units": "m/s2",
        "quantity": "vertical acceleration",
        "body": "body",
        "position": 6.9,
    }
    rate = {"units": "rad/s", "quantity": "pitch rate", "body": "leading bogie", "position": -1.0}
    valid = np.ones(DISTANCE.size, bool)
    return xr.Dataset(
        {
            "time": ("sample", DISTANCE / 20),
            "distance": ("sample", DISTANCE),
            "speed": ("sample", np.full(DISTANCE.size, 20.0)),
            "a": ("sample", signal, acceleration),
            "a_valid": ("sample", valid & (DISTANCE < 400)),
            "q": ("sample", 0.01 * signal, rate),
            "q_valid": ("sample", valid),
        },
        attrs={"kind_of_data": "recording", "line": "a line", "direction": "", "source": ""},
    )


STATED = a_profile(standard_deviation=DEVIATION, standard_deviation_D1=DEVIATION / 5)
REPRODUCED = {"a": 0.9 * a_recording()["a"].to_numpy(), "q": a_recording()["q"].to_numpy()}


def test_interactive_figure_has_a_panel_for_each_band_and_two_for_each_sensor():
    figure: Any = interactive_profile_figure(STATED, a_recording(), reproduced=REPRODUCED)
    names = [trace.name for trace in figure.data]
    assert names == [
        *["95 % interval", "elevation"] * 2,
        "elevation",
        *["measured", "reproduced", "residual"] * 2,
    ]
    text = " ".join(note.text for note in figure.layout.annotations)
    for words in ("Elevation", "long wavelengths dominate", "D1, 3 to 25 m", "D2, 25 to 70 m"):
        assert words in text
    assert "body, 6.9 m ahead of its centre" in text
    assert "leading bogie, 1 m behind its centre" in text
    units = [figure.layout[f"yaxis{row}"].title.text for row in ("", 2, 3, 4, 5, 6, 7)]
    assert units == ["mm", "mm", "mm", "m/s²", "m/s²", "mrad/s", "mrad/s"]
    assert figure.layout.title.text == "<b>Track profile, a line, 0 to 500 m</b>"


def test_static_figure_has_the_same_panels_as_the_interactive_one():
    interactive: Any = interactive_profile_figure(STATED, a_recording(), reproduced=REPRODUCED)
    static = static_profile_figure(STATED, a_recording(), reproduced=REPRODUCED)
    titles = [f"<b>{a.get_title('left')}</b>   {a.get_title('right')}" for a in static.axes]
    assert titles == [note.text for note in interactive.layout.annotations]


def test_interval_is_196_standard_deviations_to_each_side_in_millimetres():
    elevation, d1, d2 = profile_chart(STATED, None, None, {}).panels
    half = (not_none(elevation.interval).high - not_none(elevation.interval).low) / 2
    assert half == pytest.approx(1.96e3 * DEVIATION)
    assert not_none(elevation.interval).low + half == pytest.approx(1e3 * LEVEL)
    half = (not_none(d1.interval).high - not_none(d1.interval).low) / 2
    assert half == pytest.approx(1.96e3 * DEVIATION / 5)
    assert not_none(d1.interval).low + half == pytest.approx(1e3 * band_pass(LEVEL, 0.25, D1))
    assert d2.interval is None


def test_interactive_figure_draws_the_interval_around_the_elevation():
    figure: Any = interactive_profile_figure(STATED)
    interval, elevation = figure.data[:2]
    there, back = np.split(np.asarray(interval.y)[:-1], 2)
    assert back[::-1] - elevation.y == pytest.approx(1.96e3 * DEVIATION)
    assert elevation.y - there == pytest.approx(1.96e3 * DEVIATION)


def test_residual_is_measured_minus_reproduced_where_the_sample_is_valid():
    panels = profile_chart(a_profile(), a_recording(), None, REPRODUCED).panels
    residual = panels[4].lines[0]
    good = DISTANCE < 400
    expected = 0.1 * a_recording()["a"].to_numpy()
    assert residual.y[good] == pytest.approx(expected[good])
    assert np.isnan(residual.y[~good]).all()
    assert panels[4].description == "RMS 0.071 m/s², of 0.71 m/s² measured"


def test_samples_are_drawn_at_the_given_distance():
    chart = profile_chart(a_profile(), a_recording(), DISTANCE + 9.0, {})
    assert chart.panels[3].lines[0].x[0] == 9.0
    assert [line.name for line in chart.panels[3].lines] == ["measured"]


@pytest.mark.parametrize("kind", ["missing elevation", "flag", "missing rows"])
def test_gaps_are_shaded_and_empty(kind):
    inside = (DISTANCE > 100) & (DISTANCE < 150)
    level = np.where(inside, np.nan if kind == "missing elevation" else 5.0, LEVEL)
    quality = inside.astype(np.int8)
    profile = a_profile(level=level, quality=quality, standard_deviation=DEVIATION)
    if kind == "missing rows":
        profile = profile.isel(distance=~inside)
    chart = profile_chart(profile, None, None, {})
    assert chart.gaps == ((100.0, 150.0),)
    assert np.isnan(chart.panels[0].lines[0].y[inside]).all()
    figure: Any = interactive_profile_figure(profile)
    assert {(shape.x0, shape.x1) for shape in figure.layout.shapes} == {(100.0, 150.0)}
    assert len(figure.layout.shapes) == len(chart.panels)
    drawn = np.asarray(figure.data[0].x)
    assert not ((drawn > 100) & (drawn < 150)).any()


def test_a_band_longer_than_the_profile_is_not_drawn():
    short = a_profile(DISTANCE[:200], LEVEL[:200])
    assert [panel.name for panel in profile_chart(short, None, None, {}).panels] == [
        "Elevation",
        "D1, 3 to 25 m",
    ]


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 5000), st.integers(10, 500), st.integers(0, 99))
def test_decimation_keeps_the_extremes_and_the_ends(size, max_points, seed):
    values = np.random.default_rng(seed).standard_normal(size)
    kept = extremes(values, max_points)
    assert kept.size <= min(size, max_points + 2)
    assert (np.diff(kept) > 0).all()
    assert {0, size - 1, values.argmin(), values.argmax()} <= set(kept.tolist())


def test_decimation_keeps_one_point_of_every_gap():
    values = np.zeros(100_000)
    values[50_000:50_003] = np.nan
    assert np.isnan(values[extremes(values)]).any()


def test_a_long_profile_is_decimated_and_the_note_says_so():
    distance = np.arange(0.0, 10_000.0, 0.25)
    level = np.sin(distance)
    level[12_345] = 5.0
    figure: Any = interactive_profile_figure(a_profile(distance, level))
    assert all(len(trace.x) <= MAX_POINTS + 2 for trace in figure.data)
    assert max(figure.data[0].y) == pytest.approx(5e3)
    assert "extremes of 2000 segments" in figure.layout.title.subtitle.text


def test_html_figure_needs_no_network(tmp_path):
    write_html(interactive_profile_figure(STATED), tmp_path / "page")
    page = (tmp_path / "page").read_text(encoding="utf-8")
    assert "<title>Track profile, 0 to 500 m</title>" in page
    assert 'src="http' not in page
    assert "<link" not in page.split("<script")[0]
    assert len(page) > 1_000_000


def test_static_figure_is_written_as_png_for_any_suffix(tmp_path):
    write_png(
        static_profile_figure(STATED, a_recording(), reproduced=REPRODUCED), tmp_path / "p.part"
    )
    assert (tmp_path / "p.part").read_bytes().startswith(b"\x89PNG")


def test_arrays_that_do_not_fit_the_recording_are_refused():
    recording = a_recording()
    with pytest.raises(DataError, match="Reproduced b: the recording has only a, q"):
        interactive_profile_figure(STATED, recording, reproduced={"b": DISTANCE})
    with pytest.raises(DataError, match=r"Reproduced a: .* 2000, got shape \(3,\)"):
        interactive_profile_figure(STATED, recording, reproduced={"a": DISTANCE[:3]})
    with pytest.raises(DataError, match=r"one value per sample, 2000, got shape \(2,\)"):
        interactive_profile_figure(STATED, recording, DISTANCE[:2])
    with pytest.raises(DataError, match="no distance: give sample_distance"):
        static_profile_figure(STATED, recording.drop_vars("distance"))


def test_importing_the_package_loads_neither_plotly_nor_matplotlib():
    code = "import sys, trackprofile.reporting.figures; print({'plotly', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def a_run(force=150e3, deflection=-1.6e-3):
    wheels = np.ones((DISTANCE.size, 2))
    names = (("body", "heave"), ("wheel 1", "heave"), ("wheel 2", "heave"))
    still = np.zeros((DISTANCE.size, 3))
    speed = np.linspace(20.0, 30.0, DISTANCE.size)
    return Simulation(
        DISTANCE / 20, DISTANCE, speed, names, still, still, still, force * wheels, deflection * wheels, ()
    )  # fmt: skip


def test_simulation_chart_shows_profile_signals_forces_and_deflections_in_their_units():
    chart = simulation_chart(a_profile(), a_recording(), a_run(), "A run")
    assert [(panel.name, panel.unit) for panel in chart.panels] == [
        ("Profile", "mm"),
        ("Vertical acceleration", "m/s²"),
        ("Pitch rate", "mrad/s"),
        ("Contact force", "kN"),
        ("Rail deflection", "mm"),
    ]
    profile, signal, _, force, deflection = (panel.lines[0] for panel in chart.panels)
    assert profile.y == pytest.approx(1e3 * LEVEL)
    assert signal.name == "simulated"
    assert force.y == pytest.approx(150.0)
    assert deflection.y == pytest.approx(-1.6)
    assert chart.title == "A run, 0 to 500 m"
    assert chart.note.startswith("72 to 108 km/h")


def test_every_wheel_has_a_colour_that_no_other_line_has():
    *_, force, deflection = simulation_chart(a_profile(), a_recording(), a_run(), "").panels
    assert [line.name for line in force.lines] == ["wheel 1", "wheel 2"]
    assert [line.colour for line in force.lines] == [line.colour for line in deflection.lines]
    colours = [
        line.colour
        for panel in profile_chart(a_profile(), None, None, {}).panels
        for line in panel.lines
    ]
    assert len({*colours, *(line.colour for line in force.lines)}) == len(set(colours)) + 2


def test_a_rigid_track_has_no_deflection_panel_and_lift_off_is_noted_with_the_forces():
    chart = simulation_chart(a_profile(), a_recording(), a_run(force=-1e3, deflection=0.0), "")
    assert chart.panels[-1].name == "Contact force"
    assert chart.panels[-1].description == "-1 to -1 kN: below 0 the wheel would lift off"


def test_static_simulation_figure_has_the_same_panels_as_the_interactive_one():
    simulation = (a_profile(), a_recording(), a_run(), "A run")
    interactive: Any = interactive_simulation_figure(*simulation)
    static = static_simulation_figure(*simulation)
    titles = [f"<b>{a.get_title('left')}</b>   {a.get_title('right')}" for a in static.axes]
    assert titles == [note.text for note in interactive.layout.annotations]
    names = [trace.name for trace in interactive.data]
    assert names == ["elevation", "simulated", "simulated", *["wheel 1", "wheel 2"] * 2]

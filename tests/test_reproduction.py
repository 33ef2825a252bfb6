"""The cases of the paper, the studies of them, and the report."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from trackprofile.errors import FileError
from trackprofile.methods.cross_entropy.search_settings import TABLE_6
from trackprofile.models.integrate import newmark, wilson
from trackprofile.models.irregularity import Bell
from trackprofile.reproduction import PAGE, TITLE, reproduce
from trackprofile.reproduction.cases import (
    bell,
    case_recording,
    fine_signals,
    instruments,
    model_b,
    search_grid_signals,
    with_lead,
)
from trackprofile.reproduction.noise_study import fit_bell, profiles, sensors
from trackprofile.reproduction.paper_tables import settings
from trackprofile.reproduction.parts import FigurePanel, PageSection, Table
from trackprofile.reproduction.reproduction_html import files, html
from trackprofile.reproduction.studies import (
    band_rms,
    error_growth,
    run_search,
    shortened,
    without_parabola,
)


def test_every_printed_number_is_the_one_that_the_package_uses() -> None:
    sections = settings()
    assert [one.key for one in sections] == [f"table-{n}" for n in range(1, 7)]
    for section in sections:
        assert section.table is not None
        for *_, ratio in section.table.rows:
            assert ratio == pytest.approx(1.0)


def test_signals_on_the_search_grid_agree_with_the_fine_simulation() -> None:
    case = bell()
    own, fine = search_grid_signals(case), fine_signals(case)
    assert own.shape == fine.shape == (801, 1)
    assert np.linalg.norm(own - fine) < 2e-3 * np.linalg.norm(fine)


def test_lead_adds_track_before_and_after_without_changing_the_signals() -> None:
    case = bell()
    extended = with_lead(case)
    assert extended.position[0] == -100.0
    assert extended.position[-1] == pytest.approx(120.0)
    longer = fine_signals(extended)
    own = fine_signals(case)
    np.testing.assert_allclose(longer[4000:4801], own, atol=1e-6 * np.abs(own).max())


def test_instruments_add_their_noise() -> None:
    case = shortened(model_b("fra-6"), 40.0)
    still = np.zeros((case.scans + 1, 2))
    noisy = case_recording(case, still, instruments("B"), seed=1)
    deviation = float(noisy["acceleration"].std())
    density = instruments("B")[0].sensor.noise_density
    assert density is not None
    assert deviation == pytest.approx(density * np.sqrt(0.5 / case.step), rel=0.1)


def test_errors_grow_much_faster_with_newmark_than_with_wilson() -> None:
    case = shortened(model_b("fra-6"), 40.0)
    with_wilson = error_growth(case, wilson(case.step), 10)
    assert 1.2 < with_wilson < 3.0
    assert error_growth(case, newmark(case.step), 10) > 1e3


def test_search_recovers_the_first_metres_of_model_b() -> None:
    case = shortened(model_b("fra-4"), 15.0)
    study = run_search(case, search_grid_signals(case), TABLE_6)
    assert np.abs(study.error).max() < 1e-6
    assert study.rate > 0


def test_band_rms_is_that_of_a_sine_in_the_band() -> None:
    place = np.linspace(0.0, 200.0, 2001)
    error = 1e-3 * np.sin(2 * np.pi * place / 10.0)
    found = band_rms(place, error)
    assert found["D1"] == pytest.approx(np.sqrt(0.5), rel=0.01)
    assert found["D2"] == pytest.approx(0.0, abs=0.01)
    assert band_rms(place[:400], error[:400])["D1"] is None


def test_without_parabola_removes_offset_slope_and_curvature() -> None:
    place = np.linspace(5.0, 25.0, 100)
    wave = np.sin(place)
    np.testing.assert_allclose(
        without_parabola(place, wave + 3 + 0.1 * place - 0.02 * place**2),
        without_parabola(place, wave),
        atol=1e-12,
    )


@pytest.mark.parametrize(("depth", "centre"), [(40e-3, 100.0), (25e-3, 93.0)])
def test_bell_is_fitted_on_a_slope(depth: float, centre: float) -> None:
    place = np.linspace(0.0, 200.0, 2001)
    level = Bell(depth, 10.0, centre).at(place)[0] + 1e-4 * place
    fit = fit_bell(place, level)
    assert fit[0] == pytest.approx(1e3 * depth, rel=1e-3)
    assert fit[1] == pytest.approx(centre, abs=0.06)


@pytest.mark.parametrize("section", [profiles(), *sensors()], ids=lambda one: one.key)
def test_spectra_follow_their_models(section: PageSection) -> None:
    lines = section.panels[-1].lines
    modelled = {name: name.split(",")[0] for name in lines if "," in name}
    assert modelled
    for model, simulated in modelled.items():
        # The standard deviation of a Welch estimate from n segments is 1/√n.
        ratio = lines[simulated][1] / lines[model][1]
        assert np.median(ratio) == pytest.approx(1.0, abs=0.2)


SECTION = PageSection(
    "figure-1",
    "A <title>",
    ("Text & more.",),
    Table(("what", "mm"), (("one", 1.5), ("none", None))),
    (FigurePanel("x, m", "y, mm", {"line": (np.arange(3.0), np.ones(3))}, "y"),),
)


def test_report_is_self_contained_and_escapes_its_text() -> None:
    text = html("A page", ("Said.",), (SECTION,))
    assert "A &lt;title&gt;" in text
    assert "Text &amp; more." in text
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=", text)


def test_csv_files_of_a_section() -> None:
    found = files(SECTION)
    assert set(found) == {"figure-1.csv", "figure-1-lines.csv"}
    assert found["figure-1.csv"] == "what,mm\none,1.5\nnone,\n"
    assert list(csv.reader(found["figure-1-lines.csv"].splitlines()))[1] == ["line", "0.0", "1.0"]


def test_another_file_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / PAGE).write_text("my own")
    with pytest.raises(FileError, match="not a reproduction report"):
        reproduce(tmp_path)
    assert (tmp_path / PAGE).read_text() == "my own"


@pytest.mark.acceptance
def test_the_paper_is_reproduced(tmp_path: Path) -> None:
    paths = reproduce(tmp_path / "out")
    names = {path.name for path in paths}
    assert {f"figure-{n}.csv" for n in (3, *range(10, 19))} <= names
    assert TITLE in paths[0].read_text(encoding="utf-8")

    with (tmp_path / "out" / "figure-13.csv").open(encoding="utf-8") as file:
        largest = {row["maximum error"]: float(row["ours, mm"]) for row in csv.DictReader(file)}
    assert largest["covariance"] <= 0.001
    with (tmp_path / "out" / "figure-17.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for grade in ("fra-4", "fra-5", "fra-6"):
        for level in ("A", "B", "C"):
            own = {
                row["method"]: row for row in rows if (row["class"], row["noise"]) == (grade, level)
            }
            smoother, found = own["smoother"], own["cross-entropy, literal"]
            assert float(smoother["D1, mm"]) < 0.03
            assert float(found["D1, mm"]) > 30 * float(smoother["D1, mm"])

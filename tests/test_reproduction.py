"""The paper's cases, the studies of them, and the page that shows them."""

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


def test_every_printed_number_is_what_the_package_runs_with() -> None:
    sections = settings()
    assert [one.key for one in sections] == [f"table-{n}" for n in range(1, 7)]
    for section in sections:
        assert section.table is not None
        for *_, ratio in section.table.rows:
            assert ratio == pytest.approx(1.0)


def test_search_s_grid_tends_to_the_fine_simulation() -> None:
    case = bell()
    own, fine = search_grid_signals(case), fine_signals(case)
    assert own.shape == fine.shape == (801, 1)
    assert np.linalg.norm(own - fine) < 2e-3 * np.linalg.norm(fine)


def test_lead_adds_track_before_and_after_and_moves_nothing() -> None:
    case = bell()
    led = with_lead(case)
    assert led.position[0] == -100.0
    assert led.position[-1] == pytest.approx(120.0)
    longer = fine_signals(led)
    own = fine_signals(case)
    np.testing.assert_allclose(longer[4000:4801], own, atol=1e-6 * np.abs(own).max())


def test_instruments_add_their_noise() -> None:
    case = shortened(model_b("fra-6"), 40.0)
    still = np.zeros((case.scans + 1, 2))
    noisy = case_recording(case, still, instruments("B"), seed=1)
    spread = float(noisy["acceleration"].std())
    density = instruments("B")[0].sensor.noise_density
    assert density is not None
    assert spread == pytest.approx(density * np.sqrt(0.5 / case.step), rel=0.1)


def test_errors_grow_with_newmark_and_hardly_above_the_leading_axle() -> None:
    case = shortened(model_b("fra-6"), 40.0)
    by_wilson = error_growth(case, wilson(case.step), 10)
    assert 1.2 < by_wilson < 3.0
    assert error_growth(case, newmark(case.step), 10) > 1e3


def test_search_finds_the_first_metres_of_model_b() -> None:
    case = shortened(model_b("fra-4"), 15.0)
    done = run_search(case, search_grid_signals(case), TABLE_6)
    assert np.abs(done.error).max() < 1e-6
    assert done.rate > 0


def test_error_in_a_band_is_that_of_its_wave() -> None:
    place = np.linspace(0.0, 200.0, 2001)
    error = 1e-3 * np.sin(2 * np.pi * place / 10.0)
    found = band_rms(place, error)
    assert found["D1"] == pytest.approx(np.sqrt(0.5), rel=0.01)
    assert found["D2"] == pytest.approx(0.0, abs=0.01)
    assert band_rms(place[:400], error[:400])["D1"] is None


def test_parabola_is_what_an_unknown_offset_leaves() -> None:
    place = np.linspace(5.0, 25.0, 100)
    wave = np.sin(place)
    np.testing.assert_allclose(
        without_parabola(place, wave + 3 + 0.1 * place - 0.02 * place**2),
        without_parabola(place, wave),
        atol=1e-12,
    )


@pytest.mark.parametrize(("depth", "centre"), [(40e-3, 100.0), (25e-3, 93.0)])
def test_dip_is_found_on_a_slope(depth: float, centre: float) -> None:
    place = np.linspace(0.0, 200.0, 2001)
    level = Bell(depth, 10.0, centre).at(place)[0] + 1e-4 * place
    found = fit_bell(place, level)
    assert found[0] == pytest.approx(1e3 * depth, rel=1e-3)
    assert found[1] == pytest.approx(centre, abs=0.06)


@pytest.mark.parametrize("section", [profiles(), *sensors()], ids=lambda one: one.key)
def test_spectra_follow_their_models(section: PageSection) -> None:
    lines = section.panels[-1].lines
    modelled = {name: name.split(",")[0] for name in lines if "," in name}
    assert modelled
    for model, made in modelled.items():
        # A Welch estimate of n pieces strays by 1/√n.
        ratio = lines[made][1] / lines[model][1]
        assert np.median(ratio) == pytest.approx(1.0, abs=0.2)


SECTION = PageSection(
    "figure-1",
    "A <title>",
    ("Text & more.",),
    Table(("what", "mm"), (("one", 1.5), ("none", None))),
    (FigurePanel("x, m", "y, mm", {"line": (np.arange(3.0), np.ones(3))}, "y"),),
)


def test_page_needs_no_network_and_escapes_what_it_shows() -> None:
    text = html("A page", ("Said.",), (SECTION,))
    assert "A &lt;title&gt;" in text
    assert "Text &amp; more." in text
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=", text)


def test_numbers_beside_the_page() -> None:
    found = files(SECTION)
    assert set(found) == {"figure-1.csv", "figure-1-lines.csv"}
    assert found["figure-1.csv"] == "what,mm\none,1.5\nnone,\n"
    assert list(csv.reader(found["figure-1-lines.csv"].splitlines()))[1] == ["line", "0.0", "1.0"]


def test_another_page_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / PAGE).write_text("my own")
    with pytest.raises(FileError, match="no reproduction"):
        reproduce(tmp_path)
    assert (tmp_path / PAGE).read_text() == "my own"


@pytest.mark.acceptance
def test_the_paper_is_reproduced(tmp_path: Path) -> None:
    paths = reproduce(tmp_path / "out")
    names = {path.name for path in paths}
    assert {f"figure-{n}.csv" for n in (3, *range(10, 19))} <= names
    assert TITLE in paths[0].read_text(encoding="utf-8")

    with (tmp_path / "out" / "figure-13.csv").open(encoding="utf-8") as file:
        largest = {row["largest error"]: float(row["ours, mm"]) for row in csv.DictReader(file)}
    assert largest["covariance"] <= 0.001
    with (tmp_path / "out" / "figure-17.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for grade in ("fra-4", "fra-5", "fra-6"):
        for level in ("A", "B", "C"):
            own = {
                row["what"]: row for row in rows if (row["class"], row["noise"]) == (grade, level)
            }
            smoother, found = own["smoother"], own["cross-entropy, literal"]
            assert float(smoother["D1, mm"]) < 0.03
            assert float(found["D1, mm"]) > 30 * float(smoother["D1, mm"])

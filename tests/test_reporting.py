"""The report: its sentences, its HTML in a real browser, its PDF, and the commands that write it."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from conftest import Run
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits import Action
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.assessment.tables import geojson, tables
from trackprofile.bands import BANDS, D1, D2
from trackprofile.contracts import Quality, build_profile
from trackprofile.errors import FileError
from trackprofile.io import write
from trackprofile.io.model_toml import read_spectrum
from trackprofile.models.irregularity import random_irregularity
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.reporting.band_figures import chart_data
from trackprofile.reporting.report import report
from trackprofile.reporting.summary import summary

EN, KM_H = read_limits("en-13848"), 1 / 3.6
SPEED = 140 * KM_H
BROWSER = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
CHAINAGE = ChainageTable([0.0, 3000.0], [40.0, 37.0], [0.0, 3000.0], [47.0, 47.02], [8.0, 8.01])


def profile_of(length: float, seed: int = 1, deviation: float = 3e-4, gap: bool = True):
    at = np.arange(0.0, length, 0.25)
    level = random_irregularity(read_spectrum("fra-6"), seed, 2.0, 200.0, length=length).at(at)[0]
    dips = ((0.55, 0.045), (0.8, 0.02))
    level -= sum(depth * np.exp(-0.5 * ((at - share * length) / 2.0) ** 2) for share, depth in dips)
    flags = np.zeros(at.size, np.int8)
    if gap:
        flags[(at > 0.3 * length) & (at < 0.3 * length + 20)] = Quality.GAP
        level = np.where(flags & Quality.GAP, np.nan, level)
    return build_profile(
        at,
        level,
        kind="posterior",
        method="smoother",
        standard_deviation=np.full(at.size, 5e-3),
        band_standard_deviations={
            band.name: np.full(at.size, factor * deviation)
            for band, factor in zip(BANDS, (1.0, 2.0, 8.0), strict=True)
        },
        quality=flags,
        vehicle="velaro",
        provenance=["simulated"],
    )


@pytest.fixture(scope="module")
def profile():
    return profile_of(3000.0)


@pytest.fixture(scope="module")
def assessment(profile):
    return assess(profile, EN, SPEED, spectra={"fra-6": read_spectrum("fra-6")})


def test_summary_begins_with_the_most_severe_defect(assessment) -> None:
    sentences = summary(assessment, CHAINAGE)
    assert re.match(
        r"1 location requires immediate action: km 38\.350 \(D1, \d+\.\d ± 0\.6 mm down",
        sentences[0],
    )
    assert "exceeds 23 mm with" in sentences[0]
    assert sentences[1].startswith("Required action: reduce the risk of derailment")
    assert any(text.startswith("Assessed length: ") for text in sentences)


def test_summary_of_good_track_requires_no_action() -> None:
    at = np.arange(0.0, 500.0, 0.25)
    flat = build_profile(at, 1e-4 * np.sin(at), kind="truth")
    assert summary(assess(flat, EN, SPEED, bands=[D1]), ChainageTable())[0].startswith(
        "No location requires an action"
    )


def test_tables_contain_every_defect_and_section(assessment) -> None:
    result = tables(assessment, CHAINAGE)
    assert len(result["defects"]["band"]) == len(assessment.defects)
    assert len(result["sections"]["band"]) == len(assessment.sections)
    deepest = int(np.argmin(result["defects"]["height_mm"]))
    assert result["defects"]["peak_kilometre"][deepest] == pytest.approx(38.35, abs=0.01)
    assert result["defects"]["required_action"][deepest] == "immediate action"
    assert result["defects"]["required_action_text"][deepest].startswith("reduce the risk")
    assert set(result["not_assessed"]["reasons"]) >= {"gap", "edge"}
    assert result["spectra"]["nearest_spectrum"] == ["fra-6"] * 3


def test_geojson_has_the_coordinates_of_the_defects(assessment) -> None:
    collection = geojson(assessment, CHAINAGE)
    assert len(collection["features"]) == len(assessment.defects)
    one = collection["features"][0]
    east, north = one["geometry"]["coordinates"]
    share = one["properties"]["peak_m"] / 3000.0
    assert (east, north) == pytest.approx((8.0 + 0.01 * share, 47.0 + 0.02 * share), abs=1e-6)
    assert geojson(assessment, ChainageTable())["features"] == []


def test_chart_data_have_a_resolution_of_a_hundredth_of_a_millimetre(assessment) -> None:
    import base64

    drawn = chart_data(assessment, CHAINAGE, assessment)
    counts = np.frombuffer(base64.b64decode(drawn["bands"][0]["level"]), "<i2")
    level = assessment.levels["D1"].level
    known = np.isfinite(level)
    assert np.abs(counts[known] * 1e-5 - level[known]).max() <= 5.01e-6
    assert (counts[~known] == -32768).all()
    assert drawn["bands"][0]["compared"] == drawn["bands"][0]["level"]
    assert drawn["chainage_km"][0] == 40.0


def test_html_is_self_contained_and_escaped(assessment, tmp_path: Path) -> None:
    (page,) = report(
        assessment,
        tmp_path / "r.html",
        title="<Line> & more",
        chainage=CHAINAGE,
        compared=assessment,
        compared_name="twin",
    )
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"""(src|href)=["']https?:""", text)
    assert not re.search(r"^(import|export) ", text, re.MULTILINE)
    assert "&lt;Line&gt; &amp; more" in text
    assert "not verified against the standard" in text
    assert 'href="#at=' in text
    assert "of the same class" in text
    assert text.count("<polyline") == 2  # this profile's spectrum and the known one's


def test_report_as_pdf_has_text_charts_and_tables(assessment, tmp_path: Path) -> None:
    files = report(assessment, tmp_path / "r.pdf", tmp_path / "r.html")
    assert files[0].read_bytes().startswith(b"%PDF")
    assert files[0].read_bytes().count(b"/Type /Page ") >= 3


def test_report_with_another_suffix_is_refused(assessment, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"a file name that ends in .html or .pdf for a report"):
        report(assessment, tmp_path / "r.docx")
    assert not list(tmp_path.iterdir())


def browsed(page: Path, tmp_path: Path, fragment: str = "") -> tuple[str, list[str]]:
    """Elements of the HTML after its script ran, and what it wrote to the console."""
    assert BROWSER is not None
    done = subprocess.run(
        [
            BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--v=0",
            f"--user-data-dir={tmp_path / 'browser'}", "--window-size=1280,1200", "--virtual-time-budget=10000",
            "--dump-dom", page.absolute().as_uri() + fragment,
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this system")
def test_charts_draw_in_a_real_browser_without_an_error(assessment, tmp_path: Path) -> None:
    (page,) = report(assessment, tmp_path / "r.html", chainage=CHAINAGE)
    drawn, messages = browsed(page, tmp_path, "#at=1650.0&span=200")
    assert messages == []
    assert re.search(r'data-drawn="[\d.]+"', drawn)
    assert "km 38.450 to 38.250, 200 m" in drawn
    assert drawn.count("<canvas") == 5  # three levels, the sections, the schematic


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this system")
def test_charts_zoom_move_and_show_values(assessment, tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    (file,) = report(assessment, tmp_path / "r.html", chainage=CHAINAGE)
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(file.as_uri())
        page.locator("#charts").focus()
        page.keyboard.press("+")
        page.wait_for_url(re.compile("span=1500"))
        page.get_by_role("button", name="zoom out").click()
        page.wait_for_url(re.compile("span=3000"))
        page.locator("#chart-D1 .u-over").hover()
        assert re.match(r"km 38\.\d+, \d+\.\d m: D1 ", page.locator("#reading").inner_text())
        assert page.locator("#chart-D3 .u-cursor-x:not(.u-off)").count() == 1  # linked cursors
        page.mouse.wheel(0, -600)
        page.wait_for_url(re.compile("span=1220"))
        page.locator("#defects a").first.click()
        page.wait_for_function("document.getElementById('range').textContent.endsWith(', 200 m')")
        page.locator("#choice").select_option("3")
        assert page.locator("#defects tbody tr:visible").count() == 1
        page.locator('a[href="#caveats"]').click()
        assert page.locator("#range").inner_text().endswith(", 200 m")
        browser.close()
    assert errors == []


def test_assess_prints_a_summary_and_writes_tables(profile, tmp_path: Path, run: Run) -> None:
    write(profile, tmp_path / "p.nc")
    way = tmp_path / "way.csv"
    way.write_text(
        "distance_m,kilometre,latitude_deg,longitude_deg\n0,40,47,8\n3000,37,47.02,8.01\n"
    )
    outputs = [tmp_path / name for name in ("a.csv", "a.parquet", "a.geojson")]
    code, out, err = run(
        "assess", tmp_path / "p.nc", "--speed", "140 km/h", "--chainage", way,
        *(word for path in outputs for word in ("-o", path)),
    )  # fmt: skip
    assert code == 0
    assert "1 location requires immediate action: km 38.350" in out
    assert "not verified" in err
    rows = list(csv.DictReader((tmp_path / "a-defects.csv").read_text().splitlines()))
    assert {"height_mm", "probability_alert", "required_action_text"} <= rows[0].keys()
    assert json.loads(outputs[2].read_text())["type"] == "FeatureCollection"
    names = sorted(path.name for path in tmp_path.iterdir())
    assert [f"a-{one}.parquet" for one in ("defects", "not_assessed", "sections", "spectra")] == [
        name for name in names if name.endswith(".parquet")
    ]


def test_assess_as_json_is_one_object(profile, tmp_path: Path, run: Run) -> None:
    write(profile, tmp_path / "p.nc")
    code, out, _ = run("assess", tmp_path / "p.nc", "--speed", "140 km/h", "--json")
    result = json.loads(out)
    assert code == 0
    assert result["filter"].startswith("4th-order Butterworth, zero phase")
    assert max(result["defects"][f"probability_{Action.IMMEDIATE_ACTION.name.lower()}"]) > 0.9


def test_report_and_changes_commands(profile, tmp_path: Path, run: Run) -> None:
    before, after = tmp_path / "may.nc", tmp_path / "june.nc"
    write(profile, before)
    later = profile.copy()
    at = profile["distance"].to_numpy()
    later["elevation"] = profile["elevation"] - 0.012 * np.exp(-0.5 * ((at - 2000) / 2) ** 2)
    write(later, after)
    page = tmp_path / "r.html"
    code, out, _ = run(
        "report", after, "--speed", "140 km/h", "--previous", f"{before}=2026-05-03",
        "--date", "2026-06-02", "--compare-with", before, "-o", page,
    )  # fmt: skip
    assert code == 0
    text = page.read_text(encoding="utf-8")
    assert "changed from 2026-05-03 (may.nc) to 2026-06-02 (june.nc): km 2.000 (D1" in text
    code, out, _ = run(
        "trend", f"{before}=2026-05-03", f"{after}=2026-06-02", "--speed", "140 km/h",
        "-o", tmp_path / "c.csv",
    )  # fmt: skip
    assert code == 0
    assert "km 2.000 (D1" in out
    assert "mm in 30 days" in out
    assert (tmp_path / "c-changes.csv").is_file()
    assert (tmp_path / "c-repeatability.csv").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["assess", "P", "--speed", "fast"], "is not a speed"),
        (["assess", "P", "--speed", "400 km/h"], "up to 300 km/h, got 400 km/h"),
        (["assess", "P", "--speed", "100 km/h", "-o", "x.xlsx"], "tables are written to files that end in"),
        (["assess", "P", "--speed", "100 km/h", "-o", "x.geojson"], "needs latitude and longitude"),
        (["assess", "P", "--speed", "100 km/h", "--limits", "none"], "none"),
        (["assess", "P", "--speed", "100 km/h", "--chainage", "no.csv"], "expected a chainage table"),
        (["report", "P", "--speed", "100 km/h", "-o", "x.html", "--date", "2026-01-01"], "needs both"),
        (["trend", "P=2026-01-01"], "needs two passes or more"),
        (["trend", "P", "P"], "expected a profile and its date"),
    ],
)  # fmt: skip
def test_wrong_use_is_reported_in_one_sentence_and_nothing_is_written(
    arguments: list[str], message: str, tmp_path: Path, run: Run, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(profile_of(400.0, gap=False), tmp_path / "p.nc")
    code, out, err = run(*(one.replace("P", "p.nc") for one in arguments))
    assert code == 1
    assert message in err
    assert err.startswith("trackprofile: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["p.nc"]
    assert out == ""


def test_profile_shorter_than_a_band_is_assessed_in_the_others(tmp_path: Path, run: Run) -> None:
    write(profile_of(60.0, gap=False), tmp_path / "p.nc")
    code, _out, err = run("assess", tmp_path / "p.nc", "--speed", "140 km/h")
    assert code == 0
    assert D2.name in err
    assert "it is not assessed" in err
    write(profile_of(20.0, gap=False), tmp_path / "q.nc")
    code, _, err = run("assess", tmp_path / "q.nc", "--speed", "140 km/h")
    assert code == 1
    assert "No band can be assessed" in err

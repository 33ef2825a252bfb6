"""The plan for a country: arithmetic against hand calculation, and a real measurement."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.cli import main
from trackprofile.errors import DataError
from trackprofile.fleet.capacity import Cost, Network, need
from trackprofile.fleet.capacity_html import Plan, html, markdown, tables
from trackprofile.fleet.cost_measurement import Sample, cost, stored_per_metre
from trackprofile.store import create

COST = Cost(cpu=2e-3, memory=1e9, recorded=400.0, recorded_as_csv=1000.0, stored=50.0, files=7)
amounts = st.floats(1e-3, 1e6)


def test_a_country_by_hand() -> None:
    # 10,000 km x 50 a day = 5e8 m a day; x 2 ms = 1e6 core seconds; in 12 h at 50 %: 1e6 / 21600 = 46.3 cores.
    network = Network(10_000e3, 50, 20e3, 30.0, hours=12, utilisation=0.5, copies=3, raw_days=7)
    found = need(network, COST)
    assert found.metres == 5e8
    assert found.recordings == 25_000
    assert found.core_seconds == pytest.approx(1e6)
    assert found.cores == 47
    assert found.memory == pytest.approx(47e9)
    assert found.received == pytest.approx(200e9)
    # 200 GB in 43,200 s are 4.63 MB/s, that is 37.0 Mbit/s.
    assert found.received_rate == pytest.approx(37.04e6, rel=1e-3)
    assert found.raw_kept == pytest.approx(200e9 * 7 * 3)
    assert found.stored == pytest.approx(25e9)
    assert found.stored_year == pytest.approx(25e9 * 365 * 3)
    assert found.files_year == 25_000 * 7 * 365
    assert found.written_rate == pytest.approx(4.63e6, rel=1e-3)


@given(amounts, amounts, st.floats(0.1, 24.0), st.floats(0.05, 1.0))
def test_cores_are_enough_and_one_fewer_is_not(
    length: float, passes: float, hours: float, utilisation: float
) -> None:
    network = Network(length, passes, hours=hours, utilisation=utilisation)
    found = need(network, COST)
    of_one = 3600 * hours * utilisation
    assert found.cores * of_one >= found.core_seconds * (1 - 1e-6)
    assert found.cores == 1 or (found.cores - 1) * of_one < found.core_seconds


@given(st.integers(1, 40), amounts)
def test_twice_the_passes_need_twice_the_storage_and_transfer(times: int, passes: float) -> None:
    one, many = (need(Network(passes=one), COST) for one in (passes, times * passes))
    for name in ("metres", "core_seconds", "received", "received_rate", "raw_kept", "stored_year"):
        assert getattr(many, name) == pytest.approx(times * getattr(one, name))


@pytest.mark.parametrize(
    "wrong",
    [
        {"length": 0.0},
        {"passes": -1.0},
        {"hours": 25.0},
        {"utilisation": 0.0},
        {"utilisation": 1.1},
        {"copies": float("nan")},
        {"raw_days": -1.0},
    ],
)
def test_a_network_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(DataError):
        Network(**wrong)


def plan(command: str = "trackprofile plan") -> Plan:
    network = Network()
    return Plan(network, Sample(), COST, need(network, COST), "", "2 cores of a machine", command)


def test_every_number_is_measured_or_named_as_an_option() -> None:
    made = tables(plan())
    assert all(one.startswith("--") for one in made["assumed"]["option"])
    assert len(made["assumed"]["option"]) == 11
    needed = dict(zip(made["needed"]["needed"], made["needed"]["value"], strict=True))
    assert needed["cores"] == "20"  # 1e6 core seconds in 86,400 s at 60 %: 19.3
    assert needed["store"] == "18.2 TB a year"  # 50 B x 5e8 m x 365 x 2 = 18.25 TB
    assert needed["received"] == "200 GB a day"


def test_page_and_markdown_say_the_same_and_how_to_make_them_anew() -> None:
    of = plan("trackprofile plan -o '<b>.md'")
    page, text = html(of), markdown(of)
    for name, table in tables(of).items():
        for row in zip(*table.values(), strict=True):
            assert f"| {' | '.join(row)} |" in text, name
            assert all(cell.replace("'", "&#x27;") in page for cell in row), name
    assert "Repeat with `trackprofile plan -o '<b>.md'`." in text
    assert "&lt;b&gt;.md" in page
    assert "<b>" not in page
    assert "http" not in page


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "plan.pdf"], "plan.pdf: expected a file name that ends in .html or .md"),
        (["--recording-length", "0.5 km"], "a recording of at least 1000 m"),
        (["--utilisation", "2"], "Utilisation: expected above 0 and up to 1, got 2"),
        (["--sampling-rate", "often"], "'often' is not a frequency"),
        (["--prior", "steep"], "steep: the file does not exist"),
        (["--store", "nowhere"], "nowhere: there is no store"),
    ],
)
def test_wrong_requests_are_refused_in_one_sentence(
    options: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["plan", *options])
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1


def test_a_store_without_passes_says_nothing_of_their_size(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="it has no passes yet"):
        stored_per_metre(create(str(tmp_path / "store")))


@pytest.mark.acceptance
def test_measured_cost_is_that_of_the_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sample = Sample(length=2000.0, sampling=250.0, prior="german-low")
    found = cost(sample)
    # Two channels, time and speed of 8 bytes at 250 / 33 samples a metre; the steady speed packs to nothing.
    columns = 8 * 250 / 33
    assert 2 * columns < found.recorded < 4 * columns
    assert found.recorded_as_csv > found.recorded
    assert 1e-4 < found.cpu < 1e-1
    assert 2e8 < found.memory < 4e9
    # Four points a metre, each with an elevation and four standard deviations.
    assert 20 < found.stored < 4 * 5 * 8
    with pytest.raises(SystemExit) as ended:
        main(["plan", "--recording-length", "2 km", "--sampling-rate", "250 Hz", "--prior", "german-low",
              "--length", "100 km", "--json", "-o", str(tmp_path / "plan.html")])  # fmt: skip
    assert ended.value.code == 0
    said = json.loads(capsys.readouterr().out)
    assert said["measured"]["stored"] == pytest.approx(found.stored, rel=0.01)
    again = need(Network(length=100e3, recording_length=2000.0), Cost(**said["measured"]))
    assert replace(again, memory=0.0).metres == said["needed"]["metres"]
    assert again.cores == said["needed"]["cores"]
    assert "100 km of line, 50 passes a day" in (tmp_path / "plan.html").read_text(encoding="utf-8")

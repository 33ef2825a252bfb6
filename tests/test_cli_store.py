"""`trackprofile store`: outputs of its commands, and what they refuse with one sentence."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from conftest import Run
from network import Network
from trackprofile import read, write
from trackprofile import store as stores
from trackprofile.contracts import content_digest

PASS = (
    "--line",
    "Main / North",
    "--direction",
    "up",
    "--date",
    "2026-05-31",
    "--speed",
    "140 km/h",
)


@pytest.fixture
def run(run: Run) -> Run:
    """Runs `trackprofile store`."""
    return lambda *arguments: run("store", *arguments)


@pytest.fixture(scope="module")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the profiles of two passes."""
    folder = tmp_path_factory.mktemp("profiles")
    network = Network(1, 600.0, 2)
    for number, name in enumerate(("may.nc", "june.nc")):
        profile = network.passed(0, number)
        write(profile.assign_attrs(recording=64 * str(number)), folder / name)
    return folder


@pytest.fixture
def at(profiles: Path, tmp_path: Path, run: Run) -> Path:
    """A store with the first of them."""
    code, _, said = run(
        "add", profiles / "may.nc", "--store", tmp_path / "S", *PASS, "--run", "06:12"
    )
    assert code == 0, said
    return tmp_path / "S"


def test_add_reports_the_entry_and_stores_a_pass_once(profiles: Path, at: Path, run: Run) -> None:
    again = ("add", profiles / "may.nc", "--store", at, *PASS, "--run", "06:12")
    code, out, _ = run(*again)
    assert code == 0
    assert out.startswith(f"Already in the store: {16 * '0'}-")
    code, out, _ = run(*again, "--json")
    said = json.loads(out)
    assert (code, said["new"], said["shown"]) == (0, False, True)
    assert said["entry"]["origin"]["recording"] == 64 * "0"
    assert said["entry"]["key"] == {
        "line": "Main / North",
        "direction": "up",
        "day": "2026-05-31",
        "run": "06:12",
    }


def test_add_reports_that_another_version_is_shown(profiles: Path, at: Path, run: Run) -> None:
    given = (
        "add",
        profiles / "may.nc",
        "--store",
        at,
        *PASS,
        "--run",
        "06:12",
        "--limits",
        "national-example",
    )
    _, out, _ = run(*given, "--revision", "1")
    assert out.startswith("Stored as")
    _, _, said = run(
        "add", profiles / "may.nc", "--store", at, *PASS, "--run", "06:12", "--forward-backward"
    )
    assert (
        "Another version of this recording remains the one that is shown: see --revision." in said
    )
    _, out, _ = run("list", "--store", at, "--line", "Main / North", "--json")
    (shown,) = json.loads(out)["passes"]
    assert shown["origin"]["revision"] == 1
    _, out, _ = run("list", "--store", at, "--all-versions", "--json")
    assert len(json.loads(out)["passes"]) == 3


def test_a_conflicting_recording_is_refused_and_the_store_unchanged(
    profiles: Path, at: Path, run: Run
) -> None:
    before = sorted(at.rglob("*"))
    code, out, said = run("add", profiles / "june.nc", "--store", at, *PASS, "--run", "06:12")
    assert (code, out) == (1, "")
    assert said.count("\n") == 1
    assert "the store has another recording (may.nc) of 600 m of this track" in said
    assert sorted(at.rglob("*")) == before


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"--date": "31.5.2026"}, "'31.5.2026': expected a date such as 2026-05-31"),
        ({"--line": ""}, "A pass needs the name of its line"),
        ({"--speed": "fast"}, "fast"),
    ],
)
def test_an_invalid_pass_is_refused_and_no_store_is_created(
    profiles: Path, tmp_path: Path, run: Run, changed: dict[str, str], said: str
) -> None:
    given = dict(zip(PASS[::2], PASS[1::2], strict=True)) | changed
    options = [one for pair in given.items() for one in pair]
    code, out, error = run("add", profiles / "may.nc", "--store", tmp_path / "new", *options)
    assert (code, out) == (1, "")
    assert said in error
    assert not (tmp_path / "new").exists()


def test_list_shows_lines_and_with_a_filter_passes(at: Path, run: Run) -> None:
    _, out, _ = run("list", "--store", at)
    assert out.splitlines()[1].split() == [
        "Main",
        "/",
        "North",
        "up",
        "0",
        "600",
        "1",
        "2026-05-31",
        "2026-05-31",
    ]
    _, out, _ = run("list", "--store", at, "--json")
    assert json.loads(out)["lines"] == [
        {
            "line": "Main / North",
            "direction": "up",
            "start": 0.0,
            "end": 600.0,
            "days": ["2026-05-31"],
            "passes": 1,
        }
    ]
    for chosen in (
        ["--line", "Main / North"],
        ["--first-date", "2026-05-31"],
        ["--from", "600"],
        ["--direction", "up"],
    ):
        assert len(run("list", "--store", at, *chosen)[1].splitlines()) == 2
    for others in (
        ["--line", "Main"],
        ["--first-date", "2026-06-01"],
        ["--from", "601"],
        ["--direction", "down"],
    ):
        assert len(run("list", "--store", at, *others)[1].splitlines()) == 1


def test_control_characters_in_names_are_shown_as_escapes(
    profiles: Path, tmp_path: Path, run: Run
) -> None:
    name = "\x1b[2J\u202egnikcab"
    given = ["--line", name, *PASS[2:], "--run", "\x07"]
    run("add", profiles / "may.nc", "--store", tmp_path / "S", *given)
    for asked in (["list"], ["list", "--line", name], ["show", "0000"]):
        _, out, _ = run(*asked, "--store", tmp_path / "S")
        assert "\\u001b[2J\\u202egnikcab" in out
        assert all(one.isprintable() or one == "\n" for one in out)


def test_show_prints_the_origin_of_a_pass(at: Path, run: Run) -> None:
    _, out, notes = run("show", "0000", "--store", at)
    rows = {row[:25].strip(): row[25:].strip() for row in out.splitlines()}
    assert (rows["recording"], rows["source"], rows["line"]) == (64 * "0", "may.nc", "Main / North")
    assert "Limits are not verified against the standard" in notes
    _, out, _ = run("show", "0000", "--store", at, "--json")
    assert json.loads(out)["points"] == 2401
    for wrong in ("", "1234"):
        code, _, said = run("show", wrong, "--store", at)
        assert code == 1
        assert "expected the name of one pass or its beginning, 0 match" in said


def test_an_exported_profile_equals_the_stored_one(
    profiles: Path, at: Path, run: Run, tmp_path: Path
) -> None:
    code, out, _ = run("export", "--store", at, "--entry", "0000", "-o", tmp_path / "back.nc")
    assert (code, out) == (0, f"1 pass in {tmp_path / 'back.nc'}.\n")
    came, back = read(profiles / "may.nc"), read(tmp_path / "back.nc")
    assert back.attrs == came.attrs
    assert float(abs(back["elevation"] - came["elevation"]).max()) <= 2.0**-24
    run("export", "--store", at, "--from", "100", "--to", "200", "-o", tmp_path / "piece.csv")
    assert read(tmp_path / "piece.csv")["distance"].values[[0, -1]].tolist() == [100.0, 200.0]


def test_export_of_tables_of_the_passes_that_match(
    profiles: Path, at: Path, run: Run, tmp_path: Path
) -> None:
    run("add", profiles / "june.nc", "--store", at, *PASS, "--run", "07:12")
    tables = ["--table", "passes", "--table", "sections"]
    code, out, _ = run("export", "--store", at, *tables, "-o", tmp_path / "all.csv", "--json")
    files = [str(tmp_path / f"all-{name}.csv") for name in ("passes", "sections")]
    assert (code, json.loads(out)) == (0, {"files": files, "passes": 2})
    with open(files[0], encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(one["run"], one["source"], float(one["end_m"])) for one in rows] == [
        ("06:12", "may.nc", 600.0),
        ("07:12", "june.nc", 600.0),
    ]
    run(
        "export",
        "--store",
        at,
        *tables,
        "--from",
        "200",
        "--to",
        "350",
        "-o",
        tmp_path / "some.csv",
    )
    with open(tmp_path / "some-sections.csv", encoding="utf-8", newline="") as file:
        assert {float(one["start_m"]) for one in csv.DictReader(file)} == {100.0, 200.0, 300.0, 0.0}


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["-o", "x.html"], "a profile is written to a file that ends in .nc, .csv, .parquet"),
        (
            ["-o", "x.nc", "--table", "defects"],
            "tables are written to files that end in .csv, .parquet",
        ),
        (["-o", "x.csv", "--table", "faults"], "There is no table 'faults'; choose one of defects"),
        (
            ["-o", "x.csv", "--line", "none"],
            "0 passes match the filters, a file holds one profile; select one with --entry",
        ),
        (["-o", "x.csv", "--from", "700"], "0 passes match the filters"),
    ],
)
def test_export_refuses_wrong_files_tables_and_filters(
    at: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, asked: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, error = run("export", "--store", at, *asked)
    assert code == 1
    assert said in error
    assert not list(tmp_path.glob("x*"))


def test_verify_exits_with_1_for_a_changed_byte_and_clean_keeps_the_file(
    at: Path, run: Run
) -> None:
    assert run("verify", "--store", at)[:2] == (0, "No problems found.\n")
    path = next(at.glob("profiles/**/*.parquet"))
    content = bytearray(path.read_bytes())
    content[500] ^= 1
    path.write_bytes(content)
    code, out, _ = run("verify", "--store", at)
    assert code == 1
    assert out.endswith(
        ": its bytes were changed; remove its entry, and add the pass again.\n1 problem found.\n"
    )
    code, out, _ = run("verify", "--store", at, "--json")
    assert (code, len(json.loads(out)["problems"])) == (1, 1)
    assert run("clean", "--store", at)[:2] == (0, "0 files removed.\n")
    assert path.exists()


def test_clean_removes_an_unfinished_pass_and_rebuilds_the_index(at: Path, run: Run) -> None:
    next(at.glob("entries/**/*.json")).unlink()
    assert run("clean", "--store", at)[1] == "0 files removed.\n"
    code, out, _ = run("clean", "--store", at, "--now", "--json")
    assert (code, len(json.loads(out)["removed"]), json.loads(out)["index"]) == (0, 6, "")


def test_a_missing_store_is_reported_and_not_created(tmp_path: Path, run: Run) -> None:
    for command in (["list"], ["show", "0"], ["verify"], ["clean"], ["export", "-o", "x.nc"]):
        code, out, said = run(*command, "--store", tmp_path / "none")
        assert (code, out) == (1, "")
        assert f"{tmp_path / 'none'}: there is no store at this location; check it" in said
    assert list(tmp_path.iterdir()) == []


def test_a_profile_without_a_recording_is_identified_by_its_content(
    profiles: Path, tmp_path: Path, run: Run
) -> None:
    profile = read(profiles / "may.nc")
    write(profile, tmp_path / "may.csv")
    run("add", tmp_path / "may.csv", "--store", tmp_path / "S", *PASS)
    (entry,) = stores.find(stores.open_store(str(tmp_path / "S")))
    assert entry.origin.recording == content_digest(read(tmp_path / "may.csv"))

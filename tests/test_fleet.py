"""A night's recordings into a store: the manifest, one job, and a whole night on two processes here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from fleet_recordings import Ride, ride, write_recording
from trackprofile.assessment.limits_toml import limit_presets
from trackprofile.cli import main
from trackprofile.errors import DataError, FileError
from trackprofile.fleet.batch import BatchResult
from trackprofile.fleet.batch_html import html
from trackprofile.fleet.batch_tables import recordings, sentences
from trackprofile.fleet.conflicts import check_conflicts
from trackprofile.fleet.job import (
    Job,
    JobResult,
    Row,
    State,
    process_recording,
    processing_settings,
    recording_of,
)
from trackprofile.fleet.manifest import read_manifest
from trackprofile.io.model_toml import presets
from trackprofile.store import create, find, open_store, read_profile

LENGTH = 300.0  # m
HEAD = """\
line = "Testline"
direction = "up"
day = 2026-05-31
vehicle = "velaro"
track = "zhai"
prior = "german-low"
speed = "144 km/h"
"""


@pytest.fixture(scope="module")
def ridden() -> Ride:
    return ride(0, LENGTH)


@pytest.fixture
def folder(ridden: Ride, tmp_path: Path) -> Path:
    """Two recordings of one line."""
    write_recording(ridden, 1, tmp_path / "one.nc")
    write_recording(ridden, 2, tmp_path / "two.nc")
    return tmp_path


def manifest(folder: Path, *recordings: str, head: str = HEAD) -> Path:
    """A manifest with these tables."""
    path = folder / "night.toml"
    tables = "\n".join(f"[[recording]]\n{one}\n" for one in recordings)
    path.write_text(f"{head}\n{tables}", encoding="utf-8")
    return path


def row(folder: Path, more: str = "", file: str = "one.nc") -> Row:
    return read_manifest(manifest(folder, f'file = "{file}"\n{more}'))[0]


def test_what_a_row_says_goes_before_what_holds_of_all(folder: Path) -> None:
    one, two = read_manifest(
        manifest(
            folder,
            'file = "one.nc"\nrun = "IC 1"',
            'file = "two.nc"\nline = "Branch"\nday = 2026-06-01\nspeed = "72 km/h"\n'
            'offset = "2 km"\nstart = "2100 m"\nrevision = 3',
        )
    )
    assert (one.number, one.file) == (1, folder / "one.nc")
    assert (one.line, one.day, one.run) == ("Testline", date(2026, 5, 31), "IC 1")
    assert (one.vehicle, one.track, one.prior, one.limits) == (
        "velaro",
        "zhai",
        "german-low",
        "en-13848",
    )
    assert (one.speed, one.offset, one.start, one.end, one.revision) == (40.0, 0.0, None, None, 0)
    assert (two.line, two.direction, two.day) == ("Branch", "up", date(2026, 6, 1))
    assert (two.speed, two.offset, two.start, two.revision) == (20.0, 2000.0, 2100.0, 3)


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_table_says_the_same_as_toml(folder: Path, separator: str) -> None:
    of_toml = read_manifest(
        manifest(
            folder, 'file = "one.nc"', 'file = "two.nc"\nrun = "IC 2"\nend = "0.2 km"\nrevision = 1'
        )
    )
    lines = ["file,run,end,revision", "one.nc,,,", "", "two.nc,IC 2,0.2 km,1"]
    (folder / "rows.csv").write_text("\n".join(lines).replace(",", separator), encoding="utf-8-sig")
    assert read_manifest(manifest(folder, head=HEAD + 'table = "rows.csv"')) == of_toml
    said = ["Testline", "up", "2026-05-31", "velaro", "zhai", "german-low", "144 km/h"]
    names = ["line", "direction", "day", "vehicle", "track", "prior", "speed"]
    lines = [",".join([lines[0], *names]), *(",".join([one, *said]) for one in lines[1:] if one)]
    (folder / "night.csv").write_text("\n".join(lines).replace(",", separator), encoding="utf-8")
    assert read_manifest(folder / "night.csv") == of_toml


def test_paths_are_beside_the_manifest_wherever_the_command_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    (folder / "velaro.toml").write_bytes(_preset("vehicle", "velaro"))
    path = manifest(folder, 'file = "one.nc"\nvehicle = "velaro.toml"')
    monkeypatch.chdir(folder)
    there = read_manifest(path.name)
    assert there[0].vehicle == str(folder / "velaro.toml")
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert read_manifest(path) == there


def _preset(kind: str, name: str) -> bytes:
    import trackprofile

    return (Path(trackprofile.__file__).parent / "presets" / kind / f"{name}.toml").read_bytes()


@pytest.mark.parametrize(
    ("more", "head", "message"),
    [
        ('file = "three.nc"', HEAD, r"recording 2 \(three.nc\): there is no such file"),
        ('file = "two.nc"\nlime = "A"', HEAD, r"unknown key 'lime' in recording 2 .did you mean 'line'"),
        ('file = "two.nc"\nday = "31.5.2026"', HEAD, "recording 2.day: .*a day such as 2026-05-31, got '31.5.2026'"),
        ('file = "two.nc"\nspeed = "fast"', HEAD, "recording 2.speed: 'fast' is not a speed"),
        ('file = "two.nc"\nspeed = "0 km/h"', HEAD, r"recording 2 .*must be above 0, got 0 m/s"),
        ('file = "two.nc"\nvehicle = "cart"', HEAD, "recording 2, vehicle: .*cart: the file does not exist"),
        ('file = "two.nc"\nlimits = "ours"', HEAD, "recording 2, limits: .*ours: the file does not exist"),
        ('file = "two.nc"\nline = ""', HEAD, "recording 2.line: .*at least 1 character"),
        ('file = "two.nc"', HEAD.replace("line", "run"), "recording 1 .*key 'line' is missing"),
        ('file = "two.nc"', HEAD + 'table = "no.csv"', "no.csv: cannot be read"),
    ],
)  # fmt: skip
def test_a_wrong_manifest_is_refused_with_its_row(
    folder: Path, more: str, head: str, message: str
) -> None:
    with pytest.raises(FileError, match=message):
        read_manifest(manifest(folder, 'file = "one.nc"\nrun = "IC 1"', more, head=head))


def test_a_manifest_without_recordings_is_refused(folder: Path) -> None:
    with pytest.raises(FileError, match="names no recording"):
        read_manifest(manifest(folder))
    (folder / "rows.csv").write_text("file,line\none.nc\n", encoding="utf-8")
    with pytest.raises(FileError, match="recording 1 has 1 cells, the header 2"):
        read_manifest(folder / "rows.csv")
    (folder / "empty.csv").write_text("", encoding="utf-8")
    with pytest.raises(FileError, match="names no recording"):
        read_manifest(folder / "empty.csv")


@pytest.mark.parametrize(
    ("one", "two", "contradict"),
    [
        ('file = "one.nc"', 'file = "two.nc"', True),
        ('file = "one.nc"', 'file = "one.nc"', False),
        ('file = "one.nc"\nrun = "IC 1"', 'file = "two.nc"\nrun = "IC 2"', False),
        ('file = "one.nc"', 'file = "two.nc"\nday = 2026-06-01', False),
        ('file = "one.nc"', 'file = "two.nc"\noffset = "250 m"', False),
        ('file = "one.nc"', 'file = "two.nc"\noffset = "100 m"', True),
        ('file = "one.nc"\nend = "160 m"', 'file = "two.nc"\nstart = "140 m"', False),
    ],
)
def test_two_recordings_of_one_run_and_stretch_contradict_each_other_if_they_differ(
    folder: Path, one: str, two: str, contradict: bool
) -> None:
    rows = read_manifest(manifest(folder, one, two))
    if contradict:
        with pytest.raises(DataError, match=r"Recordings 1 \(one.nc\) and 2 \(two.nc\) both claim"):
            check_conflicts(rows)
    else:
        check_conflicts(rows)


def test_a_job_stores_once_and_knows_before_inferring(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = create(str(folder / "store"))
    job = Job(row(folder, 'offset = "2 km"'), store.url)
    first = process_recording(job)
    assert (first.state, first.reason) == (State.STORED, "")
    profile = read_profile(store, find(store)[0])
    assert profile["distance"].to_numpy()[[0, -1]] == pytest.approx([2000.0, 2300.0], abs=0.3)
    assert "2000 m added to the distance" in profile.attrs["provenance"]

    def fall(*_: object, **__: object) -> None:
        raise AssertionError("inferred again")

    monkeypatch.setattr("trackprofile.inference.infer.estimate", fall)
    second = process_recording(job)
    assert (second.state, second.entry) == (State.THERE, first.entry)
    with pytest.raises(AssertionError, match="inferred again"):
        process_recording(replace(job, row=replace(job.row, track="rigid")))


def test_where_a_preset_or_vehicle_lies_makes_no_other_version(folder: Path) -> None:
    store = create(str(folder / "store"))
    entries = set()
    for name in ("a", "b"):
        (folder / name).mkdir()
        (folder / name / "car.toml").write_bytes(_preset("vehicle", "velaro"))
        outcome = process_recording(Job(row(folder, f'vehicle = "{name}/car.toml"'), store.url))
        assert outcome.entry is not None
        entries.add(outcome.entry.id)
    assert len(entries) == 1


def test_what_cannot_be_used_is_an_outcome_with_its_reason(folder: Path) -> None:
    store = create(str(folder / "store"))
    path = manifest(folder, 'file = "one.nc"')
    (folder / "one.nc").write_bytes((folder / "one.nc").read_bytes()[:5000])
    outcome = process_recording(Job(read_manifest(path)[0], store.url))
    assert outcome.state is State.FAILED
    assert outcome.reason == "damaged or cut short; copy it again."
    assert outcome.entry is None
    outcome = process_recording(Job(outcome.row, store.url, software="0.0.1"))
    assert "this batch needs 0.0.1" in outcome.reason
    outcome = process_recording(Job(outcome.row, str(folder / "nowhere")))
    assert "there is no store" in outcome.reason


def night(folder: Path, *outcomes: tuple[State, str]) -> BatchResult:
    one = row(folder)
    made = [
        JobResult(replace(one, number=number, run=f"<b>{number}</b>"), state, reason)
        for number, (state, reason) in enumerate(outcomes, start=1)
    ]
    return BatchResult(tuple(made), "<i>store</i>", 10.0, 2)


def test_page_shows_what_failed_first_and_markup_as_text(folder: Path) -> None:
    of = night(folder, (State.THERE, ""), (State.FAILED, "<script>alert(1)</script> is no name"))
    assert recordings(of)["number"] == [2, 1]
    assert sentences(of) == ["0 recordings stored, 1 there already, 1 failed."]
    page = html(of, "night.toml")
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; is no name" in page
    assert "<b>" not in page.partition("</style>")[2]
    assert "<i>" not in page
    assert "http" not in page


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "trackprofile", "fleet", *map(str, arguments)]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return subprocess.run(
        command, env=os.environ | one_thread, capture_output=True, text=True, check=False, timeout=500
    )  # fmt: skip


def test_a_night_on_two_processes_with_one_broken_recording_and_again(folder: Path) -> None:
    (folder / "broken.nc").write_bytes(b"\x89HDF" + bytes(100))
    path = manifest(
        folder,
        'file = "one.nc"\nrun = "1"',
        'file = "broken.nc"\nrun = "2"',
        'file = "two.nc"\nrun = "3"',
    )
    options = ["--store", folder / "store", "--workers", 2]
    first = run(path, *options, "--json")
    assert first.returncode == 0, first.stderr
    said = json.loads(first.stdout)
    assert (said["stored"], said["there"], said["failed"], said["workers"]) == (2, 0, 1, 2)
    assert said["recordings"]["file"] == ["broken.nc", "one.nc", "two.nc"]
    assert said["recordings"]["reason"][0].startswith("expected a recording or profile in NetCDF")
    assert said["length_m"] == pytest.approx(2 * LENGTH, abs=1.0)
    store = open_store(str(folder / "store"))
    assert {entry.id for entry in find(store)} == set(said["recordings"]["entry"][1:])
    again = run(path, *options[:2], "--workers", 1, "-o", folder / "again.csv")
    assert again.returncode == 0, again.stderr
    assert again.stdout.startswith("0 recordings stored, 2 there already, 1 failed.")
    assert again.stderr.startswith("Recording 2, broken.nc: expected a recording")
    assert len(again.stderr.splitlines()) == 1
    states = [
        line.split(",")[6] for line in (folder / "again-recordings.csv").read_text().splitlines()
    ]
    assert states == ['"state"', '"failed"', '"there already"', '"there already"']
    assert (folder / "night-fleet.html").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], "no Dask scheduler answers there within"),
        (["--scheduler", "nonsense://x"], "nonsense://x: an address begins with one of"),
        (["--scheduler", "missing.json"], "there is no such file"),
        (
            ["--scheduler", "tcp://127.0.0.1:9", "--workers", "3"],
            "worker processes on this machine",
        ),
        (["--memory", "much"], "'much' is no amount of memory"),
        (["-o", "night.docx"], "tables are written to files that end in .csv, .parquet"),
    ],
)
def test_bad_input_leaves_the_store_untouched(
    folder: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("trackprofile.fleet.cluster.ANSWER", 0.5)
    path = manifest(folder, 'file = "one.nc"')
    with pytest.raises(SystemExit) as ended:
        main(["fleet", str(path), "--store", str(folder / "store"), *options])
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
    assert not (folder / "store").exists()


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ("two.nc", "both claim 300 m of Testline, up, 2026-05-31, run '', and differ"),
        ("three.nc", "recording 2 (three.nc): there is no such file"),
    ],
)
def test_a_wrong_manifest_leaves_the_store_untouched(
    folder: Path, second: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = manifest(folder, 'file = "one.nc"', f'file = "{second}"')
    with pytest.raises(SystemExit) as ended:
        main(["fleet", str(path), "--store", str(folder / "store")])
    assert ended.value.code == 1
    assert message in capsys.readouterr().err
    assert not (folder / "store").exists()


def test_without_dask_one_sentence_says_what_to_install(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    path = manifest(folder, 'file = "one.nc"')
    for options in ([], ["--scheduler", "tcp://127.0.0.1:9"]):
        with pytest.raises(SystemExit) as ended:
            main(["fleet", str(path), "--store", str(folder / "store"), *options])
        assert ended.value.code == 1
        assert "pip install 'trackprofile[network]'" in capsys.readouterr().err
    assert not (folder / "store").exists()


def test_what_a_version_depends_on_is_told_by_numbers_not_by_addresses(folder: Path) -> None:
    said = {'vehicle = "{}"': presets("vehicle"), 'track = "{}"': presets("track"),
            'prior = "{}"': ("german-low", "fra-6"), 'limits = "{}"': limit_presets()}  # fmt: skip
    digests = []
    for key, names in said.items():
        head = "".join(line for line in HEAD.splitlines(True) if not line.startswith(key[:5]))
        for name in names:
            path = manifest(folder, f'file = "one.nc"\n{key.format(name)}', head=head)
            only = read_manifest(path)[0]
            means = processing_settings(only, recording_of(only))
            assert " at 0x" not in repr(means)
            digests.append(means.digest())
    # The four that HEAD and the usual limits name are one and the same.
    assert len(set(digests)) == len(digests) - 3


def test_store_of_a_newer_schema_is_left_alone(folder: Path) -> None:
    (folder / "store").mkdir()
    (folder / "store" / "store.json").write_text('{"schema": 99}\n', encoding="utf-8")
    done = run(manifest(folder, 'file = "one.nc"'), "--store", folder / "store", "--workers", 1)
    assert done.returncode == 1
    assert "the store has schema 99" in done.stderr
    assert [path.name for path in (folder / "store").iterdir()] == ["store.json"]

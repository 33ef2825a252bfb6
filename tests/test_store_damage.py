"""A store after writers were killed and bytes were changed."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pytest

from network import SPEED, Network, fill
from trackprofile import store as stores
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.contracts import content_digest
from trackprofile.errors import FileError
from trackprofile.store import Origin, PassKey, Store, StoreProblem
from trackprofile.store.entry import entry_document
from trackprofile.store.layout import ENTRIES
from trackprofile.store.object_files import LocalFiles

NETWORK = Network(1, 600.0, 3)
PROFILE = NETWORK.passed(0, 0)
ASSESSMENT = assess(PROFILE, read_limits("en-13848"), SPEED)
KEY = PassKey("Main", "up", date(2026, 5, 1))
ORIGIN = Origin(content_digest(PROFILE))
PASS = (KEY, PROFILE, ASSESSMENT, ORIGIN)


def contents(store: Store) -> dict[str, bytes]:
    folder = Path(store.url)
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


class Killed(BaseException):
    """Stands for the end of the process."""


@dataclass(frozen=True)
class KilledFiles(LocalFiles):
    """A folder whose writer is killed at the n-th file, with half of it written under a temporary name."""

    remaining: list[int]

    def put(self, path: str, content: bytes) -> None:
        self.remaining[0] -= 1
        if self.remaining[0] >= 0:
            super().put(path, content)
            return
        target = Path(self.root, path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.with_name(f".{target.stem}.0123abcd{target.suffix}").write_bytes(
            content[: len(content) // 2]
        )
        raise Killed


@pytest.mark.parametrize("moment", range(7))
def test_a_pass_is_complete_or_absent_whenever_its_writer_is_killed(
    tmp_path: Path, moment: int
) -> None:
    undisturbed, store = (stores.create(str(tmp_path / name)) for name in ("undisturbed", "store"))
    stores.add(undisturbed, *PASS)
    with pytest.raises(Killed):
        stores.add(replace(store, files=KilledFiles(store.url, [moment])), *PASS)
    assert stores.find(store) == stores.lines(store) == ()
    assert {one.what[:16] for one in stores.verify(store)} == {"no entry refers "}
    assert stores.clean(store) == ()  # another writer could still be active
    second = stores.add(store, *PASS)
    assert second.new
    assert len(stores.clean(store, timedelta(0))) == 1  # the half under a temporary name
    assert stores.verify(store) == ()
    assert contents(store) == contents(undisturbed)


def test_abandoned_files_are_removed(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    empty = contents(store)
    for moment in (0, 3, 6):
        with pytest.raises(Killed):
            stores.add(replace(store, files=KilledFiles(store.url, [moment])), *PASS)
    (tmp_path / "notes.txt").write_text("of the user", encoding="utf-8")
    old = time.time() - 2 * 86400
    for path in tmp_path.rglob("*"):
        os.utime(path, (old, old))
    assert len(stores.clean(store)) == 6 + 3
    assert contents(store) == empty | {"notes.txt": b"of the user"}
    (tmp_path / "notes.txt").unlink()
    for path in sorted(tmp_path.rglob("*"), reverse=True):
        if path.is_dir():
            os.utime(path, (old, old))
    stores.clean(store, timedelta(0))
    assert [path.name for path in tmp_path.iterdir()] == ["store.json"]


def test_an_incomplete_pass_is_removed_from_a_file_system_without_folders() -> None:
    store = stores.create("memory://half")
    entry = stores.add(store, *PASS).entry
    store.files.remove(entry.path(ENTRIES))
    assert {one.path for one in stores.verify(store)} == set(entry.paths)
    assert set(stores.clean(store, timedelta(0))) == set(entry.paths)
    assert stores.verify(store) == ()


def test_nothing_is_removed_while_an_entry_is_damaged(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    entry = stores.add(store, *PASS).entry
    store.files.put(entry.path(ENTRIES), entry_document(entry)[:-9])
    before = contents(store)
    with pytest.raises(FileError, match="the entry is incomplete"):
        stores.clean(store, timedelta(0))
    assert contents(store) == before


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store with two passes and their index."""
    store = stores.create(str(tmp_path / "store"))
    stores.add(store, *PASS)
    stores.add(store, replace(KEY, day=date(2026, 5, 2)), *PASS[1:])
    stores.build_index(store)
    assert stores.verify(store) == ()
    return store


def test_a_flipped_bit_is_detected_in_every_file(store: Store) -> None:
    generator = random.Random(1)
    for path, content in contents(store).items():
        for position in {0, len(content) - 1, *generator.sample(range(len(content)), 6)}:
            damaged = bytearray(content)
            damaged[position] ^= 1 << generator.randrange(8)
            Path(store.url, path).write_bytes(damaged)
            assert path in {one.path for one in stores.verify(store)}, position
        Path(store.url, path).write_bytes(content)
    assert stores.verify(store) == ()


def test_a_missing_file_is_detected(store: Store) -> None:
    index = next(path for path in contents(store) if path.startswith("index"))
    for path, content in contents(store).items():
        if path in ("store.json", index):
            continue
        Path(store.url, path).unlink()
        problems = stores.verify(store)
        if path.startswith(ENTRIES):  # its data files have no entry now
            assert len(problems) == 6
            assert {one.what[:24] for one in problems} == {"no entry refers to it: i"}
        else:
            assert problems == (
                StoreProblem(path, "the file is missing; remove its entry, and add the pass again"),
            )
        Path(store.url, path).write_bytes(content)


def test_an_incomplete_file_is_detected(store: Store) -> None:
    for path, content in contents(store).items():
        if path == "store.json":
            continue
        Path(store.url, path).write_bytes(content[: len(content) // 2])
        assert [one.path for one in stores.verify(store)] == [path]
        Path(store.url, path).write_bytes(content)


def test_a_foreign_file_and_a_moved_entry_are_detected(store: Store) -> None:
    Path(store.url, "profiles", "x.parquet").write_bytes(b"")
    entry = stores.find(store)[0]
    moved = entry.path(ENTRIES).replace("line=Main", "line=Other")
    store.files.put(moved, entry_document(entry))
    problems = {one.path: one.what for one in stores.verify(store)}
    assert problems["profiles/x.parquet"] == "it is not a file of a store; remove it"
    assert "does not belong at this path" in problems[moved]
    assert len(problems) == 2


def test_an_outdated_index_is_detected_and_renewed(store: Store) -> None:
    entry = stores.find(store)[0]
    other = replace(entry, notes=("changed since",))
    store.files.put(entry.path(ENTRIES), entry_document(other))
    (problem,) = stores.verify(store)
    assert problem.path.startswith("index/")
    assert "run trackprofile store clean to renew it" in problem.what
    stores.build_index(store)
    assert stores.verify(store) == ()
    assert stores.find(store)[0] == other


def test_rows_of_the_index_without_an_entry_are_ignored(store: Store) -> None:
    first, second = stores.find(store)
    store.files.remove(first.path(ENTRIES))
    assert stores.find(store) == (second,)
    store.files.remove(second.path(ENTRIES))
    assert stores.find(store) == ()
    assert stores.build_index(store) == ""
    assert not any(path.startswith("index") for path in contents(store))


def test_a_damaged_index_is_reported_and_not_used(store: Store) -> None:
    path = next(path for path in contents(store) if path.startswith("index"))
    Path(store.url, path).write_bytes(contents(store)[path][:-1])
    with pytest.raises(
        FileError, match="does not match its checksum; remove it, and run trackprofile store clean"
    ):
        stores.find(stores.open_store(store.url))
    Path(store.url, path).unlink()
    assert len(stores.find(store)) == 2


def test_two_recordings_of_one_run_that_were_added_at_the_same_time_are_detected(
    store: Store, tmp_path: Path
) -> None:
    other = NETWORK.passed(0, 1)
    second = stores.create(str(tmp_path / "second"))
    assessment = assess(other, read_limits("en-13848"), SPEED)
    entry = stores.add(second, KEY, other, assessment, Origin(content_digest(other))).entry
    for path in (*entry.paths, entry.path(ENTRIES)):
        store.files.put(path, second.files.read(path))
    problems = stores.verify(store)
    assert len(problems) == 1
    assert "has another recording" in problems[0].what


def test_reading_a_damaged_pass_is_refused(store: Store) -> None:
    entry = stores.find(store)[0]
    path = Path(store.url, entry.path("profiles"))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(
        FileError, match=r"profiles/line=Main.* is damaged; run trackprofile store verify"
    ):
        stores.read_profile(store, entry)
    path.unlink()
    with pytest.raises(FileError, match=r"profiles/line=Main.* is missing"):
        stores.envelope(store, entry, "D1", 0.0, 100.0, 800)


def test_a_damaged_entry_is_reported_with_its_path(store: Store) -> None:
    entry = stores.find(store)[0]
    content = entry_document(entry)
    store.files.put(entry.path(ENTRIES), content.replace(b'"start":0.0', b'"start":1.0'))
    store.files.put(entry.path(ENTRIES), content.replace(b'"points"', b'"point"'))
    with pytest.raises(
        FileError, match=r"entries/line=Main.*the entry does not match its checksum"
    ):
        stores.find(store)


def test_a_folder_that_is_not_writable_is_reported_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "store").write_bytes(b"a file, not a folder")
    with pytest.raises(FileError, match="cannot be"):
        stores.create(str(tmp_path / "store" / "inner"))


PASSES = Network(1, 2000.0, 8)
KILLS = 12


def start_writer(folder: Path) -> subprocess.Popen[bytes]:
    """Start a process that adds all passes, and prints its progress after each."""
    command = [sys.executable, str(Path(__file__).with_name("network.py")), str(folder)]
    command += ["--lines", "1", "--length", "2000", "--passes", str(PASSES.passes)]
    return subprocess.Popen(command, stdout=subprocess.PIPE)


def exit_codes_of_writers(folder: Path, writers: int = 1) -> list[int]:
    """Exit codes of some writers that run at the same time."""
    with ExitStack() as stack:
        started = [stack.enter_context(start_writer(folder)) for _ in range(writers)]
        for one in started:
            one.communicate()
    return [one.returncode for one in started]


@pytest.mark.acceptance
def test_a_store_is_identical_after_twelve_kills(tmp_path: Path) -> None:
    undisturbed = stores.create(str(tmp_path / "undisturbed"))
    fill(undisturbed, PASSES)
    store = stores.create(str(tmp_path / "killed"))
    generator, killed = np.random.default_rng(2), 0
    for _ in range(KILLS):
        with start_writer(tmp_path / "killed") as writer:
            assert writer.stdout is not None
            writer.stdout.read(1)  # it is writing
            time.sleep(generator.uniform(0, 0.4))
            writer.send_signal(signal.SIGKILL)
        killed += writer.returncode == -signal.SIGKILL
        entries = stores.find(store)
        for one in stores.verify(store):
            assert one.what.startswith("no entry refers to it")
        for entry in entries:
            stores.read_profile(store, entry)
        if len(entries) == PASSES.passes:  # start again, so that every kill hits a writer
            shutil.rmtree(tmp_path / "killed")
            stores.create(str(tmp_path / "killed"))
    assert killed >= 10
    assert exit_codes_of_writers(tmp_path / "killed") == [0]
    stores.clean(store, timedelta(0))
    assert stores.verify(store) == ()
    assert contents(store) == contents(undisturbed)


@pytest.mark.acceptance
def test_concurrent_writers_of_the_same_passes_write_what_one_writer_writes(tmp_path: Path) -> None:
    alone = stores.create(str(tmp_path / "alone"))
    fill(alone, PASSES)
    assert exit_codes_of_writers(tmp_path / "together", writers=4) == [0] * 4
    together = stores.open_store(str(tmp_path / "together"))
    assert stores.verify(together) == ()
    assert contents(together) == contents(alone)

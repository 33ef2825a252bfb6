"""Whatever dies while it writes, and whatever happens to the bytes afterwards."""

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
from trackprofile.store.entry import document
from trackprofile.store.layout import ENTRIES
from trackprofile.store.object_files import LocalFiles

NETWORK = Network(1, 600.0, 3)
PROFILE = NETWORK.passed(0, 0)
FOUND = assess(PROFILE, read_limits("en-13848"), SPEED)
PLACE = PassKey("Main", "up", date(2026, 5, 1))
ORIGIN = Origin(content_digest(PROFILE))
PASS = (PLACE, PROFILE, FOUND, ORIGIN)


def tree(store: Store) -> dict[str, bytes]:
    folder = Path(store.url)
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


class Killed(BaseException):
    """As far as the code can see, the end."""


@dataclass(frozen=True)
class Dying(LocalFiles):
    """A folder whose writer dies at the n-th file, having written half of it under a temporary name."""

    left: list[int]

    def put(self, path: str, content: bytes) -> None:
        self.left[0] -= 1
        if self.left[0] >= 0:
            super().put(path, content)
            return
        target = Path(self.root, path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.with_name(f".{target.stem}.0123abcd{target.suffix}").write_bytes(
            content[: len(content) // 2]
        )
        raise Killed


@pytest.mark.parametrize("moment", range(7))
def test_whenever_a_writer_dies_there_is_a_whole_pass_or_none(tmp_path: Path, moment: int) -> None:
    whole, store = (stores.create(str(tmp_path / name)) for name in ("whole", "store"))
    stores.add(whole, *PASS)
    with pytest.raises(Killed):
        stores.add(replace(store, files=Dying(store.url, [moment])), *PASS)
    assert stores.find(store) == stores.lines(store) == ()
    assert {one.what[:16] for one in stores.verify(store)} == {"no entry names i"}
    assert stores.clean(store) == ()  # another writer might be at work on it
    again = stores.add(store, *PASS)
    assert again.new
    assert len(stores.clean(store, timedelta(0))) == 1  # the half that it left under another name
    assert stores.verify(store) == ()
    assert tree(store) == tree(whole)


def test_what_nobody_takes_up_again_is_cleared_away(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    empty = tree(store)
    for moment in (0, 3, 6):
        with pytest.raises(Killed):
            stores.add(replace(store, files=Dying(store.url, [moment])), *PASS)
    (tmp_path / "notes.txt").write_text("not ours", encoding="utf-8")
    old = time.time() - 2 * 86400
    for path in tmp_path.rglob("*"):
        os.utime(path, (old, old))
    assert len(stores.clean(store)) == 6 + 3
    assert tree(store) == empty | {"notes.txt": b"not ours"}
    (tmp_path / "notes.txt").unlink()
    for path in sorted(tmp_path.rglob("*"), reverse=True):
        if path.is_dir():
            os.utime(path, (old, old))
    stores.clean(store, timedelta(0))
    assert [path.name for path in tmp_path.iterdir()] == ["store.json"]


def test_half_a_pass_is_cleared_away_where_there_are_no_folders() -> None:
    store = stores.create("memory://half")
    entry = stores.add(store, *PASS).entry
    store.files.remove(entry.path(ENTRIES))
    assert {one.path for one in stores.verify(store)} == set(entry.paths)
    assert set(stores.clean(store, timedelta(0))) == set(entry.paths)
    assert stores.verify(store) == ()


def test_nothing_is_cleared_away_beside_a_damaged_entry(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    entry = stores.add(store, *PASS).entry
    store.files.put(entry.path(ENTRIES), document(entry)[:-9])
    before = tree(store)
    with pytest.raises(FileError, match="no whole entry"):
        stores.clean(store, timedelta(0))
    assert tree(store) == before


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Two passes, and their index."""
    store = stores.create(str(tmp_path / "store"))
    stores.add(store, *PASS)
    stores.add(store, replace(PLACE, day=date(2026, 5, 2)), *PASS[1:])
    stores.build_index(store)
    assert stores.verify(store) == ()
    return store


def test_a_flipped_bit_is_found_wherever_it_is(store: Store) -> None:
    generator = random.Random(1)
    for path, content in tree(store).items():
        for place in {0, len(content) - 1, *generator.sample(range(len(content)), 6)}:
            damaged = bytearray(content)
            damaged[place] ^= 1 << generator.randrange(8)
            Path(store.url, path).write_bytes(damaged)
            assert path in {one.path for one in stores.verify(store)}, place
        Path(store.url, path).write_bytes(content)
    assert stores.verify(store) == ()


def test_a_missing_file_is_found(store: Store) -> None:
    index = next(path for path in tree(store) if path.startswith("index"))
    for path, content in tree(store).items():
        if path in ("store.json", index):
            continue
        Path(store.url, path).unlink()
        problems = stores.verify(store)
        if path.startswith(ENTRIES):  # its files are now nobody's
            assert len(problems) == 6
            assert {one.what[:19] for one in problems} == {"no entry names it: "}
        else:
            assert problems == (
                StoreProblem(path, "the file is missing; remove its entry, and add the pass again"),
            )
        Path(store.url, path).write_bytes(content)


def test_a_half_written_partition_is_found(store: Store) -> None:
    for path, content in tree(store).items():
        if path == "store.json":
            continue
        Path(store.url, path).write_bytes(content[: len(content) // 2])
        assert [one.path for one in stores.verify(store)] == [path]
        Path(store.url, path).write_bytes(content)


def test_a_strange_file_and_a_moved_entry_are_found(store: Store) -> None:
    Path(store.url, "profiles", "x.parquet").write_bytes(b"")
    entry = stores.find(store)[0]
    moved = entry.path(ENTRIES).replace("line=Main", "line=Other")
    store.files.put(moved, document(entry))
    problems = {one.path: one.what for one in stores.verify(store)}
    assert problems["profiles/x.parquet"] == "not a file of a store; remove it"
    assert "does not belong there" in problems[moved]
    assert len(problems) == 2


def test_an_index_that_says_something_else_is_found_and_made_anew(store: Store) -> None:
    entry = stores.find(store)[0]
    other = replace(entry, notes=("changed since",))
    store.files.put(entry.path(ENTRIES), document(other))
    (problem,) = stores.verify(store)
    assert problem.path.startswith("index/")
    assert "tidy the store to make it anew" in problem.what
    stores.build_index(store)
    assert stores.verify(store) == ()
    assert stores.find(store)[0] == other


def test_an_index_says_nothing_of_what_is_no_longer_there(store: Store) -> None:
    first, second = stores.find(store)
    store.files.remove(first.path(ENTRIES))
    assert stores.find(store) == (second,)
    store.files.remove(second.path(ENTRIES))
    assert stores.find(store) == ()
    assert stores.build_index(store) == ""
    assert not any(path.startswith("index") for path in tree(store))


def test_a_damaged_index_is_told_and_not_believed(store: Store) -> None:
    path = next(path for path in tree(store) if path.startswith("index"))
    Path(store.url, path).write_bytes(tree(store)[path][:-1])
    with pytest.raises(FileError, match="its bytes were changed; remove it, and tidy the store"):
        stores.find(stores.open_store(store.url))
    Path(store.url, path).unlink()
    assert len(stores.find(store)) == 2


def test_two_recordings_of_one_run_are_found_even_if_they_came_at_once(
    store: Store, tmp_path: Path
) -> None:
    other = NETWORK.passed(0, 1)
    beside = stores.create(str(tmp_path / "beside"))
    found = assess(other, read_limits("en-13848"), SPEED)
    entry = stores.add(beside, PLACE, other, found, Origin(content_digest(other))).entry
    for path in (*entry.paths, entry.path(ENTRIES)):
        store.files.put(path, beside.files.read(path))
    problems = stores.verify(store)
    assert len(problems) == 1
    assert "has another recording" in problems[0].what


def test_a_damaged_pass_says_so_when_it_is_read(store: Store) -> None:
    entry = stores.find(store)[0]
    path = Path(store.url, entry.path("profiles"))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(
        FileError, match=r"profiles/line=Main.* is damaged; see what trackprofile store verify says"
    ):
        stores.read_profile(store, entry)
    path.unlink()
    with pytest.raises(FileError, match=r"profiles/line=Main.* is missing"):
        stores.envelope(store, entry, "D1", 0.0, 100.0, 800)


def test_a_damaged_entry_is_told_by_its_path(store: Store) -> None:
    entry = stores.find(store)[0]
    content = document(entry)
    store.files.put(entry.path(ENTRIES), content.replace(b'"start":0.0', b'"start":1.0'))
    store.files.put(entry.path(ENTRIES), content.replace(b'"points"', b'"point"'))
    with pytest.raises(FileError, match=r"entries/line=Main.*the entry was changed"):
        stores.find(store)


def test_a_folder_that_cannot_be_written_is_said_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "store").write_bytes(b"a file, not a folder")
    with pytest.raises(FileError, match="cannot be"):
        stores.create(str(tmp_path / "store" / "inner"))


PASSES = Network(1, 2000.0, 8)
KILLS = 12


def filling(folder: Path) -> subprocess.Popen[bytes]:
    """Another process that adds all passes, and says a word after each."""
    command = [sys.executable, str(Path(__file__).with_name("network.py")), str(folder)]
    command += ["--lines", "1", "--length", "2000", "--passes", str(PASSES.passes)]
    return subprocess.Popen(command, stdout=subprocess.PIPE)


def filled(folder: Path, writers: int = 1) -> list[int]:
    """How so many of them end that are left alone."""
    with ExitStack() as stack:
        started = [stack.enter_context(filling(folder)) for _ in range(writers)]
        for one in started:
            one.communicate()
    return [one.returncode for one in started]


@pytest.mark.acceptance
def test_a_store_is_the_same_to_the_last_bit_after_twelve_kills(tmp_path: Path) -> None:
    undisturbed = stores.create(str(tmp_path / "undisturbed"))
    fill(undisturbed, PASSES)
    store = stores.create(str(tmp_path / "killed"))
    generator, killed = np.random.default_rng(2), 0
    for _ in range(KILLS):
        with filling(tmp_path / "killed") as writer:
            assert writer.stdout is not None
            writer.stdout.read(1)  # it is at work
            time.sleep(generator.uniform(0, 0.4))
            writer.send_signal(signal.SIGKILL)
        killed += writer.returncode == -signal.SIGKILL
        entries = stores.find(store)
        for one in stores.verify(store):
            assert one.what.startswith("no entry names it")
        for entry in entries:
            stores.read_profile(store, entry)
        if len(entries) == PASSES.passes:  # begin again, so that every kill strikes
            shutil.rmtree(tmp_path / "killed")
            stores.create(str(tmp_path / "killed"))
    assert killed >= 10
    assert filled(tmp_path / "killed") == [0]
    stores.clean(store, timedelta(0))
    assert stores.verify(store) == ()
    assert tree(store) == tree(undisturbed)


@pytest.mark.acceptance
def test_processes_that_add_the_same_at_once_write_what_one_writes(tmp_path: Path) -> None:
    alone = stores.create(str(tmp_path / "alone"))
    fill(alone, PASSES)
    assert filled(tmp_path / "together", writers=4) == [0] * 4
    together = stores.open_store(str(tmp_path / "together"))
    assert stores.verify(together) == ()
    assert tree(together) == tree(alone)

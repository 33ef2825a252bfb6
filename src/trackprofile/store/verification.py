"""Seeing that a store holds what it says, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from trackprofile.errors import DataError, FileError
from trackprofile.store.entry import Entry, document, file_checksum, parsed
from trackprofile.store.index import indexed
from trackprofile.store.layout import (
    DATA,
    DATA_PATH,
    ENTRIES,
    ENTRY_PATH,
    INDEX_PATH,
    STORE_FILE,
    UNFINISHED_PATH,
)
from trackprofile.store.object_files import FoundFile
from trackprofile.store.store import HEAD, Store
from trackprofile.store.writing import check_claim


@dataclass(frozen=True)
class StoreProblem:
    """What is wrong with a file of a store.

    Parameters
    ----------
    path : below the store's root
    what : in a sentence, with what to do
    """

    path: str
    what: str


def verify(store: Store) -> tuple[StoreProblem, ...]:
    """Read every byte of a store, and name each file that is not what its entry says.

    Found are a flipped byte, a missing file, files of a pass that was not added to its end, files that are not of a
    store, and two recordings that contradict each other.
    """
    found = {one.path: one for one in store.files.listing("")}
    entries: list[Entry] = []
    problems: list[StoreProblem] = []
    named = {STORE_FILE}
    named.update(path for path in found if INDEX_PATH.fullmatch(path) or ENTRY_PATH.fullmatch(path))
    for path in found:
        if ENTRY_PATH.fullmatch(path):
            try:
                entries.append(parsed(store.files.read(path), path))
            except FileError as error:
                problems.append(StoreProblem(path, str(error)))
                named.update(_beside(path))
    if store.files.read(STORE_FILE) != HEAD:
        problems.append(
            StoreProblem(
                STORE_FILE, f"its bytes were changed; it should say {HEAD.decode().strip()}"
            )
        )
    for entry in entries:
        problems += _damaged(store, entry, found)
        named.update(entry.paths)
    problems += _untrue(store, found, entries)
    problems += [_unnamed(path) for path in found if path not in named]
    problems += _contradicting(entries)
    return tuple(sorted(problems, key=lambda one: one.path))


def _beside(entry: str) -> Iterator[str]:
    """Paths of the data files of an entry that cannot be read, by its own."""
    for table in DATA:
        yield f"{table}{entry.removeprefix(ENTRIES).removesuffix('.json')}.parquet"


def _damaged(store: Store, entry: Entry, found: dict[str, FoundFile]) -> Iterator[StoreProblem]:
    again = "remove its entry, and add the pass again"
    for table, stored in entry.files.items():
        path = entry.path(table)
        if path not in found:
            yield StoreProblem(path, f"the file is missing; {again}")
            continue
        size = found[path].size
        if size != stored.size:
            yield StoreProblem(
                path, f"half-written or replaced: {size} B of {stored.size} B; {again}"
            )
            continue
        try:
            if file_checksum(store.files.read(path)) != stored:
                yield StoreProblem(path, f"its bytes were changed; {again}")
        except FileNotFoundError:
            yield StoreProblem(path, f"the file was removed since; {again}")
        except FileError as error:
            yield StoreProblem(path, str(error))


def _untrue(
    store: Store, found: dict[str, FoundFile], entries: list[Entry]
) -> Iterator[StoreProblem]:
    """Indices that are damaged, or say of an entry what its file does not."""
    documents = {entry.path(ENTRIES): document(entry) for entry in entries}
    for path in found:
        if not INDEX_PATH.fullmatch(path):
            continue
        try:
            rows = indexed(store.files.read(path), path)
        except FileError as error:
            yield StoreProblem(path, str(error))
            continue
        told = zip(rows["path"].to_pylist(), rows["document"].to_pylist(), strict=True)
        other = [entry for entry, content in told if documents.get(entry, content) != content]
        if other:
            yield StoreProblem(path, f"it is older than {other[0]}; tidy the store to make it anew")


def _unnamed(path: str) -> StoreProblem:
    if UNFINISHED_PATH.fullmatch(path) or DATA_PATH.fullmatch(path):
        return StoreProblem(
            path,
            "no entry names it: a writer is at work or was killed; add the pass again, or tidy the store",
        )
    return StoreProblem(path, "not a file of a store; remove it")


def _contradicting(entries: list[Entry]) -> Iterator[StoreProblem]:
    days: dict[tuple[str, str, str], list[Entry]] = {}
    for one in entries:
        days.setdefault((one.line, one.direction, one.day.isoformat()), []).append(one)
    for of_day in days.values():
        for one, other in combinations(of_day, 2):
            try:
                check_claim((other,), one.place, one.origin.recording, one.start, one.end)
            except DataError as error:
                yield StoreProblem(one.path("entries"), str(error))

"""Seeing that a store holds what it says, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from trackprofile.errors import DataError, FileError
from trackprofile.store.entry import Entry, parsed, sealed
from trackprofile.store.files import Found
from trackprofile.store.layout import DATA_PATH, ENTRY_PATH, STORE_FILE, UNFINISHED_PATH
from trackprofile.store.room import Store
from trackprofile.store.writing import check_claim


@dataclass(frozen=True)
class Problem:
    """What is wrong with a file of a store.

    Parameters
    ----------
    path : below the store's root
    what : in a sentence, with what to do
    """

    path: str
    what: str


def verify(store: Store) -> tuple[Problem, ...]:
    """Read every byte of a store, and name each file that is not what its entry says.

    Found are a flipped byte, a missing file, files of a pass that was not added to its end, files that are not of a
    store, and two recordings that contradict each other.
    """
    found = {one.path: one for one in store.files.listing("")}
    entries: list[Entry] = []
    problems: list[Problem] = []
    for path in found:
        if ENTRY_PATH.fullmatch(path):
            try:
                entries.append(_own(parsed(store.files.read(path), path), path))
            except FileError as error:
                problems.append(Problem(path, str(error)))
    named = {STORE_FILE, *(path for path in found if ENTRY_PATH.fullmatch(path))}
    for entry in entries:
        problems += _damaged(store, entry, found)
        named.update(entry.path(table) for table in entry.files)
    problems += [_unnamed(path) for path in found if path not in named]
    problems += _contradicting(entries)
    return tuple(sorted(problems, key=lambda one: one.path))


def _own(entry: Entry, path: str) -> Entry:
    if entry.path("entries") != path:
        raise FileError(f"{path}: the entry belongs to {entry.path('entries')}; move or remove it.")
    return entry


def _damaged(store: Store, entry: Entry, found: dict[str, Found]) -> Iterator[Problem]:
    again = "remove its entry, and add the pass again"
    for table, stored in entry.files.items():
        path = entry.path(table)
        if path not in found:
            yield Problem(path, f"the file is missing; {again}")
            continue
        size = found[path].size
        if size != stored.size:
            yield Problem(path, f"half-written or replaced: {size} B of {stored.size} B; {again}")
        elif sealed(store.files.read(path)) != stored:
            yield Problem(path, f"its bytes were changed; {again}")


def _unnamed(path: str) -> Problem:
    if UNFINISHED_PATH.fullmatch(path) or DATA_PATH.fullmatch(path):
        return Problem(
            path,
            "no entry names it: a writer is at work or was killed; add the pass again, or tidy the store",
        )
    return Problem(path, "not a file of a store; remove it")


def _contradicting(entries: list[Entry]) -> Iterator[Problem]:
    days: dict[tuple[str, str, str], list[Entry]] = {}
    for one in entries:
        days.setdefault((one.line, one.direction, one.day.isoformat()), []).append(one)
    for of_day in days.values():
        for one, other in combinations(of_day, 2):
            try:
                check_claim((other,), one.place, one.origin.recording, one.start, one.end)
            except DataError as error:
                yield Problem(one.path("entries"), str(error))

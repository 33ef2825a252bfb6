"""Verification of a store: every byte is read and compared with the checksums of the entries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from trackprofile.errors import FileError
from trackprofile.store.entry import Entry, file_checksum, parse_entry
from trackprofile.store.index import parse_index
from trackprofile.store.layout import (
    DATA,
    DATA_PATH,
    ENTRIES,
    ENTRY_PATH,
    INDEX_PATH,
    SCHEMA,
    STORE_FILE,
    UNFINISHED_PATH,
)
from trackprofile.store.object_files import FileInfo
from trackprofile.store.recording_conflicts import conflicting_entries
from trackprofile.store.store import Store, store_file_content

_ADD_AGAIN = "remove its entry, and add the pass again"


@dataclass(frozen=True)
class StoreProblem:
    """A problem with a file of a store.

    Parameters
    ----------
    path : path below the store's root
    what : the problem and its remedy
    """

    path: str
    what: str


def verify(store: Store) -> tuple[StoreProblem, ...]:
    """Read every byte of a store, and report each file that differs from its entry.

    Reported are changed bytes, missing files, files of a pass that was not added completely, files that do not belong
    to a store, and recordings in conflict with each other.
    """
    files = {one.path: one for one in store.files.listing("")}
    documents: dict[str, bytes] = {}
    entries: list[Entry] = []
    problems: list[StoreProblem] = []
    expected = {STORE_FILE}
    expected.update(
        path for path in files if INDEX_PATH.fullmatch(path) or ENTRY_PATH.fullmatch(path)
    )
    for path in files:
        if ENTRY_PATH.fullmatch(path):
            try:
                content = store.files.read(path)
                entries.append(parse_entry(content, path))
                documents[path] = content
            except FileError as error:
                problems.append(StoreProblem(path, str(error)))
                expected.update(_data_paths(path))
    problems += _store_file_problems(store)
    for entry in entries:
        problems += _data_problems(store, entry, files)
        expected.update(entry.paths)
    problems += _index_problems(store, files, documents)
    problems += [_unexpected_file(path) for path in files if path not in expected]
    problems += _conflicts(entries)
    return tuple(sorted(problems, key=lambda one: one.path))


def _data_paths(entry: str) -> Iterator[str]:
    """Paths of the data files of an entry that cannot be read, from the path of the entry."""
    for table in DATA:
        yield f"{table}{entry.removeprefix(ENTRIES).removesuffix('.json')}.parquet"


def _store_file_problems(store: Store) -> Iterator[StoreProblem]:
    valid = [store_file_content(schema) for schema in range(1, SCHEMA + 1)]
    if store.files.read(STORE_FILE) not in valid:
        content = valid[-1].decode().strip()
        yield StoreProblem(STORE_FILE, f"its bytes were changed; its content should be {content}")


def _data_problems(
    store: Store, entry: Entry, files: Mapping[str, FileInfo]
) -> Iterator[StoreProblem]:
    for table, stored in entry.files.items():
        path = entry.path(table)
        if path not in files:
            yield StoreProblem(path, f"the file is missing; {_ADD_AGAIN}")
            continue
        size = files[path].size
        if size != stored.size:
            yield StoreProblem(
                path, f"incomplete or replaced: {size} B instead of {stored.size} B; {_ADD_AGAIN}"
            )
            continue
        try:
            if file_checksum(store.files.read(path)) != stored:
                yield StoreProblem(path, f"its bytes were changed; {_ADD_AGAIN}")
        except FileNotFoundError:
            yield StoreProblem(path, f"the file was removed during the verification; {_ADD_AGAIN}")
        except FileError as error:
            yield StoreProblem(path, str(error))


def _index_problems(
    store: Store, files: Mapping[str, FileInfo], documents: Mapping[str, bytes]
) -> Iterator[StoreProblem]:
    """Indices that are damaged, or that differ from the file of an entry."""
    for path in files:
        if not INDEX_PATH.fullmatch(path):
            continue
        try:
            rows = parse_index(store.files.read(path), path)
        except FileError as error:
            yield StoreProblem(path, str(error))
            continue
        indexed = zip(rows["path"].to_pylist(), rows["document"].to_pylist(), strict=True)
        outdated = [entry for entry, content in indexed if documents.get(entry, content) != content]
        if outdated:
            yield StoreProblem(
                path,
                f"the index is older than {outdated[0]}; run trackprofile store clean to renew it",
            )


def _unexpected_file(path: str) -> StoreProblem:
    if UNFINISHED_PATH.fullmatch(path) or DATA_PATH.fullmatch(path):
        return StoreProblem(
            path,
            "no entry refers to it: its writer is still active or was killed; add the pass again, or run trackprofile "
            "store clean",
        )
    return StoreProblem(path, "it is not a file of a store; remove it")


def _conflicts(entries: list[Entry]) -> Iterator[StoreProblem]:
    days: dict[tuple[str, str, str], list[Entry]] = {}
    for one in entries:
        days.setdefault((one.line, one.direction, one.day.isoformat()), []).append(one)
    for of_day in days.values():
        for position, one in enumerate(of_day):
            later = of_day[position + 1 :]
            for other, message in conflicting_entries(
                of_day, one.key, one.origin, one.start, one.end
            ):
                if other in later:
                    yield StoreProblem(one.path(ENTRIES), message)

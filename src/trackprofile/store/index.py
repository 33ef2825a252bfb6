"""The entries as one table: gathered in one file, so that thousands need not be opened to know what there is.

The file is an acceleration and no more. Its name is the hash of its bytes; what it says of an entry that is no longer
there is passed over, and entries that it does not know are read from their own files.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from datetime import date
from functools import lru_cache
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as parquet

from trackprofile.errors import FileError
from trackprofile.store.columns import written
from trackprofile.store.entry import Entry, document, file_checksum, parsed
from trackprofile.store.layout import ENTRIES, ENTRY_PATH, INDEX, INDEX_PATH
from trackprofile.store.object_files import Files, FoundFile
from trackprofile.store.store import Store

_KEPT = 50_000  # rows in memory, of some 3 kB


class EntryRow(NamedTuple):
    """What is asked for of an entry, and the whole of it as its file has it."""

    path: str
    size: int
    entry: str
    line: str
    direction: str
    day: date
    run: str
    recording: str
    start_m: float
    end_m: float
    revision: int
    software: str
    document: bytes


_SCHEMA = pa.schema(
    {
        "path": pa.string(),
        "size": pa.int64(),
        "entry": pa.string(),
        "line": pa.string(),
        "direction": pa.string(),
        "day": pa.date32(),
        "run": pa.string(),
        "recording": pa.string(),
        "start_m": pa.float64(),
        "end_m": pa.float64(),
        "revision": pa.int64(),
        "software": pa.string(),
        "document": pa.binary(),
    }
)


def entry_table(store: Store, folder: str = ENTRIES) -> pa.Table:
    """All entries below a folder, a `EntryRow` each.

    Raises
    ------
    FileError : an entry or the index is damaged.
    """
    there = {one.path: one for one in store.files.listing(folder) if ENTRY_PATH.fullmatch(one.path)}
    known = _known(store, there)
    paths = set(known["path"].to_pylist())
    fresh = _rows(store, [one for path, one in there.items() if path not in paths])
    return pa.concat_tables([known, _table(fresh)])


def rows_below(store: Store, folder: str) -> tuple[EntryRow, ...]:
    """All entries below a folder, each from its own file.

    Raises
    ------
    FileError : an entry is damaged.
    """
    return _rows(
        store, [one for one in store.files.listing(folder) if ENTRY_PATH.fullmatch(one.path)]
    )


def table_of(entries: Collection[Entry]) -> pa.Table:
    """Entries as `entry_table` would give them."""
    return _table([_row(one, document(one)) for one in entries])


def build_index(store: Store) -> str:
    """Gather all entries in the file that makes the catalogue of a large store quick, in the place of an older one.

    The same entries give the same file. Passes that are added later are found without it, at some 50 µs each.

    Returns
    -------
    its path below the store's root; empty where there are no entries

    Raises
    ------
    FileError : an entry is damaged.
    """
    rows = rows_below(store, ENTRIES)
    content = written(_table(sorted(rows)))
    path = f"{INDEX}/{file_checksum(content).sha256}.parquet"
    older = [one.path for one in store.files.listing(INDEX) if INDEX_PATH.fullmatch(one.path)]
    if rows and path not in older:
        store.files.put(path, content)
    for one in older:
        if one != path or not rows:
            store.files.remove(one)
    return path if rows else ""


def indexed(content: bytes, path: str) -> pa.Table:
    """The rows of an index file.

    Raises
    ------
    FileError : its bytes were changed.
    """
    if f"{INDEX}/{file_checksum(content).sha256}.parquet" != path:
        raise FileError(
            f"{path}: its bytes were changed; remove it, and tidy the store to make it anew."
        )
    return parquet.read_table(pa.BufferReader(content)).select(_SCHEMA.names).cast(_SCHEMA)


def _known(store: Store, there: dict[str, FoundFile]) -> pa.Table:
    """Rows of the index whose entries are there, as large as it says."""
    found = [one.path for one in store.files.listing(INDEX) if INDEX_PATH.fullmatch(one.path)]
    for path in reversed(found):
        try:
            table = _index(store.files, path)
        except FileNotFoundError:  # another has taken its place since
            continue
        places = zip(table["path"].to_pylist(), table["size"].to_pylist(), strict=True)
        valid = [path in there and there[path].size == size for path, size in places]
        return table.filter(pa.array(valid, pa.bool_()))
    return _SCHEMA.empty_table()


def _rows(store: Store, found: Iterable[FoundFile]) -> tuple[EntryRow, ...]:
    rows = []
    for one in found:
        try:
            rows.append(_read(store.files, one.path, one.size, one.stamp))
        except FileNotFoundError:  # removed since
            continue
    return tuple(rows)


@lru_cache(4)
def _index(files: Files, path: str) -> pa.Table:
    return indexed(files.read(path), path)


@lru_cache(_KEPT)
def _read(files: Files, path: str, size: int, stamp: str) -> EntryRow:
    """What an entry's file says, read once for as long as it is not replaced."""
    content = files.read(path)
    return _row(parsed(content, path), content)


def _row(entry: Entry, content: bytes) -> EntryRow:
    return EntryRow(
        path=entry.path(ENTRIES),
        size=len(content),
        entry=entry.id,
        line=entry.line,
        direction=entry.direction,
        day=entry.day,
        run=entry.run,
        recording=entry.origin.recording,
        start_m=entry.start,
        end_m=entry.end,
        revision=entry.origin.revision,
        software=_sortable(entry.origin.software),
        document=content,
    )


def _table(rows: Collection[EntryRow]) -> pa.Table:
    columns = list(zip(*rows, strict=True)) or [()] * len(_SCHEMA)
    arrays = [pa.array(one, field.type) for one, field in zip(columns, _SCHEMA, strict=True)]
    return pa.table(arrays, schema=_SCHEMA)


def _sortable(version: str) -> str:
    """A version as a text that sorts as versions do.

    >>> _sortable("0.9.1") < _sortable("0.10.0")
    True
    """
    return re.sub(r"\d+", lambda found: f"{int(found[0]):08d}", version)

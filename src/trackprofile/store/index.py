"""Table of all entries, and the index: one file with all entries, so that a catalogue is read without opening each.

The index only saves time. Its name is the digest of its bytes; rows of entries that no longer exist are ignored, and
entries that are not in it are read from their own files.
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
from trackprofile.store.columns import table_to_parquet
from trackprofile.store.entry import Entry, entry_document, file_checksum, parse_entry
from trackprofile.store.layout import ENTRIES, ENTRY_PATH, INDEX, INDEX_PATH
from trackprofile.store.object_files import FileInfo, Files
from trackprofile.store.store import Store

_CACHED_ROWS = 50_000  # rows in memory, of about 3 kB each
_CACHED_INDICES = 4


class EntryRow(NamedTuple):
    """Columns of an entry that are searched, and its document."""

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
    fingerprint: str
    schema: int
    document: bytes


_COLUMNS = pa.schema(
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
        "fingerprint": pa.string(),
        "schema": pa.int64(),
        "document": pa.binary(),
    }
)
_DEFAULTS = {"fingerprint": "", "schema": 1}
"""Values of the columns that an index of schema 1 lacks."""


def entry_table(store: Store, folder: str = ENTRIES) -> pa.Table:
    """All entries below a folder, one `EntryRow` each.

    Raises
    ------
    FileError : an entry or the index is damaged.
    """
    existing = {
        one.path: one for one in store.files.listing(folder) if ENTRY_PATH.fullmatch(one.path)
    }
    indexed = _indexed_rows(store, existing)
    paths = set(indexed["path"].to_pylist())
    others = _read_rows(store, [one for path, one in existing.items() if path not in paths])
    return pa.concat_tables([indexed, _table(others)])


def read_entry_rows(store: Store, folder: str) -> tuple[EntryRow, ...]:
    """All entries below a folder, each read from its own file.

    Raises
    ------
    FileError : an entry is damaged.
    """
    return _read_rows(
        store, [one for one in store.files.listing(folder) if ENTRY_PATH.fullmatch(one.path)]
    )


def table_of_entries(entries: Collection[Entry]) -> pa.Table:
    """The table that `entry_table` gives for these entries."""
    return _table([_row(one, entry_document(one)) for one in entries])


def build_index(store: Store) -> str:
    """Write the index, and remove earlier ones.

    The same entries give the same file. Passes that are added later are read from their own files, about 50 µs each.

    Returns
    -------
    path of the index below the store's root; empty if there are no entries

    Raises
    ------
    FileError : an entry is damaged.
    """
    rows = read_entry_rows(store, ENTRIES)
    content = table_to_parquet(_table(sorted(rows)))
    path = f"{INDEX}/{file_checksum(content).sha256}.parquet"
    earlier = [one.path for one in store.files.listing(INDEX) if INDEX_PATH.fullmatch(one.path)]
    if rows and path not in earlier:
        store.files.put(path, content)
    for one in earlier:
        if one != path or not rows:
            store.files.remove(one)
    return path if rows else ""


def parse_index(content: bytes, path: str) -> pa.Table:
    """Rows of an index file, of the current schema or an earlier one.

    Raises
    ------
    FileError : its bytes do not match its name.
    """
    if f"{INDEX}/{file_checksum(content).sha256}.parquet" != path:
        raise FileError(
            f"{path}: the index does not match its checksum; remove it, and run trackprofile store clean."
        )
    rows = parquet.read_table(pa.BufferReader(content))
    for name, value in _DEFAULTS.items():
        if name not in rows.column_names:
            rows = rows.append_column(
                name, pa.array([value] * rows.num_rows, _COLUMNS.field(name).type)
            )
    return rows.select(_COLUMNS.names).cast(_COLUMNS)


def _indexed_rows(store: Store, existing: dict[str, FileInfo]) -> pa.Table:
    """Rows of the index whose entries exist with the stated size."""
    indices = [one.path for one in store.files.listing(INDEX) if INDEX_PATH.fullmatch(one.path)]
    for path in reversed(indices):
        try:
            rows = _read_index(store.files, path)
        except FileNotFoundError:  # replaced by another since the listing
            continue
        sizes = zip(rows["path"].to_pylist(), rows["size"].to_pylist(), strict=True)
        valid = [entry in existing and existing[entry].size == size for entry, size in sizes]
        return rows.filter(pa.array(valid, pa.bool_()))
    return _COLUMNS.empty_table()


def _read_rows(store: Store, files: Iterable[FileInfo]) -> tuple[EntryRow, ...]:
    rows = []
    for one in files:
        try:
            rows.append(_read_row(store.files, one.path, one.size, one.stamp))
        except FileNotFoundError:  # removed since the listing
            continue
    return tuple(rows)


@lru_cache(_CACHED_INDICES)
def _read_index(files: Files, path: str) -> pa.Table:
    return parse_index(files.read(path), path)


@lru_cache(_CACHED_ROWS)
def _read_row(files: Files, path: str, size: int, stamp: str) -> EntryRow:
    """Row of an entry's file, cached until the file is replaced."""
    content = files.read(path)
    return _row(parse_entry(content, path), content)


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
        fingerprint=entry.origin.fingerprint,
        schema=entry.schema,
        document=content,
    )


def _table(rows: Collection[EntryRow]) -> pa.Table:
    columns = list(zip(*rows, strict=True)) or [()] * len(_COLUMNS)
    arrays = [pa.array(one, field.type) for one, field in zip(columns, _COLUMNS, strict=True)]
    return pa.table(arrays, schema=_COLUMNS)


def _sortable(version: str) -> str:
    """A version as text whose alphabetical order is the order of versions.

    >>> _sortable("0.9.1") < _sortable("0.10.0")
    True
    """
    return re.sub(r"\d+", lambda number: f"{int(number[0]):08d}", version)

"""The catalogue: which passes a store has, queried in SQL with DuckDB inside this process.

Of the versions of one recording, `find` returns the current one: that with the largest revision, then the latest
version of the software, then the latest schema, then the largest identifier. This order does not depend on when a
version was stored.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import Any

import pyarrow as pa

from trackprofile.errors import FileError
from trackprofile.store.entry import Entry, parse_entry
from trackprofile.store.index import entry_table, read_entry_rows, table_of_entries
from trackprofile.store.layout import ENTRIES, PassKey, encoded
from trackprofile.store.store import Store

_CACHED_ENTRIES = 10_000  # entries in memory, of about 5 kB each


@dataclass(frozen=True)
class StoredLine:
    """A line and direction with its passes.

    Parameters
    ----------
    line, direction : names
    start, end : smallest and largest chainage of all passes [m]
    days : days with passes, sorted
    passes : number of passes, each counted once whatever its versions
    """

    line: str
    direction: str
    start: float
    end: float
    days: tuple[date, ...]
    passes: int


def find(
    store: Store,
    *,
    line: str | None = None,
    direction: str | None = None,
    first: date | None = None,
    last: date | None = None,
    start: float | None = None,
    end: float | None = None,
    all_versions: bool = False,
) -> tuple[Entry, ...]:
    """Entries of a store, by line, direction, day and stretch.

    Parameters
    ----------
    store : the store
    line, direction : names; None selects all
    first, last : first and last day, both included
    start, end : ends of a stretch that the pass overlaps [m]
    all_versions : all versions of each recording, not only the current one

    Raises
    ------
    FileError : an entry is damaged, or DuckDB is not installed.
    """
    folder = ENTRIES if line is None else f"{ENTRIES}/line={encoded(line)}"
    rows = _query(entry_table(store, folder), _FIND, {
        "line": line, "direction": direction, "first": first, "last": last, "start": start,
        "end": end, "all_versions": all_versions,
    })  # fmt: skip
    return tuple(_entry(content, path) for path, content in rows)


def lines(store: Store) -> tuple[StoredLine, ...]:
    """All lines and directions with passes.

    Raises
    ------
    FileError : an entry is damaged, or DuckDB is not installed.
    """
    return tuple(
        StoredLine(line, direction, start, end, tuple(days), passes)
        for line, direction, start, end, days, passes in _query(entry_table(store), _LINES, {})
    )


def entries_of_day(store: Store, key: PassKey) -> tuple[Entry, ...]:
    """All entries of a line, direction and day, in all versions; the key's run is ignored."""
    rows = read_entry_rows(store, key.folder(ENTRIES))
    return tuple(_entry(row.document, row.path) for row in rows)


def current_versions(entries: Collection[Entry]) -> frozenset[str]:
    """Path of the entry that is the current version, for each recording."""
    return frozenset(path for (path,) in _query(table_of_entries(entries), _CURRENT, {}))


_SAME_PASS = "line, direction, day, run"

# Entries are of one recording if they have its identity or its fingerprint in common. An entry of schema 1 has the
# fingerprint as its identity. Each step gives connected entries the smallest label among them.
_CURRENT = f"""
WITH fingerprints AS (
    SELECT path, {_SAME_PASS}, recording, revision, software, schema, entry,
        coalesce(nullif(fingerprint, ''), recording) AS label_0
    FROM catalogue
), by_recording AS (
    SELECT *, min(label_0) OVER (PARTITION BY {_SAME_PASS}, recording) AS label_1 FROM fingerprints
), by_fingerprint AS (
    SELECT *, min(label_1) OVER (PARTITION BY {_SAME_PASS}, label_0) AS label_2 FROM by_recording
), recordings AS (
    SELECT *, min(label_2) OVER (PARTITION BY {_SAME_PASS}, recording) AS label_3 FROM by_fingerprint
)
SELECT path FROM recordings
QUALIFY row_number() OVER (
    PARTITION BY {_SAME_PASS}, label_3 ORDER BY revision DESC, software DESC, schema DESC, entry DESC
) = 1
"""

_FIND = f"""
SELECT path, document FROM catalogue
WHERE ($line IS NULL OR line = $line) AND ($direction IS NULL OR direction = $direction)
  AND ($first IS NULL OR day >= $first) AND ($last IS NULL OR day <= $last)
  AND ($start IS NULL OR end_m >= $start) AND ($end IS NULL OR start_m <= $end)
  AND ($all_versions OR path IN ({_CURRENT}))
ORDER BY line, direction, day, start_m, run, entry
"""

_LINES = f"""
SELECT line, direction, min(start_m), max(end_m), list(DISTINCT day ORDER BY day), count(*)
FROM catalogue WHERE path IN ({_CURRENT}) GROUP BY line, direction ORDER BY line, direction
"""


@lru_cache(_CACHED_ENTRIES)
def _entry(content: bytes, path: str) -> Entry:
    return parse_entry(content, path)


def _query(catalogue: pa.Table, query: str, values: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    with _database().cursor() as cursor:
        cursor.register("catalogue", catalogue)
        return cursor.execute(query, dict(values)).fetchall()


@lru_cache(1)
def _database() -> Any:
    try:
        import duckdb
    except ImportError as error:
        raise FileError(
            "The catalogue of a store needs DuckDB: pip install 'trackprofile[network]'."
        ) from error
    settings = {
        "threads": 2,
        "memory_limit": "256MB",
        "autoinstall_known_extensions": False,
        "enable_external_access": False,
    }
    return duckdb.connect(":memory:", config=settings)

"""The catalogue: which passes there are, asked in SQL of a DuckDB that lives in this process.

Of one recording `find` gives the newest version only. Newest is the greatest revision, then the greatest version of the
software, then the greatest entry: an order that does not depend on when something was stored.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import Any

import pyarrow as pa

from trackprofile.errors import FileError
from trackprofile.store.entry import Entry, parsed
from trackprofile.store.index import entry_table, rows_below, table_of
from trackprofile.store.layout import ENTRIES, PassKey, encoded
from trackprofile.store.store import Store

_KEPT = 10_000  # entries in memory, of some 5 kB


@dataclass(frozen=True)
class StoredLine:
    """A line in one direction, as far as it was passed.

    Parameters
    ----------
    line, direction : by name
    start, end : of all its passes [m]
    days : on which it was passed, in their order
    passes : how many, of which each counts in its newest version
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
    """The passes that there are, by line, direction, day and place.

    Parameters
    ----------
    line, direction : by name; None takes all
    first, last : days, both included
    start, end : of a stretch that the pass touches [m]
    all_versions : not only the newest of each recording

    Raises
    ------
    FileError : an entry is damaged, or DuckDB is not installed.
    """
    folder = ENTRIES if line is None else f"{ENTRIES}/line={encoded(line)}"
    rows = _ask(entry_table(store, folder), _FIND, {
        "line": line, "direction": direction, "first": first, "last": last, "start": start,
        "end": end, "all_versions": all_versions,
    })  # fmt: skip
    return tuple(_entry(content, path) for path, content in rows)


def lines(store: Store) -> tuple[StoredLine, ...]:
    """Every line and direction of which there are passes.

    Raises
    ------
    FileError : an entry is damaged, or DuckDB is not installed.
    """
    return tuple(
        StoredLine(line, direction, start, end, tuple(days), passes)
        for line, direction, start, end, days, passes in _ask(entry_table(store), _LINES, {})
    )


def entries_of_day(store: Store, place: PassKey) -> tuple[Entry, ...]:
    """All entries of a line, direction and day, in all versions."""
    return tuple(_entry(row.document, row.path) for row in rows_below(store, place.folder(ENTRIES)))


def newest(entries: Collection[Entry]) -> frozenset[str]:
    """Of each recording of a run the newest version, by the path of its entry."""
    return frozenset(path for (path,) in _ask(table_of(entries), _NEWEST, {}))


_NEWEST = """
SELECT path FROM catalogue
QUALIFY row_number() OVER (
    PARTITION BY line, direction, day, run, recording ORDER BY revision DESC, software DESC, entry DESC
) = 1
"""

_FIND = f"""
SELECT path, document FROM catalogue
WHERE ($line IS NULL OR line = $line) AND ($direction IS NULL OR direction = $direction)
  AND ($first IS NULL OR day >= $first) AND ($last IS NULL OR day <= $last)
  AND ($start IS NULL OR end_m >= $start) AND ($end IS NULL OR start_m <= $end)
  AND ($all_versions OR path IN ({_NEWEST}))
ORDER BY line, direction, day, start_m, run, entry
"""

_LINES = f"""
SELECT line, direction, min(start_m), max(end_m), list(DISTINCT day ORDER BY day), count(*)
FROM catalogue WHERE path IN ({_NEWEST}) GROUP BY line, direction ORDER BY line, direction
"""


@lru_cache(_KEPT)
def _entry(content: bytes, path: str) -> Entry:
    return parsed(content, path)


def _ask(catalogue: pa.Table, query: str, values: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    with _database().cursor() as cursor:
        cursor.register("catalogue", catalogue)
        return cursor.execute(query, dict(values)).fetchall()


@lru_cache(1)
def _database() -> Any:
    try:
        import duckdb
    except ImportError as error:
        raise FileError(
            "The catalogue of a store is asked by DuckDB: pip install 'trackprofile[network]'."
        ) from error
    settings = {
        "threads": 2,
        "memory_limit": "256MB",
        "autoinstall_known_extensions": False,
        "enable_external_access": False,
    }
    return duckdb.connect(":memory:", config=settings)

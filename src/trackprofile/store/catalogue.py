"""The catalogue: which passes there are, asked in SQL of a DuckDB that lives in this process.

Of one recording `find` gives the newest version only. Newest is the greatest revision, then the greatest version of the
software, then the greatest entry: an order that does not depend on when something was stored.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import Any

import pyarrow as pa

from trackprofile.errors import FileError
from trackprofile.store.entry import Entry, parsed
from trackprofile.store.files import Files
from trackprofile.store.layout import ENTRIES, ENTRY_PATH, Place, encoded
from trackprofile.store.room import Store

_KEPT = 100_000  # entries in memory


@dataclass(frozen=True)
class Line:
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
    entries, table = _catalogue(store, line)
    rows = _ask(table, _FIND, {
        "line": line, "direction": direction, "first": first, "last": last, "start": start,
        "end": end, "all_versions": all_versions,
    })  # fmt: skip
    return tuple(entries[number] for (number,) in rows)


def lines(store: Store) -> tuple[Line, ...]:
    """Every line and direction of which there are passes.

    Raises
    ------
    FileError : an entry is damaged, or DuckDB is not installed.
    """
    _, table = _catalogue(store, None)
    return tuple(
        Line(line, direction, start, end, tuple(days), passes)
        for line, direction, start, end, days, passes in _ask(table, _LINES, {})
    )


def entries_of_day(store: Store, place: Place) -> tuple[Entry, ...]:
    """All entries of a line, direction and day, in all versions."""
    return tuple(_entries(store, place.folder(ENTRIES)))


def newest(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Of each recording of a run the newest version."""
    found: dict[tuple[Place, str], Entry] = {}
    for one in entries:
        key = (one.place, one.origin.recording)
        if key not in found or _rank(one) > _rank(found[key]):
            found[key] = one
    return tuple(found.values())


_FIND = """
SELECT number FROM catalogue
WHERE ($line IS NULL OR line = $line) AND ($direction IS NULL OR direction = $direction)
  AND ($first IS NULL OR day >= $first) AND ($last IS NULL OR day <= $last)
  AND ($start IS NULL OR end_m >= $start) AND ($end IS NULL OR start_m <= $end)
  AND ($all_versions OR newest)
ORDER BY line, direction, day, start_m, run, entry
"""

_LINES = """
SELECT line, direction, min(start_m), max(end_m), list(DISTINCT day ORDER BY day), count(*)
FROM catalogue WHERE newest GROUP BY line, direction ORDER BY line, direction
"""


def _rank(entry: Entry) -> tuple[int, tuple[int, ...], str]:
    """The greatest is the newest version."""
    numbers = re.match(r"\d+(\.\d+)*", entry.origin.software)
    version = tuple(map(int, numbers[0].split("."))) if numbers else ()
    return entry.origin.revision, version, entry.id


def _catalogue(store: Store, line: str | None) -> tuple[tuple[Entry, ...], pa.Table]:
    """All entries, or those of a line, and a table of them."""
    folder = ENTRIES if line is None else f"{ENTRIES}/line={encoded(line)}"
    entries = tuple(_entries(store, folder))
    latest = {id(one) for one in newest(entries)}
    columns: dict[str, tuple[pa.DataType, list[Any]]] = {
        "number": (pa.int64(), list(range(len(entries)))),
        "entry": (pa.string(), [one.id for one in entries]),
        "line": (pa.string(), [one.line for one in entries]),
        "direction": (pa.string(), [one.direction for one in entries]),
        "day": (pa.date32(), [one.day for one in entries]),
        "run": (pa.string(), [one.run for one in entries]),
        "start_m": (pa.float64(), [one.start for one in entries]),
        "end_m": (pa.float64(), [one.end for one in entries]),
        "newest": (pa.bool_(), [id(one) in latest for one in entries]),
    }
    return entries, pa.table({name: pa.array(rows, kind) for name, (kind, rows) in columns.items()})


def _entries(store: Store, folder: str) -> Iterable[Entry]:
    for one in store.files.listing(folder):
        if ENTRY_PATH.fullmatch(one.path):
            yield _entry(store.files, one.path, one.size, one.stamp)


@lru_cache(_KEPT)
def _entry(files: Files, path: str, size: int, stamp: str) -> Entry:
    """What a file says, read once for as long as it is not replaced."""
    return parsed(files.read(path), path)


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
        "autoinstall_known_extensions": False,
        "enable_external_access": False,
    }
    return duckdb.connect(":memory:", config=settings)

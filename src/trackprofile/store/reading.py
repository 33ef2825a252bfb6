"""Reading what a pass has in the store: no more of it than is needed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import append_provenance, build_profile
from trackprofile.errors import DataError, FileError, TrackprofileError
from trackprofile.store.columns import ATTRIBUTES, LEVEL, SPREAD
from trackprofile.store.entry import Entry
from trackprofile.store.layout import PROFILES, TABLES
from trackprofile.store.store import Store


def read_columns(
    store: Store,
    entry: Entry,
    names: Sequence[str],
    start: float = -np.inf,
    end: float = np.inf,
    *,
    table: str = PROFILES,
    optional: Sequence[str] = (),
) -> dict[str, NDArray[Any]]:
    """Columns of a pass between two places, both included; numbers that are not known are NaN.

    ``distance_m`` is among them, whatever is asked for.

    Parameters
    ----------
    names : as of `trackprofile.store.columns`, such as ``level_D1_m``
    start, end : [m]
    table : ``profiles`` or ``overviews``
    optional : those of the names that a pass may not have

    Raises
    ------
    DataError : the pass has no such column.
    FileError : the file is missing or damaged.
    """
    return _rows(store, entry, names, start, end, table, optional)[0]


def read_profile(
    store: Store, entry: Entry, start: float | None = None, end: float | None = None
) -> xr.Dataset:
    """The profile of a pass, or of a stretch of it with both ends included.

    Raises
    ------
    DataError : fewer than two points lie between start and end.
    FileError : the file is missing or damaged.
    """
    low = -np.inf if start is None else start
    high = np.inf if end is None else end
    columns, attributes = _rows(store, entry, None, low, high, PROFILES, ())
    if columns["distance_m"].size < 2:
        raise DataError(
            f"Between {low:g} m and {high:g} m there are {columns['distance_m'].size} points of a pass from "
            f"{entry.start:g} m to {entry.end:g} m; choose a stretch inside it."
        )
    profile = _dataset(columns, attributes)
    if start is None and end is None:
        return profile
    return append_provenance(profile, f"between {low:g} m and {high:g} m")


def table(
    store: Store,
    entries: Iterable[Entry],
    name: str,
    start: float | None = None,
    end: float | None = None,
) -> dict[str, list[Any]]:
    """Rows of an assessment's table of all these passes that touch a stretch.

    Parameters
    ----------
    name : one of `trackprofile.store.layout.TABLES`
    start, end : [m]; None leaves that end open

    Returns
    -------
    columns as of `trackprofile.assessment.tables`, after ``entry``, ``line``, ``direction``, ``day``, ``run``

    Raises
    ------
    FileError : a file is missing or damaged.
    """
    parts = [rows_of(store, entry, name, start, end) for entry in entries]
    if not parts:
        return {}
    return pa.concat_tables(parts, promote_options="default").to_pydict()


def rows_of(
    store: Store,
    entry: Entry,
    name: str,
    start: float | None = None,
    end: float | None = None,
    columns: Sequence[str] | None = None,
) -> pa.Table:
    """The same of one pass as an Arrow table; of some columns only, where they are named.

    Raises
    ------
    DataError : there is no such table.
    FileError : the file is missing or damaged.
    """
    if name not in TABLES:
        raise DataError(f"There is no table {name!r}; choose one of {', '.join(TABLES)}.")
    wanted = None if columns is None else [*dict.fromkeys((*columns, "start_m", "end_m"))]
    with _opened(store, entry.path(name)) as file:
        there = file.schema_arrow.names
        rows = file.read(None if wanted is None else [one for one in wanted if one in there])
        if start is not None:
            rows = rows.filter(pa.array(rows["end_m"].to_numpy() >= start))
        if end is not None:
            rows = rows.filter(pa.array(rows["start_m"].to_numpy() <= end))
    return rows


def defects(
    store: Store, entries: Iterable[Entry], start: float | None = None, end: float | None = None
) -> dict[str, list[Any]]:
    """The isolated defects of all these passes that touch a stretch; see `table`."""
    return table(store, entries, "defects", start, end)


def sections(
    store: Store, entries: Iterable[Entry], start: float | None = None, end: float | None = None
) -> dict[str, list[Any]]:
    """The sections of all these passes that touch a stretch; see `table`."""
    return table(store, entries, "sections", start, end)


@contextmanager
def _opened(store: Store, path: str) -> Iterator[parquet.ParquetFile]:
    """A Parquet file of a store; what goes wrong in it is told as ours."""
    try:
        with store.files.open(path) as file:
            yield parquet.ParquetFile(file, page_checksum_verification=True)
    except TrackprofileError:
        raise
    except FileNotFoundError as error:
        raise FileError(f"{store.url}: {path} is missing; {_REMEDY}.") from error
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise FileError(f"{store.url}: {path} is damaged; {_REMEDY}.") from error


_REMEDY = (
    "see what trackprofile store verify says, remove it with its entry, and add the pass again"
)


def _rows(
    store: Store,
    entry: Entry,
    names: Sequence[str] | None,
    start: float,
    end: float,
    table: str,
    optional: Sequence[str],
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    with _opened(store, entry.path(table)) as file:
        there = file.schema_arrow.names
        if table == PROFILES and file.metadata.num_rows != entry.points:
            raise FileError(f"{store.url}: {entry.path(table)} is of another pass; {_REMEDY}.")
        if names is None:
            names = [name for name in there if not name.startswith(LEVEL)]
        names = list(dict.fromkeys(("distance_m", *names)))
        lacking = [name for name in names if name not in there and name not in optional]
        if lacking:
            raise DataError(f"The pass {entry.id} has no {lacking[0]}; it has {', '.join(there)}.")
        names = [name for name in names if name in there]
        found = file.read_row_groups(_groups(file, start, end), columns=names)
        about = json.loads(file.schema_arrow.metadata[ATTRIBUTES])
        attributes = about["attributes"] if table == PROFILES else {}
    columns = {name: found[name].to_numpy() for name in names}
    distance = columns["distance_m"]
    inside = slice(
        np.searchsorted(distance, start, "left"), np.searchsorted(distance, end, "right")
    )
    return {name: values[inside] for name, values in columns.items()}, attributes


def _dataset(columns: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> xr.Dataset:
    """The profile contract from its columns: of the mean, and of each rail where they are told apart."""
    bands = {
        found[1]: values
        for name, values in columns.items()
        if (found := re.fullmatch(f"{SPREAD}_(.+)_m", name))
    }
    profile = build_profile(
        columns["distance_m"],
        columns["elevation_m"],
        kind=attributes["kind"],
        standard_deviation=columns.get(f"{SPREAD}_m"),
        band_standard_deviations=bands,
        quality=columns["quality"],
        loading=attributes["loading"],
    ).assign_attrs(attributes)
    flags, metre = profile["quality"].attrs, {"units": "m"}
    for column, values in columns.items():
        name = column.removesuffix("_m")
        if name not in profile.variables:
            about, values = (
                (flags, values) if name == column else (metre, values.astype(np.float64))
            )
            profile[name] = ("distance", values, about)
    return profile


def _groups(file: parquet.ParquetFile, start: float, end: float) -> list[int]:
    """The row groups that touch a stretch, by the statistics of their distance."""
    place = file.schema_arrow.get_field_index("distance_m")
    kept = []
    for number in range(file.metadata.num_row_groups):
        told = file.metadata.row_group(number).column(place).statistics
        if told is None or (told.min <= end and told.max >= start):
            kept.append(number)
    return kept

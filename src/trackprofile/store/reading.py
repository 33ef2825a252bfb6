"""Reading the profile and the tables of a pass, or a stretch of them."""

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

from trackprofile.assessment.tables import ASSESSMENT_TABLES
from trackprofile.contracts import append_provenance, build_profile
from trackprofile.errors import DataError, FileError, TrackprofileError
from trackprofile.store.columns import LEVEL, METADATA_KEY, STANDARD_DEVIATION
from trackprofile.store.entry import Entry
from trackprofile.store.layout import PROFILES
from trackprofile.store.store import Store

_REMEDY = "run trackprofile store verify, remove the file with its entry, and add the pass again"

_RENAMED_COLUMNS = {
    "likely": "required_action",
    "required_action_text": "required_action_text",
    "of_estimate_mm": "estimate_standard_deviation_mm",
}
"""Columns of assessment tables that schema 1 named differently, old name first."""


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
    """Columns of a pass on a stretch, both ends included; unknown numbers are NaN.

    Parameters
    ----------
    store, entry : the pass
    names : names of columns, as in `trackprofile.store.columns`, such as ``level_D1_m``; ``distance_m`` is always read
    start, end : ends of the stretch [m]
    table : ``profiles`` or ``overviews``
    optional : those of the names that a pass may lack

    Raises
    ------
    DataError : the pass has no such column.
    FileError : the file is missing or damaged.
    """
    return _read_table(store, entry, names, (start, end), table=table, optional=optional)[0]


def read_profile(
    store: Store, entry: Entry, start: float | None = None, end: float | None = None
) -> xr.Dataset:
    """Profile of a pass, or of a stretch of it, both ends included.

    Parameters
    ----------
    store, entry : the pass
    start, end : ends of the stretch [m]; None is the end of the pass

    Raises
    ------
    DataError : the stretch has fewer than two points of the pass.
    FileError : the file is missing or damaged.
    """
    low = -np.inf if start is None else start
    high = np.inf if end is None else end
    columns, attributes = _read_table(store, entry, None, (low, high), table=PROFILES)
    if (count := columns["distance_m"].size) < 2:
        raise DataError(
            f"Between {low:g} m and {high:g} m the pass from {entry.start:g} m to {entry.end:g} m has "
            f"{count} {'point' if count == 1 else 'points'}; choose a stretch inside it."
        )
    profile = _dataset(columns, attributes)
    if start is None and end is None:
        return profile
    return append_provenance(profile, f"between {low:g} m and {high:g} m")


def read_table(
    store: Store,
    entries: Iterable[Entry],
    name: str,
    start: float | None = None,
    end: float | None = None,
) -> dict[str, list[Any]]:
    """Rows of a table of the assessments of some passes that overlap a stretch.

    Parameters
    ----------
    store, entries : the passes
    name : one of `trackprofile.assessment.tables.ASSESSMENT_TABLES`
    start, end : ends of the stretch [m]; None is open

    Returns
    -------
    columns as in `trackprofile.assessment.tables`, after ``entry``, ``line``, ``direction``, ``day``, ``run``

    Raises
    ------
    DataError : there is no such table.
    FileError : a file is missing or damaged.
    """
    parts = [read_table_rows(store, entry, name, start, end) for entry in entries]
    if not parts:
        return {}
    return pa.concat_tables(parts, promote_options="default").to_pydict()


def read_table_rows(
    store: Store,
    entry: Entry,
    name: str,
    start: float | None = None,
    end: float | None = None,
    columns: Sequence[str] | None = None,
) -> pa.Table:
    """Rows of a table of one pass that overlap a stretch, as an Arrow table.

    Parameters
    ----------
    store, entry : the pass
    name : one of `trackprofile.assessment.tables.ASSESSMENT_TABLES`
    start, end : ends of the stretch [m]; None is open
    columns : names of the columns; None reads all

    Raises
    ------
    DataError : there is no such table.
    FileError : the file is missing or damaged.
    """
    if name not in ASSESSMENT_TABLES:
        raise DataError(
            f"There is no table {name!r}; choose one of {', '.join(ASSESSMENT_TABLES)}."
        )
    wanted = None if columns is None else [*dict.fromkeys((*columns, "start_m", "end_m"))]
    with _open_parquet(store, entry.path(name)) as file:
        stored = {_RENAMED_COLUMNS.get(one, one): one for one in file.schema_arrow.names}
        rows = file.read(
            None if wanted is None else [stored[one] for one in wanted if one in stored]
        )
        rows = rows.rename_columns([_RENAMED_COLUMNS.get(one, one) for one in rows.column_names])
        if start is not None:
            rows = rows.filter(pa.array(rows["end_m"].to_numpy() >= start))
        if end is not None:
            rows = rows.filter(pa.array(rows["start_m"].to_numpy() <= end))
    return rows


def defects(
    store: Store, entries: Iterable[Entry], start: float | None = None, end: float | None = None
) -> dict[str, list[Any]]:
    """Isolated defects of some passes that overlap a stretch; see `read_table`."""
    return read_table(store, entries, "defects", start, end)


def sections(
    store: Store, entries: Iterable[Entry], start: float | None = None, end: float | None = None
) -> dict[str, list[Any]]:
    """Sections of some passes that overlap a stretch; see `read_table`."""
    return read_table(store, entries, "sections", start, end)


@contextmanager
def _open_parquet(store: Store, path: str) -> Iterator[parquet.ParquetFile]:
    """Open a Parquet file of a store; turn errors while it is read into `FileError`."""
    try:
        with store.files.open(path) as file:
            yield parquet.ParquetFile(file, page_checksum_verification=True)
    except TrackprofileError:
        raise
    except FileNotFoundError as error:
        raise FileError(f"{store.url}: {path} is missing; {_REMEDY}.") from error
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise FileError(f"{store.url}: {path} is damaged; {_REMEDY}.") from error


def _read_table(
    store: Store,
    entry: Entry,
    names: Sequence[str] | None,
    stretch: tuple[float, float],
    *,
    table: str,
    optional: Sequence[str] = (),
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Columns of a pass on a stretch, all but the band levels if no names are given, and the profile's attributes."""
    with _open_parquet(store, entry.path(table)) as file:
        existing = file.schema_arrow.names
        if table == PROFILES and file.metadata.num_rows != entry.points:
            raise FileError(f"{store.url}: {entry.path(table)} is of another pass; {_REMEDY}.")
        if names is None:
            names = [name for name in existing if not name.startswith(LEVEL)]
        names = list(dict.fromkeys(("distance_m", *names)))
        lacking = [name for name in names if name not in existing and name not in optional]
        if lacking:
            raise DataError(
                f"The pass {entry.id} has no column {lacking[0]}; choose from {', '.join(existing)}."
            )
        names = [name for name in names if name in existing]
        rows = file.read_row_groups(_row_groups(file, *stretch), columns=names)
        metadata = json.loads(file.schema_arrow.metadata[METADATA_KEY])
        attributes = metadata["attributes"] if table == PROFILES else {}
    columns = {name: rows[name].to_numpy() for name in names}
    start, end = (
        np.searchsorted(columns["distance_m"], at, side)
        for at, side in zip(stretch, ("left", "right"), strict=True)
    )
    return {name: values[start:end] for name, values in columns.items()}, attributes


def _dataset(columns: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> xr.Dataset:
    """Profile contract from its columns: the mean, and each rail if the rails are separate."""
    bands = {
        match[1]: values
        for name, values in columns.items()
        if (match := re.fullmatch(f"{STANDARD_DEVIATION}_(.+)_m", name))
    }
    profile = build_profile(
        columns["distance_m"],
        columns["elevation_m"],
        kind=attributes["kind"],
        standard_deviation=columns.get(f"{STANDARD_DEVIATION}_m"),
        band_standard_deviations=bands,
        quality=columns["quality"],
        loading=attributes["loading"],
    ).assign_attrs(attributes)
    flags, metre = profile["quality"].attrs, {"units": "m"}
    for column, values in columns.items():
        name = column.removesuffix("_m")
        if name in profile.variables:
            continue
        if name == column:
            profile[name] = ("distance", values, flags)
        else:
            profile[name] = ("distance", values.astype(np.float64), metre)
    return profile


def _row_groups(file: parquet.ParquetFile, start: float, end: float) -> list[int]:
    """Row groups that overlap a stretch, by the statistics of their distance."""
    column = file.schema_arrow.get_field_index("distance_m")
    selected = []
    for number in range(file.metadata.num_row_groups):
        statistics = file.metadata.row_group(number).column(column).statistics
        if statistics is None or (statistics.min <= end and statistics.max >= start):
            selected.append(number)
    return selected

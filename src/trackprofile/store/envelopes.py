"""A stretch of a pass to be drawn: least and greatest value of each of not too many bins.

Bins are 0.25 m · 2ʲ long and start at multiples of that: those of two passes are the same, and zooming or moving a
picture does not change what is in a bin. Sixteen metres of each are stored as an overview, so that a whole line is not
read to draw it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Quality
from trackprofile.errors import DataError
from trackprofile.store.columns import ELEVATION, LEVEL, SPREAD
from trackprofile.store.entry import Entry
from trackprofile.store.layout import OVERVIEWS, PROFILES
from trackprofile.store.reading import read_columns
from trackprofile.store.store import Store

Array = NDArray[np.float64]

STEP = 0.25
"""Shortest bin, which holds one point of a profile [m]."""

BIN = 16.0
"""Of an overview [m]."""

MOST_BINS = 100_000
"""That one strip may have."""

_LOW, _HIGH = "_low_m", "_high_m"


@dataclass(frozen=True)
class Envelope:
    """A column of a pass, bin by bin.

    Parameters
    ----------
    bin : their length [m]
    distance : middle of the points that a bin may hold (n) [m]
    low, high : least and greatest value in a bin (n) [m]; NaN where none is known
    deviation : greatest standard deviation in it (n) [m]; NaN where none is stated
    quality : sums of `trackprofile.contracts.Quality` that any of its points has (n)
    """

    bin: float
    distance: Array
    low: Array
    high: Array
    deviation: Array
    quality: NDArray[np.int16]


def envelope(
    store: Store, entry: Entry, column: str, start: float, end: float, width: int
) -> Envelope:
    """What to draw of a pass between two places, in bins that are all whole.

    Parameters
    ----------
    column : ``elevation``, of one rail ``elevation_left`` and so on, or the name of a band
    start, end : of the picture [m]; what of it the pass does not reach has no bins
    width : how many bins the whole picture may have

    Raises
    ------
    DataError : there is no such column, or the stretch or width are none.
    FileError : the store is damaged.
    """
    size = bin_size(start, end, width)
    first = max(_number(start, size), _number(entry.start, size))
    last = min(_number(end, size), _number(entry.end, size))
    if size >= BIN:
        table, around = OVERVIEWS, (first * size, (last + 1) * size - BIN)
    else:
        table, around = PROFILES, (first * size, np.nextafter((last + 1) * size, -np.inf))
    low, high, spread = _names(table, column)
    wanted = [*dict.fromkeys((low, high)), spread, "quality"]
    if last < first:
        around = (np.inf, np.inf)
    rows = read_columns(store, entry, wanted, *around, table=table, optional=(spread,))
    numbers = np.arange(first, max(last + 1, first))
    groups = np.floor(rows["distance_m"] / size).astype(np.int64) - first
    spreads = rows.get(spread, np.full(groups.size, np.nan))
    return Envelope(
        size,
        np.asarray(numbers * size + (size - STEP) / 2, np.float64),
        _binned(np.fmin, rows[low], groups, numbers.size, np.nan),
        _binned(np.fmax, rows[high], groups, numbers.size, np.nan),
        _binned(np.fmax, spreads, groups, numbers.size, np.nan),
        _binned(np.bitwise_or, rows["quality"], groups, numbers.size, Quality.GAP),
    )


def bin_size(start: float, end: float, width: int) -> float:
    """The shortest bins of which not more than `width` touch a stretch [m].

    Raises
    ------
    DataError : the stretch has no length, or the width is none.

    Examples
    --------
    >>> bin_size(0.0, 100_000.0, 1000), bin_size(0.0, 100.0, 1000)
    (128.0, 0.25)
    """
    if not (np.isfinite([start, end]).all() and start < end):
        raise DataError(f"A strip needs a start before its end, got {start:g} m and {end:g} m.")
    if not 2 <= width <= MOST_BINS:
        raise DataError(f"A strip is 2 to {MOST_BINS} bins wide, got {width}.")
    size = STEP
    while _number(end, size) - _number(start, size) + 1 > width:
        size *= 2
    return size


def overview(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Columns of a profile in bins of `BIN`; those that hold no point are left out."""
    numbers = np.floor(columns["distance_m"] / BIN).astype(np.int64)
    there, groups = np.unique(numbers, return_inverse=True)
    made: dict[str, NDArray[Any]] = {"distance_m": there * BIN}
    for name, values in columns.items():
        if values.dtype.kind == "i":
            made[name] = _binned(np.bitwise_or, values, groups, there.size, Quality.GAP)
        elif SPREAD in name:
            made[name] = _binned(np.fmax, values, groups, there.size, np.nan)
        elif name.startswith((ELEVATION, LEVEL)):
            stem = name.removesuffix("_m")
            made[stem + _LOW] = _binned(np.fmin, values, groups, there.size, np.nan)
            made[stem + _HIGH] = _binned(np.fmax, values, groups, there.size, np.nan)
    return made


def _names(table: str, column: str) -> tuple[str, str, str]:
    """Of the columns that hold least, greatest and standard deviation."""
    if column == ELEVATION:
        stem, spread = ELEVATION, f"{SPREAD}_m"
    elif column.startswith(f"{ELEVATION}_"):  # of one rail
        stem, spread = column, f"{column}_{SPREAD}_m"
    else:
        stem, spread = LEVEL + column, f"{SPREAD}_{column}_m"
    if table == PROFILES:
        return f"{stem}_m", f"{stem}_m", spread
    return stem + _LOW, stem + _HIGH, spread


def _binned(
    least_or_greatest: np.ufunc,
    values: NDArray[Any],
    groups: NDArray[np.int64],
    count: int,
    empty: float,
) -> NDArray[Any]:
    """Of all values of a group, which stand together; what an empty group has."""
    found = np.full(count, empty, values.dtype)
    if values.size:
        begins = np.flatnonzero(np.diff(groups, prepend=groups[0] - 1))
        found[groups[begins]] = least_or_greatest.reduceat(values, begins)
    return found


def _number(place: float, size: float) -> int:
    return int(np.floor(place / size))

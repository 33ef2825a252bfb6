"""Envelopes of a pass for figures: minimum and maximum in each bin of a stretch.

Bins are 0.25 m · 2ʲ wide and start at multiples of their width: two passes have the same bins, and zooming or moving a
figure does not change the content of a bin. Bins of 16 m are stored as an overview, so that a figure of a whole line
does not need all points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Quality
from trackprofile.errors import DataError
from trackprofile.store.columns import ELEVATION, LEVEL, STANDARD_DEVIATION
from trackprofile.store.entry import Entry
from trackprofile.store.layout import OVERVIEWS, PROFILES
from trackprofile.store.reading import read_columns
from trackprofile.store.store import Store

Array = NDArray[np.float64]

MIN_BIN_WIDTH = 0.25
"""Smallest width of a bin, which then holds one point of a profile [m]."""

OVERVIEW_BIN_WIDTH = 16.0
"""Width of the bins of an overview [m]."""

MAX_BINS = 100_000
"""Upper bound of the number of bins of one envelope."""

_LOW, _HIGH = "_low_m", "_high_m"


@dataclass(frozen=True)
class Envelope:
    """Envelope of a column of a pass.

    Parameters
    ----------
    bin_width : width of the bins [m]
    distance : centre of the points that a bin may hold (n) [m]
    low, high : minimum and maximum in a bin (n) [m]; NaN where no value is known
    deviation : maximum standard deviation in a bin (n) [m]; NaN where none is stated
    quality : sum of all `trackprofile.contracts.Quality` flags in a bin (n)
    """

    bin_width: float
    distance: Array
    low: Array
    high: Array
    deviation: Array
    quality: NDArray[np.int16]


def envelope(
    store: Store, entry: Entry, column: str, start: float, end: float, width: int
) -> Envelope:
    """Envelope of a pass on a stretch, in complete bins.

    Parameters
    ----------
    store, entry : the pass
    column : ``elevation``, of one rail ``elevation_left`` and so on, or the name of a band
    start, end : ends of the stretch [m]; there are no bins outside the pass
    width : maximum number of bins of the stretch

    Raises
    ------
    DataError : the pass has no such column, or the stretch or the width is invalid.
    FileError : the store is damaged.
    """
    size = bin_width(start, end, width)
    first = max(_bin_number(start, size), _bin_number(entry.start, size))
    last = min(_bin_number(end, size), _bin_number(entry.end, size))
    if size >= OVERVIEW_BIN_WIDTH:
        table, stretch = OVERVIEWS, (first * size, (last + 1) * size - OVERVIEW_BIN_WIDTH)
    else:
        table, stretch = PROFILES, (first * size, np.nextafter((last + 1) * size, -np.inf))
    low, high, deviation = _column_names(table, column)
    names = [*dict.fromkeys((low, high)), deviation, "quality"]
    if last < first:
        stretch = (np.inf, np.inf)
    rows = read_columns(store, entry, names, *stretch, table=table, optional=(deviation,))
    numbers = np.arange(first, max(last + 1, first))
    groups = np.floor(rows["distance_m"] / size).astype(np.int64) - first
    deviations = rows.get(deviation, np.full(groups.size, np.nan))
    return Envelope(
        size,
        np.asarray(numbers * size + (size - MIN_BIN_WIDTH) / 2, np.float64),
        _reduced(np.fmin, rows[low], groups, numbers.size, np.nan),
        _reduced(np.fmax, rows[high], groups, numbers.size, np.nan),
        _reduced(np.fmax, deviations, groups, numbers.size, np.nan),
        _reduced(np.bitwise_or, rows["quality"], groups, numbers.size, Quality.GAP),
    )


def bin_width(start: float, end: float, width: int) -> float:
    """Smallest width of bins with at most `width` of them on a stretch [m].

    Raises
    ------
    DataError : the stretch has no length, or the number of bins is outside its range.

    Examples
    --------
    >>> bin_width(0.0, 100_000.0, 1000), bin_width(0.0, 100.0, 1000)
    (128.0, 0.25)
    """
    if not (np.isfinite([start, end]).all() and start < end):
        raise DataError(
            f"An envelope needs a start before its end, got {start:g} m and {end:g} m; correct them."
        )
    if not 2 <= width <= MAX_BINS:
        raise DataError(f"An envelope has 2 to {MAX_BINS} bins, got {width}; correct the number.")
    size = MIN_BIN_WIDTH
    while _bin_number(end, size) - _bin_number(start, size) + 1 > width:
        size *= 2
    return size


def overview(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Columns of a profile in bins of `OVERVIEW_BIN_WIDTH`, without bins that hold no point."""
    numbers = np.floor(columns["distance_m"] / OVERVIEW_BIN_WIDTH).astype(np.int64)
    bins, groups = np.unique(numbers, return_inverse=True)
    reduced: dict[str, NDArray[Any]] = {"distance_m": bins * OVERVIEW_BIN_WIDTH}
    for name, values in columns.items():
        if values.dtype.kind == "i":
            reduced[name] = _reduced(np.bitwise_or, values, groups, bins.size, Quality.GAP)
        elif STANDARD_DEVIATION in name:
            reduced[name] = _reduced(np.fmax, values, groups, bins.size, np.nan)
        elif name.startswith((ELEVATION, LEVEL)):
            stem = name.removesuffix("_m")
            reduced[stem + _LOW] = _reduced(np.fmin, values, groups, bins.size, np.nan)
            reduced[stem + _HIGH] = _reduced(np.fmax, values, groups, bins.size, np.nan)
    return reduced


def _column_names(table: str, column: str) -> tuple[str, str, str]:
    """Names of the columns with minimum, maximum and standard deviation."""
    if column == ELEVATION:
        stem, deviation = ELEVATION, f"{STANDARD_DEVIATION}_m"
    elif column.startswith(f"{ELEVATION}_"):  # of one rail
        stem, deviation = column, f"{column}_{STANDARD_DEVIATION}_m"
    else:
        stem, deviation = LEVEL + column, f"{STANDARD_DEVIATION}_{column}_m"
    if table == PROFILES:
        return f"{stem}_m", f"{stem}_m", deviation
    return stem + _LOW, stem + _HIGH, deviation


def _reduced(
    operation: np.ufunc,
    values: NDArray[Any],
    groups: NDArray[np.int64],
    count: int,
    empty: float,
) -> NDArray[Any]:
    """Reduction of the values in each group of consecutive points; `empty` for a group without points."""
    reduced = np.full(count, empty, values.dtype)
    if values.size:
        starts = np.flatnonzero(np.diff(groups, prepend=groups[0] - 1))
        reduced[groups[starts]] = operation.reduceat(values, starts)
    return reduced


def _bin_number(distance: float, size: float) -> int:
    return int(np.floor(distance / size))

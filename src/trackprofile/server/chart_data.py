"""The level in a band from all passes of a day, in bins of the same edges, so that passes merge exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.assessment.limits import Action
from trackprofile.errors import DataError
from trackprofile.server.requests import MAX_BINS
from trackprofile.server.responses import EnvelopeResponse, Limit, NotAssessedStretch
from trackprofile.store import Entry, Store, envelope, read_table_rows
from trackprofile.store.envelopes import bin_width

Array = NDArray[np.float64]

MAX_STRETCHES = 500
"""Maximum number of stretches that are not assessed in one answer: the longest."""

_MILLI = 1e3


@dataclass(frozen=True)
class Bins:
    """Values in bins of one length.

    Parameters
    ----------
    first : number of the first bin, which starts at first · size
    size : length of a bin [m]
    low, high, deviation : minimum, maximum and standard deviation in each bin, NaN where unknown, (n,) [m]
    """

    first: int
    size: float
    low: Array
    high: Array
    deviation: Array

    @property
    def start(self) -> float:
        """Start of the first bin [m]."""
        return self.first * self.size

    @property
    def end(self) -> float:
        """End of the last bin [m]."""
        return (self.first + self.low.size) * self.size


def empty_bins(start: float, end: float, size: float) -> Bins:
    """All bins that touch a stretch, without values."""
    first = int(np.floor(start / size))
    count = int(np.floor(end / size)) - first + 1
    return Bins(first, size, *(np.full(count, np.nan) for _ in range(3)))


def fill_bins(bins: Bins, distance: Array, low_high: tuple[Array, Array], deviation: Array) -> Bins:
    """Bins with values added at some distances: minimum, maximum and largest deviation; NaN adds nothing."""
    number = np.floor(distance / bins.size).astype(np.int64) - bins.first
    inside = (number >= 0) & (number < bins.low.size)
    number = number[inside]
    low, high, largest = (one.copy() for one in (bins.low, bins.high, bins.deviation))
    np.fmin.at(low, number, low_high[0][inside])
    np.fmax.at(high, number, low_high[1][inside])
    np.fmax.at(largest, number, deviation[inside])
    return Bins(bins.first, bins.size, low, high, largest)


def merge_passes(
    store: Store, entries: Sequence[Entry], band: str, stretch: tuple[float, float], max_bins: int
) -> tuple[Bins, tuple[str, ...]]:
    """Bins of a band over a stretch from several passes, and notes on passes without the band."""
    start, end = stretch
    # Bins that are shorter than the spacing of the points would be empty.
    count = max(2, min(max_bins, *(_point_count(one, end - start) for one in entries), MAX_BINS))
    bins = empty_bins(start, end, bin_width(start, end, count))
    notes = []
    for entry in entries:
        if entry.end < start or entry.start > end:
            continue
        try:
            one = envelope(store, entry, band, start, end, count)
        except DataError as error:
            notes.append(str(error).removesuffix("."))
            continue
        bins = fill_bins(bins, one.distance, (one.low, one.high), one.deviation)
    return bins, tuple(notes)


def _point_count(entry: Entry, length: float) -> int:
    """Number of points that a pass has over a length."""
    spacing = (entry.end - entry.start) / max(1, entry.points - 1)
    return int(length / spacing * (1 + 1e-9)) + 2


def envelope_response(
    bins: Bins,
    band: str,
    entries: Sequence[Entry],
    *,
    heights: Mapping[Action, float] | None = None,
    not_assessed: Sequence[NotAssessedStretch] = (),
    notes: Sequence[str] = (),
) -> EnvelopeResponse:
    """The answer that holds some bins; ``heights`` are limits [m]."""
    return EnvelopeResponse(
        entries=[one.id for one in entries],
        band=band,
        from_m=bins.start,
        to_m=bins.end,
        bin_m=bins.size,
        low_mm=millimetres(bins.low, 3),
        high_mm=millimetres(bins.high, 3),
        standard_deviation_mm=millimetres(bins.deviation, 4),
        limits=limit_list(heights or {}),
        not_assessed=list(not_assessed),
        notes=list(notes),
    )


def millimetres(values: Array, digits: int) -> list[float | None]:
    """Lengths in m as rounded numbers in mm; None for NaN.

    Examples
    --------
    >>> millimetres(np.array([0.0012, np.nan]), 3)
    [1.2, None]
    """
    rounded = np.round(_MILLI * values, digits)
    return [None if math.isnan(one) else one for one in rounded.tolist()]


def limit_list(heights: Mapping[Action, float]) -> list[Limit]:
    """Limits in order, the lowest first; ``heights`` in m."""
    return [
        Limit(action=action.text, height_mm=round(_MILLI * height, 6))
        for action, height in sorted(heights.items())
    ]


def not_assessed_stretches(
    store: Store, entries: Sequence[Entry], band: str, bins: Bins
) -> list[NotAssessedStretch]:
    """Stretches that the only pass of a day does not assess; with several passes, another may assess them."""
    if len(entries) != 1:
        return []
    rows = read_table_rows(store, entries[0], "not_assessed", bins.start, bins.end)
    stretches = [
        NotAssessedStretch(start_m=one["start_m"], end_m=one["end_m"], reasons=one["reasons"])
        for one in rows.to_pylist()
        if one["band"] == band
    ]
    longest = sorted(stretches, key=lambda one: one.start_m - one.end_m)[:MAX_STRETCHES]
    return sorted(longest, key=lambda one: one.start_m)

"""A band along the line from all passes of a day: any two have the same bins, so that they merge exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.assessment.limits import Action
from trackprofile.errors import DataError
from trackprofile.server import responses as models
from trackprofile.server.requests import MOST_BINS
from trackprofile.store import Entry, Store, envelope, rows_of
from trackprofile.store.envelopes import bin_size

Array = NDArray[np.float64]

_MILLI = 1e3
MOST_STRETCHES = 500
"""Not judged, that are told: the longest."""


@dataclass(frozen=True)
class Bins:
    """Values in bins of one length.

    Parameters
    ----------
    first : number of the first bin, which starts at first · size
    size : of a bin [m]
    low, high, deviation : of each bin, NaN where nothing is known (n) [m]
    """

    first: int
    size: float
    low: Array
    high: Array
    deviation: Array

    @property
    def start(self) -> float:
        """Of the first bin [m]."""
        return self.first * self.size

    @property
    def end(self) -> float:
        """Of the last bin [m]."""
        return (self.first + self.low.size) * self.size


def empty(start: float, end: float, size: float) -> Bins:
    """Bins that hold nothing, of all that touch a stretch."""
    first = int(np.floor(start / size))
    count = int(np.floor(end / size)) - first + 1
    return Bins(first, size, *(np.full(count, np.nan) for _ in range(3)))


def filled(bins: Bins, distance: Array, low_high: tuple[Array, Array], deviation: Array) -> Bins:
    """The same with values at some places put in: least, greatest, and greatest deviation; NaN counts as none."""
    number = np.floor(distance / bins.size).astype(np.int64) - bins.first
    inside = (number >= 0) & (number < bins.low.size)
    number = number[inside]
    low, high, spread = (one.copy() for one in (bins.low, bins.high, bins.deviation))
    np.fmin.at(low, number, low_high[0][inside])
    np.fmax.at(high, number, low_high[1][inside])
    np.fmax.at(spread, number, deviation[inside])
    return Bins(bins.first, bins.size, low, high, spread)


def merged(
    store: Store, entries: Sequence[Entry], band: str, start: float, end: float, width: int
) -> tuple[Bins, tuple[str, ...]]:
    """A band between two places from some passes, and what has to be said of them."""
    # A bin that is shorter than the points are apart would be empty for no reason.
    width = max(2, min(width, *(_points(one, end - start) for one in entries), MOST_BINS))
    bins = empty(start, end, bin_size(start, end, width))
    notes = []
    for entry in entries:
        if entry.end < start or entry.start > end:
            continue
        try:
            found = envelope(store, entry, band, start, end, width)
        except DataError as error:
            notes.append(str(error).removesuffix("."))
            continue
        bins = filled(bins, found.distance, (found.low, found.high), found.deviation)
    return bins, tuple(notes)


def _points(entry: Entry, length: float) -> int:
    """How many of its points a pass has over a length."""
    spacing = (entry.end - entry.start) / max(1, entry.points - 1)
    return int(length / spacing * (1 + 1e-9)) + 2


def model(
    bins: Bins,
    band: str,
    entries: Sequence[Entry],
    heights: Mapping[Action, float] | None = None,
    not_judged: Sequence[models.NotJudged] = (),
    notes: Sequence[str] = (),
) -> models.EnvelopeResponse:
    """Bins as they are answered."""
    return models.EnvelopeResponse(
        entries=[one.id for one in entries],
        band=band,
        from_m=bins.start,
        to_m=bins.end,
        bin_m=bins.size,
        low_mm=millimetres(bins.low, 3),
        high_mm=millimetres(bins.high, 3),
        deviation_mm=millimetres(bins.deviation, 4),
        limits=limit_models(heights or {}),
        not_judged=list(not_judged),
        notes=list(notes),
    )


def millimetres(values: Array, digits: int) -> list[float | None]:
    """Of metres; None for NaN.

    Examples
    --------
    >>> millimetres(np.array([0.0012, np.nan]), 3)
    [1.2, None]
    """
    rounded = np.round(_MILLI * values, digits)
    return [None if one != one else one for one in rounded.tolist()]


def limit_models(heights: Mapping[Action, float]) -> list[models.Limit]:
    """Limits from the lowest."""
    return [
        models.Limit(action=action.words, height_mm=round(_MILLI * height, 6))
        for action, height in sorted(heights.items())
    ]


def not_judged(
    store: Store, entries: Sequence[Entry], band: str, bins: Bins
) -> list[models.NotJudged]:
    """Stretches in which the only pass of a day is not judged; two may judge where one may not."""
    if len(entries) != 1:
        return []
    rows = rows_of(store, entries[0], "not_assessed", bins.start, bins.end)
    found = [
        models.NotJudged(start_m=one["start_m"], end_m=one["end_m"], reasons=one["reasons"])
        for one in rows.to_pylist()
        if one["band"] == band
    ]
    longest = sorted(found, key=lambda one: one.start_m - one.end_m)[:MOST_STRETCHES]
    return sorted(longest, key=lambda one: one.start_m)

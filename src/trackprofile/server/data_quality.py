"""Data quality of the passes over a line: how much of it each one covers, and with what uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Quality
from trackprofile.errors import DataError
from trackprofile.server.chart_data import millimetres
from trackprofile.server.line_catalogue import LineCatalogue
from trackprofile.server.responses import Flag, PassQuality, QualityResponse
from trackprofile.store import Entry, Envelope, Store, envelope
from trackprofile.store.layout import ENTRIES

Array = NDArray[np.float64]

MAX_PASSES = 100
"""Maximum number of passes in one answer: the latest."""

FINE_BINS = 8000
"""Number of bins of a pass from which its quality is determined."""

_MILLI = 1e3
_SMALLEST_DEVIATION = 1e-6  # m, where no pass states any


def quality_response(
    catalogue: LineCatalogue, passes: Sequence[Entry], band: str, bins: int
) -> QualityResponse:
    """Quality of the latest passes over a line, the earliest first."""
    shown = passes[-MAX_PASSES:]
    start, end = min(one.start for one in shown), max(one.end for one in shown)
    size = (end - start) / bins

    def pass_quality(one: Entry) -> tuple[Array, list[Flag]]:
        key = ("quality", one.path(ENTRIES), band, start, size)
        return catalogue.cached(
            key, lambda: _along_line(catalogue.store, one, band, start, size, bins)
        )

    qualities = [pass_quality(one) for one in shown]
    lowest = [np.nanquantile(along, 0.05) for along, _ in qualities if np.isfinite(along).any()]
    return QualityResponse(
        band=band,
        start_m=start,
        bin_m=size,
        lowest_standard_deviation_mm=round(
            _MILLI * float(min(lowest, default=_SMALLEST_DEVIATION)), 5
        ),
        passes=[_pass_quality(one, *each) for one, each in zip(shown, qualities, strict=True)],
        omitted_passes=len(passes) - len(shown),
    )


def _along_line(
    store: Store, entry: Entry, band: str, start: float, size: float, bins: int
) -> tuple[Array, list[Flag]]:
    """Standard deviation of a pass along the line [m], and its flags."""
    try:
        one = envelope(store, entry, band, entry.start, entry.end, FINE_BINS)
    except DataError:  # the pass is too short for this band
        return np.full(bins, np.nan), []
    known = np.isfinite(one.low)
    stated = np.where(known, np.nan_to_num(one.deviation), np.nan)
    number = ((one.distance - start) / size).astype(np.int64)
    along = np.full(bins, np.nan)
    np.fmax.at(along, np.clip(number, 0, bins - 1), stated)
    return along, _flags(one)


def _flags(one: Envelope) -> list[Flag]:
    shares = {flag: float(np.mean(one.quality & flag != 0)) for flag in Quality}
    return [
        Flag(name=str(flag.name).lower(), share=round(share, 4))
        for flag, share in shares.items()
        if share > 0
    ]


def _pass_quality(entry: Entry, along: Array, flags: list[Flag]) -> PassQuality:
    return PassQuality(
        entry=entry.id,
        day=entry.day,
        run=entry.run,
        vehicle=entry.origin.vehicle,
        start_m=entry.start,
        end_m=entry.end,
        known_share=entry.known_share,
        standard_deviation_mm={
            name: _MILLI * one for name, one in entry.standard_deviations.items()
        },
        defect_counts={name: count for name, count in entry.defects.items() if count},
        flags=flags,
        standard_deviation_along_mm=millimetres(along, 4),
    )

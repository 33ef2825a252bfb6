"""What the passes over a line are worth: how much of it each one tells, and how well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Quality
from trackprofile.errors import DataError
from trackprofile.server import responses as models
from trackprofile.server.chart_data import millimetres
from trackprofile.server.line_catalogue import Catalogue
from trackprofile.store import Entry, Envelope, Store, envelope
from trackprofile.store.layout import ENTRIES

Array = NDArray[np.float64]

MOST_PASSES = 100
"""That are told of at once: the latest."""

FINE = 8000
"""Bins of a pass from which its quality is told."""

_MILLI = 1e3


def quality(
    catalogue: Catalogue, passes: Sequence[Entry], band: str, bins: int
) -> models.QualityResponse:
    """Of the latest passes over a line, the earliest first."""
    shown = passes[-MOST_PASSES:]
    start, end = min(one.start for one in shown), max(one.end for one in shown)
    size = (end - start) / bins

    def told(one: Entry) -> tuple[Array, list[models.Flag]]:
        key = ("quality", one.path(ENTRIES), band, start, size)
        return catalogue.recall(
            key, lambda: _of_pass(catalogue.store, one, band, start, size, bins)
        )

    found = [told(one) for one in shown]
    sure = [np.nanquantile(along, 0.05) for along, _ in found if np.isfinite(along).any()]
    return models.QualityResponse(
        band=band,
        start_m=start,
        bin_m=size,
        least_mm=round(_MILLI * float(min(sure, default=1e-6)), 5),
        passes=[_model(one, *each) for one, each in zip(shown, found, strict=True)],
        omitted=len(passes) - len(shown),
    )


def _of_pass(
    store: Store, entry: Entry, band: str, start: float, size: float, bins: int
) -> tuple[Array, list[models.Flag]]:
    """Standard deviation along the line, and flags, of a pass."""
    try:
        found = envelope(store, entry, band, entry.start, entry.end, FINE)
    except DataError:  # too short for the band: known in others, not in this one
        return np.full(bins, np.nan), []
    known = np.isfinite(found.low)
    stated = np.where(known, np.nan_to_num(found.deviation), np.nan)
    number = ((found.distance - start) / size).astype(np.int64)
    along = np.full(bins, np.nan)
    np.fmax.at(along, np.clip(number, 0, bins - 1), stated)
    return along, _flags(found)


def _flags(found: Envelope) -> list[models.Flag]:
    shares = {flag: float(np.mean(found.quality & flag != 0)) for flag in Quality}
    return [
        models.Flag(name=str(flag.name).lower(), share=round(share, 4))
        for flag, share in shares.items()
        if share > 0
    ]


def _model(entry: Entry, along: Array, flags: list[models.Flag]) -> models.PassQuality:
    return models.PassQuality(
        entry=entry.id,
        day=entry.day,
        run=entry.run,
        vehicle=entry.origin.vehicle,
        start_m=entry.start,
        end_m=entry.end,
        known_share=entry.known,
        deviation_mm={name: _MILLI * one for name, one in entry.deviations.items()},
        counts={name: count for name, count in entry.defects.items() if count},
        flags=flags,
        deviation_along_mm=millimetres(along, 4),
    )

"""Places through time: how one developed, and what two days differ by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import timedelta

import numpy as np

from trackprofile.assessment.development import Development, around, development
from trackprofile.assessment.limits import Action, DefectLimits, Limits
from trackprofile.assessment.trend import ChangedLocation, DatedProfile, LimitCrossing, Trend, trend
from trackprofile.assessment.trend_fit import Rate
from trackprofile.bands import BANDS, Band
from trackprofile.errors import DataError
from trackprofile.server import responses as models
from trackprofile.server.assessment_rows import section_columns
from trackprofile.server.chart_data import (
    Bins,
    empty,
    filled,
    limit_models,
    merged,
    millimetres,
    model,
)
from trackprofile.server.line_catalogue import UnknownError
from trackprofile.store import Entry, Store, read_profile

MOST_PASSES = 60
"""That a development is worked out from: more are thinned out evenly."""

CLOSEST = 10_000.0
"""Stretch up to which two days are compared point by point [m]."""

SEEN_AROUND = 30.0
"""To either side of a place, of which the shape is shown [m]."""

LEAST_AHEAD, MOST_AHEAD = 30, 3650
"""Days of a forecast."""

_MILLI = 1e3
_ANY_SPEED = 1.0  # m/s: the limits of a pass are those of its line's speed
_STEPS = 80  # of a forecast


def band_of(name: str) -> Band:
    """The band of a name."""
    return next(one for one in BANDS if one.name == name)


def place(
    store: Store,
    passes: Sequence[Entry],
    band: Band,
    at: float,
    heights: Mapping[Action, float],
) -> models.DevelopmentResponse:
    """How a place developed over some passes of a line.

    Raises
    ------
    UnknownError : no pass reaches it.
    DataError : none tells it in this band.
    """
    there = [one for one in passes if one.start <= at <= one.end]
    if not there:
        raise UnknownError(f"No pass of that time reaches {at:.1f} m.")
    looked = _thinned(there)
    named = {_name(one): one for one in looked}
    reach = around(band)
    read = [
        DatedProfile(read_profile(store, one, at - reach, at + reach), one.day, name)
        for name, one in named.items()
    ]
    found = development(read, band, at, heights)
    rate = found.rate
    told = [named[name] for name, _ in found.passes]
    return models.DevelopmentResponse(
        band=band.name,
        at_m=found.at,
        passes=[
            models.Told(entry=one.id, day=one.day, run=one.run, vehicle=one.origin.vehicle)
            for one in told
        ],
        level_mm=[round(_MILLI * one, 4) for one in found.level.tolist()],
        deviation_mm=[round(_MILLI * one, 4) for one in found.deviation.tolist()],
        trend=rate and _trend(rate, found),
        forecast=_forecast(rate, found) if rate else [],
        reached=_reached(found.reached),
        beyond=[
            one
            for one in limit_models(heights)
            if rate and abs(_MILLI * rate.level) > one.height_mm
        ],
        limits=limit_models(heights),
        around=_around(found),
        left_out=[
            models.LeftOut(entry=one.id, day=one.day, run=one.run, reason=found.left_out[name])
            for name, one in named.items()
            if name in found.left_out
        ],
        omitted=len(there) - len(looked),
        notes=said_of(told, band),
    )


def _name(one: Entry) -> str:
    """Of a pass among those of a line: the same recording may stand on two days."""
    return " ".join(part for part in (one.day.isoformat(), one.run, one.id) if part)


def _thinned(passes: Sequence[Entry]) -> list[Entry]:
    if len(passes) <= MOST_PASSES:
        return list(passes)
    kept = np.unique(np.linspace(0, len(passes) - 1, MOST_PASSES).round().astype(int))
    return [passes[number] for number in kept]


def _trend(rate: Rate, found: Development) -> models.Trend:
    return models.Trend(
        per_day_mm=_MILLI * rate.per_day,
        per_day_deviation_mm=_MILLI * rate.deviation,
        straight=found.straight,
    )


def _forecast(rate: Rate, found: Development) -> list[models.Ahead]:
    """The trend from the first pass to some time after the last: half as long again, or to the next limit."""
    first, last = found.passes[0][1], found.passes[-1][1]
    past = (last - first).days
    ahead = max(LEAST_AHEAD, past // 2)
    following = min((one.median for one in found.reached if one.median), default=None)
    if following is not None and (following - last).days <= 3 * max(past, LEAST_AHEAD):
        ahead = max(ahead, round(1.15 * (following - last).days))
    behind, before = (
        np.linspace(-past, 0.0, _STEPS),
        np.linspace(0.0, min(ahead, MOST_AHEAD), _STEPS),
    )
    days = np.unique(np.round(np.concatenate([behind, before])).astype(np.float64))
    level, deviation = rate.ahead(days)
    return [
        models.Ahead(
            day=last + timedelta(days=int(day)),
            level_mm=round(_MILLI * value, 4),
            deviation_mm=round(_MILLI * spread, 4),
        )
        for day, value, spread in zip(
            days.tolist(), level.tolist(), deviation.tolist(), strict=True
        )
    ]


def _around(found: Development) -> models.Around:
    near = np.abs(found.distance - found.at) <= SEEN_AROUND
    return models.Around(
        distance_m=np.round(found.distance[near], 3).tolist(),
        levels_mm=[millimetres(one[near], 3) for one in found.along],
    )


def _reached(ones: Sequence[LimitCrossing]) -> list[models.ReachedInfo]:
    return [
        models.ReachedInfo(
            action=one.action.words,
            height_mm=round(_MILLI * one.limit, 6),
            earliest=one.earliest,
            median=one.median,
            latest=one.latest,
        )
        for one in ones
    ]


def compare(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    width: int,
    heights: Mapping[Action, float],
) -> models.ComparisonResponse:
    """What the passes of two days, the earlier first, differ by between two places.

    Raises
    ------
    DataError : the passes of the two days do not look alike.
    """
    first, second = days
    drawn = [merged(store, ones, band.name, *stretch, width) for ones in days]
    notes = [note for _, said in drawn for note in said]
    difference = empty(*stretch, drawn[0][0].size)
    places: list[models.ChangedPlaceInfo] = []
    length = 0.0
    if stretch[1] - stretch[0] <= CLOSEST:
        try:
            found = _changes(store, days, band, stretch, heights)
        except DataError as error:  # what was read is drawn all the same
            notes.append(str(error).removesuffix("."))
        else:
            notes += found.notes
            difference = _difference(difference, found, band)
            places = [_changed(one) for one in found.places if stretch[0] <= one.peak <= stretch[1]]
    else:
        length, difference = _by_section(store, days, band, stretch, width)
    return models.ComparisonResponse(
        band=band.name,
        first_day=first[0].day,
        second_day=second[0].day,
        first=model(drawn[0][0], band.name, first, heights),
        second=model(drawn[1][0], band.name, second, heights),
        difference=model(difference, band.name, (*first, *second)),
        by_section=length,
        closest_m=CLOSEST,
        places=places,
        notes=[*notes, *said_of(second, band)],
    )


def said_of(entries: Sequence[Entry], band: Band) -> list[str]:
    """What has to be said with every limit of a band."""
    every = dict.fromkeys(note for one in entries for note in one.notes)
    return [note for note in every if f"isolated defects in {band.name}" in note]


def _changes(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    heights: Mapping[Action, float],
) -> Trend:
    """Between the two passes that have most of the stretch."""
    reach = around(band)
    passes = []
    for entries in days:
        one = max(entries, key=lambda each: min(each.end, stretch[1]) - max(each.start, stretch[0]))
        profile = read_profile(store, one, stretch[0] - reach, stretch[1] + reach)
        passes.append(DatedProfile(profile, one.day, _name(one)))
    # Whether they are verified is said by the passes.
    rule = DefectLimits(band.name, 0.0, np.inf, "the store", True, heights)
    return trend(passes, Limits("of the passes", (rule,)), _ANY_SPEED, bands=[band])


def _difference(bins: Bins, found: Trend, band: Band) -> Bins:
    change = found.bands.get(band.name)
    if change is None:
        return bins
    values = np.where(change.usable, change.change, np.nan)
    deviation = np.where(change.usable, change.deviation, np.nan)
    return filled(bins, change.distance, (values, values), deviation)


def _changed(one: ChangedLocation) -> models.ChangedPlaceInfo:
    per_day = None if one.per_day is None else _MILLI * one.per_day
    spread = None if one.per_day_deviation is None else _MILLI * one.per_day_deviation
    return models.ChangedPlaceInfo(
        start_m=one.start,
        peak_m=one.peak,
        end_m=one.end,
        change_mm=_MILLI * one.change,
        deviation_mm=_MILLI * one.deviation,
        level_mm=_MILLI * one.level,
        per_day_mm=per_day,
        per_day_deviation_mm=spread,
        reached=_reached(one.reached),
    )


def _by_section(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    width: int,
) -> tuple[float, Bins]:
    """Length of the sections [m], and what their standard deviations differ by."""
    lengths, starts, values, spreads = [], [], [], []
    for entries in days:
        length, columns = section_columns(store, entries, band.name, *stretch)
        lengths.append(length)
        starts.append(columns["start_m"])
        values.append(columns["standard_deviation_mm"] / _MILLI)
        spreads.append((columns["high_mm"] - columns["low_mm"]) / (2 * 1.96 * _MILLI))
    length = lengths[0]
    if lengths[0] != lengths[1] or not length:
        return length, empty(*stretch, stretch[1] - stretch[0])
    numbers = [np.floor(one / length + 0.5).astype(np.int64) for one in starts]
    _, a, b = np.intersect1d(*numbers, return_indices=True)
    size = length * 2 ** max(0, int(np.ceil(np.log2((stretch[1] - stretch[0]) / length / width))))
    change = values[1][b] - values[0][a]
    at = (numbers[0][a] + 0.5) * length
    spread = np.hypot(spreads[0][a], spreads[1][b])
    return length, filled(empty(*stretch, size), at, (change, change), spread)  # fmt: skip

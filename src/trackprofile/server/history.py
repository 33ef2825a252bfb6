"""Locations over time: the development of one location, and the comparison of two days."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import timedelta

import numpy as np

from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.development import Development, development, required_reach
from trackprofile.assessment.limits import Action, DefectLimits, Limits
from trackprofile.assessment.trend import ChangedLocation, DatedProfile, LimitCrossing, Trend, trend
from trackprofile.assessment.trend_fit import Rate
from trackprofile.bands import BANDS, Band
from trackprofile.errors import DataError
from trackprofile.server.assessment_rows import section_columns
from trackprofile.server.chart_data import (
    Bins,
    empty_bins,
    envelope_response,
    fill_bins,
    limit_list,
    merge_passes,
    millimetres,
)
from trackprofile.server.line_catalogue import UnknownError
from trackprofile.server.responses import (
    ChangedLocationInfo,
    ComparisonResponse,
    DevelopmentPass,
    DevelopmentResponse,
    ExcludedPass,
    ForecastPoint,
    LimitCrossingInfo,
    Surroundings,
    TrendInfo,
)
from trackprofile.store import Entry, Store, read_profile

MAX_PASSES = 60
"""Maximum number of passes from which a development is determined; of more, evenly distributed ones."""

MAX_POINTWISE_LENGTH = 10_000.0
"""Longest stretch over which two days are compared point by point [m]."""

SURROUNDINGS = 30.0
"""Distance to each side of a location over which its surroundings are shown [m]."""

MIN_FORECAST_DAYS, MAX_FORECAST_DAYS = 30, 3650

_MILLI = 1e3
_ANY_SPEED = 1.0  # m/s; the limits of a pass are those of its line speed
_FORECAST_POINTS = 80


def band_of(name: str) -> Band:
    """The band with a name."""
    return next(one for one in BANDS if one.name == name)


def development_response(
    store: Store,
    passes: Sequence[Entry],
    band: Band,
    at: float,
    heights: Mapping[Action, float],
) -> DevelopmentResponse:
    """Development of a location over some passes of a line.

    Parameters
    ----------
    store : that holds the passes
    passes : of one line and direction, by day
    band : band of the level
    at : distance of the location [m]
    heights : limits [m]

    Raises
    ------
    UnknownError : no pass covers the location.
    DataError : no pass determines it in this band.
    """
    covering = [one for one in passes if one.start <= at <= one.end]
    if not covering:
        raise UnknownError(f"No pass of these days covers {at:.1f} m.")
    used = _thinned(covering)
    by_name = {_pass_name(one): one for one in used}
    reach = required_reach(band)
    profiles = [
        DatedProfile(read_profile(store, one, at - reach, at + reach), one.day, name)
        for name, one in by_name.items()
    ]
    result = development(profiles, band, at, heights)
    rate = result.rate
    determining = [by_name[name] for name, _ in result.passes]
    return DevelopmentResponse(
        band=band.name,
        at_m=result.at,
        passes=[
            DevelopmentPass(entry=one.id, day=one.day, run=one.run, vehicle=one.origin.vehicle)
            for one in determining
        ],
        level_mm=[round(_MILLI * one, 4) for one in result.level.tolist()],
        standard_deviation_mm=[round(_MILLI * one, 4) for one in result.deviation.tolist()],
        trend=rate and _trend(rate, result),
        forecast=_forecast(rate, result) if rate else [],
        limit_crossings=_limit_crossings(result.limit_crossings),
        exceeded_limits=[
            one for one in limit_list(heights) if rate and abs(_MILLI * rate.level) > one.height_mm
        ],
        limits=limit_list(heights),
        surroundings=_surroundings(result),
        excluded=[
            ExcludedPass(entry=one.id, day=one.day, run=one.run, reason=result.excluded[name])
            for name, one in by_name.items()
            if name in result.excluded
        ],
        omitted_passes=len(covering) - len(used),
        notes=caveats_on_band(determining, band),
    )


def _pass_name(one: Entry) -> str:
    """Unique name of a pass among those of a line: the same run may have passes on two days."""
    return " ".join(part for part in (one.day.isoformat(), one.run, one.id) if part)


def _thinned(passes: Sequence[Entry]) -> list[Entry]:
    if len(passes) <= MAX_PASSES:
        return list(passes)
    kept = np.unique(np.linspace(0, len(passes) - 1, MAX_PASSES).round().astype(int))
    return [passes[number] for number in kept]


def _trend(rate: Rate, result: Development) -> TrendInfo:
    return TrendInfo(
        rate_mm_per_day=_MILLI * rate.per_day,
        rate_standard_deviation_mm_per_day=_MILLI * rate.deviation,
        is_linear=result.is_linear,
    )


def _forecast(rate: Rate, result: Development) -> list[ForecastPoint]:
    """The trend from the first pass to some time after the last: half of the past again, or to the next limit."""
    first, last = result.passes[0][1], result.passes[-1][1]
    past = (last - first).days
    ahead = max(MIN_FORECAST_DAYS, past // 2)
    crossing = min((one.median for one in result.limit_crossings if one.median), default=None)
    if crossing is not None and (crossing - last).days <= 3 * max(past, MIN_FORECAST_DAYS):
        ahead = max(ahead, round(1.15 * (crossing - last).days))
    history = np.linspace(-past, 0.0, _FORECAST_POINTS)
    future = np.linspace(0.0, min(ahead, MAX_FORECAST_DAYS), _FORECAST_POINTS)
    days = np.unique(np.round(np.concatenate([history, future])).astype(np.float64))
    level, deviation = rate.predict(days)
    return [
        ForecastPoint(
            day=last + timedelta(days=int(day)),
            level_mm=round(_MILLI * value, 4),
            standard_deviation_mm=round(_MILLI * standard_deviation, 4),
        )
        for day, value, standard_deviation in zip(
            days.tolist(), level.tolist(), deviation.tolist(), strict=True
        )
    ]


def _surroundings(result: Development) -> Surroundings:
    near = np.abs(result.distance - result.at) <= SURROUNDINGS
    return Surroundings(
        distance_m=np.round(result.distance[near], 3).tolist(),
        levels_mm=[millimetres(one[near], 3) for one in result.surroundings],
    )


def _limit_crossings(crossings: Sequence[LimitCrossing]) -> list[LimitCrossingInfo]:
    return [
        LimitCrossingInfo(
            action=one.action.text,
            height_mm=round(_MILLI * one.limit, 6),
            earliest=one.earliest,
            median=one.median,
            latest=one.latest,
        )
        for one in crossings
    ]


def comparison_response(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    *,
    max_bins: int,
    heights: Mapping[Action, float],
) -> ComparisonResponse:
    """Comparison of the passes of two days over a stretch.

    Parameters
    ----------
    store : that holds the passes
    days : passes of the earlier day, and of the later
    band : band of the level
    stretch : start and end [m]
    max_bins : maximum number of bins of each level
    heights : limits [m]

    Raises
    ------
    DataError : the passes of the two days cannot be aligned.
    """
    first, second = days
    levels = [merge_passes(store, ones, band.name, stretch, max_bins) for ones in days]
    notes = [note for _, more in levels for note in more]
    difference = empty_bins(*stretch, levels[0][0].size)
    locations: list[ChangedLocationInfo] = []
    section_length = 0.0
    if stretch[1] - stretch[0] <= MAX_POINTWISE_LENGTH:
        try:
            changes = _changes(store, days, band, stretch, heights)
        except DataError as error:  # the two levels are shown without their difference
            notes.append(str(error).removesuffix("."))
        else:
            notes += changes.notes
            difference = _difference(difference, changes, band)
            locations = [
                _changed_location(one)
                for one in changes.changed_locations
                if stretch[0] <= one.peak <= stretch[1]
            ]
    else:
        section_length, difference = _section_changes(store, days, band, stretch, max_bins)
    return ComparisonResponse(
        band=band.name,
        first_day=first[0].day,
        second_day=second[0].day,
        first=envelope_response(levels[0][0], band.name, first, heights=heights),
        second=envelope_response(levels[1][0], band.name, second, heights=heights),
        difference=envelope_response(difference, band.name, (*first, *second)),
        section_length_m=section_length,
        max_pointwise_length_m=MAX_POINTWISE_LENGTH,
        locations=locations,
        notes=[*notes, *caveats_on_band(second, band)],
    )


def caveats_on_band(entries: Sequence[Entry], band: Band) -> list[str]:
    """Notes of some passes that concern the limits of a band."""
    notes = dict.fromkeys(note for one in entries for note in one.notes)
    return [note for note in notes if f"isolated defects in {band.name}" in note]


def _changes(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    heights: Mapping[Action, float],
) -> Trend:
    """Changes between the pass of each day that covers most of the stretch."""
    reach = required_reach(band)
    passes = []
    for entries in days:
        one = max(entries, key=lambda each: min(each.end, stretch[1]) - max(each.start, stretch[0]))
        profile = read_profile(store, one, stretch[0] - reach, stretch[1] + reach)
        passes.append(DatedProfile(profile, one.day, _pass_name(one)))
    # Whether the limits are verified is stated in the notes of the passes.
    rule = DefectLimits(band.name, 0.0, np.inf, "the store", True, heights)
    return trend(passes, Limits("of the passes", (rule,)), _ANY_SPEED, bands=[band])


def _difference(bins: Bins, changes: Trend, band: Band) -> Bins:
    change = changes.bands.get(band.name)
    if change is None:
        return bins
    values = np.where(change.usable, change.change, np.nan)
    deviation = np.where(change.usable, change.deviation, np.nan)
    return fill_bins(bins, change.distance, (values, values), deviation)


def _changed_location(one: ChangedLocation) -> ChangedLocationInfo:
    rate = None if one.per_day is None else _MILLI * one.per_day
    deviation = None if one.per_day_deviation is None else _MILLI * one.per_day_deviation
    return ChangedLocationInfo(
        start_m=one.start,
        peak_m=one.peak,
        end_m=one.end,
        change_mm=_MILLI * one.change,
        standard_deviation_mm=_MILLI * one.deviation,
        level_mm=_MILLI * one.level,
        rate_mm_per_day=rate,
        rate_standard_deviation_mm_per_day=deviation,
        limit_crossings=_limit_crossings(one.limit_crossings),
    )


def _section_changes(
    store: Store,
    days: tuple[Sequence[Entry], Sequence[Entry]],
    band: Band,
    stretch: tuple[float, float],
    max_bins: int,
) -> tuple[float, Bins]:
    """Length of the sections [m], and the change of their standard deviations."""
    lengths, starts, values, deviations = [], [], [], []
    for entries in days:
        length, columns = section_columns(store, entries, band.name, *stretch)
        lengths.append(length)
        starts.append(columns["start_m"])
        values.append(columns["standard_deviation_mm"] / _MILLI)
        deviations.append((columns["high_mm"] - columns["low_mm"]) / (2 * NORMAL_95 * _MILLI))
    length = lengths[0]
    if lengths[0] != lengths[1] or not length:
        return length, empty_bins(*stretch, stretch[1] - stretch[0])
    numbers = [np.floor(one / length + 0.5).astype(np.int64) for one in starts]
    _, first, second = np.intersect1d(*numbers, return_indices=True)
    sections = (stretch[1] - stretch[0]) / length
    size = length * 2 ** max(0, int(np.ceil(np.log2(sections / max_bins))))
    change = values[1][second] - values[0][first]
    centre = (numbers[0][first] + 0.5) * length
    deviation = np.hypot(deviations[0][first], deviations[1][second])
    return length, fill_bins(empty_bins(*stretch, size), centre, (change, change), deviation)

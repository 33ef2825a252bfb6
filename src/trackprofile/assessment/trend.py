"""Change of the track between passes: where it changed, at what rate, and when limits will be reached.

Passes are aligned with the earliest (`alignment`), a straight line in time is fitted to the level at every point
(`trend_fit`), and significant changes are grouped to locations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from itertools import combinations, pairwise

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from trackprofile.assessment.alignment import MAX_LAG, Alignment, align, resample_to_common_grid
from trackprofile.assessment.levels import band_levels
from trackprofile.assessment.limits import (
    Accuracy,
    Action,
    Limits,
    unverified,
    unverified_accuracies,
)
from trackprofile.assessment.trend_fit import (
    BandChange,
    LevelStack,
    Rate,
    fit_trend,
    rate_at,
    stack_levels,
)
from trackprofile.bands import BANDS, Band
from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HORIZON = 3650
"""Maximum number of days ahead for which the date of a limit crossing is predicted."""

_QUANTILES = (0.975, 0.5, 0.025)


@dataclass(frozen=True)
class DatedProfile:
    """A profile with the date of its recording and a unique name."""

    profile: xr.Dataset
    day: date
    name: str


@dataclass(frozen=True)
class LimitCrossing:
    """Predicted date on which a limit is reached if the trend continues.

    Parameters
    ----------
    action : what the limit requires
    limit : height [m]
    earliest, median, latest : dates by which it is reached with a probability of 2.5, 50 and 97.5 %; None: not within
        `HORIZON`
    """

    action: Action
    limit: float
    earliest: date | None
    median: date | None
    latest: date | None


@dataclass(frozen=True)
class ChangedLocation:
    """A location at which the track changed significantly.

    Parameters
    ----------
    band : name of the band
    start, peak, end : distances where the change begins, is largest and ends [m]
    change, deviation : change at the peak and its standard deviation; settlement is negative [m]
    level : level at the peak in the last pass [m]
    per_day, per_day_deviation : rate of change and its standard deviation [m/day]; None if all passes have one date
    limit_crossings : one per limit that is not exceeded yet
    """

    band: str
    start: float
    peak: float
    end: float
    change: float
    deviation: float
    level: float
    per_day: float | None
    per_day_deviation: float | None
    limit_crossings: tuple[LimitCrossing, ...]


@dataclass(frozen=True)
class Repeatability:
    """95th percentile of the absolute differences between passes, comparable with the limits of EN 13848-2.

    Parameters
    ----------
    band : name of the band
    same_vehicle : True: repeatability (same vehicle); False: reproducibility (different vehicles)
    difference : 95th percentile [m]
    required : requirement of the limit set, if it has one
    pairs : number of pairs of passes
    """

    band: str
    same_vehicle: bool
    difference: float
    required: Accuracy | None
    pairs: int

    @property
    def limit(self) -> float | None:
        """Maximum difference that the limit set allows [m]."""
        if self.required is None:
            return None
        return self.required.repeatability if self.same_vehicle else self.required.reproducibility


@dataclass(frozen=True)
class Trend:
    """Change between passes over the same track.

    Parameters
    ----------
    passes : names and dates; the others are aligned with the first
    alignments : alignment of each pass but the first, by name
    bands : change in each band, by name
    changed_locations : locations that changed, by band and distance
    repeatabilities : per band; meaningful only if most of the track did not change
    notes : caveats, as sentences without full stop
    """

    passes: tuple[tuple[str, date], ...]
    alignments: Mapping[str, Alignment]
    bands: Mapping[str, BandChange]
    changed_locations: tuple[ChangedLocation, ...]
    repeatabilities: tuple[Repeatability, ...]
    notes: tuple[str, ...]


def trend(
    passes: Sequence[DatedProfile],
    limits: Limits | None = None,
    speed: float | None = None,
    *,
    bands: Sequence[Band] = BANDS,
    max_lag: float = MAX_LAG,
) -> Trend:
    """Detect changes between passes over the same track; all passes are aligned with the earliest.

    Parameters
    ----------
    passes : two or more profiles with dates
    limits, speed : limit set, and the speed of the line [m/s], for the predicted dates of limit crossings
    bands : bands to compare
    max_lag : maximum lag between two passes that is searched [m]

    Raises
    ------
    DataError : there is only one pass, two passes have the same name, or two do not overlap.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> at = np.arange(0.0, 1000.0, 0.25)
    >>> rough = np.cumsum(np.random.default_rng(1).standard_normal(at.size)) * 2e-4
    >>> def recorded(day, dip):
    ...     level = rough - dip * np.exp(-0.5 * ((at - 600) / 3) ** 2)
    ...     error = np.random.default_rng(day + 5).standard_normal(at.size) * 1e-5
    ...     return DatedProfile(build_profile(at, level + error, kind="point"), date(2026, 1, day), f"day {day}")
    >>> result = trend([recorded(1, 0.0), recorded(31, 0.004)], bands=[BANDS[0]])
    >>> [(round(one.peak), one.change < -1e-3) for one in result.changed_locations]
    [(600, True)]
    """
    ordered = sorted(passes, key=lambda one: one.day)
    _check(ordered)
    first = ordered[0]
    alignments = {
        one.name: align(one.profile, first.profile, one.name, max_lag=max_lag)
        for one in ordered[1:]
    }
    aligned = [first.profile, *(alignments[one.name].shifted(one.profile) for one in ordered[1:])]
    levels, notes = [], []
    for one, profile in zip(ordered, resample_to_common_grid(aligned), strict=True):
        pass_levels, pass_notes = band_levels(profile, bands)
        levels.append(pass_levels)
        notes += [f"{one.name}: {note}" for note in pass_notes]
    days = np.array([(one.day - first.day).days for one in ordered], np.float64)
    changes, locations, repeatabilities = {}, [], []
    for band in bands:
        if not all(band.name in pass_levels for pass_levels in levels):
            continue
        stack = stack_levels(
            band, [pass_levels[band.name] for pass_levels in levels], tuple(alignments.values())
        )
        change = fit_trend(stack, days)
        changes[band.name] = change
        heights = limits.defects_at(band.name, speed) if limits and speed else None
        locations += _changed_locations(
            stack, change, days, first.day, heights.heights if heights else {}
        )
        repeatabilities += _repeatabilities(stack, ordered, limits)
    notes += _scatter_notes(changes)
    if limits:
        notes += unverified_accuracies(limits, list(changes))
        if speed:
            notes += unverified(limits, list(changes), speed)
    return Trend(
        tuple((one.name, one.day) for one in ordered),
        alignments,
        changes,
        tuple(locations),
        tuple(repeatabilities),
        tuple(notes),
    )


def _check(passes: Sequence[DatedProfile]) -> None:
    if len(passes) < 2:
        raise DataError(f"A change needs two passes or more, got {len(passes)}; add a pass.")
    names = [one.name for one in passes]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"Two passes have the name {name!r}; give each its own name.")


def _scatter_notes(changes: Mapping[str, BandChange]) -> list[str]:
    return [
        f"{name}: the passes differ by {change.scatter:.2g} times what their standard deviations explain, which were "
        "multiplied by that factor"
        for name, change in changes.items()
        if change.scatter is not None and change.scatter > 1.5
    ]


def _changed_locations(
    stack: LevelStack,
    change: BandChange,
    days: Array,
    first: date,
    heights: Mapping[Action, float],
) -> list[ChangedLocation]:
    significant = change.usable & (
        np.abs(np.nan_to_num(change.change)) > change.threshold * change.deviation
    )
    locations, halves = [], _half_waves(change.change)
    for group in _groups(significant, halves):
        top = group.start + int(np.argmax(np.abs(np.where(significant, change.change, 0.0)[group])))
        half = halves[int(_containing(halves, top))]
        rate = rate_at(stack, days, top)
        locations.append(
            ChangedLocation(
                band=stack.band.name,
                start=float(change.distance[half.start]),
                peak=float(change.distance[top]),
                end=float(change.distance[half.stop - 1]),
                change=float(change.change[top]),
                deviation=float(change.deviation[top]),
                level=float(stack.level[-1, top]),
                per_day=rate.per_day if rate else None,
                per_day_deviation=rate.deviation if rate else None,
                limit_crossings=limit_crossings(
                    rate, heights, first + timedelta(days=float(days[-1]))
                )
                if rate
                else (),
            )
        )
    return locations


def _half_waves(change: Array) -> list[slice]:
    """Stretches over which the change keeps its sign, in order of distance."""
    turns = np.flatnonzero(np.diff(np.sign(np.nan_to_num(change)))) + 1
    return [slice(a, b) for a, b in pairwise([0, *turns.tolist(), change.size])]


def _containing(halves: Sequence[slice], points: ArrayLike) -> NDArray[np.intp]:
    """Indices of the half waves that contain given points."""
    starts = [half.start for half in halves]
    return np.searchsorted(starts, np.asarray(points), side="right") - 1


def _groups(significant: Mask, halves: Sequence[slice]) -> list[slice]:
    """Stretches of adjacent half waves with a significant change: band-filtered, one dip has side lobes."""
    numbers = np.unique(_containing(halves, np.flatnonzero(significant)))
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return [slice(halves[one[0]].start, halves[one[-1]].stop) for one in pieces if one.size]


def limit_crossings(
    rate: Rate, heights: Mapping[Action, float], last: date
) -> tuple[LimitCrossing, ...]:
    """Predict when the level exceeds each limit that it moves towards and does not exceed yet.

    Parameters
    ----------
    rate : level and its rate of change
    heights : limits [m]
    last : date of the last pass
    """
    side = np.sign(rate.per_day)
    level, deviation = rate.predict(np.arange(HORIZON + 1, dtype=np.float64))
    crossings = []
    for action, height in sorted(heights.items()):
        probability = ndtr((side * level - height) / np.maximum(deviation, 1e-9))
        dates = [
            last + timedelta(days=int(np.argmax(probability >= 1 - q))) if (probability >= 1 - q).any() else None
            for q in _QUANTILES
        ]  # fmt: skip
        if side * level[0] < height:
            crossings.append(LimitCrossing(action, height, *dates))
    return tuple(crossings)


def _repeatabilities(
    stack: LevelStack, passes: Sequence[DatedProfile], limits: Limits | None
) -> list[Repeatability]:
    required = limits.accuracy(stack.band.name) if limits else None
    repeatabilities = []
    for same in (True, False):
        pairs = [
            (i, k)
            for i, k in combinations(range(len(passes)), 2)
            if same == (_vehicle(passes[i]) == _vehicle(passes[k]))
        ]
        if pairs and stack.usable.any():
            differences = np.concatenate(
                [np.abs(stack.level[k] - stack.level[i])[stack.usable] for i, k in pairs]
            )
            repeatabilities.append(
                Repeatability(
                    stack.band.name, same, float(np.quantile(differences, 0.95)), required, len(pairs)
                )
            )  # fmt: skip
    return repeatabilities


def _vehicle(one: DatedProfile) -> str:
    return str(one.profile.attrs.get("vehicle", ""))

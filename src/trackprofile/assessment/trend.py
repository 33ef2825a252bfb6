"""What changed between passes over the same place: where, how fast, and when a limit is reached.

Passes are aligned with the earliest (`alignment`), a line in time is laid through the level at every
place (`trend`), and what changed more than chance allows is a place.
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

from trackprofile.assessment.alignment import LARGEST, Alignment, align, on_common_grid
from trackprofile.assessment.levels import band_levels
from trackprofile.assessment.limits import (
    Accuracy,
    Action,
    Limits,
    unverified,
    unverified_accuracies,
)
from trackprofile.assessment.trend_fit import BandChange, Rate, Stack, fit_trend, rate_at, stack
from trackprofile.bands import BANDS, Band
from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HORIZON = 3650
"""Days over which a limit's date is sought."""

_QUANTILES = (0.975, 0.5, 0.025)


@dataclass(frozen=True)
class DatedProfile:
    """A profile, the day it was recorded and what it is called."""

    profile: xr.Dataset
    day: date
    name: str


@dataclass(frozen=True)
class LimitCrossing:
    """When a limit is reached if the change goes on; None is not within `HORIZON`.

    Parameters
    ----------
    limit : [m]
    earliest, median, latest : by then with a probability of 2.5, 50 and 97.5 %
    """

    action: Action
    limit: float
    earliest: date | None
    median: date | None
    latest: date | None


@dataclass(frozen=True)
class ChangedLocation:
    """One place that changed.

    Parameters
    ----------
    band : by name
    start, peak, end : where the change begins, is greatest, ends [m]
    change, deviation : at the peak; settlement is negative [m]
    level : there, at the last pass [m]
    per_day, per_day_deviation : rate [m/day]; None where all passes are of one day
    reached : per limit that lies ahead
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
    reached: tuple[LimitCrossing, ...]


@dataclass(frozen=True)
class Repeatability:
    """What 95 % of the differences between passes stay below, in the form of EN 13848-2.

    Parameters
    ----------
    band : by name
    same_vehicle : repeatability if so, else reproducibility
    difference : [m]
    required : by the limits, if they state it
    pairs : of passes behind it
    """

    band: str
    same_vehicle: bool
    difference: float
    required: Accuracy | None
    pairs: int

    @property
    def limit(self) -> float | None:
        """What the difference is to stay below [m]."""
        if self.required is None:
            return None
        return self.required.repeatability if self.same_vehicle else self.required.reproducibility


@dataclass(frozen=True)
class Trend:
    """Passes over one place, compared.

    Parameters
    ----------
    passes : by name and day, the first is what the others are aligned with
    alignments : of all but the first
    bands : the change in each
    places : that changed, by band and distance
    repeatabilities : per band; of use where little has changed
    notes : in sentences
    """

    passes: tuple[tuple[str, date], ...]
    alignments: Mapping[str, Alignment]
    bands: Mapping[str, BandChange]
    places: tuple[ChangedLocation, ...]
    repeatabilities: tuple[Repeatability, ...]
    notes: tuple[str, ...]


def trend(
    passes: Sequence[DatedProfile],
    limits: Limits | None = None,
    speed: float | None = None,
    *,
    bands: Sequence[Band] = BANDS,
    largest: float = LARGEST,
) -> Trend:
    """Compare passes over the same place; the earliest is what the others are aligned with.

    Parameters
    ----------
    passes : two or more
    limits, speed : that a limit's date is stated for; the line's speed [m/s]
    bands : to compare
    largest : lag between two passes that is searched for [m]

    Raises
    ------
    DataError : there is one pass only, two have one name, or two do not overlap.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> at = np.arange(0.0, 1000.0, 0.25)
    >>> rough = np.cumsum(np.random.default_rng(1).standard_normal(at.size)) * 2e-4
    >>> def seen(day, dip):
    ...     level = rough - dip * np.exp(-0.5 * ((at - 600) / 3) ** 2)
    ...     error = np.random.default_rng(day + 5).standard_normal(at.size) * 1e-5
    ...     return Pass(build_profile(at, level + error, kind="point"), date(2026, 1, day), f"day {day}")
    >>> found = changes([seen(1, 0.0), seen(31, 0.004)], bands=[BANDS[0]])
    >>> [(round(one.peak), one.change < -1e-3) for one in found.places]
    [(600, True)]
    """
    ordered = sorted(passes, key=lambda one: one.day)
    _check(ordered)
    first = ordered[0]
    alignments = {one.name: align(one.profile, first.profile, one.name, largest) for one in ordered[1:]}  # fmt: skip
    moved = [first.profile, *(alignments[one.name].moved(one.profile) for one in ordered[1:])]
    levels, notes = [], []
    for one, profile in zip(ordered, on_common_grid(moved), strict=True):
        of_pass, said = band_levels(profile, bands)
        levels.append(of_pass)
        notes += [f"{one.name}: {sentence}" for sentence in said]
    days = np.array([(one.day - first.day).days for one in ordered], np.float64)
    found, places, repeated = {}, [], []
    for band in bands:
        if not all(band.name in of_pass for of_pass in levels):
            continue
        of_band = [of_pass[band.name] for of_pass in levels]
        together = stack(band, of_band, tuple(alignments.values()))
        change = fit_trend(together, days)
        found[band.name] = change
        heights = limits.defects_at(band.name, speed) if limits and speed else None
        places += _places(together, change, days, first.day, heights.heights if heights else {})
        repeated += _repeatabilities(together, ordered, limits)
    notes += _untold(found)
    if limits:
        notes += unverified_accuracies(limits, list(found))
        if speed:
            notes += unverified(limits, list(found), speed)
    return Trend(
        tuple((one.name, one.day) for one in ordered),
        alignments,
        found,
        tuple(places),
        tuple(repeated),
        tuple(notes),
    )


def _check(passes: Sequence[DatedProfile]) -> None:
    if len(passes) < 2:
        raise DataError(f"A change needs two passes or more, got {len(passes)}; add one.")
    names = [one.name for one in passes]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"Two passes are called {name!r}; give each its own name.")


def _untold(found: Mapping[str, BandChange]) -> list[str]:
    return [
        f"{name}: the passes scatter {change.scatter:.2g} times as much as they state, and were taken at that"
        for name, change in found.items()
        if change.scatter is not None and change.scatter > 1.5
    ]


def _places(
    together: Stack, change: BandChange, days: Array, first: date, heights: Mapping[Action, float]
) -> list[ChangedLocation]:
    beyond = change.usable & (
        np.abs(np.nan_to_num(change.change)) > change.threshold * change.deviation
    )
    places, halves = [], _half_waves(change.change)
    for group in _groups(beyond, halves):
        top = group.start + int(np.argmax(np.abs(np.where(beyond, change.change, 0.0)[group])))
        half = halves[int(_holding(halves, top))]
        rate = rate_at(together, days, top)
        last = float(together.level[-1, top])
        places.append(
            ChangedLocation(
                band=together.band.name,
                start=float(change.distance[half.start]),
                peak=float(change.distance[top]),
                end=float(change.distance[half.stop - 1]),
                change=float(change.change[top]),
                deviation=float(change.deviation[top]),
                level=last,
                per_day=rate.per_day if rate else None,
                per_day_deviation=rate.deviation if rate else None,
                reached=limits_reached(rate, heights, first + timedelta(days=float(days[-1])))
                if rate
                else (),
            )
        )
    return places


def _half_waves(change: Array) -> list[slice]:
    """Stretches over which the change keeps its sign, in their order."""
    turns = np.flatnonzero(np.diff(np.sign(np.nan_to_num(change)))) + 1
    return [slice(a, b) for a, b in pairwise([0, *turns.tolist(), change.size])]


def _holding(halves: Sequence[slice], places: ArrayLike) -> NDArray[np.intp]:
    """Numbers of the half waves that hold some places."""
    starts = [half.start for half in halves]
    return np.searchsorted(starts, np.asarray(places), side="right") - 1


def _groups(beyond: Mask, halves: Sequence[slice]) -> list[slice]:
    """Neighbouring half waves that changed are one place: a dip has shoulders in any band."""
    numbers = np.unique(_holding(halves, np.flatnonzero(beyond)))
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return [slice(halves[one[0]].start, halves[one[-1]].stop) for one in pieces if one.size]


def limits_reached(
    rate: Rate, heights: Mapping[Action, float], last: date
) -> tuple[LimitCrossing, ...]:
    """When the level goes beyond each height that lies ahead, on the side to which it moves.

    Parameters
    ----------
    rate : of the level
    heights : of limits [m]
    last : day of the last pass
    """
    side = np.sign(rate.per_day)
    level, deviation = rate.ahead(np.arange(HORIZON + 1, dtype=np.float64))
    found = []
    for action, height in sorted(heights.items()):
        chance = ndtr((side * level - height) / np.maximum(deviation, 1e-9))
        by = [
            last + timedelta(days=int(np.argmax(chance >= 1 - q))) if (chance >= 1 - q).any() else None
            for q in _QUANTILES
        ]  # fmt: skip
        if side * level[0] < height:
            found.append(LimitCrossing(action, height, *by))
    return tuple(found)


def _repeatabilities(
    together: Stack, passes: Sequence[DatedProfile], limits: Limits | None
) -> list[Repeatability]:
    required = limits.accuracy(together.band.name) if limits else None
    found = []
    for same in (True, False):
        pairs = [
            (i, k)
            for i, k in combinations(range(len(passes)), 2)
            if same == (_vehicle(passes[i]) == _vehicle(passes[k]))
        ]
        if pairs and together.usable.any():
            differences = np.concatenate(
                [np.abs(together.level[k] - together.level[i])[together.usable] for i, k in pairs]
            )
            found.append(
                Repeatability(
                    together.band.name, same, float(np.quantile(differences, 0.95)), required, len(pairs)
                )
            )  # fmt: skip
    return found


def _vehicle(one: DatedProfile) -> str:
    return str(one.profile.attrs.get("vehicle", ""))

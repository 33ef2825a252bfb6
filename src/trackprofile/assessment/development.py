"""Development of one location over many passes: its level on each date, the rate, and predicted limit crossings.

Every pass is aligned with the earliest usable one (`alignment`), and a straight line in time is fitted to the level
of the location (`trend_fit`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import gammaincc

from trackprofile.assessment.alignment import MAX_LAG, Alignment, align, resample_to_common_grid
from trackprofile.assessment.levels import NotAssessedReason, band_levels
from trackprofile.assessment.limits import Action
from trackprofile.assessment.trend import DatedProfile, LimitCrossing, limit_crossings
from trackprofile.assessment.trend_fit import LevelStack, Rate, rate_at, stack_levels
from trackprofile.bands import Band, edge_distance
from trackprofile.errors import DataError

Array = NDArray[np.float64]

MIN_REACH = 500.0
"""Minimum distance to each side of a location over which passes are aligned [m]: two windows of the alignment."""

MIN_LINEARITY_P_VALUE = 0.01
"""p-value of the chi-squared test of linearity below which the passes are reported not to lie on a straight line."""


@dataclass(frozen=True)
class Development:
    """The level of a location in one band on each date on which it could be assessed.

    Parameters
    ----------
    band : the band
    at : distance of the location in the earliest pass [m]
    passes : names and dates of the passes, in order of time
    level, deviation : level at the location and the standard deviation of its error, (passes,) [m]
    rate : level and rate of change; None without two dates
    linearity_p_value : p-value of the chi-squared test that the passes lie on a straight line; None for fewer than
        three passes
    limit_crossings : one per limit that is not exceeded yet, if the rate is significant
    excluded : passes that cannot be used at this location, with the reason, by name
    distance : distances around the location in the earliest pass, (n,) [m]
    surroundings : level of every pass at these distances, (passes, n) [m]
    """

    band: Band
    at: float
    passes: tuple[tuple[str, date], ...]
    level: Array
    deviation: Array
    rate: Rate | None
    linearity_p_value: float | None
    limit_crossings: tuple[LimitCrossing, ...]
    excluded: Mapping[str, str]
    distance: Array
    surroundings: Array

    @property
    def is_linear(self) -> bool:
        """Whether a straight line in time describes the passes."""
        return self.linearity_p_value is None or self.linearity_p_value >= MIN_LINEARITY_P_VALUE


def required_reach(band: Band) -> float:
    """Distance to each side of a location over which its passes are needed [m].

    Examples
    --------
    >>> from trackprofile.bands import D1, D3
    >>> round(required_reach(D1)), round(required_reach(D3))
    (550, 1310)
    """
    return edge_distance(band) + max(MIN_REACH, 5 * band.longest) + MAX_LAG


def development(
    passes: Sequence[DatedProfile],
    band: Band,
    at: float,
    heights: Mapping[Action, float] | None = None,
) -> Development:
    """Determine the development of a location from the passes over it.

    Parameters
    ----------
    passes : passes in any order; their profiles should extend by `required_reach` to each side of the location
    band : band of the level
    at : distance of the location in the earliest usable pass [m]
    heights : limits whose crossings are predicted [m]

    Raises
    ------
    DataError : no pass can be used at the location in this band.

    Examples
    --------
    >>> from trackprofile.bands import D1
    >>> from trackprofile.contracts import build_profile
    >>> x = np.arange(0.0, 1000.0, 0.25)
    >>> rough = np.cumsum(np.random.default_rng(1).standard_normal(x.size)) * 2e-4
    >>> def recorded(month):
    ...     level = rough - 2e-3 * month * np.exp(-0.5 * ((x - 500) / 3) ** 2)
    ...     return DatedProfile(build_profile(x, level, kind="truth"), date(2026, month, 1), f"month {month}")
    >>> result = development([recorded(1), recorded(2), recorded(3)], D1, 500.0)
    >>> print(f"{30e3 * result.rate.per_day:.1f} mm in 30 days")
    -1.0 mm in 30 days
    """
    usable, excluded = _usable_passes(sorted(passes, key=lambda one: one.day), band, at)
    if not usable:
        reasons = "; ".join(dict.fromkeys(excluded.values())) or "there is no pass"
        raise DataError(f"At {at:.1f} m the level in {band.name} is not known: {reasons}.")
    stack = _stack(usable, band)
    point = int(np.argmin(np.abs(stack.distance - at)))
    days = np.array([(each.dated.day - usable[0].dated.day).days for each in usable], np.float64)
    rate = rate_at(stack, days, point) if len(usable) > 1 else None
    level, deviation = stack.level[:, point], stack.deviation[:, point]
    crossings: tuple[LimitCrossing, ...] = ()
    if rate and rate.significant and heights:
        crossings = limit_crossings(rate, heights, usable[-1].dated.day)
    return Development(
        band=band,
        at=float(stack.distance[point]),
        passes=tuple((each.dated.name, each.dated.day) for each in usable),
        level=level,
        deviation=deviation,
        rate=rate,
        linearity_p_value=_linearity_p_value(level, deviation, rate, days),
        limit_crossings=crossings,
        excluded=excluded,
        distance=stack.distance,
        surroundings=stack.level,
    )


@dataclass(frozen=True)
class _UsablePass:
    """A pass, its profile with distances of the first pass, and the alignment of both."""

    dated: DatedProfile
    profile: xr.Dataset
    alignment: Alignment | None


def _usable_passes(
    passes: Sequence[DatedProfile], band: Band, at: float
) -> tuple[list[_UsablePass], Mapping[str, str]]:
    """The passes that can be used at the location, in order; and the reasons against the others, by name."""
    usable: list[_UsablePass] = []
    excluded: dict[str, str] = {}
    for one in passes:
        try:
            candidate = _aligned(one, usable[0].profile if usable else None)
            reason = _obstacle(candidate.profile, band, at)
        except DataError as error:
            excluded[one.name] = str(error).removeprefix(f"{one.name}: ").removesuffix(".")
            continue
        if reason:
            excluded[one.name] = reason
        else:
            usable.append(candidate)
    return usable, excluded


def _aligned(one: DatedProfile, first: xr.Dataset | None) -> _UsablePass:
    if first is None:
        return _UsablePass(one, one.profile, None)
    alignment = align(one.profile, first, one.name)
    return _UsablePass(one, alignment.shifted(one.profile), alignment)


def _obstacle(profile: xr.Dataset, band: Band, at: float) -> str:
    """Why a profile cannot be used at a location in a band; empty if it can."""
    level = band_levels(profile, [band])[0][band.name]
    point = int(np.argmin(np.abs(level.distance - at)))
    if abs(level.distance[point] - at) > level.spacing:
        return "it does not cover the location"
    return NotAssessedReason(int(level.reasons[point])).text


def _stack(passes: Sequence[_UsablePass], band: Band) -> LevelStack:
    profiles = resample_to_common_grid([one.profile for one in passes])
    levels = [band_levels(profile, [band])[0][band.name] for profile in profiles]
    return stack_levels(band, levels, [one.alignment for one in passes if one.alignment])


def _linearity_p_value(
    level: Array, deviation: Array, rate: Rate | None, days: Array
) -> float | None:
    """P(χ² of passes - 2 degrees of freedom > Σ((l - line)/s)²)."""
    if rate is None or days.size < 3 or not (deviation > 0).all():
        return None
    line, _ = rate.predict(days - days[-1])
    return float(gammaincc((days.size - 2) / 2, np.sum(np.square((level - line) / deviation)) / 2))

"""How one place developed over many passes: its level on each day, the rate, and when a limit is reached.

Every pass is aligned with the earliest that can be judged there (`alignment`), and a line in time is
laid through the level of the place (`trend`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import gammaincc

from trackprofile.assessment.alignment import LARGEST, Alignment, align, on_common_grid
from trackprofile.assessment.levels import NotAssessedReason, band_levels
from trackprofile.assessment.limits import Action
from trackprofile.assessment.trend import DatedProfile, LimitCrossing, limits_reached
from trackprofile.assessment.trend_fit import Rate, Stack, rate_at, stack
from trackprofile.bands import Band, edge_distance
from trackprofile.errors import DataError

Array = NDArray[np.float64]

LEAST_AROUND = 500.0
"""To either side of a place that passes are compared over [m]: two windows of the alignment."""

STRAIGHT = 0.01
"""Chance of passes to scatter so far about their line, below which they are said not to lie on one."""


@dataclass(frozen=True)
class Development:
    """The level of a place in one band on each day that it could be judged.

    Parameters
    ----------
    band : the band
    at : the place, in the distance of the earliest pass (m)
    passes : names and days, in time (passes)
    level, deviation : there, and the standard deviation of its error (passes) [m]
    rate : None where there are not two days
    straightness : chance of passes that lie on a line to scatter about it as far as these do; None
        for fewer than three passes
    reached : per limit that lies ahead, where the rate is no chance
    left_out : passes that do not tell this place, with the reason
    distance : around the place, of the earliest pass (n) [m]
    along : level of every pass there (passes, n) [m]
    """

    band: Band
    at: float
    passes: tuple[tuple[str, date], ...]
    level: Array
    deviation: Array
    rate: Rate | None
    straightness: float | None
    reached: tuple[LimitCrossing, ...]
    left_out: Mapping[str, str]
    distance: Array
    along: Array

    @property
    def straight(self) -> bool:
        """Whether a line describes the passes."""
        return self.straightness is None or self.straightness >= STRAIGHT


def around(band: Band) -> float:
    """How far to either side of a place its passes are needed [m].

    Examples
    --------
    >>> from trackprofile.bands import D1, D3
    >>> round(around(D1)), round(around(D3))
    (550, 1310)
    """
    return edge_distance(band) + max(LEAST_AROUND, 5 * band.longest) + LARGEST


def development(
    passes: Sequence[DatedProfile],
    band: Band,
    at: float,
    heights: Mapping[Action, float] | None = None,
) -> Development:
    """Follow a place through the passes over it.

    Parameters
    ----------
    passes : with profiles that reach `around` the place where they can, in any order
    band : to look at
    at : the place, in the distance of the earliest pass that tells it [m]
    heights : of limits whose dates are wanted [m]

    Raises
    ------
    DataError : no pass tells the place in this band.

    Examples
    --------
    >>> from trackprofile.bands import D1
    >>> from trackprofile.contracts import build_profile
    >>> x = np.arange(0.0, 1000.0, 0.25)
    >>> rough = np.cumsum(np.random.default_rng(1).standard_normal(x.size)) * 2e-4
    >>> def seen(month):
    ...     level = rough - 2e-3 * month * np.exp(-0.5 * ((x - 500) / 3) ** 2)
    ...     return Pass(build_profile(x, level, kind="truth"), date(2026, month, 1), f"month {month}")
    >>> found = development([seen(1), seen(2), seen(3)], D1, 500.0)
    >>> print(f"{30e3 * found.rate.per_day:.1f} mm in 30 days")
    -1.0 mm in 30 days
    """
    told, left_out = _telling(sorted(passes, key=lambda one: one.day), band, at)
    if not told:
        reasons = "; ".join(dict.fromkeys(left_out.values())) or "there is no pass"
        raise DataError(f"At {at:.1f} m nothing is known in {band.name}: {reasons}.")
    together = _stack(told, band)
    place = int(np.argmin(np.abs(together.distance - at)))
    days = np.array([(each.one.day - told[0].one.day).days for each in told], np.float64)
    rate = rate_at(together, days, place) if len(told) > 1 else None
    ahead = rate if rate and rate.certain else None
    level, deviation = together.level[:, place], together.deviation[:, place]
    return Development(
        band=band,
        at=float(together.distance[place]),
        passes=tuple((each.one.name, each.one.day) for each in told),
        level=level,
        deviation=deviation,
        rate=rate,
        straightness=_straightness(level, deviation, rate, days),
        reached=limits_reached(ahead, heights, told[-1].one.day) if ahead and heights else (),
        left_out=left_out,
        distance=together.distance,
        along=together.level,
    )


@dataclass(frozen=True)
class _Told:
    """A pass that tells the place, in the distance of the first, and how it was brought there."""

    one: DatedProfile
    moved: xr.Dataset
    alignment: Alignment | None


def _telling(
    passes: Sequence[DatedProfile], band: Band, at: float
) -> tuple[list[_Told], Mapping[str, str]]:
    """The passes that tell the place, in their order; and why the others do not, by name."""
    told: list[_Told] = []
    left_out: dict[str, str] = {}
    for one in passes:
        try:
            candidate = _aligned(one, told[0].moved if told else None)
            reason = _obstacle(candidate.moved, band, at)
        except DataError as error:
            left_out[one.name] = str(error).removeprefix(f"{one.name}: ").removesuffix(".")
            continue
        if reason:
            left_out[one.name] = reason
        else:
            told.append(candidate)
    return told, left_out


def _aligned(one: DatedProfile, first: xr.Dataset | None) -> _Told:
    if first is None:
        return _Told(one, one.profile, None)
    alignment = align(one.profile, first, one.name)
    return _Told(one, alignment.moved(one.profile), alignment)


def _obstacle(profile: xr.Dataset, band: Band, at: float) -> str:
    """Why a profile does not tell a place in a band; empty where it does."""
    level = band_levels(profile, [band])[0][band.name]
    place = int(np.argmin(np.abs(level.distance - at)))
    if abs(level.distance[place] - at) > level.spacing:
        return "it does not reach there"
    return NotAssessedReason(int(level.reasons[place])).words


def _stack(told: Sequence[_Told], band: Band) -> Stack:
    profiles = on_common_grid([one.moved for one in told])
    levels = [band_levels(profile, [band])[0][band.name] for profile in profiles]
    return stack(band, levels, [one.alignment for one in told if one.alignment])


def _straightness(level: Array, deviation: Array, rate: Rate | None, days: Array) -> float | None:
    """P(χ² of passes - 2 degrees of freedom > Σ((l - line)/s)²)."""
    if rate is None or days.size < 3 or not (deviation > 0).all():
        return None
    line, _ = rate.ahead(days - days[-1])
    return float(gammaincc((days.size - 2) / 2, np.sum(np.square((level - line) / deviation)) / 2))

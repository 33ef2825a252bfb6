"""Isolated defects: half waves of a band's level that exceed a limit, or may in truth.

A defect runs from where the level leaves its mean to where it comes back to it; its height is that
of the peak over the mean (EN 13848-5). It is listed if the estimate exceeds the lowest limit, and
also if it does not but the true level does with a probability that matters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.assessment.exceedance import exceedance_probability
from trackprofile.assessment.levels import BandLevel
from trackprofile.assessment.limits import Action, DefectLimits

Array = NDArray[np.float64]

_FAR = 5.0  # standard deviations, beyond which no limit is reached in earnest


@dataclass(frozen=True)
class Defect:
    """One isolated defect.

    Parameters
    ----------
    band : by name
    start, peak, end : where the level leaves its mean, is farthest from it, comes back [m]
    height : of the peak over the mean, up is positive [m]
    deviation : standard deviation of the height; 0 where the profile states none [m]
    exceeded : the gravest limit that the estimate exceeds, if any
    probabilities : per action, that the true level exceeds its limit somewhere from start to end
    limits : what they were judged by
    location_deviation : standard deviation of where it is; None where the profile does not say [m]
    """

    band: str
    start: float
    peak: float
    end: float
    height: float
    deviation: float
    exceeded: Action | None
    probabilities: Mapping[Action, float]
    limits: DefectLimits
    location_deviation: float | None = None

    @property
    def length(self) -> float:
        """From start to end [m]."""
        return self.end - self.start

    @property
    def likely(self) -> Action | None:
        """The gravest action whose limit is exceeded with a probability of at least one half."""
        return max((one for one, p in self.probabilities.items() if p >= 0.5), default=None)


def find_defects(
    level: BandLevel, limits: DefectLimits, least_probability: float
) -> tuple[Defect, ...]:
    """All defects of a band, in their order.

    Parameters
    ----------
    level : the profile in the band
    limits : of that band at the line's speed
    least_probability : of exceeding the lowest limit, from which a defect is listed

    Examples
    --------
    >>> from trackprofile.assessment.levels import band_levels
    >>> from trackprofile.bands import D1
    >>> from trackprofile.contracts import build_profile
    >>> distance = np.arange(0.0, 200.0, 0.25)
    >>> dip = -0.02 * np.exp(-0.5 * ((distance - 100) / 2) ** 2)
    >>> levels, _ = band_levels(build_profile(distance, dip, kind="truth"), [D1])
    >>> limits = DefectLimits("D1", 0.0, 50.0, "ours", True, {Action.ALERT: 0.01})
    >>> for one in find_defects(levels["D1"], limits, 0.05):
    ...     print(f"{one.peak:.0f} m, {1e3 * one.height:.1f} mm, P = {one.probabilities[Action.ALERT]:.0f}")
    100 m, -13.1 mm, P = 1
    """
    if not limits.heights:
        return ()
    lowest = min(limits.heights.values())
    reach = np.abs(level.level) + _FAR * level.deviation > lowest
    found = []
    for half in _half_waves(level):
        if reach[half].any():
            defect = _defect(level, limits, half)
            if max(defect.probabilities.values()) >= least_probability or defect.exceeded:
                found.append(defect)
    return tuple(found)


def _half_waves(level: BandLevel) -> list[slice]:
    """Stretches of one sign within what may be judged."""
    up = np.nan_to_num(level.level) > 0
    turns = np.flatnonzero(up[1:] != up[:-1]) + 1
    halves = []
    for run in runs(level.assessed):
        inner = turns[np.searchsorted(turns, run.start, "right") : np.searchsorted(turns, run.stop)]
        edges = [run.start, *inner.tolist(), run.stop]
        halves += [slice(a, b) for a, b in pairwise(edges)]
    return halves


def _defect(level: BandLevel, limits: DefectLimits, half: slice) -> Defect:
    values, deviation = level.level[half], level.deviation[half]
    top = int(np.argmax(np.abs(values)))
    sign = 1.0 if values[top] > 0 else -1.0
    wavenumber = level.colour.wavenumber
    probabilities = {
        action: exceedance_probability(sign * values, deviation, height, level.spacing, wavenumber)
        for action, height in limits.heights.items()
    }
    over = [one for one, height in limits.heights.items() if sign * values[top] > height]
    start, end = _crossing(level, half.start), _crossing(level, half.stop)
    return Defect(
        band=level.band.name,
        start=start,
        peak=float(level.distance[half.start + top]),
        end=end,
        height=float(values[top]),
        deviation=float(deviation[top]),
        exceeded=max(over, default=None),
        probabilities=probabilities,
        limits=limits,
    )


def _crossing(level: BandLevel, place: int) -> float:
    """Where the level is zero between two neighbours [m]; at an end or gap, the end."""
    if place in (0, level.level.size):
        return float(level.distance[min(place, level.level.size - 1)])
    before, after = level.level[place - 1], level.level[place]
    share = before / (before - after) if before * after <= 0 and before != after else 0.5
    if not np.isfinite(share):
        share = 1.0
    return float(level.distance[place - 1] + share * level.spacing)

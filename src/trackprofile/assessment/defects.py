"""Isolated defects: half waves of a band's level that exceed a limit, or do so with a minimum probability.

A defect extends between the two points at which the level crosses its mean; its height is that of the peak over the
mean (EN 13848-5). It is listed if the estimate exceeds the lowest limit, or if the true level does so with a
probability above a minimum.
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

_MAX_DEVIATIONS = 5.0  # standard deviations from the limit at which its exceedance is improbable


@dataclass(frozen=True)
class Defect:
    """One isolated defect.

    Parameters
    ----------
    band : name of the band
    start, peak, end : distances at which the level leaves its mean, has its peak, and returns to the mean [m]
    height : height of the peak over the mean, positive upwards [m]
    deviation : standard deviation of the height; 0 if the profile states none [m]
    exceeded : most severe action whose limit the estimate exceeds, if any
    probabilities : for each action, probability that the true level exceeds its limit between start and end
    limits : limits of the band at the line speed
    location_deviation : standard deviation of the location; None if the profile states none [m]
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
        """Length from start to end [m]."""
        return self.end - self.start

    @property
    def required_action(self) -> Action | None:
        """Most severe action whose limit is exceeded with a probability of at least 50 %."""
        return max((one for one, p in self.probabilities.items() if p >= 0.5), default=None)


def find_defects(
    level: BandLevel, limits: DefectLimits, least_probability: float
) -> tuple[Defect, ...]:
    """Find all defects of a band, in order of distance.

    Parameters
    ----------
    level : level in the band
    limits : limits of the band at the line speed
    least_probability : minimum probability of exceeding the lowest limit for a defect to be listed

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
    reach = np.abs(level.level) + _MAX_DEVIATIONS * level.deviation > lowest
    defects = []
    for half in _half_waves(level):
        if reach[half].any():
            defect = _defect(level, limits, half)
            if max(defect.probabilities.values()) >= least_probability or defect.exceeded:
                defects.append(defect)
    return tuple(defects)


def _half_waves(level: BandLevel) -> list[slice]:
    """Stretches of constant sign within the assessed stretches."""
    up = np.nan_to_num(level.level) > 0
    crossings = np.flatnonzero(up[1:] != up[:-1]) + 1
    halves = []
    for run in runs(level.assessed):
        first, last = np.searchsorted(crossings, [run.start + 1, run.stop])
        inner = crossings[first:last]
        edges = [run.start, *inner.tolist(), run.stop]
        halves += [slice(a, b) for a, b in pairwise(edges)]
    return halves


def _defect(level: BandLevel, limits: DefectLimits, half: slice) -> Defect:
    values, deviation = level.level[half], level.deviation[half]
    top = int(np.argmax(np.abs(values)))
    sign = 1.0 if values[top] > 0 else -1.0
    wavenumber = level.error_spectrum.wavenumber
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


def _crossing(level: BandLevel, point: int) -> float:
    """Distance at which the level is zero between two neighbouring points [m]; at an end or gap, that end."""
    if point in (0, level.level.size):
        return float(level.distance[min(point, level.level.size - 1)])
    before, after = level.level[point - 1], level.level[point]
    share = before / (before - after) if before * after <= 0 and before != after else 0.5
    if not np.isfinite(share):
        share = 1.0
    return float(level.distance[point - 1] + share * level.spacing)

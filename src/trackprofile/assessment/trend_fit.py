"""The level of all passes on one grid, and its change with time at each point.

At each point the level of a band, l(t) = a + b t, is fitted to the passes by weighted least squares. The change over
the time T between the first and the last pass is b T, or the last level minus the first if all passes have one date.
A change is significant if |change|/deviation exceeds the value that its maximum over the whole stretch exceeds by
chance with a probability of 5 % (Rice 1945: over a length L an error of wavenumber κ crosses ±u about
L κ/π exp(-u²/2) times).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.alignment import Alignment
from trackprofile.assessment.levels import BandLevel
from trackprofile.bands import Band
from trackprofile.kalman.reweighting import STANDARD_DEVIATION_PER_MAD

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FALSE_ALARM_PROBABILITY = 0.05
"""Probability that unchanged track is reported as changed somewhere."""

MIN_WAVELENGTHS = 10
"""Minimum length that the passes share, in longest wavelengths of a band, from which their scatter is estimated."""

_MIN_SCATTER = 1e-9  # avoids a division by zero for identical passes


@dataclass(frozen=True)
class BandChange:
    """Change in one band along the line.

    Parameters
    ----------
    band : the band
    distance : distance of the first pass, (n,) [m]
    change : change between the first and the last pass, (n,) [m]
    deviation : standard deviation of its error, (n,) [m]
    usable : True where all passes are assessed, (n,)
    scatter : ratio of the passes' differences to their standard deviations; None if one states none
    threshold : value of |change|/deviation above which a change is significant
    """

    band: Band
    distance: Array
    change: Array
    deviation: Array
    usable: Mask
    scatter: float | None
    threshold: float


@dataclass(frozen=True)
class LevelStack:
    """Levels of all passes in one band on the grid of the first pass.

    Parameters
    ----------
    band : the band
    distance : distance of the first pass, (n,) [m]
    level : level of each pass, (passes, n) [m]
    deviation : standard deviation of its error, including that of the alignment, (passes, n) [m]
    usable : True where all passes are assessed, (n,)
    wavenumber : RMS wavenumber of the error [rad/m]
    scatter : ratio of the passes' differences to their standard deviations; None if one states none
    """

    band: Band
    distance: Array
    level: Array
    deviation: Array
    usable: Mask
    wavenumber: float
    scatter: float | None


def stack_levels(
    band: Band, levels: Sequence[BandLevel], alignments: Sequence[Alignment]
) -> LevelStack:
    """Combine the levels of passes, and their standard deviations.

    A lag of standard deviation σ adds σ times the slope of the level. Since most of the track does not change, the
    scatter is estimated from the median of the differences between passes.

    Parameters
    ----------
    band : the band
    levels : levels of the passes on one grid, the earliest pass first
    alignments : alignments of all passes but the first
    """
    grid = levels[0].distance
    level = np.stack([one.level for one in levels])
    deviation = np.stack([one.deviation for one in levels])
    usable = np.logical_and.reduce([one.assessed for one in levels])
    stated = all(one.stated for one in levels) and bool((deviation[:, usable] > 0).all())
    if not stated:
        deviation = np.ones(level.shape)
    scatter = _scatter(level[:, usable], deviation[:, usable])
    long_enough = levels[0].spacing * np.count_nonzero(usable) > MIN_WAVELENGTHS * band.longest
    if stated and not long_enough:
        scatter = 1.0
    slope = np.abs(np.nan_to_num(np.gradient(level[0], levels[0].spacing)))
    lag_error = np.stack([np.zeros(grid.size), *(slope * one.at(grid)[1] for one in alignments)])
    return LevelStack(
        band, grid, level, np.hypot(scatter * deviation, lag_error), usable, levels[0].error_spectrum.wavenumber,
        scatter if stated else None,
    )  # fmt: skip


def _scatter(level: Array, deviation: Array) -> float:
    """Robust standard deviation of (l_k - l_1)/√(s_k² + s_1²) over all passes k > 1."""
    if not level[1:].size:
        return 1.0
    normalised = (level[1:] - level[0]) / np.hypot(deviation[1:], deviation[0])
    return max(float(STANDARD_DEVIATION_PER_MAD * np.median(np.abs(normalised))), _MIN_SCATTER)


def _fit_lines(passes: LevelStack, days: Array) -> tuple[Array, Array]:
    """Level at the last pass and rate per day, (2, n), and the weight of each pass in them, (2, passes)."""
    weight = 1 / np.median(passes.deviation, axis=1) ** 2
    design = np.stack([np.ones(days.size), days - days[-1]], axis=1)
    normal = design.T @ (weight[:, None] * design)
    gains = np.linalg.solve(normal, design.T * weight)
    return np.asarray(gains @ passes.level, np.float64), np.asarray(gains, np.float64)


def fit_trend(passes: LevelStack, days: Array) -> BandChange:
    """Fit the change between the first and the last pass.

    Parameters
    ----------
    passes : levels of the passes
    days : days since the first pass, (passes,)
    """
    span = days[-1] - days[0]
    if span > 0:
        coefficients, gains = _fit_lines(passes, days)
        change = span * coefficients[1]
        deviation = span * np.sqrt(np.square(gains[1]) @ np.square(passes.deviation))
    else:
        change = passes.level[-1] - passes.level[0]
        deviation = np.hypot(passes.deviation[-1], passes.deviation[0])
    spacing = float(passes.distance[1] - passes.distance[0])
    length = spacing * np.count_nonzero(passes.usable)
    threshold = _threshold(length, passes.wavenumber)
    return BandChange(
        passes.band, passes.distance, change, deviation, passes.usable, passes.scatter, threshold
    )


def _threshold(length: float, wavenumber: float) -> float:
    """u with 2 Φ(-u) + L κ/π exp(-u²/2) = FALSE_ALARM_PROBABILITY."""
    candidates = np.linspace(1.5, 8.0, 1301)
    probability = 2 * ndtr(-candidates) + length * wavenumber / np.pi * np.exp(-0.5 * candidates**2)
    return float(candidates[np.argmax(probability <= FALSE_ALARM_PROBABILITY)])


@dataclass(frozen=True)
class Rate:
    """Level and rate of change at one location.

    Parameters
    ----------
    level : level at the last pass [m]
    per_day : rate of change [m/day]
    covariance : covariance of both, (2, 2) [m², m²/day, m²/day²]
    """

    level: float
    per_day: float
    covariance: Array

    @property
    def deviation(self) -> float:
        """Standard deviation of the rate [m/day]."""
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def significant(self) -> bool:
        """Whether the rate differs from 0 at the 5 % level."""
        return abs(self.per_day) > NORMAL_95 * self.deviation

    def predict(self, days: Array) -> tuple[Array, Array]:
        """Level and its standard deviation at days after (positive) or before the last pass, (n,) [m]."""
        covariance = self.covariance
        variance = covariance[0, 0] + 2 * days * covariance[0, 1] + days**2 * covariance[1, 1]
        return self.level + self.per_day * days, np.sqrt(np.maximum(variance, 0.0))


def rate_at(passes: LevelStack, days: Array, point: int) -> Rate | None:
    """Level and rate at one point of the grid; None if all passes have one date."""
    if days[-1] == days[0]:
        return None
    coefficients, gains = _fit_lines(passes, days)
    covariance = (gains * np.square(passes.deviation[:, point])) @ gains.T
    return Rate(float(coefficients[0, point]), float(coefficients[1, point]), covariance)

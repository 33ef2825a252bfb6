"""The level of all passes on one grid, and its change with time at each place.

At each place the level of a band, l(t) = a + b t, is fitted to the passes by weighted least squares;
the change over the time between first and last is b T, or last less first where all are of one day.
A place changed if |change|/deviation goes beyond what its greatest value over the whole stretch
reaches by chance in one of twenty cases (Rice 1945: over a length L the error of wavenumber κ
crosses ±u about L κ/π exp(-u²/2) times).
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

BY_CHANCE = 0.05
"""That unchanged track is said to have changed somewhere."""

INDEPENDENT = 10
"""Longest waves of a band that the passes have to share before their own scatter is believed."""

_EXACT = 1e-9  # of passes that are copies of each other


@dataclass(frozen=True)
class BandChange:
    """The change in one band along the line.

    Parameters
    ----------
    band : the band
    distance : of the first pass (n) [m]
    change : over the time between first and last pass (n) [m]
    deviation : standard deviation of its error (n) [m]
    usable : where every pass may be judged (n)
    scatter : of the passes' differences, in units of what they state; None where one states nothing
    threshold : of |change|/deviation, beyond which a place counts as changed
    """

    band: Band
    distance: Array
    change: Array
    deviation: Array
    usable: Mask
    scatter: float | None
    threshold: float


@dataclass(frozen=True)
class Stack:
    """All passes in one band on the first one's grid.

    Parameters
    ----------
    level : (passes, n) [m]
    deviation : of its error, with what the alignment leaves unsure (passes, n) [m]
    usable : where all may be judged (n)
    wavenumber : of the error [rad/m]
    scatter : of the passes' differences in units of what they state; None where one states nothing
    """

    band: Band
    distance: Array
    level: Array
    deviation: Array
    usable: Mask
    wavenumber: float
    scatter: float | None


def stack(band: Band, levels: Sequence[BandLevel], alignments: Sequence[Alignment]) -> Stack:
    """Put passes, the first one's first and all on one grid, together; a lag unsure by σ costs σ times the slope.

    Most track is as it was: the median of the differences tells how the passes scatter, whatever they state.
    """
    grid = levels[0].distance
    level = np.stack([one.level for one in levels])
    spread = np.stack([one.deviation for one in levels])
    usable = np.logical_and.reduce([one.assessed for one in levels])
    stated = all(one.stated for one in levels) and bool((spread[:, usable] > 0).all())
    if not stated:
        spread = np.ones(level.shape)
    scatter = _scatter(level[:, usable], spread[:, usable])
    long_enough = levels[0].spacing * np.count_nonzero(usable) > INDEPENDENT * band.longest
    if stated and not long_enough:
        scatter = 1.0
    slope = np.abs(np.nan_to_num(np.gradient(level[0], levels[0].spacing)))
    unsure = np.stack([np.zeros(grid.size), *(slope * one.at(grid)[1] for one in alignments)])
    return Stack(
        band, grid, level, np.hypot(scatter * spread, unsure), usable, levels[0].colour.wavenumber,
        scatter if stated else None,
    )  # fmt: skip


def _scatter(level: Array, spread: Array) -> float:
    """Robust standard deviation of (l_k - l_1)/√(s_k² + s_1²) over all later passes k."""
    if not level[1:].size:
        return 1.0
    units = (level[1:] - level[0]) / np.hypot(spread[1:], spread[0])
    return max(float(STANDARD_DEVIATION_PER_MAD * np.median(np.abs(units))), _EXACT)


def _line(passes: Stack, days: Array) -> tuple[Array, Array]:
    """Level at the last pass and per day (2, n), and what each pass adds to them (2, passes)."""
    weight = 1 / np.median(passes.deviation, axis=1) ** 2
    design = np.stack([np.ones(days.size), days - days[-1]], axis=1)
    normal = design.T @ (weight[:, None] * design)
    gains = np.linalg.solve(normal, design.T * weight)
    return np.asarray(gains @ passes.level, np.float64), np.asarray(gains, np.float64)


def fit_trend(passes: Stack, days: Array) -> BandChange:
    """The change over the time between the first and the last pass.

    Parameters
    ----------
    days : of the passes, since the first (passes)
    """
    span = days[-1] - days[0]
    if span > 0:
        coefficients, gains = _line(passes, days)
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
    """u with 2 Φ(-u) + L κ/π exp(-u²/2) = BY_CHANCE."""
    tried = np.linspace(1.5, 8.0, 1301)
    chance = 2 * ndtr(-tried) + length * wavenumber / np.pi * np.exp(-0.5 * tried**2)
    return float(tried[np.argmax(chance <= BY_CHANCE)])


@dataclass(frozen=True)
class Rate:
    """A level's value at the last pass [m], how fast it changes [m/day], and the covariance of the two."""

    level: float
    per_day: float
    covariance: Array

    @property
    def deviation(self) -> float:
        """Standard deviation of the rate [m/day]."""
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def certain(self) -> bool:
        """Whether it is no chance, with 95 %."""
        return abs(self.per_day) > NORMAL_95 * self.deviation

    def ahead(self, days: Array) -> tuple[Array, Array]:
        """Level and its standard deviation some days after the last pass, or before it (n) [m]."""
        covariance = self.covariance
        variance = covariance[0, 0] + 2 * days * covariance[0, 1] + days**2 * covariance[1, 1]
        return self.level + self.per_day * days, np.sqrt(np.maximum(variance, 0.0))


def rate_at(passes: Stack, days: Array, place: int) -> Rate | None:
    """At one place of the grid; None where all passes are of one day."""
    if days[-1] == days[0]:
        return None
    coefficients, gains = _line(passes, days)
    covariance = (gains * np.square(passes.deviation[:, place])) @ gains.T
    return Rate(float(coefficients[0, place]), float(coefficients[1, place]), covariance)

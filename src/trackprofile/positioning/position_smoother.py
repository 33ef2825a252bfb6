"""Where a train was, how fast it went, and how well that is known: all sources through one smoother.

The smoother keeps its head as that of the profile does (:mod:`trackprofile.kalman.robust`): each reading is told by
all the others, and one that is ``BEYOND`` standard deviations off is given the noise that it shows. Where the slope of
the likelihood over a jump says so, the wheel slips, or the acceleration changes. A source whose noise nobody states is
given the one that it shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from trackprofile.kalman.chain import ChainPosterior, log_likelihood, smooth_chain
from trackprofile.positioning.position_model import (
    SCALE,
    SLIP,
    A,
    D,
    PositionPrior,
    Q,
    Rows,
    V,
    chain_of,
    rows_of,
)
from trackprofile.positioning.position_observations import (
    PositionObservations,
    Source,
    StandstillInterval,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BEYOND = 5.0
"""Standard deviations: of ten million good readings six are beyond."""

STAYS = 4.0
"""Standard deviations beyond which one that was so far off stays an outlier, so that the rounds end."""

LOUDER = 3.0
"""Times its variance that a source has to show before the noise that is stated of it is not believed."""

BOLDEST = 4.0
"""Times by which the variance of a source may change in one round."""

BOLD = 0.05
"""By which the logarithm of a wheel's scale may change in one round."""

CHI_SQUARE_MEDIAN = 0.4549
"""Of the square of a standard normal number."""

FEWEST = 10
"""Readings that tell a source's noise."""

LEAST_TOLD = 1e-9
"""Share of the greatest precision below which nothing is told of a jump: at the very ends of a ride."""

SUDDEN = 1.2
"""m/s²: the most by which a train changes its acceleration at once; a wheel that does more slips."""

FREE = 1.0
"""m by which a wheel that slips may do so in a step: more than what is known without it."""

SLIPPING = 1.5
"""s about where a wheel slips, over which it is not believed."""

APART = 10.0
"""s about the clearest jump in which no other is taken in the same round."""

WHEEL_FIRST = 3
"""The round from which a wheel's readings can be outliers: before, its slips are looked for."""

MOST_ROUNDS = 25

SETTLED = 0.05
"""Change of the logarithm of every variance below which the rounds end."""

UNLIKELY = 1.0
"""Standard deviation of the logarithms of noises that nobody states, about their usual ones."""


@dataclass(frozen=True)
class PositionWeights:
    """What is believed of each reading and step.

    Parameters
    ----------
    level : by source, its noise variance over the one that was thought
    own : (rows,), noise variance of readings that have one of their own, else 0
    slip : (steps,), variance of the wheel's slip, m²
    jerk : (steps,), variance of a change of the acceleration, (m/s²)²
    """

    level: Mapping[Source, float]
    own: Array
    slip: Array
    jerk: Array

    def noise(self, rows: Rows) -> Array:
        """Noise variance of each row, (rows,)."""
        level = np.array([self.level[one] for one in rows.source])
        return np.where(self.own > 0.0, self.own, level * rows.variance)


@dataclass(frozen=True)
class PositionEstimate:
    """What all readings make of a ride, at the nodes (n,).

    Parameters
    ----------
    time, distance, speed, acceleration : s, m, m/s, m/s²
    deviation : standard deviation of the distance, m
    scale, scale_deviation : true over nominal diameter of the wheel at the end, and how well its logarithm is known
    wander : standard deviation of the common error of satellite positions, m
    rows, weights : the readings and what was believed of them
    slipped : (n,), by how far the wheel had slipped, m
    rounds : how many it took
    """

    time: Array
    distance: Array
    speed: Array
    acceleration: Array
    deviation: Array
    scale: float
    scale_deviation: float
    wander: float
    rows: Rows
    weights: PositionWeights
    slipped: Array
    rounds: int


def smooth_position(
    readings: Sequence[PositionObservations],
    stands: Sequence[StandstillInterval],
    dead: Sequence[StandstillInterval],
    assumed: PositionPrior,
    span: StandstillInterval,
) -> PositionEstimate:
    """Smooth all readings, weigh down what disagrees, and again until nothing changes.

    Parameters
    ----------
    readings : of each source at most one
    stands, dead : from when to when the train stood, and its wheel said nothing, s
    span : first and last time that are asked for, s
    """
    rows = rows_of(readings, stands, dead, span)
    weights = PositionWeights(
        dict.fromkeys(Source, 1.0),
        np.zeros(len(rows.value)),
        np.zeros(len(rows.time) - 1),
        np.zeros(len(rows.time) - 1),
    )
    speed = rough_speed(rows)
    settled = _settled(rows, assumed, weights, speed)
    fixes = rows.of(Source.FIX)
    if np.count_nonzero(fixes) >= FEWEST and not (assumed.wander_stated and rows.stated[fixes][0]):
        likelier = _with_likely_noise(rows, settled)
        settled = _settled(rows, likelier.assumed, likelier.weights, likelier.speed)
    return _travel(rows, settled)


@dataclass(frozen=True)
class _Settled:
    found: ChainPosterior
    assumed: PositionPrior
    weights: PositionWeights
    speed: Array
    rounds: int


def _settled(
    rows: Rows, assumed: PositionPrior, weights: PositionWeights, speed: Array
) -> _Settled:
    rounds = 0
    while True:
        rounds += 1
        chain, values = chain_of(rows, assumed, speed, weights.slip, weights.jerk)
        found = smooth_chain(chain, values[:, None], weights.noise(rows))
        again = _judged(weights, rows, found, outliers_of_wheel=rounds >= WHEEL_FIRST)
        error = float(np.clip(np.median(found.state[:, SCALE, 0]), -BOLD, BOLD))
        speed = np.maximum(found.state[:, V, 0], 0.0)
        done = rounds >= WHEEL_FIRST and _same(again, weights) and abs(error) < 1e-5
        if done or rounds == MOST_ROUNDS:
            return _Settled(found, assumed, weights, speed, rounds)
        weights = again
        assumed = replace(assumed, scale=float(assumed.scale * np.exp(error)))


def _judged(
    weights: PositionWeights, rows: Rows, found: ChainPosterior, *, outliers_of_wheel: bool
) -> PositionWeights:
    """The weights that the last round asks for."""
    squares = np.square(found.error[:, 0])
    level = {one: _level(one, weights, rows, found, squares) for one in weights.level}
    noise = np.array([level[one] for one in rows.source]) * rows.variance
    bar = np.where(weights.own > 0.0, STAYS, BEYOND)
    far = squares > bar**2 * (noise + found.open)
    far &= ~rows.of(Source.STANDING)
    if not outliers_of_wheel:
        far &= ~rows.of(Source.ROLLED)
    own = np.where(far, squares - found.open, 0.0)
    slip, jerk = _jumps(weights, rows, found)
    return PositionWeights(level, own, slip, jerk)


def _level(
    source: Source, weights: PositionWeights, rows: Rows, found: ChainPosterior, squares: Array
) -> float:
    """Noise variance of a source over the one that was thought."""
    here, level = rows.of(source), weights.level[source]
    if source is Source.STANDING or np.count_nonzero(here) < FEWEST:
        return level
    expected = level * rows.variance[here] + found.open[here]
    shown = float(np.median(squares[here] / expected)) / CHI_SQUARE_MEDIAN
    bold = level * float(np.clip(shown, 1.0 / BOLDEST, BOLDEST))
    if not rows.stated[here][0]:
        return bold
    return max(1.0, bold) if shown > LOUDER or level > 1.0 else level


def _jumps(weights: PositionWeights, rows: Rows, found: ChainPosterior) -> tuple[Array, Array]:
    """Variances of slips and changes of acceleration: those that still show, and the clearest others."""
    far, size = {}, {}
    for place, variance in ((SLIP, weights.slip), (A, weights.jerk)):
        score, precision = found.score[:, place, 0], found.precision[:, place]
        known = precision > LEAST_TOLD * np.max(precision, initial=0.0)
        precise = np.where(known, precision, 1.0)
        shown, without = np.square(score / precise), 1.0 / precise - variance
        known &= without > LEAST_TOLD / precise
        far[place] = np.where(known, shown, 0.0) / np.where(known, without, 1.0)
        size[place] = np.maximum(shown - without, 0.0)
    far[A][size[A] > SUDDEN**2] = 0.0
    far[SLIP][rows.lost] = 0.0
    slip = weights.slip.copy()
    jerk = np.where(weights.jerk > 0.0, size[A], 0.0)
    clear = np.maximum(far[SLIP], far[A]) * (weights.slip == 0.0) * (weights.jerk == 0.0)
    middle = 0.5 * (rows.time[1:] + rows.time[:-1])
    while np.max(clear, initial=0.0) > BEYOND**2:
        k = int(np.argmax(clear))
        if far[SLIP][k] >= far[A][k]:
            slip[np.abs(middle - middle[k]) < SLIPPING] = FREE**2
        else:
            jerk[k] = size[A][k]
        clear[np.abs(middle - middle[k]) < APART] = 0.0
    return slip, jerk


def _same(a: PositionWeights, b: PositionWeights) -> bool:
    change = max(abs(np.log(a.level[one] / b.level[one])) for one in a.level)
    pairs = ((a.own, b.own), (a.slip, b.slip), (a.jerk, b.jerk))
    return bool(
        change < SETTLED and all(np.array_equal(one > 0.0, other > 0.0) for one, other in pairs)
    )


def _with_likely_noise(rows: Rows, settled: _Settled) -> _Settled:
    """With the common error of satellite positions, and their own where nobody states it, that are the likeliest."""
    weights, assumed = settled.weights, settled.assumed
    # Logarithms of the wander over the usual one, and of the positions' own noise over theirs; those stated stay 0.
    free = np.array([not assumed.wander_stated, not rows.stated[rows.of(Source.FIX)][0]])
    level = weights.level[Source.FIX]

    def at(logarithms: Array) -> tuple[PositionWeights, PositionPrior]:
        wander, own = np.exp(_spread(logarithms, free))
        return (
            replace(
                weights, level={**weights.level, Source.FIX: float(own**2) if free[1] else level}
            ),
            replace(assumed, wander=assumed.wander * float(wander)),
        )

    def improbability(logarithms: Array) -> float:
        tried, about = at(logarithms)
        chain, values = chain_of(rows, about, settled.speed, tried.slip, tried.jerk)
        likelihood = log_likelihood(chain, values[:, None], tried.noise(rows))
        return 0.5 * float(np.sum(np.square(logarithms))) / UNLIKELY**2 - likelihood

    start = np.array([0.0, 0.5 * np.log(level)])[free]
    simplex = np.vstack([start, start - UNLIKELY * np.eye(len(start))])
    best = minimize(improbability, start, method="Nelder-Mead",
                    options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05}).x  # fmt: skip
    tried, about = at(best)
    return replace(settled, weights=tried, assumed=about)


def _spread(values: Array, free: Mask) -> Array:
    spread = np.zeros(len(free))
    spread[free] = values
    return spread


def rough_speed(rows: Rows) -> Array:
    """At the nodes, m/s, by the first of the sources that say it."""
    for source in (Source.SHOWN, Source.FIX_SPEED):
        here = rows.of(source)
        if np.count_nonzero(here) > 1:
            return np.interp(rows.time, rows.time[rows.node[here]], rows.value[here])
    for source in (Source.ROLLED, Source.FIX, Source.POST):
        here = rows.of(source)
        if np.count_nonzero(here) > 1:
            place = np.interp(rows.time, rows.time[rows.node[here]], rows.value[here])
            return np.clip(np.gradient(place, rows.time), 0.0, 100.0)
    return np.zeros(len(rows.time))


def _travel(rows: Rows, settled: _Settled) -> PositionEstimate:
    state, P = settled.found.state[:, :, 0], settled.found.covariance
    error = state[:, SCALE]
    variance = P[:, Q, Q] + 2 * P[:, Q, D] + P[:, D, D]
    return PositionEstimate(
        rows.time,
        state[:, Q] + state[:, D],
        state[:, V] * (1.0 + error),
        state[:, A] * (1.0 + error),
        np.sqrt(np.maximum(variance, 0.0)),
        float(settled.assumed.scale * np.exp(error[-1])),
        float(np.sqrt(max(P[-1, SCALE, SCALE], 0.0))),
        settled.assumed.wander,
        rows,
        settled.weights,
        state[:, SLIP],
        settled.rounds,
    )

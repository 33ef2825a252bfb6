"""The smoother's model of a ride.

The state is [q, v, a, Σ, D, δ, b, o]: what a wheel that never slips would have rolled at the scale that it is thought
to have, its speed and acceleration, which is a random walk; by how far the wheel slipped; the distance less q, which
moves as v δ with the error δ of the scale's logarithm, a slow walk; the common error of satellite positions, which
wanders; and where a line begins that is known from these positions alone (theory, section 12).

The acceleration's walk is that of q and not of the distance: else a ride of many changes would speak for a smaller
wheel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.chain import GaussMarkovChain
from trackprofile.positioning.position_observations import (
    PositionObservations,
    Source,
    StandstillInterval,
)
from trackprofile.preprocessing.motion import ACCELERATION_WALK

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Q, V, A, SLIP, D, SCALE, WANDER, ORIGIN = range(8)
"""Places in the state."""

GRID = 1.0
"""s between nodes at most, where that makes no more than ``MOST`` for each reading."""

MOST = 50

FAR = 1000.0
"""m: standard deviation of where the train begins, about where its sources say it does, and of what a wheel that says
nothing does not count."""

FASTEST = 30.0
"""m/s: standard deviation of the speed at the start."""

HARDEST = 1.0
"""m/s²: standard deviation of the acceleration at the start, and of its change where a train stops or starts."""

ROLLING = 0.01
"""m per √m: how a wheel that does not slip wanders against the rail. Its rolling radius changes by some tenths of a
thousandth with its place on the rail, over some hundred metres."""

WEAR = 3e-6
"""per √s: how a wheel's scale wanders as it wears and warms up."""

COMMON = 1.5
"""m: usual standard deviation of the common error of satellite positions."""

WANDERED = 100.0
"""s in which the common error of satellite positions is forgotten."""

BENT = 0.15
"""m per √s: how a line that is known from satellite positions alone may be longer or shorter than it is."""

UNSEEN = 0.1
"""Share of a long stretch without positions by which such a line may be longer or shorter there, in a curve."""

CURVED = 4.6e-8
"""1/m²: times the cube of a short one's length, the same: a hundredth of what curves of 300 m could do."""

STANDING = 1e-3
"""m/s: of a train that stands."""

_READS = {
    Source.FIX: (Q, D, WANDER, ORIGIN),
    Source.FIX_SPEED: (V,),
    Source.ROLLED: (Q, SLIP),
    Source.SHOWN: (V,),
    Source.POST: (Q, D),
    Source.STANDING: (V,),
}


@dataclass(frozen=True)
class PositionPrior:
    """What is known before the readings, and about which the model is linear.

    Parameters
    ----------
    scale_deviation : standard deviation of the logarithm of the wheel's true over its nominal diameter; 0: no wheel
    begin, begin_deviation : m, where the train was at the first node
    own_line : whether the line is known from satellite positions alone, and not between those far apart
    anchored : whether its beginning is where the first of them is, and not elsewhere by `FAR`
    wander : standard deviation of the common error of satellite positions, m
    wander_stated : whether that is known; else the data say
    scale : true over nominal diameter
    """

    scale_deviation: float
    begin: float
    begin_deviation: float
    own_line: bool = False
    anchored: bool = True
    wander: float = COMMON
    wander_stated: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Rows:
    """All readings of a ride in the order of time, (rows,) each, at nodes ``time``, (n,) in s.

    Of each step, ``stops`` says whether a train stops or starts in it, ``lost`` whether its wheel says nothing.
    """

    time: Array
    source: NDArray[np.object_]
    node: NDArray[np.int64]
    value: Array
    variance: Array
    stated: Mask
    stops: Mask
    lost: Mask

    def of(self, source: Source) -> Mask:
        """Which rows are of that source."""
        return self.source == source


def rows_of(
    readings: Sequence[PositionObservations],
    stands: Sequence[StandstillInterval],
    dead: Sequence[StandstillInterval],
    span: StandstillInterval,
) -> Rows:
    """All readings, with those of a train that stands, on nodes over a span of time, s.

    ``dead`` : from when to when its wheel says nothing
    """
    times = [one.time for one in readings]
    begin = min(span[0], *(float(t[0]) for t in times if len(t)))
    end = max(span[1], *(float(t[-1]) for t in times if len(t)))
    count = 2 + int(min((end - begin) / GRID, MOST * sum(map(len, times))))
    grid = np.linspace(begin, end, count)
    time = np.unique(np.concatenate([grid, *times]))
    still = np.zeros(len(time), bool)
    stops, lost = np.zeros(len(time) - 1, bool), np.zeros(len(time) - 1, bool)
    for ends in stands:
        still |= (time >= ends[0]) & (time <= ends[1])
        for at in ends:
            stops |= (time[1:] > at - GRID) & (time[:-1] < at + GRID)
    for begin_, end_ in dead:
        lost |= (time[1:] > begin_) & (time[:-1] < end_)
    count = np.count_nonzero(still)
    standing = PositionObservations(
        Source.STANDING, time[still], np.zeros(count), np.full(count, STANDING**2)
    )
    readings = [*readings, standing]
    node = np.searchsorted(time, np.concatenate([one.time for one in readings]))
    order = np.argsort(node, kind="stable")
    source = np.concatenate([np.full(len(one.time), one.source, object) for one in readings])
    value, variance = (
        np.concatenate([getattr(one, name) for one in readings]) for name in ("value", "variance")
    )
    stated = np.concatenate([np.full(len(one.time), one.stated) for one in readings])
    return Rows(
        time, source[order], node[order], value[order], variance[order], stated[order], stops, lost
    )


def chain_of(
    rows: Rows, assumed: PositionPrior, speed: Array, slip: Array, jerk: Array
) -> tuple[GaussMarkovChain, Array]:
    """The chain, and the values of its rows, about a ``speed`` at the nodes, m/s.

    Parameters
    ----------
    slip, jerk : (steps,), variances of the wheel's slip in m² and of a change of the acceleration in (m/s²)²
    """
    dt = np.diff(rows.time)
    run = 0.5 * (speed[1:] + speed[:-1]) * dt
    F, noise = _steps(dt, run, assumed)
    if assumed.own_line:
        noise[:, ORIGIN, ORIGIN] = BENT**2 * dt + _unseen(rows, run)
    noise[:, SLIP, SLIP] += slip + FAR**2 * rows.lost
    noise[:, A, A] += jerk + HARDEST**2 * np.minimum(dt / GRID, 1.0) * rows.stops
    values, h = rows.value.copy(), np.zeros((len(rows.node), 8))
    for source, reads in _READS.items():
        h[np.ix_(rows.of(source), reads)] = 1.0
    fix_speed = rows.of(Source.FIX_SPEED)
    h[fix_speed, SCALE] = speed[rows.node[fix_speed]]
    wheel = rows.of(Source.ROLLED)
    values[wheel | rows.of(Source.SHOWN)] *= assumed.scale
    mean, P = np.zeros(8), np.zeros((8, 8))
    mean[V], P[V, V], P[A, A] = speed[0], FASTEST**2, HARDEST**2
    mean[D], P[D, D] = assumed.begin, assumed.begin_deviation**2
    mean[SCALE], P[SCALE, SCALE] = -np.log(assumed.scale), assumed.scale_deviation**2
    P[WANDER, WANDER] = assumed.wander**2
    P[ORIGIN, ORIGIN] = FAR**2 * (assumed.own_line and not assumed.anchored)
    if wheel.any():
        first = int(np.argmax(wheel))
        mean[SLIP] = values[first] - np.sum(run[: rows.node[first]])
        P[SLIP, SLIP] = FAR**2
    return GaussMarkovChain(mean[:, None], P, F, noise, rows.node, h), values


def _steps(dt: Array, run: Array, assumed: PositionPrior) -> tuple[Array, Array]:
    """What happens from node to node: matrices (steps, 8, 8) and covariances."""
    F = np.tile(np.eye(8), (len(dt), 1, 1))
    F[:, Q, V] = F[:, V, A] = dt
    F[:, Q, A] = 0.5 * dt**2
    F[:, D, SCALE] = run
    F[:, WANDER, WANDER] = np.exp(-dt / WANDERED)
    noise = np.zeros_like(F)
    for i, j, power, share in (
        (Q, Q, 5, 20), (Q, V, 4, 8), (Q, A, 3, 6), (V, V, 3, 3), (V, A, 2, 2), (A, A, 1, 1),
    ):  # fmt: skip
        noise[:, i, j] = noise[:, j, i] = ACCELERATION_WALK**2 * dt**power / share
    if assumed.scale_deviation > 0.0:
        noise[:, SLIP, SLIP] = ROLLING**2 * np.abs(run)
        noise[:, SCALE, SCALE] = WEAR**2 * dt
    noise[:, WANDER, WANDER] = assumed.wander**2 * (1.0 - F[:, WANDER, WANDER] ** 2)
    return F, noise


def _unseen(rows: Rows, run: Array) -> Array:
    """Of each step, the variance, m², of the length of a line that is known from satellite positions alone."""
    seen = np.unique(rows.node[rows.of(Source.FIX)])
    inner = np.arange(len(run))
    gap = np.searchsorted(seen, inner, side="right")
    length = np.bincount(gap, run, minlength=len(seen) + 1)
    wrong = np.minimum(UNSEEN * length, CURVED * length**3)
    # What comes before the first and after the last position is no part of the line.
    wrong[[0, -1]] = 0.0
    return (wrong[gap] ** 2) * run / np.maximum(length[gap], 1e-9)

"""The line that a train took, from its satellite positions alone, so that their noise does not lengthen it.

Over the distance that the train ran, about, a smooth curve is laid through the positions: each coordinate's second
derivative is a random walk, as the curvature of a railway is, and so strong as the positions make likely. Its length
is the distance, and each position is projected onto it: what stands beside the line adds nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import integral
from trackprofile.kalman.chain import ChainPosterior, GaussMarkovChain, log_likelihood, smooth_chain

Array = NDArray[np.float64]

USUAL = 3.0
"""m: standard deviation of a position, at first."""

BENDS = tuple(float(one) for one in np.geomspace(3e-4, 1e-6, 13))
"""1/m per √m: how fast curvature wanders, of which the likeliest is taken. Transitions to curves of 300 m have the
first."""

STEERS = 0.5
"""m/s² per √s: how fast the acceleration of a position wanders, along and across."""

SPACING = 5.0
"""m between points of the line, but no more than ``MOST`` for each position."""

MOST = 50

FAR = 1e4
"""m, m per m or s, and so on: standard deviations of a curve's start."""

BEYOND = 5.0
"""Standard deviations beyond which a position is given the noise that it shows."""

FINEST = 0.01
"""m: no position is better."""

LEAST = 1e-6
"""Of what is divided by."""

PLANE = 2.0
"""Directions in which a position can be off."""

SQUARE_MEDIAN = 1.3863
"""Of the square of its error over the variance in each of them."""

LACKING = 0.01
"""m per m, the most by which a smooth curve is taken to be too short."""

SETTLED = 0.1
"""Change of the logarithm of the variance below which the rounds end."""

MOST_ROUNDS = 8


def align_to_own_line(time: Array, points: Array, run: Array | None) -> tuple[Array, Array]:
    """Where along the line through positions each one is, and how far beside it, (n,) each in m.

    Parameters
    ----------
    time : (n,), s, rising
    points : (n, 3), m from the Earth's centre
    run : (n,), m that the train ran since the first, about; None: by the positions themselves

    Examples
    --------
    >>> time, metres = np.arange(100.0), np.random.default_rng(1).normal(0.0, 3.0, (100, 3))
    >>> metres[:, 2] = 0.0
    >>> metres[:, 0] += 20.0 * time
    >>> along, beside = own_line(time, metres, 20.0 * time)
    >>> bool(abs(np.polyfit(time, along, 1)[0] - 20.0) < 0.05)
    True
    """
    off = points - np.mean(points, axis=0)
    run = np.maximum.accumulate(_run(time, off) if run is None else run)
    count = int(min((run[-1] - run[0]) / SPACING, MOST * len(run))) + 2
    at = np.unique(np.concatenate([np.linspace(run[0], run[-1], count), run]))
    _, variance = _laid(_curve(at, run, BENDS[0]), off)
    curves = [_curve(at, run, bend) for bend in BENDS]
    likely = max(curves, key=lambda curve: log_likelihood(curve, off, variance))
    found, _ = _laid(likely, off)
    place, slope = found.state[:, 0], found.state[:, 1]
    per_metre = np.maximum(np.linalg.norm(slope, axis=1), LEAST)
    # What is left of the bends in a smooth curve is shorter by half the square of the directions that it lacks.
    lacking = np.minimum(found.covariance[:, 1, 1] / (2 * per_metre), LACKING)
    length = integral(per_metre + lacking, at)
    left = off - place[likely.node]
    along = np.sum(left * slope[likely.node], axis=1) / per_metre[likely.node]
    beside = np.sqrt(np.maximum(np.sum(left**2, axis=1) - along**2, 0.0))
    return length[likely.node] + along, beside


def _run(time: Array, off: Array) -> Array:
    """How far a train ran by its positions alone, about, (n,) m."""
    found, _ = _laid(_curve(time, time, STEERS), off)
    return integral(np.linalg.norm(found.state[:, 1], axis=1), time)


def _curve(at: Array, where: Array, walk: float) -> GaussMarkovChain:
    """Coordinates whose second derivative wanders so fast, at nodes, read at some of them."""
    step = np.diff(at)
    F = np.tile(np.eye(3), (len(step), 1, 1))
    F[:, 0, 1] = F[:, 1, 2] = step
    F[:, 0, 2] = 0.5 * step**2
    Q = np.empty_like(F)
    for i, j, power, share in (
        (0, 0, 5, 20), (0, 1, 4, 8), (0, 2, 3, 6), (1, 1, 3, 3), (1, 2, 2, 2), (2, 2, 1, 1),
    ):  # fmt: skip
        Q[:, i, j] = Q[:, j, i] = walk**2 * step**power / share
    h = np.zeros((len(where), 3))
    h[:, 0] = 1.0
    start = np.diag([FAR, FAR / 100, FAR / 1e4]) ** 2
    return GaussMarkovChain(np.zeros((3, 3)), start, F, Q, np.searchsorted(at, where), h)


def _laid(curve: GaussMarkovChain, off: Array) -> tuple[ChainPosterior, Array]:
    """The curve laid through positions, and the variance that each showed, (n,) m²."""
    variance = np.full(len(off), USUAL**2)
    level, own = USUAL**2, np.zeros(len(off))
    rounds = 0
    while True:
        rounds += 1
        found = smooth_chain(curve, off, variance)
        squares = np.sum(found.error**2, axis=1)
        shown = max(float(np.median(squares / (level + found.open))) / SQUARE_MEDIAN, LEAST)
        level = max(level * float(np.clip(shown, 0.25, 4.0)), FINEST**2)
        far = squares > PLANE * BEYOND**2 * (level + found.open)
        before, own = own, np.where(far, squares / PLANE - found.open, 0.0)
        variance = np.where(far, own, level)
        same = np.array_equal(before > 0.0, far) and abs(np.log(shown)) < SETTLED
        if same or rounds == MOST_ROUNDS:
            return found, variance

"""Distance along a line that is known only from the GNSS fixes of the run itself.

The line is a smooth curve p(ξ) through the fixes, over the approximate travelled distance ξ: the second derivative of
each coordinate is a random walk, as the curvature of a railway is, and its strength is the most likely one. The
distance is the length of the curve,

    s(ξ) = ∫ |p'| + Var p'/(2 |p'|) dξ,

where the second term replaces the length of the bends that a smooth estimate lacks. Each fix is projected onto the
curve, so that lateral noise does not lengthen the distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import integral
from trackprofile.kalman.chain import (
    ChainPosterior,
    GaussMarkovChain,
    log_likelihood,
    smooth_chain,
    wiener_acceleration,
)
from trackprofile.kalman.reweighting import (
    MAX_NOISE_CHANGE,
    OUTLIER_THRESHOLD,
    Iteration,
    is_converged,
    limited_change,
    reweight,
)

Array = NDArray[np.float64]

INITIAL_STD = 3.0
"""m, initial standard deviation of a fix in each direction."""

MIN_STD = 0.01
"""m, smallest standard deviation of a fix."""

PLANE_COMPONENTS = 2
"""Directions of a fix's error: both lie in the plane of the Earth's surface."""

CURVATURE_WALKS = tuple(float(one) for one in np.geomspace(3e-4, 1e-6, 13))
"""1/m per √m, strengths of the random walk of the curvature, of which the most likely is used. The first is that of the
transitions to curves of 300 m radius."""

ACCELERATION_WALK = 0.5
"""m/s² per √s, random walk of the acceleration in each coordinate, for an approximate distance without other
sources."""

NODE_SPACING = 5.0
"""m, distance between nodes of the curve, unless that makes more than `MAX_NODES_PER_FIX`."""

MAX_NODES_PER_FIX = 50

PRIOR_STD = (1e4, 1e2, 1.0)
"""Prior standard deviations of a coordinate and its first two derivatives at the first node (m; m per m or per s)."""

MIN_RATIO = 1e-6
"""Lower limit of divisors."""

MAX_MISSING_LENGTH = 0.01
"""m per m, largest relative length of the bends that a smooth curve lacks."""

TOLERANCE = 0.1
"""Largest change of the noise variance's logarithm in the last iteration."""

MAX_ITERATIONS = 8


@dataclass(frozen=True)
class _Noise:
    """Noise variance of all fixes, m², and of each outlier, (n,) m², else 0."""

    common: float
    outlier: Array

    def variance(self) -> Array:
        """Noise variance of each fix, (n,) m²."""
        return np.where(self.outlier > 0.0, self.outlier, self.common)


def align_to_own_line(time: Array, points: Array, travelled: Array | None) -> tuple[Array, Array]:
    """Distance of GNSS fixes along the smooth curve through them, and their lateral offset from it.

    Parameters
    ----------
    time : (n,), s, increasing
    points : (n, 3), m from the Earth's centre
    travelled : (n,), approximate travelled distance, m; None: from the fixes themselves

    Returns
    -------
    distance, lateral offset : (n,), m

    Examples
    --------
    >>> time, points = np.arange(100.0), np.random.default_rng(1).normal(0.0, 3.0, (100, 3))
    >>> points[:, 2] = 0.0
    >>> points[:, 0] += 20.0 * time
    >>> distance, offset = align_to_own_line(time, points, 20.0 * time)
    >>> bool(abs(np.polyfit(time, distance, 1)[0] - 20.0) < 0.05)
    True
    """
    points = points - np.mean(points, axis=0)
    if travelled is None:
        travelled = _travelled_distance(time, points)
    curve = _smooth_curve(np.maximum.accumulate(travelled), points)
    coordinates, slope = curve.posterior.state[:, 0], curve.posterior.state[:, 1]
    speed = np.maximum(np.linalg.norm(slope, axis=1), MIN_RATIO)
    missing = np.minimum(curve.posterior.covariance[:, 1, 1] / (2 * speed), MAX_MISSING_LENGTH)
    length = integral(speed + missing, curve.nodes)
    difference = points - coordinates[curve.node]
    along = np.sum(difference * slope[curve.node], axis=1) / speed[curve.node]
    offset = np.sqrt(np.maximum(np.sum(difference**2, axis=1) - along**2, 0.0))
    return length[curve.node] + along, offset


@dataclass(frozen=True)
class _Curve:
    """Posterior of a curve at nodes, (m,) m of travelled distance, and the node of each fix, (n,)."""

    nodes: Array
    node: NDArray[np.int64]
    posterior: ChainPosterior


def _smooth_curve(travelled: Array, points: Array) -> _Curve:
    """Curve through the fixes with the most likely random walk of the curvature."""
    extent = travelled[-1] - travelled[0]
    count = int(min(extent / NODE_SPACING, MAX_NODES_PER_FIX * len(travelled))) + 2
    grid = np.linspace(travelled[0], travelled[-1], count)
    nodes = np.unique(np.concatenate([grid, travelled]))
    _, variance = _smooth_robustly(_chain(nodes, travelled, CURVATURE_WALKS[0]), points)
    chains = [_chain(nodes, travelled, walk) for walk in CURVATURE_WALKS]
    likeliest = max(chains, key=lambda chain: log_likelihood(chain, points, variance))
    posterior, _ = _smooth_robustly(likeliest, points)
    return _Curve(nodes, likeliest.node, posterior)


def _travelled_distance(time: Array, points: Array) -> Array:
    """Approximate travelled distance from the fixes alone, (n,) m."""
    posterior, _ = _smooth_robustly(_chain(time, time, ACCELERATION_WALK), points)
    return integral(np.linalg.norm(posterior.state[:, 1], axis=1), time)


def _chain(nodes: Array, at: Array, walk: float) -> GaussMarkovChain:
    """Coordinates whose second derivative is a random walk over the nodes, observed at some of them."""
    F, Q = wiener_acceleration(np.diff(nodes), walk)
    h = np.zeros((len(at), 3))
    h[:, 0] = 1.0
    covariance = np.diag(PRIOR_STD) ** 2
    return GaussMarkovChain(np.zeros((3, 3)), covariance, F, Q, np.searchsorted(nodes, at), h)


def _smooth_robustly(chain: GaussMarkovChain, points: Array) -> tuple[ChainPosterior, Array]:
    """Posterior of the curve and the noise variance of each fix, (n,) m²."""

    def iterate(noise: _Noise, number: int) -> Iteration[_Noise, tuple[ChainPosterior, Array]]:
        posterior = smooth_chain(chain, points, noise.variance())
        residuals = posterior.leave_one_out(PLANE_COMPONENTS)
        ratio = max(residuals.noise_ratio(noise.common), MIN_RATIO)
        change = float(limited_change(ratio, MAX_NOISE_CHANGE))
        common = max(noise.common * change, MIN_STD**2)
        outlier = residuals.outlier_variance(common, OUTLIER_THRESHOLD**2)
        adapted = _Noise(common, outlier)
        converged = is_converged(np.array([ratio]), TOLERANCE, (outlier, noise.outlier))
        return Iteration((posterior, adapted.variance()), adapted, converged)

    initial = _Noise(INITIAL_STD**2, np.zeros(len(points)))
    return reweight(iterate, initial, MAX_ITERATIONS)

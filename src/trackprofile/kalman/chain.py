"""Kalman filter and fixed-interval smoother of a small Gauss-Markov chain with scalar observations.

    x_(k+1) = F_k x_k + w_k, w_k ~ N(0, Q_k);    y_r = h_r x_k + v_r, v_r ~ N(0, R_r)

All nodes' states together have a block-tridiagonal precision matrix, so that the filter forwards and the modified
Bryson-Frazier recursion backwards (theory, section 7) are linear in the number of nodes.

The package has two smoothers. This one takes any F, Q and h, stores the covariance of every node and smooths
states of some ten numbers: the position of a train, a smooth curve through GNSS fixes. The other,
`trackprofile.kalman.smoother`, estimates the profile: its state also holds a sliding window of spline coefficients,
which enter and leave in a ring, and it stores only what the elevation of each knot needs. Both give the same statistics
to the robust reweighting (`trackprofile.kalman.reweighting`).

Source: G. J. Bierman, Fixed interval smoothing with discrete measurements, International Journal of Control 18(1),
1973.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.reweighting import LeaveOneOutResiduals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaussMarkovChain:
    """A state of m numbers at n nodes, and the observation rows.

    Parameters
    ----------
    mean : (m, signals), prior mean at the first node; all signals share the covariance
    covariance : (m, m), prior covariance at the first node
    F, Q : (n - 1, m, m), transition from each node to the next and covariance of its noise
    node : (rows,), node of each observation, in ascending order
    h : (rows, m), observation rows
    """

    mean: Array
    covariance: Array
    F: Array
    Q: Array
    node: NDArray[np.int64]
    h: Array


@dataclass(frozen=True)
class ChainPosterior:
    """Posterior of the states given all observations.

    Parameters
    ----------
    state : (n, m, signals), posterior mean
    covariance : (n, m, m), posterior covariance
    residual : (rows, signals), leave-one-out residuals: each observation less its prediction from all others
    prediction_variance : (rows,), variance of that prediction
    jump_score : (n - 1, m, signals), slope of the log-likelihood over a jump of each state at the end of a step
    jump_precision : (n - 1, m), variance of that slope
    log_likelihood : of all rows of all signals
    """

    state: Array
    covariance: Array
    residual: Array
    prediction_variance: Array
    jump_score: Array
    jump_precision: Array
    log_likelihood: float

    def leave_one_out(self, components: int = 1) -> LeaveOneOutResiduals:
        """Leave-one-out residuals with the signals as coordinates of one vector.

        Parameters
        ----------
        components : independent components of the vector: 2 for positions on the Earth in three coordinates
        """
        square = np.sum(self.residual**2, axis=1) / components
        return LeaveOneOutResiduals(square, self.prediction_variance, components)


def smooth_chain(chain: GaussMarkovChain, values: Array, variance: Array) -> ChainPosterior:
    """Posterior of the states of a chain.

    Parameters
    ----------
    values : (rows, signals), observations
    variance : (rows,), noise variances

    Examples
    --------
    A constant, observed three times: its posterior is the mean, and the third observation differs by 4.5 from the mean
    of the two others, which has the variance 0.5.

    >>> level = GaussMarkovChain(np.zeros((1, 1)), np.array([[1e6]]), np.ones((2, 1, 1)), np.zeros((2, 1, 1)),
    ...                          np.arange(3), np.ones((3, 1)))
    >>> posterior = smooth_chain(level, np.array([[1.0], [2.0], [6.0]]), np.ones(3))
    >>> posterior.state[:, 0, 0].round(3), posterior.residual[2].round(3), posterior.prediction_variance[2].round(3)
    (array([3., 3., 3.]), array([4.5]), np.float64(0.5))
    """
    means, covariances, gains, innovations, variances = _filter(
        chain.mean, chain.covariance, chain.F, chain.Q, chain.node, chain.h, values, variance
    )
    state, covariance, u, d, score, precision = _smooth_backwards(
        means, covariances, chain.F, chain.node, chain.h, gains, innovations, variances
    )
    return ChainPosterior(
        state,
        covariance,
        u / d[:, None],
        np.maximum(1.0 / d - variance, 0.0),
        score,
        precision,
        _gaussian_log_likelihood(innovations, variances),
    )


def log_likelihood(chain: GaussMarkovChain, values: Array, variance: Array) -> float:
    """Log-likelihood of observations, (rows, signals), with noise variances (rows,), without smoothing them."""
    _, _, _, innovations, variances = _filter(
        chain.mean, chain.covariance, chain.F, chain.Q, chain.node, chain.h, values, variance
    )
    return _gaussian_log_likelihood(innovations, variances)


def wiener_acceleration(step: Array, walk: float) -> tuple[Array, Array]:
    """Transition and noise covariance of position, velocity and acceleration where the acceleration is a random walk.

        F = [1  t  t²/2]      Q = W² [t⁵/20  t⁴/8  t³/6]
            [0  1  t   ]             [t⁴/8   t³/3  t²/2]
            [0  0  1   ]             [t³/6   t²/2  t   ]

    Parameters
    ----------
    step : (steps,), t, s (or m, of a curve over its length)
    walk : W, root of the density of the white jerk, m/s² per √s (of a curve m⁻¹ per √m)

    Returns
    -------
    F, Q : (steps, 3, 3)

    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
    section 6.2.3 (Wiener-process acceleration model).

    Examples
    --------
    >>> wiener_acceleration(np.array([2.0]), 1.0)[1][0].round(3)
    array([[1.6  , 2.   , 1.333],
           [2.   , 2.667, 2.   ],
           [1.333, 2.   , 2.   ]])
    """
    F = np.tile(np.eye(3), (len(step), 1, 1))
    F[:, 0, 1] = F[:, 1, 2] = step
    F[:, 0, 2] = 0.5 * step**2
    Q = np.empty_like(F)
    for i, j, power, divisor in (
        (0, 0, 5, 20), (0, 1, 4, 8), (0, 2, 3, 6), (1, 1, 3, 3), (1, 2, 2, 2), (2, 2, 1, 1),
    ):  # fmt: skip
        Q[:, i, j] = Q[:, j, i] = walk**2 * step**power / divisor
    return F, Q


def _gaussian_log_likelihood(innovations: Array, variances: Array) -> float:
    S = 2 * np.pi * variances[:, None]
    return -0.5 * float(np.sum(np.log(S) + innovations**2 / variances[:, None]))


@numba.njit(cache=True, nogil=True)
def _filter(mean, covariance, F, Q, node, h, values, variance):  # pragma: no cover
    """Filtered means and covariances; gain, innovation and innovation variance of each row."""
    n, m, signals, rows = len(F) + 1, mean.shape[0], mean.shape[1], len(node)
    means, covariances = np.empty((n, m, signals)), np.empty((n, m, m))
    gains, innovations, variances = np.empty((rows, m)), np.empty((rows, signals)), np.empty(rows)
    x, P, r = mean.copy(), covariance.copy(), 0
    for k in range(n):
        if k > 0:
            x = F[k - 1] @ x
            P = F[k - 1] @ P @ F[k - 1].T + Q[k - 1]
        while r < rows and node[r] == k:
            p = P @ h[r]
            # Rounding after a long time without observations may make it negative.
            S = variance[r] + max(h[r] @ p, 0.0)
            for c in range(signals):
                e = values[r, c]
                for i in range(m):
                    e -= h[r, i] * x[i, c]
                innovations[r, c] = e
                for i in range(m):
                    x[i, c] += p[i] / S * e
            for i in range(m):
                gains[r, i] = p[i] / S
                for j in range(m):
                    P[i, j] -= p[i] * p[j] / S
            variances[r] = S
            r += 1
        means[k], covariances[k] = x, P
    return means, covariances, gains, innovations, variances


@numba.njit(cache=True, nogil=True)
def _smooth_backwards(
    means, covariances, F, node, h, gains, innovations, variances
):  # pragma: no cover
    """Smoothed means and covariances; u = S⁻¹ y and the diagonal of S⁻¹; jump scores and their variances."""
    n, m, signals = means.shape
    rows = len(node)
    state, covariance = np.empty_like(means), np.empty_like(covariances)
    u, d = np.empty((rows, signals)), np.empty(rows)
    score, precision = np.empty((n - 1, m, signals)), np.empty((n - 1, m))
    adjoint, information, r = np.zeros((m, signals)), np.zeros((m, m)), rows - 1
    for k in range(n - 1, -1, -1):
        P = covariances[k]
        state[k] = means[k] - P @ adjoint
        covariance[k] = P - P @ information @ P
        while r >= 0 and node[r] == k:
            g = information @ gains[r]
            d[r] = 1.0 / variances[r] + gains[r] @ g
            for c in range(signals):
                u[r, c] = innovations[r, c] / variances[r]
                for i in range(m):
                    u[r, c] += gains[r, i] * adjoint[i, c]
                for i in range(m):
                    adjoint[i, c] -= h[r, i] * u[r, c]
            for i in range(m):
                for j in range(m):
                    information[i, j] += d[r] * h[r, i] * h[r, j] - h[r, i] * g[j] - g[i] * h[r, j]
            r -= 1
        if k > 0:
            score[k - 1] = -adjoint
            for i in range(m):
                precision[k - 1, i] = information[i, i]
            adjoint = F[k - 1].T @ adjoint
            information = F[k - 1].T @ information @ F[k - 1]
    return state, covariance, u, d, score, precision

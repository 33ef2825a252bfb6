"""The optimal smoother of a small state that is observed, a number at a time, along a chain of nodes.

    x_(k+1) = F_k x_k + w_k, w_k ~ N(0, Q_k);    y_r = h_r x_k + noise of variance R_r

Forwards a Kalman filter, backwards the modified Bryson-Frazier recursion (theory, section 7), which also tells each
observation from all the others, and how much likelier a jump of the state would make all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaussMarkovChain:
    """A state of m numbers at n nodes, and what each of some rows reads of it.

    Parameters
    ----------
    mean : (m, signals), at the first node; all signals share the covariance
    covariance : (m, m), of it
    F, Q : (n - 1, m, m), from each node to the next
    node : (rows,), at which node each row is read, rising
    h : (rows, m)
    """

    mean: Array
    covariance: Array
    F: Array
    Q: Array
    node: NDArray[np.int64]
    h: Array


@dataclass(frozen=True)
class ChainPosterior:
    """What all observations together say.

    Parameters
    ----------
    state : (n, m, signals), the posterior mean
    covariance : (n, m, m), the posterior's
    error : (rows, signals), each row less what all the others make of it
    open : (rows,), variance of what the others make of it
    score : (n - 1, m, signals), slope of the log-likelihood over a jump of each number at the end of a step
    precision : (n - 1, m), that slope's variance
    log_likelihood : of all rows of all signals
    """

    state: Array
    covariance: Array
    error: Array
    open: Array
    score: Array
    precision: Array
    log_likelihood: float


def smooth_chain(chain: GaussMarkovChain, values: Array, variance: Array) -> ChainPosterior:
    """The posterior of the state.

    Parameters
    ----------
    values : (rows, signals)
    variance : (rows,), of each row's noise

    Examples
    --------
    A constant, read three times: the mean of the readings, each of which is told by the other two.

    >>> level = Chain(np.zeros((1, 1)), np.array([[1e6]]), np.ones((2, 1, 1)), np.zeros((2, 1, 1)),
    ...               np.arange(3), np.ones((3, 1)))
    >>> found = smooth(level, np.array([[1.0], [2.0], [6.0]]), np.ones(3))
    >>> found.state[:, 0, 0].round(3), found.error[2].round(3), found.open[2].round(3)
    (array([3., 3., 3.]), array([4.5]), np.float64(0.5))
    """
    means, covariances, gains, innovations, variances = _forwards(
        chain.mean, chain.covariance, chain.F, chain.Q, chain.node, chain.h, values, variance
    )
    state, covariance, u, d, score, precision = _backwards(
        means, covariances, chain.F, chain.node, chain.h, gains, innovations, variances
    )
    return ChainPosterior(
        state,
        covariance,
        u / d[:, None],
        np.maximum(1.0 / d - variance, 0.0),
        score,
        precision,
        _likelihood(innovations, variances),
    )


def log_likelihood(chain: GaussMarkovChain, values: Array, variance: Array) -> float:
    """Of all rows (rows, signals) under noise of that variance (rows,)."""
    _, _, _, innovations, variances = _forwards(
        chain.mean, chain.covariance, chain.F, chain.Q, chain.node, chain.h, values, variance
    )
    return _likelihood(innovations, variances)


def _likelihood(innovations: Array, variances: Array) -> float:
    S = 2 * np.pi * variances[:, None]
    return -0.5 * float(np.sum(np.log(S) + innovations**2 / variances[:, None]))


@numba.njit(cache=True, nogil=True)
def _forwards(mean, covariance, F, Q, node, h, values, variance):  # pragma: no cover
    """Filtered means and covariances, and of each row the gain, the innovation and its variance."""
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
            # Rounding after a long time without readings may ask for less.
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
def _backwards(means, covariances, F, node, h, gains, innovations, variances):  # pragma: no cover
    """Smoothed means and covariances; u = S⁻¹ y and the diagonal of S⁻¹; the slope over jumps, and its variance."""
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

"""Maximum of a Gaussian likelihood by Fisher scoring, with a Gaussian prior on the parameters."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Progress = Callable[[str, float], None]
"""Called with the stage's name and the share of it that is done."""

Innovations = Callable[[Array], tuple[Array, Array]]
"""Innovations e and their variances S, each (rows,), for given parameters."""

STEP = 1e-4
LARGEST_MOVE = 0.7
MOST_ITERATIONS = 40


@dataclass(frozen=True)
class Maximum:
    """Where the posterior of the parameters is highest.

    Parameters
    ----------
    parameters : (p,)
    information : (p, p), Fisher information of the data alone
    precision : (p,), of the prior
    log_likelihood : of the data there
    converged : whether the last step promised less than a thousandth of a unit of log-likelihood
    """

    parameters: Array
    information: Array
    precision: Array
    log_likelihood: float
    converged: bool

    @property
    def covariance(self) -> Array:
        """Posterior covariance of the parameters, (p, p)."""
        return np.linalg.inv(self.information + np.diag(self.precision))


def log_likelihood(e: Array, S: Array) -> float:
    """Σ -½ (log 2πS + e²/S)."""
    return float(-0.5 * np.sum(np.log(2 * np.pi * S) + e**2 / S))


def fisher_information(innovations: Innovations, parameters: Array) -> tuple[Array, Array, float]:
    """Score, Fisher information and log-likelihood at the parameters.

    I_ij = Σ ∂_i e ∂_j e / S + ½ ∂_i S ∂_j S / S²; the derivatives are differences with a step of ``STEP``.
    """
    e, S = innovations(parameters)
    with ThreadPoolExecutor(max_workers=2) as pool:
        moved = list(pool.map(innovations, parameters + STEP * np.eye(len(parameters))))
    de = np.array([(there - e) / STEP for there, _ in moved])
    dS = np.array([(there - S) / STEP for _, there in moved])
    score = -de @ (e / S) - 0.5 * dS @ (1 / S - e**2 / S**2)
    information = (de / S) @ de.T + 0.5 * (dS / S**2) @ dS.T
    return score, information, log_likelihood(e, S)


def maximise(
    innovations: Innovations,
    start: Array,
    centre: Array,
    precision: Array,
    progress: Callable[[float], None] = lambda share: None,
) -> Maximum:
    """Climb log-likelihood + log-prior from ``start``, damped as by Levenberg and Marquardt.

    Parameters
    ----------
    start, centre, precision : (p,), where to begin, and the prior's mean and inverse variance
    """
    parameters, damping, converged = start.copy(), 1e-2, False

    def height(at: Array, likelihood: float) -> float:
        return likelihood - 0.5 * float(np.sum(precision * (at - centre) ** 2))

    score, information, likelihood = fisher_information(innovations, parameters)
    for iteration in range(MOST_ITERATIONS):
        progress(iteration / MOST_ITERATIONS)
        gradient = score - precision * (parameters - centre)
        curvature = information + np.diag(precision)
        here = height(parameters, likelihood)
        while True:
            damped = curvature + damping * np.diag(np.diag(curvature))
            step = np.clip(np.linalg.solve(damped, gradient), -LARGEST_MOVE, LARGEST_MOVE)
            converged = float(gradient @ step) < 1e-3
            gained = height(parameters + step, log_likelihood(*innovations(parameters + step))) - here
            if gained > 0 or converged or damping > 1e8:
                break
            damping *= 5
        if gained > 0:
            parameters, damping = parameters + step, max(damping / 5, 1e-7)
            score, information, likelihood = fisher_information(innovations, parameters)
        if converged or gained <= 0:
            break
    progress(1.0)
    return Maximum(parameters, information, precision, likelihood, converged)

"""Maximum of a Gaussian likelihood by Fisher scoring, with a Gaussian prior on the parameters."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Progress = Callable[[str, float], None]
"""Called with the name of the stage and its completed share, 0 to 1."""

Innovations = Callable[[Array], tuple[Array, Array]]
"""Innovations e and their variances S, each (rows,), for given parameters."""

STEP = 1e-6
"""Step of each parameter for a derivative: errors by round-off and curvature both stay below 1e-5 of it."""

MAX_STEP = 0.7
"""Maximum change of a parameter in one iteration."""

MAX_ITERATIONS = 40


@dataclass(frozen=True)
class Slopes:
    """Log-likelihood at given parameters, with the score of each row (p, rows) and the Fisher information (p, p)."""

    log_likelihood: float
    scores: Array
    information: Array


@dataclass(frozen=True)
class Maximum:
    """Maximum of the posterior of the parameters.

    Parameters
    ----------
    parameters : (p,)
    slopes : of the log-likelihood at the maximum
    precision : (p,), of the prior
    converged : whether the last step promised less gain than the tolerance
    """

    parameters: Array
    slopes: Slopes
    precision: Array
    converged: bool

    def covariance(self, memory: int = 0) -> Array:
        """Posterior covariance of the parameters, (p, p).

        With a ``memory`` in rows it allows for residuals that are correlated over that distance, unlike white noise:
        H⁻¹ V H⁻¹ with V the covariance of the scores, Bartlett-weighted (Newey and West 1987).
        """
        hessian_inverse = np.asarray(
            np.linalg.inv(self.slopes.information + np.diag(self.precision)), np.float64
        )
        if memory == 0:
            return hessian_inverse
        scores = self.slopes.scores - np.mean(self.slopes.scores, axis=1, keepdims=True)
        score_covariance = scores @ scores.T
        for lag in range(1, min(memory, scores.shape[1] - 1) + 1):
            cross = scores[:, lag:] @ scores[:, :-lag].T
            score_covariance += (1 - lag / (memory + 1)) * (cross + cross.T)
        return hessian_inverse @ (score_covariance + np.diag(self.precision)) @ hessian_inverse


def log_likelihood(e: Array, S: Array) -> float:
    """Σ -½ (log 2πS + e²/S)."""
    return float(-0.5 * np.sum(np.log(2 * np.pi * S) + e**2 / S))


def slopes(
    innovations: Innovations, parameters: Array, at_parameters: tuple[Array, Array] | None = None
) -> Slopes:
    """Scores and Fisher information at the parameters.

    I_ij = Σ ∂_i e ∂_j e / S + ½ ∂_i S ∂_j S / S²; the derivatives are differences with a step of ``STEP``.

    Parameters
    ----------
    parameters : (p,)
    at_parameters : innovations and variances at the parameters, where they are already known
    """
    e, S = at_parameters or innovations(parameters)
    # Noise and prior come last: in reverse order they meet the transitions kept for ``parameters``.
    steps = STEP * np.eye(len(parameters))[::-1]
    with ThreadPoolExecutor(max_workers=2) as pool:
        shifted = list(pool.map(innovations, parameters + steps))[::-1]
    de = np.array([(shifted_e - e) / STEP for shifted_e, _ in shifted])
    dS = np.array([(shifted_S - S) / STEP for _, shifted_S in shifted])
    scores = -de * (e / S) - 0.5 * dS * (1 / S - e**2 / S**2)
    information = (de / S) @ de.T + 0.5 * (dS / S**2) @ dS.T
    return Slopes(log_likelihood(e, S), scores, information)


def maximise(
    innovations: Innovations,
    start: Array,
    centre: Array,
    precision: Array,
    progress: Callable[[float], None] = lambda share: None,
    tolerance: float = 1e-3,
) -> Maximum:
    """Maximise log-likelihood + log-prior from ``start`` by Fisher scoring with Levenberg-Marquardt damping.

    Parameters
    ----------
    start, centre, precision : (p,), start, and mean and inverse variance of the prior
    tolerance : units of log-likelihood; a step that promises less gain is the last
    """
    parameters, damping, converged = start.copy(), 1e-2, False

    def height(at: Array, likelihood: float) -> float:
        return likelihood - 0.5 * float(np.sum(precision * (at - centre) ** 2))

    local = slopes(innovations, parameters)
    for iteration in range(MAX_ITERATIONS):
        progress(iteration / MAX_ITERATIONS)
        gradient = np.sum(local.scores, axis=1) - precision * (parameters - centre)
        curvature = local.information + np.diag(precision)
        current = height(parameters, local.log_likelihood)
        while True:
            damped = curvature + damping * np.diag(np.diag(curvature))
            step = np.clip(np.linalg.solve(damped, gradient), -MAX_STEP, MAX_STEP)
            converged = float(gradient @ step) < tolerance
            trial = innovations(parameters + step)
            gained = height(parameters + step, log_likelihood(*trial)) - current
            if gained > 0 or converged or damping > 1e8:
                break
            damping *= 5
        if gained > 0:
            parameters, damping = parameters + step, max(damping / 5, 1e-7)
            local = slopes(innovations, parameters, trial)
        if converged or gained <= 0:
            break
    progress(1.0)
    return Maximum(parameters, local, precision, converged)

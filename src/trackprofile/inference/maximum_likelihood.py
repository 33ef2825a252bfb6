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

STEP = 1e-6
"""Of each parameter, for a derivative: round-off and curvature both stay below 1e-5 of it."""

LARGEST_MOVE = 0.7
MOST_ITERATIONS = 40


@dataclass(frozen=True)
class Slopes:
    """Log-likelihood at some parameters, with each row's score (p, rows) and the Fisher information (p, p)."""

    log_likelihood: float
    scores: Array
    information: Array


@dataclass(frozen=True)
class Maximum:
    """Where the posterior of the parameters is highest.

    Parameters
    ----------
    parameters : (p,)
    slopes : of the log-likelihood there
    precision : (p,), of the prior
    converged : whether the last step promised less than was asked for
    """

    parameters: Array
    slopes: Slopes
    precision: Array
    converged: bool

    def covariance(self, memory: int = 0) -> Array:
        """Posterior covariance of the parameters, (p, p).

        With a ``memory`` of so many rows it allows for residuals that depend on each other over that distance,
        which white noise does not: H⁻¹ V H⁻¹ with V the scores' covariance, Bartlett-weighted (Newey and West
        1987).
        """
        bread = np.asarray(
            np.linalg.inv(self.slopes.information + np.diag(self.precision)), np.float64
        )
        if memory == 0:
            return bread
        scores = self.slopes.scores - np.mean(self.slopes.scores, axis=1, keepdims=True)
        meat = scores @ scores.T
        for lag in range(1, min(memory, scores.shape[1] - 1) + 1):
            cross = scores[:, lag:] @ scores[:, :-lag].T
            meat += (1 - lag / (memory + 1)) * (cross + cross.T)
        return bread @ (meat + np.diag(self.precision)) @ bread


def log_likelihood(e: Array, S: Array) -> float:
    """Σ -½ (log 2πS + e²/S)."""
    return float(-0.5 * np.sum(np.log(2 * np.pi * S) + e**2 / S))


def slopes(
    innovations: Innovations, parameters: Array, there: tuple[Array, Array] | None = None
) -> Slopes:
    """Scores and Fisher information at the parameters.

    I_ij = Σ ∂_i e ∂_j e / S + ½ ∂_i S ∂_j S / S²; the derivatives are differences with a step of ``STEP``.

    Parameters
    ----------
    parameters : (p,)
    there : innovations and variances at the parameters, where they are known already
    """
    e, S = there or innovations(parameters)
    # Noise and prior come last: in reverse order they meet the transitions kept for ``parameters``.
    steps = STEP * np.eye(len(parameters))[::-1]
    with ThreadPoolExecutor(max_workers=2) as pool:
        moved = list(pool.map(innovations, parameters + steps))[::-1]
    de = np.array([(moved_e - e) / STEP for moved_e, _ in moved])
    dS = np.array([(moved_S - S) / STEP for _, moved_S in moved])
    scores = -de * (e / S) - 0.5 * dS * (1 / S - e**2 / S**2)
    information = (de / S) @ de.T + 0.5 * (dS / S**2) @ dS.T
    return Slopes(log_likelihood(e, S), scores, information)


def maximise(
    innovations: Innovations,
    start: Array,
    centre: Array,
    precision: Array,
    progress: Callable[[float], None] = lambda share: None,
    enough: float = 1e-3,
) -> Maximum:
    """Climb log-likelihood + log-prior from ``start``, damped as by Levenberg and Marquardt.

    Parameters
    ----------
    start, centre, precision : (p,), where to begin, and the prior's mean and inverse variance
    enough : units of log-likelihood: a step that promises less is the last
    """
    parameters, damping, converged = start.copy(), 1e-2, False

    def height(at: Array, likelihood: float) -> float:
        return likelihood - 0.5 * float(np.sum(precision * (at - centre) ** 2))

    local = slopes(innovations, parameters)
    for iteration in range(MOST_ITERATIONS):
        progress(iteration / MOST_ITERATIONS)
        gradient = np.sum(local.scores, axis=1) - precision * (parameters - centre)
        curvature = local.information + np.diag(precision)
        here = height(parameters, local.log_likelihood)
        while True:
            damped = curvature + damping * np.diag(np.diag(curvature))
            step = np.clip(np.linalg.solve(damped, gradient), -LARGEST_MOVE, LARGEST_MOVE)
            converged = float(gradient @ step) < enough
            trial = innovations(parameters + step)
            gained = height(parameters + step, log_likelihood(*trial)) - here
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

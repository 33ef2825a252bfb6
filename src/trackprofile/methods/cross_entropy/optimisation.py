"""Cross-entropy optimisation of the elevations of one window (theory, section 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.methods.cross_entropy import cross_entropy_kernels as kernels
from trackprofile.methods.cross_entropy.search_settings import Objective, SearchSettings, Variant

Array = NDArray[np.float64]

Misfits = Callable[[Array], Array]
"""Function from trial profiles (n, m) to their misfits at each scan of the window (n, m), O_t of equation 11."""


@dataclass(frozen=True)
class SearchRun:
    """History of one optimisation run within a phase.

    Parameters
    ----------
    objective : (generations,), O of the best profile
    convergence : (generations,), sum of the squared changes of the means, m²
    converged : whether the last value is below the threshold
    """

    objective: Array
    convergence: Array
    converged: bool


def solve_phase(
    misfits: Misfits, mean: Array, level: float, search: SearchSettings,
    generator: np.random.Generator, *, walk: bool,
) -> tuple[Array, list[SearchRun], bool]:  # fmt: skip
    """Repeat the optimisation of one window until two consecutive runs agree.

    Parameters
    ----------
    misfits : misfit function of the window
    mean : (m,), initial means, m
    level : the last decided elevation, m
    walk : whether the first generation is a random walk

    Returns
    -------
    elevations (m,), the mean of the two runs that agree, in m; the runs; whether two runs agree
    """
    variance = np.square(_initial_deviation(search)[: len(mean)])
    # Elevations have no natural zero; only the literal variant measures agreement as the paper does.
    zero = 0.0 if search.variant is Variant.LITERAL else level
    runs: list[SearchRun] = []
    for number in range(search.runs):
        covariance, previous = np.diag(variance), mean
        first_walk = walk and number == 0
        mean, run = optimise(misfits, previous, covariance, search, generator, walk=first_walk)
        runs.append(run)
        # The threshold limits the accuracy of a run; on level track 5 % of the elevations would be 0.
        tolerance = search.agreement * np.linalg.norm(mean - zero) + 2 * np.sqrt(search.threshold)
        if number > 0 and np.linalg.norm(mean - previous) <= tolerance:
            return (mean + previous) / 2, runs, True
    return mean, runs, False


def _initial_deviation(search: SearchSettings) -> Array:
    """Standard deviations (m,) at the start of a phase, from 0.1 σ to σ: uncertainty grows with distance, m."""
    return search.standard_deviation * np.linspace(0.1, 1.0, search.unknowns)


def optimise(
    misfits: Misfits, mean: Array, covariance: Array, search: SearchSettings,
    generator: np.random.Generator, *, walk: bool = False,
) -> tuple[Array, SearchRun]:  # fmt: skip
    """Run generations until the means converge.

    Parameters
    ----------
    misfits : misfit function of the window
    mean, covariance : (m,) in m and (m, m) in m², of the first generation
    walk : the first generation is a random walk instead (equation 9)

    Returns
    -------
    the means (m,), in m, and the history of the run
    """
    n, size = search.population, search.elite_size
    per_scan, full = search.objective is Objective.SCAN, search.variant is Variant.COVARIANCE
    if walk:
        order = np.arange(1.0, len(mean) + 1)
        covariance = search.standard_deviation**2 * np.minimum.outer(order, order)
        x = kernels.draw_random_walks(generator, n, mean, search.standard_deviation)
    else:
        x = kernels.draw_normal(generator, n, mean, covariance)
    objective, convergence, change = [], [], np.inf
    for _ in range(search.generations):
        mean, covariance, best, change = kernels.update_distribution(
            x, misfits(x), size, per_scan, full, search.smoothing, mean, covariance
        )
        objective.append(best)
        convergence.append(change)
        if change < search.threshold:
            break
        x = kernels.draw_normal(generator, n, mean, covariance)
    run = SearchRun(np.array(objective), np.array(convergence), change < search.threshold)
    return mean, run

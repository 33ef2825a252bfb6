"""Variance components of passes and vehicles, compared with an explicit likelihood and simulated data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from narrowing import floats
from trackprofile.fusion.variance_components import (
    PRIOR_COUNT,
    CovarianceCells,
    estimate_variance_components,
)

Array = np.ndarray
N = 6
DAYS = np.arange(N) - 2.5
VEHICLE = np.array([0, 1, 2, 0, 1, 2])
UNTIED = np.arange(3)
TRUE_RATIO = np.array([1.0, 1.0, 4.0, 1.0, 0.5, 1.0])


def simulated_cells(
    seed: int, *, ratio: Array = TRUE_RATIO, shared: tuple[float, ...] = (0.0, 3.0, 0.0),
    change: float = 0.0, count: int = 60, stretches: int = 30, days: Array = DAYS,
    vehicle: Array = VEHICLE,
) -> CovarianceCells:  # fmt: skip
    """Cells of one subband whose passes differ with the covariance Σ, about a far larger level."""
    generator = np.random.default_rng(seed)
    n = days.size
    precision = generator.uniform(0.5, 2.0, (stretches, n))
    root = np.sqrt(precision)
    covariance = np.empty((stretches, n, n))
    for row in range(stretches):
        level, rate = 50 * generator.standard_normal((2, count))
        by_vehicle = np.sqrt(shared)[:, None] * generator.standard_normal((len(shared), count))
        own = np.sqrt(ratio)[:, None] * generator.standard_normal((n, count))
        changing = rate * np.sqrt(change) / 50 * days[:, None] * (row == 3)
        t = root[row][:, None] * (level + by_vehicle[vehicle] + changing) + own
        covariance[row] = t @ t.T / count
    start = 250.0 * np.arange(stretches)
    return CovarianceCells(
        covariance, precision, np.ones(stretches), np.full(stretches, float(count)),
        floats(start), floats(start + 250.0),
        np.zeros(stretches, int),
    )  # fmt: skip


def loss(cells: CovarianceCells, ratio: Array, shared: Array) -> float:
    """-2 log of the restricted likelihood, and of the prior of a typical variance ratio of 1."""
    total = PRIOR_COUNT * float(np.sum(np.log(ratio) + 1 / ratio))
    for C, precision, count in zip(cells.covariance, cells.precision, cells.count, strict=True):
        level = np.sqrt(precision)
        common = np.where(VEHICLE[:, None] == VEHICLE, shared[VEHICLE], 0.0)
        S = np.diag(ratio) + level[:, None] * common * level
        inverse = np.linalg.inv(S)
        weight = float(level @ inverse @ level)
        Q = inverse - np.outer(inverse @ level, level @ inverse) / weight
        total += count * (np.linalg.slogdet(S)[1] + np.log(weight) + float(np.trace(Q @ C)))
    return total


def test_the_variances_of_passes_and_vehicles_are_estimated() -> None:
    estimate = estimate_variance_components(simulated_cells(1), floats(DAYS), VEHICLE, UNTIED)
    # With 1800 independent values a variance has a standard error of 3 %, a common error a little more.
    assert estimate.variance_ratio[:, 0] == pytest.approx(TRUE_RATIO, rel=0.15)
    assert estimate.vehicle_variance[1] == pytest.approx(3.0, rel=0.2)
    assert estimate.vehicle_variance[[0, 2]].max() < 0.1
    assert estimate.counts[:, 0] == pytest.approx(1800.0)


def test_the_estimate_maximises_the_restricted_likelihood() -> None:
    cells = simulated_cells(2)
    optimum = np.exp(
        minimize(
            lambda at: loss(cells, np.exp(at[:N]), np.exp(at[N:])), np.full(N + 3, -0.5),
            method="L-BFGS-B", bounds=[(-12, 6)] * (N + 3),
        ).x
    )  # fmt: skip
    estimate = estimate_variance_components(cells, np.zeros(N), VEHICLE, UNTIED)
    # The prior is about the typical ratio, which is 1 here up to sampling error.
    reached = loss(cells, estimate.variance_ratio[:, 0], estimate.vehicle_variance)
    assert reached < loss(cells, optimum[:N], optimum[N:]) + 0.1


def test_changing_track_does_not_enlarge_the_variance_of_a_pass() -> None:
    estimate = estimate_variance_components(
        simulated_cells(3, change=400.0), floats(DAYS), VEHICLE, UNTIED
    )
    assert estimate.variance_ratio[:, 0] == pytest.approx(TRUE_RATIO, rel=0.2)
    assert estimate.rate_variance[3] > 100 * np.delete(estimate.rate_variance, 3).max()


def test_tied_vehicles_have_one_variance() -> None:
    estimate = estimate_variance_components(
        simulated_cells(4), floats(DAYS), VEHICLE, np.zeros(3, int)
    )
    assert estimate.vehicle_variance == pytest.approx(np.full(3, estimate.vehicle_variance[0]))
    assert 0.3 < estimate.vehicle_variance[0] < 3.0


def test_the_common_error_of_a_single_vehicle_is_not_estimated() -> None:
    estimate = estimate_variance_components(
        simulated_cells(5, shared=(0.0,), vehicle=np.zeros(N, int)),
        floats(DAYS),
        np.zeros(N, int),
        np.zeros(0, int),
    )
    assert estimate.vehicle_variance.size == 0
    assert estimate.variance_ratio[:, 0] == pytest.approx(TRUE_RATIO, rel=0.15)


def test_understated_errors_are_enlarged_on_a_short_line_too() -> None:
    estimate = estimate_variance_components(
        simulated_cells(6, ratio=np.full(N, 9.0), shared=(0.0,) * 3, count=8, stretches=1),
        floats(DAYS),
        VEHICLE,
        UNTIED,
    )
    assert 3.0 < np.median(estimate.variance_ratio) < 20.0


def test_a_pass_without_data_has_the_typical_variance_ratio() -> None:
    cells = simulated_cells(7)
    precision = cells.precision.copy()
    precision[:, 2] = 0.0
    estimate = estimate_variance_components(
        replace(cells, precision=precision), floats(DAYS), VEHICLE, UNTIED
    )
    assert estimate.counts[2, 0] == 0
    assert estimate.variance_ratio[2, 0] == pytest.approx(1.0, rel=0.2)
    others = np.delete(estimate.variance_ratio[:, 0], 2)
    assert others == pytest.approx(np.delete(TRUE_RATIO, 2), rel=0.25)

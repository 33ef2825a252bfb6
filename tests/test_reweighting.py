"""Iterative reweighting: residual statistics, jump statistics and convergence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from trackprofile.kalman.reweighting import (
    CHI_SQUARE_MEDIAN,
    OUTLIER_THRESHOLD,
    STANDARD_DEVIATION_PER_MAD,
    Iteration,
    LeaveOneOutResiduals,
    is_converged,
    jump_statistics,
    limited_change,
    reweight,
)


def test_constants_are_those_of_their_distributions() -> None:
    for components, median in CHI_SQUARE_MEDIAN.items():
        assert median == pytest.approx(chi2.median(components) / components, rel=1e-4)
    assert pytest.approx(1 / norm.ppf(0.75), rel=1e-4) == STANDARD_DEVIATION_PER_MAD


@given(st.integers(0, 99), st.sampled_from([1, 2]), st.floats(0.1, 10.0), st.floats(0.0, 5.0))
def test_noise_ratio_of_gaussian_residuals_is_one_whatever_the_outliers(
    seed: int, components: int, noise: float, prediction: float
) -> None:
    generator = np.random.default_rng(seed)
    std = np.sqrt(noise + prediction)
    residual = std * generator.standard_normal((4000, components))
    residual[:200] *= 1000.0
    square = np.mean(residual**2, axis=1)
    residuals = LeaveOneOutResiduals(square, np.full(4000, prediction), components)
    assert residuals.noise_ratio(noise) == pytest.approx(1.0, abs=0.25)


def test_outlier_is_given_the_variance_that_makes_its_residual_one_standard_deviation() -> None:
    residuals = LeaveOneOutResiduals(np.array([1.0, 400.0]), np.array([0.5, 0.5]))
    variance = residuals.outlier_variance(1.0, OUTLIER_THRESHOLD**2)
    np.testing.assert_array_equal(variance, [0.0, 399.5])
    assert variance[1] + residuals.prediction_variance[1] == residuals.square[1]


def test_jump_of_undetermined_states_is_not_estimated() -> None:
    jump = jump_statistics(np.array([2.0, 1.0]), np.array([4.0, 1e-12]), np.array([0.05, 0.0]))
    np.testing.assert_array_equal(jump.determined, [True, False])
    assert jump.square[0] == 0.25
    assert jump.variance[0] == pytest.approx(0.2)


def test_iteration_ends_at_convergence_or_at_its_maximum() -> None:
    def iterate(state: int, number: int) -> Iteration[int, tuple[int, int]]:
        return Iteration((state, number), state + 1, state >= 3)

    assert reweight(iterate, 0, 20) == (3, 4)
    assert reweight(iterate, 0, 2) == (1, 2)


def test_convergence_needs_the_same_outliers_and_small_changes() -> None:
    zero, one = np.zeros(2), np.array([0.0, 1.0])
    assert is_converged(np.array([1.05]), 0.1, (one, 2 * one))
    assert not is_converged(np.array([1.2]), 0.1, (one, one))
    assert not is_converged(np.array([1.0]), 0.1, (zero, one))
    assert float(limited_change(100.0, 4.0)) == 4.0
    assert float(limited_change(0.01, 4.0)) == 0.25

"""Smoother of a Gauss-Markov chain against dense linear algebra."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from trackprofile.kalman.chain import (
    GaussMarkovChain,
    log_likelihood,
    smooth_chain,
    wiener_acceleration,
)

Array = np.ndarray


@dataclass(frozen=True)
class Case:
    """A random chain with its observations, and the same as dense matrices.

    Parameters
    ----------
    states : (n m, n m), prior covariance of the states of all nodes
    mean : (n m, signals), their prior mean
    rows : (rows, n m), observation rows
    jump_effect : (steps, n m, m), change of all states by a jump at the end of a step
    """

    chain: GaussMarkovChain
    values: Array
    variance: Array
    states: Array
    mean: Array
    rows: Array
    jump_effect: Array

    @property
    def covariance(self) -> Array:
        """Covariance of all observations."""
        return self.rows @ self.states @ self.rows.T + np.diag(self.variance)

    @property
    def innovation(self) -> Array:
        return self.values - self.rows @ self.mean


def random_case(seed: int, n: int, m: int, count: int, signals: int) -> Case:
    generator = np.random.default_rng(seed)
    F = np.eye(m) + 0.3 * generator.standard_normal((n - 1, m, m))
    root = generator.standard_normal((n - 1, m, m))
    Q = root @ root.transpose(0, 2, 1)
    mean = generator.standard_normal((m, signals))
    node = np.sort(generator.integers(0, n, count))
    h = generator.standard_normal((count, m))
    chain = GaussMarkovChain(mean, 2.0 * np.eye(m), F, Q, node, h)
    variance = generator.uniform(0.1, 2.0, count)
    effect = np.zeros((n - 1, n * m, m))
    states = np.zeros((n * m, n * m))
    propagated = np.zeros((n * m, m))
    for k in range(n):
        previous = propagated[(k - 1) * m : k * m]
        propagated[k * m : (k + 1) * m] = np.eye(m) if k == 0 else F[k - 1] @ previous
    states += propagated @ chain.covariance @ propagated.T
    for k in range(n - 1):
        transition = np.eye(m)
        for later in range(k + 1, n):
            effect[k, later * m : (later + 1) * m] = transition
            if later < n - 1:
                transition = F[later] @ transition
        states += effect[k] @ Q[k] @ effect[k].T
    rows = np.zeros((count, n * m))
    for r in range(count):
        rows[r, node[r] * m : (node[r] + 1) * m] = h[r]
    values = generator.standard_normal((count, signals))
    return Case(chain, values, variance, states, propagated @ mean, rows, effect)


CASES = st.builds(
    random_case,
    st.integers(0, 1000),
    st.integers(2, 8),
    st.integers(1, 4),
    st.integers(1, 15),
    st.integers(1, 2),
)


@settings(max_examples=15)
@given(CASES)
def test_posterior_equals_dense_least_squares(case: Case) -> None:
    posterior = smooth_chain(case.chain, case.values, case.variance)
    n, m = posterior.state.shape[:2]
    # Whitened equations: the prior of all states, and the observations.
    root = np.linalg.inv(np.linalg.cholesky(case.states))
    A = np.vstack([root, case.rows / np.sqrt(case.variance)[:, None]])
    b = np.vstack([root @ case.mean, case.values / np.sqrt(case.variance)[:, None]])
    state = np.linalg.lstsq(A, b, rcond=None)[0]
    covariance = np.linalg.inv(A.T @ A)
    np.testing.assert_allclose(posterior.state.reshape(state.shape), state, atol=1e-7)
    for k in range(n):
        own = slice(k * m, (k + 1) * m)
        np.testing.assert_allclose(posterior.covariance[k], covariance[own, own], atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_residuals_are_differences_from_the_prediction_by_all_other_observations(
    case: Case,
) -> None:
    posterior = smooth_chain(case.chain, case.values, case.variance)
    S, e = case.covariance, case.innovation
    for r in range(len(e)):
        others = np.arange(len(e)) != r
        gain = S[r, others] @ np.linalg.inv(S[np.ix_(others, others)])
        np.testing.assert_allclose(posterior.residual[r], e[r] - gain @ e[others], atol=1e-7)
        variance = S[r, r] - gain @ S[others, r] - case.variance[r]
        np.testing.assert_allclose(posterior.prediction_variance[r], variance, atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_jump_score_is_the_slope_of_the_log_likelihood_over_a_jump(case: Case) -> None:
    posterior = smooth_chain(case.chain, case.values, case.variance)
    inverse = np.linalg.inv(case.covariance)
    for k, effect in enumerate(case.rows @ case.jump_effect):
        score = effect.T @ inverse @ case.innovation
        np.testing.assert_allclose(posterior.jump_score[k], score, atol=1e-7)
        precision = np.diag(effect.T @ inverse @ effect)
        np.testing.assert_allclose(posterior.jump_precision[k], precision, atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_log_likelihood_is_that_of_a_normal_distribution(case: Case) -> None:
    expected = sum(
        multivariate_normal.logpdf(column, cov=cast(Any, case.covariance))
        for column in case.innovation.T
    )
    assert np.isclose(log_likelihood(case.chain, case.values, case.variance), expected)


@settings(max_examples=10)
@given(CASES, st.floats(-3.0, 3.0))
def test_smoothing_is_linear(case: Case, factor: float) -> None:
    centred = replace(case.chain, mean=0.0 * case.chain.mean)
    once = smooth_chain(centred, case.values, case.variance).state
    scaled = smooth_chain(centred, factor * case.values, case.variance).state
    np.testing.assert_allclose(scaled, factor * once, atol=1e-9)


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_wiener_acceleration_is_the_matrix_exponential_of_its_continuous_model(
    step: float, walk: float
) -> None:
    # Van Loan 1978: the exponential of [[-A, q q'], [0, A']] holds F' and F⁻¹ Q.
    A = np.diag([1.0, 1.0], 1)
    noise = np.zeros((3, 3))
    noise[2, 2] = walk**2
    exponential = expm(step * np.block([[-A, noise], [np.zeros((3, 3)), A.T]]))
    F, Q = wiener_acceleration(np.array([step]), walk)
    np.testing.assert_allclose(F[0], exponential[3:, 3:].T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(Q[0], F[0] @ exponential[:3, 3:], rtol=1e-7, atol=1e-12 * Q.max())

"""The smoother of a small state, against dense linear algebra."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from trackprofile.kalman.chain import GaussMarkovChain, log_likelihood, smooth_chain

Array = np.ndarray


@dataclass(frozen=True)
class Case:
    """A random chain, its readings, and the same as dense matrices.

    ``states`` (n m, n m) and ``start`` (n m, signals) are the prior of all nodes' states in a row.
    """

    chain: GaussMarkovChain
    values: Array
    variance: Array
    states: Array
    start: Array
    rows: Array
    reach: Array
    """(steps, n m, m): what a jump at the end of a step does to all states."""

    @property
    def covariance(self) -> Array:
        """Of all readings."""
        return self.rows @ self.states @ self.rows.T + np.diag(self.variance)

    @property
    def innovation(self) -> Array:
        return self.values - self.rows @ self.start


def case(seed: int, n: int, m: int, count: int, signals: int) -> Case:
    generator = np.random.default_rng(seed)
    F = np.eye(m) + 0.3 * generator.standard_normal((n - 1, m, m))
    root = generator.standard_normal((n - 1, m, m))
    Q = root @ root.transpose(0, 2, 1)
    mean = generator.standard_normal((m, signals))
    node = np.sort(generator.integers(0, n, count))
    h = generator.standard_normal((count, m))
    chain = GaussMarkovChain(mean, 2.0 * np.eye(m), F, Q, node, h)
    variance = generator.uniform(0.1, 2.0, count)
    reach = np.zeros((n - 1, n * m, m))
    states = np.zeros((n * m, n * m))
    whole = np.zeros((n * m, m))
    for k in range(n):
        whole[k * m : (k + 1) * m] = np.eye(m) if k == 0 else F[k - 1] @ whole[(k - 1) * m : k * m]
    states += whole @ chain.covariance @ whole.T
    for k in range(n - 1):
        carried = np.eye(m)
        for later in range(k + 1, n):
            reach[k, later * m : (later + 1) * m] = carried
            if later < n - 1:
                carried = F[later] @ carried
        states += reach[k] @ Q[k] @ reach[k].T
    rows = np.zeros((count, n * m))
    for r in range(count):
        rows[r, node[r] * m : (node[r] + 1) * m] = h[r]
    values = generator.standard_normal((count, signals))
    return Case(chain, values, variance, states, whole @ mean, rows, reach)


CASES = st.builds(
    case,
    st.integers(0, 1000),
    st.integers(2, 8),
    st.integers(1, 4),
    st.integers(1, 15),
    st.integers(1, 2),
)


@settings(max_examples=15)
@given(CASES)
def test_posterior_is_that_of_dense_least_squares(one: Case) -> None:
    found = smooth_chain(one.chain, one.values, one.variance)
    n, m = found.state.shape[:2]
    # Whitened equations: the start, the steps, the readings.
    root = np.linalg.inv(np.linalg.cholesky(one.states))
    A = np.vstack([root, one.rows / np.sqrt(one.variance)[:, None]])
    b = np.vstack([root @ one.start, one.values / np.sqrt(one.variance)[:, None]])
    state = np.linalg.lstsq(A, b, rcond=None)[0]
    covariance = np.linalg.inv(A.T @ A)
    np.testing.assert_allclose(found.state.reshape(state.shape), state, atol=1e-7)
    for k in range(n):
        here = slice(k * m, (k + 1) * m)
        np.testing.assert_allclose(found.covariance[k], covariance[here, here], atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_each_reading_is_told_by_all_the_others(one: Case) -> None:
    found = smooth_chain(one.chain, one.values, one.variance)
    S, e = one.covariance, one.innovation
    for r in range(len(e)):
        others = np.arange(len(e)) != r
        gain = S[r, others] @ np.linalg.inv(S[np.ix_(others, others)])
        np.testing.assert_allclose(found.error[r], e[r] - gain @ e[others], atol=1e-7)
        left = S[r, r] - gain @ S[others, r] - one.variance[r]
        np.testing.assert_allclose(found.open[r], left, atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_score_is_the_slope_of_the_likelihood_over_a_jump(one: Case) -> None:
    found = smooth_chain(one.chain, one.values, one.variance)
    inverse = np.linalg.inv(one.covariance)
    for k, effect in enumerate(one.rows @ one.reach):
        np.testing.assert_allclose(found.score[k], effect.T @ inverse @ one.innovation, atol=1e-7)
        precision = np.diag(effect.T @ inverse @ effect)
        np.testing.assert_allclose(found.precision[k], precision, atol=1e-7)


@settings(max_examples=15)
@given(CASES)
def test_likelihood_is_that_of_a_normal_distribution(one: Case) -> None:
    expected = sum(
        multivariate_normal.logpdf(column, cov=one.covariance) for column in one.innovation.T
    )
    assert np.isclose(log_likelihood(one.chain, one.values, one.variance), expected)


@settings(max_examples=10)
@given(CASES, st.floats(-3.0, 3.0))
def test_smoothing_is_linear(one: Case, factor: float) -> None:
    centred = replace(one.chain, mean=0.0 * one.chain.mean)
    once = smooth_chain(centred, one.values, one.variance).state
    scaled = smooth_chain(centred, factor * one.values, one.variance).state
    np.testing.assert_allclose(scaled, factor * once, atol=1e-9)

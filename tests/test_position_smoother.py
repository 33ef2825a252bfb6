"""Position smoother against a dense least-squares solution of the same model."""

from __future__ import annotations

import numpy as np

from trackprofile.positioning.position_model import PositionPrior, WheelIntervals
from trackprofile.positioning.position_observations import PositionObservations, Source
from trackprofile.positioning.position_smoother import smooth_position

Array = np.ndarray

ACCELERATION_WALK, SLIP_WALK, SCALE_WALK, BIAS_TIME = 0.1, 0.01, 3e-6, 100.0
"""Values of docs/theory.md."""


def true_run() -> tuple[Array, Array, Array]:
    time = np.arange(0.0, 40.0, 0.5)
    speed = 20.0 + 2.0 * np.sin(2 * np.pi * time / 45.0)
    run = 20.0 * time - 2.0 * 45.0 / (2 * np.pi) * (np.cos(2 * np.pi * time / 45.0) - 1.0)
    return time, 500.0 + run, speed


def observations() -> list[PositionObservations]:
    time, distance, speed = true_run()
    generator = np.random.default_rng(3)
    fixes, pulses, posts = slice(0, None, 4), slice(1, None, 2), slice(20, None, 40)

    def noisy(source: Source, rows: slice, value: Array, std: float) -> PositionObservations:
        values = value[rows] + std * generator.standard_normal(len(time[rows]))
        return PositionObservations(source, time[rows], values, np.full(len(values), std**2))

    return [
        noisy(Source.GNSS_POSITION, fixes, distance, 3.0),
        noisy(Source.GNSS_SPEED, fixes, speed, 0.1),
        noisy(Source.ODOMETRY, pulses, (distance - 200.0) / 0.98, 0.02),
        noisy(Source.POST, posts, distance, 2.0),
    ]


def nodes(observed: list[PositionObservations]) -> Array:
    grid = np.linspace(0.0, 39.5, 41)
    return np.unique(np.concatenate([grid, *(one.time for one in observed)]))


class LeastSquares:
    """Whitened equations of the states of n nodes with m numbers each."""

    def __init__(self, n: int, m: int) -> None:
        self.n, self.m = n, m
        self.equations: list[Array] = []
        self.right: list[Array] = []

    def add(self, block: Array, value: Array, covariance: Array) -> None:
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        self.equations.append(root @ block)
        self.right.append(root @ value)

    def row(self, node: int, state: int, factor: float = 1.0) -> Array:
        row = np.zeros((1, self.n * self.m))
        row[0, node * self.m + state] = factor
        return row

    def solve(self) -> tuple[Array, Array]:
        A, b = np.vstack(self.equations), np.concatenate(self.right)
        solution = np.linalg.lstsq(A, b, rcond=None)[0].reshape(self.n, self.m)
        inverse = np.linalg.inv(np.linalg.qr(A, mode="r"))
        return solution, inverse @ inverse.T


def dense_posterior(
    observed: list[PositionObservations], prior: PositionPrior, scale: float, speed: Array
) -> tuple[Array, Array]:
    """States [q, v, a, Σ, D, δ, b] at the nodes, (n, 7), and their covariance, linearised about scale and speed."""
    time = nodes(observed)
    system = LeastSquares(len(time), 7)
    dt = np.diff(time)
    run = 0.5 * (speed[1:] + speed[:-1]) * dt
    first = next(one for one in observed if one.source is Source.ODOMETRY)
    slip = scale * first.value[0] - run[: int(np.searchsorted(time, first.time[0]))].sum()
    initial = zip(
        (0.0, speed[0], 0.0, slip, prior.start, -np.log(scale), 0.0),
        (1e-9, 30.0, 1.0, 1000.0, prior.start_std, prior.scale_std, prior.bias_std),
        strict=True,
    )
    for state, (value, std) in enumerate(initial):
        system.add(system.row(0, state), np.array([value]), np.array([[std**2]]))
    add_steps(system, dt, run, prior.bias_std)
    add_observations(system, time, observed, scale, speed)
    return system.solve()


def add_steps(system: LeastSquares, dt: Array, run: Array, bias_std: float) -> None:
    m = system.m
    for k, T in enumerate(dt):
        F = np.eye(m)
        F[0, 1], F[0, 2], F[1, 2], F[4, 5] = T, T**2 / 2, T, run[k]
        F[6, 6] = np.exp(-T / BIAS_TIME)
        Q = np.zeros((m, m))
        Q[:3, :3] = ACCELERATION_WALK**2 * np.array(
            [
                [T**5 / 20, T**4 / 8, T**3 / 6],
                [T**4 / 8, T**3 / 3, T**2 / 2],
                [T**3 / 6, T**2 / 2, T],
            ]
        )
        Q[3, 3], Q[4, 4] = SLIP_WALK**2 * run[k], 1e-18
        Q[5, 5], Q[6, 6] = SCALE_WALK**2 * T, bias_std**2 * (1 - F[6, 6] ** 2)
        block = np.zeros((m, system.n * m))
        block[:, k * m : (k + 1) * m], block[:, (k + 1) * m : (k + 2) * m] = -F, np.eye(m)
        system.add(block, np.zeros(m), Q)


def add_observations(
    system: LeastSquares,
    time: Array,
    observed: list[PositionObservations],
    scale: float,
    speed: Array,
) -> None:
    for one in observed:
        for t, value, variance in zip(one.time, one.value, one.variance, strict=True):
            k = int(np.searchsorted(time, t))
            states = {
                Source.GNSS_POSITION: ((0, 1.0), (4, 1.0), (6, 1.0)),
                Source.GNSS_SPEED: ((1, 1.0), (5, speed[k])),
                Source.ODOMETRY: ((0, 1.0), (3, 1.0)),
                Source.POST: ((0, 1.0), (4, 1.0)),
            }[one.source]
            wheel = scale if one.source is Source.ODOMETRY else 1.0
            block = sum(system.row(k, state, factor) for state, factor in states)
            system.add(np.asarray(block), np.array([wheel * value]), np.array([[variance]]))


def dense_estimate(
    observed: list[PositionObservations], prior: PositionPrior
) -> tuple[Array, Array]:
    """Distance and its standard deviation at the nodes, m, by three Gauss-Newton iterations."""
    scale, speed = 1.0, np.full(len(nodes(observed)), 20.0)
    solution, covariance = dense_posterior(observed, prior, scale, speed)
    for _ in range(2):
        speed, scale = solution[:, 1], scale * np.exp(np.median(solution[:, 5]))
        solution, covariance = dense_posterior(observed, prior, scale, speed)
    q = 7 * np.arange(len(solution))
    D = q + 4
    variance = covariance[q, q] + 2 * covariance[q, D] + covariance[D, D]
    return solution[:, 0] + solution[:, 4], np.sqrt(variance)


def test_distance_equals_dense_least_squares() -> None:
    observed = observations()
    prior = PositionPrior(0.03, 500.0, 1000.0, bias_std=1.5, bias_stated=True)
    estimate = smooth_position(observed, WheelIntervals(), prior, (0.0, 39.5))
    weights = estimate.weights
    for variance in (weights.outlier_variance, weights.slip_variance, weights.jerk_variance):
        assert not variance.any()
    distance, std = dense_estimate(observed, prior)
    # A thousandth of the standard deviation: both are linearised about nearly the same run.
    np.testing.assert_allclose(estimate.distance, distance, atol=2e-3)
    np.testing.assert_allclose(estimate.standard_deviation, std, rtol=1e-3)

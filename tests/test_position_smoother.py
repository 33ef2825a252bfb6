"""The smoother of a ride, against a dense batch least-squares solution of the same problem."""

from __future__ import annotations

import numpy as np

from trackprofile.positioning.position_model import PositionPrior
from trackprofile.positioning.position_observations import PositionObservations, Source
from trackprofile.positioning.position_smoother import smooth_position

Array = np.ndarray

WALK, ROLLING, WEAR, FORGOTTEN = 0.1, 0.01, 3e-6, 100.0
"""As docs/theory.md has them."""


def true_ride() -> tuple[Array, Array, Array]:
    time = np.arange(0.0, 40.0, 0.5)
    speed = 20.0 + 2.0 * np.sin(2 * np.pi * time / 45.0)
    run = 20.0 * time - 2.0 * 45.0 / (2 * np.pi) * (np.cos(2 * np.pi * time / 45.0) - 1.0)
    return time, 500.0 + run, speed


def readings() -> list[PositionObservations]:
    time, distance, speed = true_ride()
    generator = np.random.default_rng(3)
    fixes, pulses, posts = slice(0, None, 4), slice(1, None, 2), slice(20, None, 40)

    def read(source: Source, at: slice, value: Array, deviation: float) -> PositionObservations:
        noisy = value[at] + deviation * generator.standard_normal(len(time[at]))
        return PositionObservations(source, time[at], noisy, np.full(len(noisy), deviation**2))

    return [
        read(Source.FIX, fixes, distance, 3.0),
        read(Source.FIX_SPEED, fixes, speed, 0.1),
        read(Source.ROLLED, pulses, (distance - 200.0) / 0.98, 0.02),
        read(Source.POST, posts, distance, 2.0),
    ]


def nodes(given: list[PositionObservations]) -> Array:
    grid = np.linspace(0.0, 39.5, 41)
    return np.unique(np.concatenate([grid, *(one.time for one in given)]))


def dense(
    given: list[PositionObservations], assumed: PositionPrior, scale: float, speed: Array
) -> tuple[Array, Array]:
    """States [q, v, a, Σ, D, δ, b] at the nodes, (n, 7), and their covariance, about a scale and a speed."""
    time = nodes(given)
    n, m = len(time), 7
    equations, right = [], []

    def add(block: Array, value: Array, covariance: Array) -> None:
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        equations.append(root @ block)
        right.append(root @ value)

    def at(k: int, state: int, factor: float = 1.0) -> Array:
        row = np.zeros((1, n * m))
        row[0, k * m + state] = factor
        return row

    first = next(one for one in given if one.source is Source.ROLLED)
    k0 = int(np.searchsorted(time, first.time[0]))
    dt = np.diff(time)
    run = 0.5 * (speed[1:] + speed[:-1]) * dt
    started = scale * first.value[0] - run[:k0].sum()
    known = assumed.begin_deviation, assumed.scale_deviation, assumed.wander
    starts = zip(
        (0.0, speed[0], 0.0, started, assumed.begin, -np.log(scale), 0.0),
        (1e-9, 30.0, 1.0, 1000.0, *known),
        strict=True,
    )
    for state, (value, deviation) in enumerate(starts):
        add(at(0, state), np.array([value]), np.array([[deviation**2]]))
    for k, T in enumerate(dt):
        F = np.eye(m)
        F[0, 1], F[0, 2], F[1, 2], F[4, 5] = T, T**2 / 2, T, run[k]
        F[6, 6] = np.exp(-T / FORGOTTEN)
        Q = np.zeros((m, m))
        Q[:3, :3] = WALK**2 * np.array(
            [
                [T**5 / 20, T**4 / 8, T**3 / 6],
                [T**4 / 8, T**3 / 3, T**2 / 2],
                [T**3 / 6, T**2 / 2, T],
            ]
        )
        Q[3, 3], Q[4, 4] = ROLLING**2 * run[k], 1e-18
        Q[5, 5], Q[6, 6] = WEAR**2 * T, assumed.wander**2 * (1 - F[6, 6] ** 2)
        block = np.zeros((m, n * m))
        block[:, k * m : (k + 1) * m], block[:, (k + 1) * m : (k + 2) * m] = -F, np.eye(m)
        add(block, np.zeros(m), Q)
    for one in given:
        for t, value, variance in zip(one.time, one.value, one.variance, strict=True):
            k = int(np.searchsorted(time, t))
            reads = {
                Source.FIX: ((0, 1.0), (4, 1.0), (6, 1.0)),
                Source.FIX_SPEED: ((1, 1.0), (5, speed[k])),
                Source.ROLLED: ((0, 1.0), (3, 1.0)),
                Source.POST: ((0, 1.0), (4, 1.0)),
            }[one.source]
            wheel = scale if one.source is Source.ROLLED else 1.0
            block = sum(at(k, state, factor) for state, factor in reads)
            add(np.asarray(block), np.array([wheel * value]), np.array([[variance]]))
    A, b = np.vstack(equations), np.concatenate(right)
    solution = np.linalg.lstsq(A, b, rcond=None)[0].reshape(n, m)
    inverse = np.linalg.inv(np.linalg.qr(A, mode="r"))
    covariance = inverse @ inverse.T
    return solution, covariance


def batch(given: list[PositionObservations], assumed: PositionPrior) -> tuple[Array, Array]:
    """Distance and its standard deviation at the nodes, m: least squares, again about what comes out."""
    scale, speed = 1.0, np.full(len(nodes(given)), 20.0)
    for _ in range(3):
        solution, covariance = dense(given, assumed, scale, speed)
        speed, scale = solution[:, 1], scale * np.exp(np.median(solution[:, 5]))
    which = 7 * np.arange(len(solution))
    rolled, off = covariance[which, which], covariance[which + 4, which + 4]
    variance = rolled + 2 * covariance[which, which + 4] + off
    return solution[:, 0] + solution[:, 4], np.sqrt(variance)


def test_distance_is_that_of_dense_least_squares() -> None:
    given = readings()
    assumed = PositionPrior(0.03, 500.0, 1000.0, wander=1.5, wander_stated=True)
    found = smooth_position(given, [], [], assumed, (0.0, 39.5))
    for doubt in (found.weights.own, found.weights.slip, found.weights.jerk):
        assert not doubt.any()
    distance, deviation = batch(given, assumed)
    # A thousandth of the standard deviation: both are linear about nearly the same ride.
    np.testing.assert_allclose(found.distance, distance, atol=2e-3)
    np.testing.assert_allclose(found.deviation, deviation, rtol=1e-3)

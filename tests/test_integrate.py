"""Newmark's and Wilson's steps against exact solutions, energy, and tables in print."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from trackprofile.errors import ModelError
from trackprofile.models.integrate import Response, Scheme, integrate, newmark, wilson

Array = NDArray[np.float64]
SCHEMES = pytest.mark.parametrize("scheme", [newmark, wilson])
M = np.diag([2.0, 1.0])
C = np.array([[0.5, -0.2], [-0.2, 0.3]])
K = np.array([[6.0, -2.0], [-2.0, 4.0]])
PUSH, OMEGA = np.array([1.0, 10.0]), 1.7
START, PACE = np.array([0.3, -0.1]), np.array([-0.2, 0.5])


def exact(time: float) -> tuple[Array, Array, Array]:
    """x, ẋ and ẍ of M ẍ + C ẋ + K x = PUSH cos(OMEGA t): the load is two more states of one linear system."""
    motion = np.zeros((6, 6))
    motion[:2, 2:4] = np.eye(2)
    motion[2:4] = np.linalg.solve(M, np.column_stack([-K, -C, PUSH, np.zeros(2)]))
    motion[4, 5], motion[5, 4] = -OMEGA, OMEGA
    state = expm(motion * time) @ np.concatenate([START, PACE, [1.0, 0.0]])
    return state[:2], state[2:4], (motion @ state)[2:4]


def marched(scheme: Scheme, until: float) -> Response:
    equilibrium = (np.arange(round(until / scheme.step)) + scheme.theta) * scheme.step
    load = np.multiply.outer(np.cos(OMEGA * equilibrium), PUSH)
    return integrate(scheme, M, C, K, load, START, PACE, exact(0.0)[2])


@SCHEMES
def test_error_falls_with_the_square_of_the_step(scheme: Callable[[float], Scheme]) -> None:
    until, steps = 4.0, 0.04 / 2.0 ** np.arange(5)
    errors = []
    for step in steps:
        made = marched(scheme(step), until)
        parts = (made.displacement, made.velocity, made.acceleration)
        errors.append([np.max(np.abs(p[-1] - e)) for p, e in zip(parts, exact(until), strict=True)])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    # The error's next term is smaller by some ω Δt < 0.1 at the coarsest step, so the slope lies within 0.1.
    np.testing.assert_allclose(order, 2.0, atol=0.1)


def energy(made: Response) -> Array:
    kinetic = np.sum(made.velocity @ M * made.velocity, axis=1)
    return 0.5 * (kinetic + np.sum(made.displacement @ K * made.displacement, axis=1))


@SCHEMES
def test_free_undamped_motion_keeps_or_loses_its_energy(scheme: Callable[[float], Scheme]) -> None:
    steps = 100_000
    held = energy(integrate(scheme(0.1), M, 0 * M, K, np.zeros((steps, 2)), START, PACE))
    if scheme is newmark:
        # Each step rounds some 10 sums of relative ε; were all of one sign, 1e5 steps would add up to 2e-10.
        np.testing.assert_allclose(held, held[0], rtol=10 * steps * np.finfo(float).eps)
    else:
        # Over some four periods of the slower mode, not from step to step, within a period it swings by (ω Δt)².
        assert np.all(np.diff(held[:2000:200]) < 0)
        assert held[-1] < 1e-3 * held[0]


@pytest.mark.parametrize("step", [0.3, 3.0, 100.0])
def test_wilson_is_stable_at_any_step(step: float) -> None:
    # x, ẋ and ẍ of one mass from unit starts are the columns of the matrix of one step.
    one, columns = np.eye(1), []
    for x, v, a in np.eye(3):
        made = integrate(
            wilson(step), one, 0 * one, one, np.zeros((1, 1)), *(np.array([i]) for i in (x, v, a))
        )
        columns.append([made.displacement[1, 0], made.velocity[1, 0], made.acceleration[1, 0]])
    radius = np.max(np.abs(np.linalg.eigvals(np.array(columns).T)))
    assert radius < 1


@SCHEMES
def test_rest_under_a_constant_load_stays_the_static_solution(
    scheme: Callable[[float], Scheme],
) -> None:
    still = np.linalg.solve(K, PUSH)
    load = np.tile(PUSH, (1000, 1))
    made = integrate(scheme(0.3), M, C, K, load, still, np.zeros(2))
    # Round-off of K still = PUSH, of a few ε, is not fed back by a stable scheme.
    np.testing.assert_allclose(made.displacement, np.tile(still, (1001, 1)), rtol=1e-13)
    np.testing.assert_allclose(made.velocity, 0.0, atol=1e-13)


@SCHEMES
def test_damped_motion_comes_to_rest_at_the_static_solution(
    scheme: Callable[[float], Scheme],
) -> None:
    made = integrate(scheme(0.3), M, C, K, np.tile(PUSH, (2000, 1)), START, PACE)
    # The slower mode dies as e^(-0.066 t), over 600 s to 1e-17.
    np.testing.assert_allclose(made.displacement[-1], np.linalg.solve(K, PUSH), rtol=1e-11)


# Literature: Bathe, Finite Element Procedures, examples 9.3 (Wilson, θ = 1.4) and 9.4 (Newmark), Δt = 0.28.
BATHE_WILSON = [
    [0.00605, 0.0525, 0.196, 0.490, 0.952, 1.54, 2.16, 2.67, 2.92, 2.82, 2.33, 1.54],
    [0.366, 1.34, 2.64, 3.92, 4.88, 5.31, 5.18, 4.61, 3.82, 3.06, 2.52, 2.29],
]
BATHE_NEWMARK = [
    [0.00673, 0.0505, 0.189, 0.485, 0.961, 1.58, 2.23, 2.76, 3.00, 2.85, 2.28, 1.40],
    [0.364, 1.35, 2.68, 4.00, 4.95, 5.34, 5.13, 4.48, 3.64, 2.90, 2.44, 2.31],
]


@pytest.mark.parametrize(
    ("scheme", "printed"), [(newmark(0.28), BATHE_NEWMARK), (wilson(0.28, 1.4), BATHE_WILSON)]
)
def test_bathes_worked_example(scheme: Scheme, printed: list[list[float]]) -> None:
    load = np.tile([0.0, 10.0], (12, 1))
    made = integrate(scheme, M, 0 * M, K, load, np.zeros(2), np.zeros(2))
    # Three digits are in print, worked by hand from rounded ones: one unit of the last is let pass.
    unit = 10.0 ** (np.floor(np.log10(printed)) - 2)
    assert np.all(np.abs(made.displacement[1:].T - printed) <= unit)


def test_bad_steps_are_refused() -> None:
    for scheme in (newmark, wilson):
        for step in (0.0, -1e-3, float("nan")):
            with pytest.raises(ModelError, match="must be above 0 s"):
                scheme(step)
    for theta in (1.0, 1.369, float("nan")):
        with pytest.raises(ModelError, match=r"θ must be at least 1\.37"):
            wilson(1e-3, theta)


def test_matrices_that_cannot_be_solved_are_refused() -> None:
    load, still = np.zeros((1, 2)), np.zeros(2)
    massless = np.diag([2.0, 0.0])
    with pytest.raises(ModelError, match="give every degree of freedom a mass"):
        integrate(newmark(0.1), massless, 0 * M, 0 * M, load, still, still, still)
    with pytest.raises(ModelError, match="give every degree of freedom a mass"):
        integrate(newmark(0.1), massless, 0 * M, K, load, still, still)

"""Newmark's and Wilson's schemes compared with exact solutions, energy balance, and published examples."""

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
LOAD, OMEGA = np.array([1.0, 10.0]), 1.7
DISPLACEMENT, VELOCITY = np.array([0.3, -0.1]), np.array([-0.2, 0.5])


def exact(time: float) -> tuple[Array, Array, Array]:
    """x, ẋ and ẍ of M ẍ + C ẋ + K x = LOAD cos(OMEGA t): the load adds two states to one linear system."""
    motion = np.zeros((6, 6))
    motion[:2, 2:4] = np.eye(2)
    motion[2:4] = np.linalg.solve(M, np.column_stack([-K, -C, LOAD, np.zeros(2)]))
    motion[4, 5], motion[5, 4] = -OMEGA, OMEGA
    state = np.asarray(expm(motion * time), np.float64) @ np.concatenate(
        [DISPLACEMENT, VELOCITY, [1.0, 0.0]]
    )
    return state[:2], state[2:4], (motion @ state)[2:4]


def integrated(scheme: Scheme, until: float) -> Response:
    equilibrium = (np.arange(round(until / scheme.step)) + scheme.theta) * scheme.step
    load = np.multiply.outer(np.cos(OMEGA * equilibrium), LOAD)
    return integrate(
        scheme, M, C, K, load, displacement=DISPLACEMENT, velocity=VELOCITY,
        acceleration=exact(0.0)[2],
    )  # fmt: skip


@SCHEMES
def test_error_falls_with_the_square_of_the_step(scheme: Callable[[float], Scheme]) -> None:
    until, steps = 4.0, 0.04 / 2.0 ** np.arange(5)
    errors = []
    for step in steps:
        response = integrated(scheme(step), until)
        parts = (response.displacement, response.velocity, response.acceleration)
        errors.append([np.max(np.abs(p[-1] - e)) for p, e in zip(parts, exact(until), strict=True)])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    # The next term of the error is smaller by ω Δt < 0.1 at the coarsest step, so the slope is within 0.1.
    np.testing.assert_allclose(order, 2.0, atol=0.1)


def energy(response: Response) -> Array:
    kinetic = np.sum(response.velocity @ M * response.velocity, axis=1)
    return 0.5 * (kinetic + np.sum(response.displacement @ K * response.displacement, axis=1))


@SCHEMES
def test_free_undamped_motion_conserves_energy_or_loses_it_with_wilson(
    scheme: Callable[[float], Scheme],
) -> None:
    steps = 100_000
    total = energy(
        integrate(
            scheme(0.1),
            M,
            0 * M,
            K,
            np.zeros((steps, 2)),
            displacement=DISPLACEMENT,
            velocity=VELOCITY,
        )
    )
    if scheme is newmark:
        # Each step has about 10 sums with a round-off of ε; 1e5 steps add up to at most 2e-10.
        np.testing.assert_allclose(total, total[0], rtol=10 * steps * np.finfo(float).eps)
    else:
        # Compared over four periods of the slower mode, because it varies by (ω Δt)² within a period.
        assert np.all(np.diff(total[:2000:200]) < 0)
        assert total[-1] < 1e-3 * total[0]


@pytest.mark.parametrize("step", [0.3, 3.0, 100.0])
def test_wilson_is_stable_at_any_step(step: float) -> None:
    # x, ẋ and ẍ of one mass after unit initial values are the columns of the matrix of one step.
    one, columns = np.eye(1), []
    for x, v, a in np.eye(3):
        response = integrate(
            wilson(step),
            one,
            0 * one,
            one,
            np.zeros((1, 1)),
            displacement=np.array([x]),
            velocity=np.array([v]),
            acceleration=np.array([a]),
        )
        columns.append(
            [response.displacement[1, 0], response.velocity[1, 0], response.acceleration[1, 0]]
        )
    radius = np.max(np.abs(np.linalg.eigvals(np.array(columns).T)))
    assert radius < 1


@SCHEMES
def test_static_solution_under_a_constant_load_is_preserved(
    scheme: Callable[[float], Scheme],
) -> None:
    static = np.linalg.solve(K, LOAD)
    load = np.tile(LOAD, (1000, 1))
    response = integrate(scheme(0.3), M, C, K, load, displacement=static, velocity=np.zeros(2))
    # Round-off of K static = LOAD, of a few ε, is not amplified by a stable scheme.
    np.testing.assert_allclose(response.displacement, np.tile(static, (1001, 1)), rtol=1e-13)
    np.testing.assert_allclose(response.velocity, 0.0, atol=1e-13)


@SCHEMES
def test_damped_motion_converges_to_the_static_solution(
    scheme: Callable[[float], Scheme],
) -> None:
    response = integrate(
        scheme(0.3), M, C, K, np.tile(LOAD, (2000, 1)), displacement=DISPLACEMENT, velocity=VELOCITY
    )
    # The slower mode decays as e^(-0.066 t), to 1e-17 after 600 s.
    np.testing.assert_allclose(response.displacement[-1], np.linalg.solve(K, LOAD), rtol=1e-11)


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
def test_published_example_of_bathe(scheme: Scheme, printed: list[list[float]]) -> None:
    load = np.tile([0.0, 10.0], (12, 1))
    response = integrate(scheme, M, 0 * M, K, load, displacement=np.zeros(2), velocity=np.zeros(2))
    # The source has three digits, computed by hand from rounded ones: a difference of one last digit is accepted.
    unit = 10.0 ** (np.floor(np.log10(printed)) - 2)
    assert np.all(np.abs(response.displacement[1:].T - printed) <= unit)


def test_invalid_steps_are_rejected() -> None:
    for scheme in (newmark, wilson):
        for step in (0.0, -1e-3, float("nan")):
            with pytest.raises(ModelError, match="must be above 0 s"):
                scheme(step)
    for theta in (1.0, 1.369, float("nan")):
        with pytest.raises(ModelError, match=r"θ must be at least 1\.37"):
            wilson(1e-3, theta)


def test_singular_matrices_are_rejected() -> None:
    load, zero = np.zeros((1, 2)), np.zeros(2)
    massless = np.diag([2.0, 0.0])
    with pytest.raises(ModelError, match="give every degree of freedom a mass"):
        integrate(
            newmark(0.1),
            massless,
            0 * M,
            0 * M,
            load,
            displacement=zero,
            velocity=zero,
            acceleration=zero,
        )
    with pytest.raises(ModelError, match="give every degree of freedom a mass"):
        integrate(newmark(0.1), massless, 0 * M, K, load, displacement=zero, velocity=zero)

"""Implicit time integration of M ẍ + C ẋ + K x = f: Newmark's average acceleration and Wilson's θ method.

Both schemes have one form, which the coupled vehicle-track model uses too. Equilibrium is required at t + θ Δt,

    M ẍ* + C ẋ* + K x* = f*,    ẍ* = a_x x* - a·(x, ẋ, ẍ),    ẋ* = b_x x* - b·(x, ẋ, ẍ),

and the state at t + Δt follows from

    ẍ₊ = p·(x* - x, ẋ, ẍ),    ẋ₊ = ẋ + Δt (g·(ẍ, ẍ₊)),    x₊ = x + Δt ẋ + Δt² (h·(ẍ, ẍ₊)).

Source: Bathe, Finite Element Procedures, 9.2.4 (Newmark) and 9.2.3 (Wilson); θ = 1.420815 is the value of
O'Brien et al. 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

Array = NDArray[np.float64]

PAPER_THETA = 1.420815
"""θ of O'Brien et al. 2017."""

MINIMUM_THETA = 1.37
"""θ from which Wilson's method is unconditionally stable."""


@dataclass(frozen=True)
class Scheme:
    """Coefficients of one integration step; the module's docstring has the equations.

    Parameters
    ----------
    step : Δt, s
    theta : θ, equilibrium is required at t + θ Δt
    a, b : (3,), coefficients of x, ẋ and ẍ; a_x = a[0] and b_x = b[0]
    p : (3,)
    g, h : (2,)
    """

    step: float
    theta: float
    a: Array
    b: Array
    p: Array
    g: Array
    h: Array


def newmark(step: float, beta: float = 0.25, gamma: float = 0.5) -> Scheme:
    """Newmark's scheme; the default is average acceleration, of second order and without numerical damping.

    Parameters
    ----------
    step : Δt, s
    beta, gamma : Newmark's parameters

    Raises
    ------
    ModelError : the step is not above 0.

    Examples
    --------
    >>> newmark(1e-3).theta
    1.0
    """
    _check_step(step)
    a = np.array([1 / (beta * step**2), 1 / (beta * step), 0.5 / beta - 1])
    b = np.array([gamma / (beta * step), gamma / beta - 1, step * (0.5 * gamma / beta - 1)])
    p = np.array([a[0], -a[1], -a[2]])
    return Scheme(step, 1.0, a, b, p, np.array([1 - gamma, gamma]), np.array([0.5 - beta, beta]))


def wilson(step: float, theta: float = PAPER_THETA) -> Scheme:
    """Wilson's θ method: the acceleration is linear over θ Δt. Unconditionally stable for θ ≥ 1.37.

    Parameters
    ----------
    step : Δt, s
    theta : θ

    Raises
    ------
    ModelError : the step is not above 0, or θ is below 1.37.

    Examples
    --------
    >>> wilson(2e-3).theta
    1.420815
    """
    _check_step(step)
    if not theta >= MINIMUM_THETA:
        raise ModelError(
            f"Wilson's θ must be at least {MINIMUM_THETA:g} to be stable, got {theta:g}."
        )
    long = theta * step
    a = np.array([6 / long**2, 6 / long, 2.0])
    b = np.array([3 / long, 2.0, 0.5 * long])
    p = np.array([a[0] / theta, -a[1] / theta, 1 - 3 / theta])
    return Scheme(step, theta, a, b, p, np.array([0.5, 0.5]), np.array([1 / 3, 1 / 6]))


def _check_step(step: float) -> None:
    if not step > 0:
        raise ModelError(f"The time step must be above 0 s, got {step:g} s.")


@dataclass(frozen=True)
class Response:
    """Displacement, velocity and acceleration, each (steps + 1, freedoms), from the initial state on."""

    displacement: Array
    velocity: Array
    acceleration: Array


def integrate(
    scheme: Scheme, M: Array, C: Array, K: Array, load: Array, *, displacement: Array, velocity: Array,
    acceleration: Array | None = None,
) -> Response:  # fmt: skip
    """Integrate M ẍ + C ẋ + K x = f with constant matrices.

    Parameters
    ----------
    M, C, K : (n, n), kg, N s/m and N/m, or their rotational equivalents
    load : (steps, n), f at each step's time of equilibrium, t_k + θ Δt
    displacement, velocity : (n,), initial values
    acceleration : (n,), initial value; None takes that of equilibrium with the first load

    Raises
    ------
    ModelError
        Where the effective matrix is singular.

    Examples
    --------
    >>> one = np.eye(1)
    >>> swing = integrate(newmark(1e-3), one, 0 * one, one, np.zeros((1000, 1)),
    ...     displacement=np.ones(1), velocity=np.zeros(1))
    >>> round(float(swing.displacement[-1, 0]), 5), round(float(np.cos(1.0)), 5)
    (0.5403, 0.5403)
    """
    effective = scheme.a[0] * M + scheme.b[0] * C + K
    try:
        inverse = np.linalg.inv(effective)
        if acceleration is None:
            first = load[0] if len(load) else np.zeros(len(M))
            residual = first - C @ velocity - K @ displacement
            acceleration = np.asarray(np.linalg.solve(M, residual), np.float64)
    except np.linalg.LinAlgError as error:
        raise ModelError(
            "The matrices of motion are singular: give every degree of freedom a mass."
        ) from error
    history = [scheme.a[i] * M + scheme.b[i] * C for i in range(3)]
    transition = np.hstack([inverse @ part for part in history])
    out = np.empty((3, len(load) + 1, len(M)))
    out[0, 0], out[1, 0], out[2, 0] = displacement, velocity, acceleration
    loaded = np.ascontiguousarray(load @ inverse.T)
    integrate_steps(
        np.ascontiguousarray(transition), loaded, scheme.step, scheme.p, scheme.g, scheme.h, out
    )
    return Response(*out)


@numba.njit(cache=True, nogil=True)
def integrate_steps(transition, loaded, step, p, g, h, out):  # pragma: no cover
    """All steps of x* = loaded + transition [x; ẋ; ẍ]; ``out`` (3, steps + 1, n) holds the initial state first."""
    n = out.shape[2]
    for k in range(len(loaded)):
        for i in range(n):
            reached = loaded[k, i]
            for j in range(n):
                reached += transition[i, j] * out[0, k, j]
                reached += transition[i, n + j] * out[1, k, j]
                reached += transition[i, 2 * n + j] * out[2, k, j]
            x, v, a = out[0, k, i], out[1, k, i], out[2, k, i]
            after = p[0] * (reached - x) + p[1] * v + p[2] * a
            out[2, k + 1, i] = after
            out[1, k + 1, i] = v + step * (g[0] * a + g[1] * after)
            out[0, k + 1, i] = x + step * v + step * step * (h[0] * a + h[1] * after)

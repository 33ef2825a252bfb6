"""Exact discretisation of a state-space model: its transition and noise covariance over any time step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from trackprofile.models.statespace import StateSpace

Array = NDArray[np.float64]


def generator_matrix(system: StateSpace) -> Array:
    """The matrix G with d/dt [x; a] = G [x; a], where a_j is the j-th time derivative of the paths, j = 0..3.

    Between two samples each path is a cubic, as the profile's spline is between knots, so that exp(G t)
    propagates the state exactly.

    Returns
    -------
    (n + 4 wheels, n + 4 wheels), the derivatives ordered by j, then wheel
    """
    n, wheels = len(system.A), len(system.wheel_positions)
    matrix = np.zeros((n + 4 * wheels, n + 4 * wheels))
    matrix[:n, :n] = system.A
    for j in range(3):
        matrix[:n, n + j * wheels : n + (j + 1) * wheels] = system.B[:, j]
        rows = slice(n + j * wheels, n + (j + 1) * wheels)
        matrix[rows, n + (j + 1) * wheels : n + (j + 2) * wheels] = np.eye(wheels)
    return matrix


@dataclass(frozen=True)
class StepTable:
    """Transition over any time step t in 0..longest, as Taylor polynomials around evenly spaced nodes t_i.

    Parameters
    ----------
    spacing : distance between nodes, s
    motion : (nodes, order, n, n + 4 wheels), the first n rows of exp(G t_i) Gᵏ / k!
    noise : (nodes, order, n, n), Taylor coefficients of Q(t) = ∫ e^(Aτ) d dᵀ e^(Aτ)ᵀ dτ, the covariance that the
        disturbances d add
    """

    spacing: float
    motion: Array
    noise: Array


TAYLOR_ORDER = 13
"""Number of Taylor coefficients per node."""


def step_table(system: StateSpace, longest: float) -> StepTable:
    """Tabulate the transition over any time step up to ``longest`` (s), accurate to round-off.

    The spacing of the nodes makes |λ| δ ≤ 1/4 for the largest eigenvalue λ and the largest distance δ to a node:
    the first neglected term is (1/4)¹³/13! = 2e-18 of the sum.
    """
    n = len(system.A)
    G = generator_matrix(system)
    largest = np.max(np.abs(np.linalg.eigvals(system.A)))
    nodes = int(np.ceil(longest * largest / 0.5)) + 1
    spacing = longest / max(nodes - 1, 1)
    powers = [np.eye(len(G))]
    for k in range(1, TAYLOR_ORDER):
        powers.append(powers[-1] @ G / k)
    motion = np.empty((nodes, TAYLOR_ORDER, n, len(G)))
    noise = np.zeros((nodes, TAYLOR_ORDER, n, n))
    intensity = system.disturbance @ system.disturbance.T
    step, step_noise = expm(G * spacing), _noise_over(system.A, intensity, spacing)
    transition, covariance = np.eye(len(G)), np.zeros((n, n))
    for i in range(nodes):
        for k, power in enumerate(powers):
            motion[i, k] = transition[:n] @ power
        _noise_polynomial(system.A, intensity, covariance, noise[i])
        covariance = step[:n, :n] @ covariance @ step[:n, :n].T + step_noise
        transition = transition @ step
    return StepTable(spacing, motion, noise)


def _noise_over(A: Array, intensity: Array, duration: float) -> Array:
    """∫ e^(Aτ) q e^(Aτ)ᵀ dτ over 0..duration with q the intensity, by a block matrix exponential (Van Loan 1978)."""
    n = len(A)
    block = np.block([[-A, intensity], [np.zeros((n, n)), A.T]])
    exponential = expm(block * duration)
    return np.asarray(exponential[n:, n:].T @ exponential[:n, n:], np.float64)


def _noise_polynomial(A: Array, intensity: Array, start: Array, out: Array) -> None:
    """Taylor coefficients of Q(t) around ``start``: Q' = A Q + Q Aᵀ + q."""
    out[0] = start
    for k in range(1, len(out)):
        product = A @ out[k - 1]
        out[k] = (product + product.T + (intensity if k == 1 else 0.0)) / k

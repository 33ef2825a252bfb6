"""Compiled integration steps of a layered track.

Each node has four degrees of freedom: deflection and slope of the rail, sleeper, ballast. Sleeper and ballast are
condensed node by node; the remaining matrix of the rail is symmetric with half-bandwidth 3 and is factorised only when
the window moves by a bay. Arrays that hold a state have displacement, velocity and acceleration along the first axis.
"""

from __future__ import annotations

import numba
import numpy as np

RAIL, SLOPE, SLEEPER, BALLAST = range(4)
PAD_K, PAD_C, SLEEPER_M, BALLAST_K, BALLAST_C, BALLAST_M, GROUND_K, GROUND_C = range(8)

compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@compiled
def factorise(supports, bending, inertia, ax, bx):  # pragma: no cover
    """L D Lᵀ factors of a_x M + b_x C + K: L (2 n, 3) below the diagonal, D (2 n,); condensation terms (n, 4)."""
    n = len(supports)
    band, condensed = np.zeros((2 * n, 4)), np.empty((n, 4))
    for e in range(n - 1):
        for i in range(4):
            for j in range(i + 1):
                band[2 * e + i, i - j] += bending[i, j] + ax * inertia[i, j]
    for k in range(n):
        one = supports[k]
        pad = one[PAD_K] + bx * one[PAD_C]
        ballast = one[BALLAST_K] + bx * one[BALLAST_C]
        sleeper = ax * one[SLEEPER_M] + pad + ballast
        ground = ax * one[BALLAST_M] + ballast + one[GROUND_K] + bx * one[GROUND_C]
        determinant = sleeper * ground - ballast * ballast
        condensed[k, 0], condensed[k, 1] = ground / determinant, ballast / determinant
        condensed[k, 2], condensed[k, 3] = sleeper / determinant, pad
        band[2 * k, 0] += pad - pad * pad * condensed[k, 0]
    L, D = np.zeros((2 * n, 3)), np.empty(2 * n)
    for i in range(2 * n):
        for k in range(min(i, 3), 0, -1):
            value = band[i, k]
            for m in range(k + 1, min(i, 3) + 1):
                value -= L[i, m - 1] * L[i - k, m - k - 1] * D[i - m]
            L[i, k - 1] = value / D[i - k]
        D[i] = band[i, 0]
        for m in range(1, min(i, 3) + 1):
            D[i] -= L[i, m - 1] * L[i, m - 1] * D[i - m]
    # The leading end is clamped: a bay that enters the window is at rest and joins a node at rest.
    D[2 * n - 2 :] = np.inf
    return L, D, condensed


@compiled
def solve(L, D, columns):  # pragma: no cover
    """Solve for all columns (2 n, m) in place."""
    rows, count = columns.shape
    for i in range(rows):
        for k in range(1, min(i, 3) + 1):
            factor = L[i, k - 1]
            for c in range(count):
                columns[i, c] -= factor * columns[i - k, c]
    for i in range(rows - 1, -1, -1):
        for c in range(count):
            columns[i, c] /= D[i]
        for k in range(1, min(rows - 1 - i, 3) + 1):
            factor = L[i + k, k - 1]
            for c in range(count):
                columns[i, c] -= factor * columns[i + k, c]


@compiled
def shape_functions(fraction, h, out):  # pragma: no cover
    """Hermite shape functions N, N' and N'' (3, 4) at a fraction of a bay of length h."""
    x = fraction
    out[0, 0], out[0, 1] = 1 - 3 * x * x + 2 * x**3, h * (x - 2 * x * x + x**3)
    out[0, 2], out[0, 3] = 3 * x * x - 2 * x**3, h * (x**3 - x * x)
    out[1, 0], out[1, 1] = (6 * x * x - 6 * x) / h, 1 - 4 * x + 3 * x * x
    out[1, 2], out[1, 3] = (6 * x - 6 * x * x) / h, 3 * x * x - 2 * x
    out[2, 0], out[2, 1] = (12 * x - 6) / h**2, (6 * x - 4) / h
    out[2, 2], out[2, 3] = (6 - 12 * x) / h**2, (6 * x - 2) / h


@compiled
def combine_history(state, coefficients, out):  # pragma: no cover
    c0, c1, c2 = coefficients
    for k in range(out.shape[0]):
        for d in range(4):
            out[k, d] = c0 * state[0, k, d] + c1 * state[1, k, d] + c2 * state[2, k, d]


@compiled
def track_load(supports, inertia, hM, hC, condensed, right, inner):  # pragma: no cover
    """M hM + C hC condensed onto the rail, in column 0 of ``right``; that of sleepers and ballast in ``inner``."""
    n = len(supports)
    right[:, 0] = 0.0
    for e in range(n - 1):
        for i in range(4):
            value = 0.0
            for j in range(4):
                value += inertia[i, j] * hM[e + j // 2, j % 2]
            right[2 * e + i, 0] += value
    for k in range(n):
        one = supports[k]
        pad = one[PAD_C] * (hC[k, SLEEPER] - hC[k, RAIL])
        ballast = one[BALLAST_C] * (hC[k, BALLAST] - hC[k, SLEEPER])
        inner[k, 0] = one[SLEEPER_M] * hM[k, SLEEPER] + pad - ballast
        inner[k, 1] = one[BALLAST_M] * hM[k, BALLAST] + ballast + one[GROUND_C] * hC[k, BALLAST]
        lower = condensed[k, 0] * inner[k, 0] + condensed[k, 1] * inner[k, 1]
        right[2 * k, 0] += condensed[k, 3] * lower - pad


@compiled
def recover_displacements(supports, condensed, inner, right, forces, reached):  # pragma: no cover
    """Displacements (nodes, 4) of the window from the rail's solution columns and the contact forces."""
    for k in range(len(supports)):
        for d in range(2):
            value = right[2 * k + d, 0]
            for f in range(len(forces)):
                value -= right[2 * k + d, 1 + f] * forces[f]
            reached[k, d] = value
        pushed = inner[k, 0] + condensed[k, 3] * reached[k, RAIL]
        reached[k, SLEEPER] = condensed[k, 0] * pushed + condensed[k, 1] * inner[k, 1]
        reached[k, BALLAST] = condensed[k, 1] * pushed + condensed[k, 2] * inner[k, 1]


@compiled
def advance_state(step, p, g, h, state, reached):  # pragma: no cover
    for k in range(reached.shape[0]):
        for d in range(reached.shape[1]):
            x, v, a = state[0, k, d], state[1, k, d], state[2, k, d]
            after = p[0] * (reached[k, d] - x) + p[1] * v + p[2] * a
            state[2, k, d] = after
            state[1, k, d] = v + step * (g[0] * a + g[1] * after)
            state[0, k, d] = x + step * v + step * step * (h[0] * a + h[1] * after)


@compiled
def shift_window(state, bays):  # pragma: no cover
    """Move the window forward by ``bays``; the track that enters is at rest."""
    nodes = state.shape[1]
    for part in range(3):
        for k in range(nodes):
            for d in range(4):
                state[part, k, d] = state[part, k + bays, d] if k + bays < nodes else 0.0


@compiled
def damp_window_ends(state, kept):  # pragma: no cover
    """Multiply the velocity and acceleration at the ends of the window by ``kept`` (nodes,)."""
    for k in range(len(kept)):
        if kept[k] < 1.0:
            for d in range(4):
                state[1, k, d] *= kept[k]
                state[2, k, d] *= kept[k]


@compiled
def track_window(supports, first, absorbing, bending, inertia, ax, bx):  # pragma: no cover
    """Supports of the window from row ``first`` on, with the damping of its ends, and the factors."""
    window = supports[first : first + len(absorbing)].copy()
    window[:, GROUND_C] += absorbing
    return window, factorise(window, bending, inertia, ax, bx)

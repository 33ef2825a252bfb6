"""Compiled kernels for the transitions and measurement rows of every bay of a run.

The smoother's state is [x; c]: n vehicle states, then a ring of spline coefficients that covers all wheels. A *bay* is
the sequence of steps between the entries of two coefficients. Within a bay the state moves deterministically, so each
sample is a row h over the state at the bay's start, and the vehicle moves once, by x ← F x + G c. Each wheel reaches
``COLUMNS`` coefficients within a bay; ``slots`` holds their positions in the state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

COLUMNS = 6

Function = Callable[..., Any]


def compiled(function: Function) -> Function:
    """Compile to machine code, cached on disk; sums may be reordered, NaN and infinity remain exact."""
    flags = {"reassoc", "contract", "nsz", "arcp"}
    return numba.njit(cache=True, nogil=True, fastmath=flags, error_model="numpy")(function)


@compiled
def _evaluate(polynomials, spacing, t, out):  # pragma: no cover
    """out ← the step table's matrix at t."""
    node = min(int(t / spacing + 0.5), polynomials.shape[0] - 1) if spacing > 0 else 0
    offset = t - node * spacing
    table = polynomials[node]
    order, rows, columns = table.shape
    for i in range(rows):
        for j in range(columns):
            out[i, j] = table[order - 1, i, j]
        for k in range(order - 2, -1, -1):
            for j in range(columns):
                out[i, j] = out[i, j] * offset + table[k, i, j]


@compiled
def spline_weights(position, spacing, base, value, slope, curvature):  # pragma: no cover
    """Weights over COLUMNS coefficients from index ``base`` of r, r', r'' at ``position``."""
    bay = int(np.floor(position / spacing))
    u = position / spacing - bay
    w = 1.0 - u
    first = bay - base
    for k in range(COLUMNS):
        value[k] = slope[k] = curvature[k] = 0.0
    value[first] = w * w * w / 6.0
    value[first + 1] = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0
    value[first + 2] = (4.0 - 6.0 * w * w + 3.0 * w * w * w) / 6.0
    value[first + 3] = u * u * u / 6.0
    slope[first] = -0.5 * w * w / spacing
    slope[first + 1] = (1.5 * u * u - 2.0 * u) / spacing
    slope[first + 2] = (2.0 * w - 1.5 * w * w) / spacing
    slope[first + 3] = 0.5 * u * u / spacing
    curvature[first] = w / spacing**2
    curvature[first + 1] = (3.0 * u - 2.0) / spacing**2
    curvature[first + 2] = (3.0 * w - 2.0) / spacing**2
    curvature[first + 3] = u / spacing**2


@compiled
def _paths(
    position, speed, acceleration, wheels, spacing, bases, paths, scratch
):  # pragma: no cover
    """paths[d, i, :] ← weights of the d-th time derivative of wheel i's path over its columns."""
    for i in range(len(wheels)):
        spline_weights(position - wheels[i], spacing, bases[i], scratch[0], scratch[1], scratch[2])
        for k in range(COLUMNS):
            paths[0, i, k] = scratch[0, k]
            paths[1, i, k] = speed * scratch[1, k]
            paths[2, i, k] = speed * speed * scratch[2, k] + acceleration * scratch[1, k]


@compiled
def _step(motion, T, start, end, F, G, F_new, G_new, push):  # pragma: no cover
    """F ← Φ F and G ← Φ G + Σ_j Θ_j a_j: the paths are cubics with the values and rates at both ends."""
    n, wheels = F.shape[0], start.shape[1]
    for i in range(wheels):
        for k in range(COLUMNS):
            z0, z1, r0, r1 = start[0, i, k], end[0, i, k], start[1, i, k], end[1, i, k]
            push[i, k] = z0
            push[wheels + i, k] = r0
            push[2 * wheels + i, k] = 6.0 * (z1 - z0) / T**2 - (4.0 * r0 + 2.0 * r1) / T
            push[3 * wheels + i, k] = 12.0 * (z0 - z1) / T**3 + 6.0 * (r0 + r1) / T**2
    for a in range(n):
        F_new[a, :] = 0.0
        G_new[a, :] = 0.0
        for b in range(n):
            phi = motion[a, b]
            if phi != 0.0:
                for j in range(n):
                    F_new[a, j] += phi * F[b, j]
                for j in range(G.shape[1]):
                    G_new[a, j] += phi * G[b, j]
        for j in range(4):
            for i in range(wheels):
                theta = motion[a, n + j * wheels + i]
                for k in range(COLUMNS):
                    G_new[a, i * COLUMNS + k] += theta * push[j * wheels + i, k]
    F[:, :] = F_new
    G[:, :] = G_new


@compiled
def _add_noise(motion, noise, shaken, Q, scratch):  # pragma: no cover
    """Q ← Φ Q Φᵀ + what the disturbances add in this step, over the states that they reach."""
    for a in shaken:
        for j in shaken:
            scratch[a, j] = 0.0
        for k in shaken:
            if motion[a, k] != 0.0:
                for j in shaken:
                    scratch[a, j] += motion[a, k] * Q[k, j]
    for a in shaken:
        for c in shaken:
            if c > a:
                break
            value = noise[a, c]
            for k in shaken:
                value += scratch[a, k] * motion[c, k]
            Q[a, c] = Q[c, a] = value


@compiled
def _row(C, D, paths, F, G, row):  # pragma: no cover
    """row ← C [F G] + D [z; ż; z̈]: one sensor over the state at the bay's start."""
    n, columns = F.shape[0], G.shape[1]
    row[:] = 0.0
    for a in range(n):
        if C[a] != 0.0:
            for j in range(n):
                row[j] += C[a] * F[a, j]
            for j in range(columns):
                row[n + j] += C[a] * G[a, j]
    for d in range(3):
        for i in range(paths.shape[1]):
            if D[d, i] != 0.0:
                for k in range(COLUMNS):
                    row[n + i * COLUMNS + k] += D[d, i] * paths[d, i, k]


@compiled
def bay_transitions(
    motion_table, noise_table, table_spacing, C, D, wheels, spacing,
    interval, position, speed, acceleration, sample, first_step, first_row, sensor_of_row, bases_all,
    F_all, G_all, Q_all, rows,
):  # pragma: no cover  # fmt: skip
    """Fill F, G, Q and the measurement rows of every bay; without disturbances ``Q_all`` is empty.

    ``position``, ``speed`` and ``acceleration`` (steps + 1,) start with the state before the first step;
    ``sample`` (steps,) is the sample that the step ends at, or -1; bay b has the steps
    ``first_step[b]`` .. ``first_step[b + 1]`` and the rows ``first_row[b]`` .. ``first_row[b + 1]``;
    ``bases_all[b, i]`` is the index of the first coefficient that wheel i reaches.
    """
    n, w = F_all.shape[1], len(wheels)
    motion = np.empty((n, n + 4 * w))
    noise = np.empty((n, n))
    F_new, G_new, push = np.empty((n, n)), np.empty((n, w * COLUMNS)), np.empty((4 * w, COLUMNS))
    start, end = np.empty((3, w, COLUMNS)), np.empty((3, w, COLUMNS))
    scratch = np.empty((3, COLUMNS))
    last, disturbed = -1.0, Q_all.shape[1] > 0
    reached = np.zeros(n, np.bool_)
    for a in range(n):
        for node in range(noise_table.shape[0]):
            for order in range(noise_table.shape[1]):
                reached[a] |= noise_table[node, order, a, a] != 0.0
    shaken = np.flatnonzero(reached)
    for b in range(len(first_step) - 1):
        F, G, bases = F_all[b], G_all[b], bases_all[b]
        F[:, :] = 0.0
        G[:, :] = 0.0
        for a in range(n):
            F[a, a] = 1.0
        k0 = first_step[b]
        _paths(position[k0], speed[k0], acceleration[k0], wheels, spacing, bases, start, scratch)
        row = first_row[b]
        for k in range(k0, first_step[b + 1]):
            if interval[k] > 0.0:
                if interval[k] != last:
                    _evaluate(motion_table, table_spacing, interval[k], motion)
                    if disturbed:
                        _evaluate(noise_table, table_spacing, interval[k], noise)
                    last = interval[k]
                _paths(
                    position[k + 1], speed[k + 1], acceleration[k + 1],
                    wheels, spacing, bases, end, scratch,
                )  # fmt: skip
                _step(motion, interval[k], start, end, F, G, F_new, G_new, push)
                if disturbed:
                    _add_noise(motion, noise, shaken, Q_all[b], F_new)
                start, end = end, start
            while sample[k] >= 0 and row < first_row[b + 1] and sensor_of_row[row, 0] == sample[k]:
                sensor = sensor_of_row[row, 1]
                _row(C[sensor], D[sensor], start, F, G, rows[row])
                row += 1

"""Compiled kernels that simulate the smoother's model: samples from the prior, and the response to a known profile."""

from __future__ import annotations

import numpy as np

from trackprofile.kalman.kernels import move_means, newest_positions, oldest_positions
from trackprofile.kalman.transition_kernels import compiled


@compiled
def simulated(
    states, a1, a2, entering, accelerations, walk_steps, F_all, G_all, Q_all, slots_all, rows,
    first_row, newest, signals, knots,
):  # pragma: no cover  # fmt: skip
    """Samples from the prior and the model: ``signals`` (rows, m) without noise, ``knots`` (bays, m).

    ``states`` (size, m) starts as a sample of the initial state; ``entering`` (bays, m) are the innovations of the
    coefficients, ``accelerations`` (bays, n, m) standard normal numbers for the unmodelled accelerations,
    ``walk_steps`` (bays, flicker + sensors, m) the steps of flicker and offsets.
    """
    n, columns, m = F_all.shape[1], G_all.shape[2], signals.shape[1]
    ring = states.shape[0] - n
    moved, root = np.empty((n, m)), np.empty((n, n))
    for b in range(F_all.shape[0]):
        if b > 0:
            new, one, two = newest_positions(n, ring, newest + b)
            for s in range(m):
                states[new, s] = a1 * states[one, s] + a2 * states[two, s] + entering[b, s]
        slots = slots_all[b]
        for k in range(first_row[b], first_row[b + 1]):
            for s in range(m):
                signals[k, s] = 0.0
            for c in range(n + columns):
                index = c if c < n else slots[c - n]
                for s in range(m):
                    signals[k, s] += rows[k, c] * states[index, s]
        move_means(F_all[b], G_all[b], slots, states, moved)
        if Q_all.shape[1] > 0:
            _root(Q_all[b], root)
            for a in range(n):
                for c in range(a + 1):
                    for s in range(m):
                        states[a, s] += root[a, c] * accelerations[b, c, s]
        walking = walk_steps.shape[1]
        for i in range(walking):
            for s in range(m):
                states[n - walking + i, s] += walk_steps[b, i, s]
        one, two, three = oldest_positions(n, ring, newest + b)
        for s in range(m):
            knots[b, s] = (states[one, s] + 4.0 * states[two, s] + states[three, s]) / 6.0


@compiled
def _root(Q, root):  # pragma: no cover
    """Lower triangular root of a covariance that may be singular (Cholesky, a zero pivot gives a zero column)."""
    n = Q.shape[0]
    root[:, :] = 0.0
    for c in range(n):
        pivot = Q[c, c]
        for k in range(c):
            pivot -= root[c, k] ** 2
        if pivot > 1e-14 * Q[c, c]:
            root[c, c] = np.sqrt(pivot)
            for a in range(c + 1, n):
                value = Q[a, c]
                for k in range(c):
                    value -= root[a, k] * root[c, k]
                root[a, c] = value / root[c, c]


@compiled
def responded(
    state, coefficients, F_all, G_all, columns_of, rows, first_row, y
):  # pragma: no cover
    """y (rows,) ← signals of a run over a known profile; ``columns_of`` (bays, columns) index its coefficients."""
    n, columns = F_all.shape[1], G_all.shape[2]
    moved = np.empty(n)
    for b in range(F_all.shape[0]):
        indices = columns_of[b]
        for k in range(first_row[b], first_row[b + 1]):
            y[k] = 0.0
            for c in range(n):
                y[k] += rows[k, c] * state[c]
            for c in range(columns):
                y[k] += rows[k, n + c] * coefficients[indices[c]]
        for a in range(n):
            moved[a] = 0.0
            for c in range(n):
                moved[a] += F_all[b, a, c] * state[c]
            for c in range(columns):
                moved[a] += G_all[b, a, c] * coefficients[indices[c]]
        state[:] = moved

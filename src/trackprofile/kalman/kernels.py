"""Compiled kernels of the smoother's recursions (theory, section 7).

Forwards a Kalman filter, backwards the modified Bryson-Frazier recursion. The gains do not depend on the signals: they
are computed once, and several sets of signals are processed together. The result is the elevation at each knot,
r(x_j) = (c_j + 4 c_(j+1) + c_(j+2)) / 6, when c_j is the oldest coefficient in the ring.
"""

from __future__ import annotations

import numpy as np

from trackprofile.kalman.transition_kernels import compiled

BATCH = 8
"""Samples in one matrix product: small enough that no library distributes it over threads."""


@compiled
def covariances(
    P, a1, a2, innovation, F_all, G_all, Q_all, walk_all, slots_all, rows, variance,
    first_row, newest, gains, S, knots,
):  # pragma: no cover  # fmt: skip
    """Gains, innovation variances S, and the covariance row of the oldest knot at the end of each bay.

    P is the initial covariance and becomes the last one. The covariance Q of unmodelled accelerations and the walk of
    the last states, flicker and offsets, are added at the end of each bay.
    """
    size, n, walking = P.shape[0], F_all.shape[1], walk_all.shape[1]
    ring = size - n
    moved, p = np.empty((n, size)), np.empty(size)
    scaled = np.empty((BATCH, size))
    for b in range(F_all.shape[0]):
        if b > 0:
            _enter(P, a1, a2, innovation, n, ring, newest + b)
        slots, low, high = slots_all[b], first_row[b], first_row[b + 1]
        for m in range(low, high):
            row = rows[m]
            _times_row(P, row, slots, n, p)
            for before in range(low, m):
                dot = _dot_row(gains[before], row, slots, n) * S[before]
                for i in range(size):
                    p[i] -= dot * gains[before, i]
            S[m] = variance[m] + _dot_row(p, row, slots, n)
            for i in range(size):
                gains[m, i] = p[i] / S[m]
        for first in range(low, high, BATCH):
            last = min(first + BATCH, high)
            for m in range(first, last):
                scaled[m - first] = S[m] * gains[m]
            P -= np.dot(scaled[: last - first].T, gains[first:last])
        _move_covariance(P, F_all[b], G_all[b], slots, moved)
        for a in range(Q_all.shape[1]):
            for c in range(n):
                P[a, c] += Q_all[b, a, c]
        for i in range(n - walking, n):
            P[i, i] += walk_all[b, i - n + walking]
        one, two, three = oldest_positions(n, ring, newest + b)
        for j in range(size):
            knots[b, j] = (P[one, j] + 4.0 * P[two, j] + P[three, j]) / 6.0


@compiled
def oldest_positions(n, ring, newest):  # pragma: no cover
    """Positions of the three oldest coefficients; ``newest`` is the index of the newest one."""
    return n + (newest + 1) % ring, n + (newest + 2) % ring, n + (newest + 3) % ring


@compiled
def newest_positions(n, ring, newest):  # pragma: no cover
    """Positions of the newest coefficient and of the two before it."""
    return n + newest % ring, n + (newest - 1) % ring, n + (newest - 2) % ring


@compiled
def _enter(P, a1, a2, innovation, n, ring, newest):  # pragma: no cover
    """Replace the oldest coefficient by c_i = a1 c_(i-1) + a2 c_(i-2) + w."""
    new, one, two = newest_positions(n, ring, newest)
    size = P.shape[0]
    for j in range(size):
        P[new, j] = a1 * P[one, j] + a2 * P[two, j]
    P[new, new] = a1 * P[new, one] + a2 * P[new, two] + innovation
    for j in range(size):
        P[j, new] = P[new, j]


@compiled
def _times_row(P, row, slots, n, p):  # pragma: no cover
    """p ← P h for a symmetric P and a row h over the vehicle states and the slots."""
    p[:] = 0.0
    for c in range(len(row)):
        if row[c] != 0.0:
            index = c if c < n else slots[c - n]
            for j in range(len(p)):
                p[j] += row[c] * P[index, j]


@compiled
def _dot_row(vector, row, slots, n):  # pragma: no cover
    """h · vector."""
    value = 0.0
    for c in range(n):
        value += row[c] * vector[c]
    for c in range(len(slots)):
        value += row[n + c] * vector[slots[c]]
    return value


@compiled
def _move_covariance(P, F, G, slots, moved):  # pragma: no cover
    """P ← T P Tᵀ with T = [F G; 0 I]."""
    size, n, columns = P.shape[0], F.shape[0], G.shape[1]
    np.dot(F, P[:n], moved)
    entered = np.empty((columns, size))
    for c in range(columns):
        entered[c] = P[slots[c]]
    moved += np.dot(G, entered)
    for a in range(n):
        for c in range(a + 1):
            value = 0.0
            for j in range(n):
                value += moved[a, j] * F[c, j]
            for j in range(columns):
                value += moved[a, slots[j]] * G[c, j]
            P[a, c] = P[c, a] = value
        for j in range(n, size):
            P[a, j] = P[j, a] = moved[a, j]


@compiled
def move_means(F, G, slots, means, moved):  # pragma: no cover
    """x ← F x + G c for each signal."""
    n, columns, signals = F.shape[0], G.shape[1], means.shape[1]
    for a in range(n):
        moved[a, :] = 0.0
        for c in range(n):
            for s in range(signals):
                moved[a, s] += F[a, c] * means[c, s]
        for c in range(columns):
            for s in range(signals):
                moved[a, s] += G[a, c] * means[slots[c], s]
    means[:n] = moved


@compiled
def filtered(
    means, a1, a2, F_all, G_all, slots_all, rows, first_row, newest, gains, signals, knots
):  # pragma: no cover
    """Forward pass: ``signals`` (rows, m) become their innovations, ``knots`` (bays, m) the filtered means.

    ``means`` (size, m) starts as the prior mean and becomes the last one.
    """
    n, columns, m = F_all.shape[1], G_all.shape[2], signals.shape[1]
    ring = means.shape[0] - n
    moved = np.empty((n, m))
    for b in range(F_all.shape[0]):
        if b > 0:
            new, one, two = newest_positions(n, ring, newest + b)
            for s in range(m):
                means[new, s] = a1 * means[one, s] + a2 * means[two, s]
        slots = slots_all[b]
        for k in range(first_row[b], first_row[b + 1]):
            for c in range(n + columns):
                index = c if c < n else slots[c - n]
                for s in range(m):
                    signals[k, s] -= rows[k, c] * means[index, s]
            for i in range(means.shape[0]):
                for s in range(m):
                    means[i, s] += gains[k, i] * signals[k, s]
        move_means(F_all[b], G_all[b], slots, means, moved)
        one, two, three = oldest_positions(n, ring, newest + b)
        for s in range(m):
            knots[b, s] = (means[one, s] + 4.0 * means[two, s] + means[three, s]) / 6.0


@compiled
def smoothed(
    a1, a2, F_all, G_all, slots_all, rows, first_row, newest, gains, S, variance, covariance,
    signals, knots, offsets,
):  # pragma: no cover  # fmt: skip
    """Backward pass: ``knots`` become the smoothed elevations, ``signals`` the smoothed measurement noise.

    λ ← Tᵀ λ at a bay, λ ← λ - h (e/S + Kᵀ λ) at a sample; a knot's smoothed mean is m - P λ. The noise of a
    sample, given all data, is R (e/S + Kᵀ λ): the residual of the signal. ``offsets`` (bays, sensors)
    become -λ of the offsets, the last of the states, at the end of each bay, for the first of the signals.
    """
    n, columns, m = F_all.shape[1], G_all.shape[2], signals.shape[1]
    size = gains.shape[1]
    ring = size - n
    adjoint, moved, u = np.zeros((size, m)), np.empty((n, m)), np.empty(m)
    sensors = offsets.shape[1]
    for b in range(F_all.shape[0] - 1, -1, -1):
        for i in range(sensors):
            offsets[b, i] = -adjoint[n - sensors + i, 0]
        for j in range(size):
            for s in range(m):
                knots[b, s] -= covariance[b, j] * adjoint[j, s]
        F, G, slots = F_all[b], G_all[b], slots_all[b]
        moved[:, :] = adjoint[:n]
        adjoint[:n] = 0.0
        for a in range(n):
            for c in range(n):
                for s in range(m):
                    adjoint[c, s] += F[a, c] * moved[a, s]
            for c in range(columns):
                for s in range(m):
                    adjoint[slots[c], s] += G[a, c] * moved[a, s]
        for k in range(first_row[b + 1] - 1, first_row[b] - 1, -1):
            for s in range(m):
                u[s] = signals[k, s] / S[k]
            for i in range(size):
                for s in range(m):
                    u[s] += gains[k, i] * adjoint[i, s]
            for c in range(n + columns):
                index = c if c < n else slots[c - n]
                for s in range(m):
                    adjoint[index, s] -= rows[k, c] * u[s]
            for s in range(m):
                signals[k, s] = variance[k] * u[s]
        if b > 0:
            new, one, two = newest_positions(n, ring, newest + b)
            for s in range(m):
                adjoint[one, s] += a1 * adjoint[new, s]
                adjoint[two, s] += a2 * adjoint[new, s]
                adjoint[new, s] = 0.0


@compiled
def variances(
    a1, a2, F_all, G_all, slots_all, rows, first_row, newest, gains, S, covariance, result,
    precision, offsets,
):  # pragma: no cover  # fmt: skip
    """Posterior variance of each bay's oldest knot: P_jj - P_j Λ P_jᵀ, Λ the covariance of λ.

    ``precision`` (rows,) becomes the variance of e/S + Kᵀ λ, 1/S + Kᵀ Λ K, and ``offsets`` (bays, sensors) that of
    the offsets' λ, at the end of each bay.
    """
    n, bays = F_all.shape[1], F_all.shape[0]
    sensors = offsets.shape[1]
    size = gains.shape[1]
    ring = size - n
    max_rows = 1
    for b in range(bays):
        max_rows = max(max_rows, first_row[b + 1] - first_row[b])
    L, g = np.zeros((size, size)), np.empty((max_rows, size))
    W, V = np.empty((n, size)), np.empty((n, size))
    for b in range(bays - 1, -1, -1):
        for i in range(sensors):
            offsets[b, i] = L[n - sensors + i, n - sensors + i]
        one, two, three = oldest_positions(n, ring, newest + b)
        value = (covariance[b, one] + 4.0 * covariance[b, two] + covariance[b, three]) / 6.0
        for i in range(size):
            dot = 0.0
            for j in range(size):
                dot += L[i, j] * covariance[b, j]
            value -= covariance[b, i] * dot
        result[b] = value
        _pull_back(L, F_all[b], G_all[b], slots_all[b], W, V)
        _unmeasure(L, rows, slots_all[b], n, gains, S, first_row[b], first_row[b + 1], g, precision)
        if b > 0:
            new, one, two = newest_positions(n, ring, newest + b)
            for j in range(size):
                L[one, j] += a1 * L[new, j]
                L[two, j] += a2 * L[new, j]
            for j in range(size):
                L[j, one] += a1 * L[j, new]
                L[j, two] += a2 * L[j, new]
            for j in range(size):
                L[new, j] = L[j, new] = 0.0


@compiled
def _pull_back(L, F, G, slots, W, V):  # pragma: no cover
    """Λ ← Tᵀ Λ T with T = [F G; 0 I]; Λ_cc grows by Gᵀ V + Vᵀ G with V = Λ_xc + Λ_xx G / 2."""
    n, columns, size = F.shape[0], G.shape[1], L.shape[0]
    W[:, :] = L[:n]
    V[:, :] = L[:n]
    half, through = np.empty(size), np.empty((columns, size))
    for a in range(n):
        V[a, :n] = 0.0
        half[:columns] = 0.0
        for k in range(n):
            for c in range(columns):
                half[c] += L[a, k] * G[k, c]
        for c in range(columns):
            W[a, slots[c]] += half[c]
            V[a, slots[c]] += 0.5 * half[c]
    np.dot(G.T, V, through)
    for c in range(columns):
        for j in range(n, size):
            L[slots[c], j] += through[c, j]
    for j in range(n, size):
        for c in range(columns):
            L[j, slots[c]] += through[c, j]
    # W = [Λ_xx, Λ_xx G + Λ_xc]; its rows and its first n columns are then multiplied by F.
    L[:n] = np.dot(F.T, W)
    for a in range(n):
        for c in range(n):
            value = 0.0
            for k in range(n):
                value += L[a, k] * F[k, c]
            half[c] = value
        L[a, :n] = half[:n]
        for j in range(n, size):
            L[j, a] = L[a, j]


@compiled
def _unmeasure(L, rows, slots, n, gains, S, low, high, g, precision):  # pragma: no cover
    """Λ ← (I - K h)ᵀ Λ (I - K h) + hᵀ h / S for the samples of one bay, last first.

    Each sample adds -(h gᵀ + g hᵀ) with u = Λ K and g = u - (Kᵀ u + 1/S) h / 2; they are collected, then added.
    """
    size, width = L.shape[0], rows.shape[1]
    for first in range(low, high, BATCH):
        last = min(first + BATCH, high)
        np.dot(gains[first:last], L, g[first - low : last - low])
    for k in range(high - 1, low - 1, -1):
        u = g[k - low]
        for later in range(high - 1, k, -1):
            along, against = 0.0, _dot_row(gains[k], rows[later], slots, n)
            for j in range(size):
                along += g[later - low, j] * gains[k, j]
            for j in range(size):
                u[j] -= against * g[later - low, j]
            for c in range(width):
                u[c if c < n else slots[c - n]] -= along * rows[later, c]
        kappa = 1.0 / S[k]
        for j in range(size):
            kappa += gains[k, j] * u[j]
        precision[k] = kappa
        for c in range(width):
            u[c if c < n else slots[c - n]] -= 0.5 * kappa * rows[k, c]
    total = np.zeros((width, size))
    for first in range(low, high, BATCH):
        last = min(first + BATCH, high)
        total += np.dot(rows[first:last].T, g[first - low : last - low])
    for c in range(width):
        index = c if c < n else slots[c - n]
        for j in range(size):
            L[index, j] -= total[c, j]
    for j in range(size):
        for c in range(width):
            L[j, c if c < n else slots[c - n]] -= total[c, j]

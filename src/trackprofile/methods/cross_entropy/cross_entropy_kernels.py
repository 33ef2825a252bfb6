"""Compiled functions for one generation of the cross-entropy method (theory, section 6).

An elite is an array (m, size) of indices into the population, one row per elevation.
"""

from __future__ import annotations

import numba
import numpy as np

MINIMUM_EIGENVALUE_RATIO = 1e-6
"""Minimum eigenvalue of a covariance as a share of the largest; smaller ones are round-off or negative."""

VARIANCE_FLOOR = 1e-36
"""Variance added to keep a covariance positive definite, far below the round-off of any elevation, m²."""


@numba.njit(cache=True, nogil=True)
def draw_random_walks(generator, count, mean, deviation):  # pragma: no cover
    """Random walks (count, m): the mean of each elevation is the elevation before it (paper, equation 9)."""
    x = np.empty((count, len(mean)))
    for i in range(count):
        at = mean[0]
        for j in range(len(mean)):
            at += deviation * generator.standard_normal()
            x[i, j] = at
    return x


@numba.njit(cache=True, nogil=True)
def draw_normal(generator, count, mean, covariance):  # pragma: no cover
    """Normally distributed profiles (count, m)."""
    m = len(mean)
    # A nearly singular covariance, such as that of equal elite profiles, is kept positive definite.
    root = np.linalg.cholesky(covariance + np.diag(1e-12 * np.diag(covariance) + VARIANCE_FLOOR))
    x, z = np.empty((count, m)), np.empty(m)
    for i in range(count):
        for j in range(m):
            z[j] = generator.standard_normal()
            at = mean[j]
            for k in range(j + 1):
                at += root[j, k] * z[k]
            x[i, j] = at
    return x


@numba.njit(cache=True, nogil=True)
def misfits(gain, x, target, weight):  # pragma: no cover
    """Squared differences of G x and the target (sensors, scans), weighted, summed over the sensors, (count, scans)."""
    out = np.zeros((x.shape[0], target.shape[1]))
    for s in range(target.shape[0]):
        for i in range(x.shape[0]):
            for t in range(target.shape[1]):
                # G is lower triangular: no scan depends on an elevation ahead of it.
                difference = -target[s, t]
                for j in range(t + 1):
                    difference += gain[s, t, j] * x[i, j]
                out[i, t] += weight[s] * difference * difference
    return out


@numba.njit(cache=True, nogil=True)
def smallest(values, size):  # pragma: no cover
    """Indices of the ``size`` smallest values, sorted; by insertion, because an elite is small."""
    indices, count = np.empty(size, np.int64), 0
    for i in range(len(values)):
        if count == size and values[i] >= values[indices[size - 1]]:
            continue
        count = min(count + 1, size)
        at = count - 1
        while at > 0 and values[indices[at - 1]] > values[i]:
            indices[at] = indices[at - 1]
            at -= 1
        indices[at] = i
    return indices


@numba.njit(cache=True, nogil=True)
def elite_by_total(misfit, size):  # pragma: no cover
    """The profiles with the smallest O = ΣO_t, the same for every elevation (paper, equation 10)."""
    best = smallest(misfit.sum(axis=1), size)
    elite = np.empty((misfit.shape[1], size), np.int64)
    for t in range(misfit.shape[1]):
        elite[t] = best
    return elite


@numba.njit(cache=True, nogil=True)
def elite_by_scan(misfit, size):  # pragma: no cover
    """For each elevation, the profiles with the smallest O_t at its scan (paper, equation 11)."""
    elite = np.empty((misfit.shape[1], size), np.int64)
    for t in range(misfit.shape[1]):
        elite[t] = smallest(misfit[:, t], size)
    return elite


@numba.njit(cache=True, nogil=True)
def elite_mean(x, elite):  # pragma: no cover
    """Mean of each elevation over its elite, (m,)."""
    mean = np.empty(x.shape[1])
    for t in range(x.shape[1]):
        mean[t] = x[elite[t], t].mean()
    return mean


@numba.njit(cache=True, nogil=True)
def elite_variances(x, elite):  # pragma: no cover
    """Variance of each elevation over its elite, as a diagonal matrix, (m, m)."""
    size = elite.shape[1]
    covariance = np.zeros((x.shape[1], x.shape[1]))
    for t in range(x.shape[1]):
        covariance[t, t] = x[elite[t], t].var() * size / (size - 1)
    return covariance


@numba.njit(cache=True, nogil=True)
def elite_covariance(x, elite):  # pragma: no cover
    """Covariance (m, m) of the elevations; of a pair, over the elite of the later one, whose O_t depends on both."""
    m, size = elite.shape
    covariance = np.empty((m, m))
    for i in range(m):
        own = x[elite[i]]
        for j in range(i + 1):
            mean_i, mean_j = own[:, i].mean(), own[:, j].mean()
            total = 0.0
            for k in range(size):
                total += (own[k, i] - mean_i) * (own[k, j] - mean_j)
            covariance[i, j] = covariance[j, i] = total / (size - 1)
    return covariance


@numba.njit(cache=True, nogil=True)
def restore_positive_definite(covariance):  # pragma: no cover
    """The same variances with positive eigenvalues: pairwise covariances need not form a positive definite matrix."""
    values, vectors = np.linalg.eigh(covariance)
    corrected = (vectors * np.maximum(values, MINIMUM_EIGENVALUE_RATIO * values[-1])) @ vectors.T
    scale = np.sqrt(np.diag(covariance) / np.diag(corrected))
    return scale * corrected * scale.reshape(-1, 1)


@numba.njit(cache=True, nogil=True)
def update_distribution(
    x, misfit, size, per_scan, full, smoothing, mean, covariance
):  # pragma: no cover
    """Mean (m,) and covariance (m, m) of the next generation; O of the best profile; Σ(Δmean)²."""
    elite = elite_by_scan(misfit, size) if per_scan else elite_by_total(misfit, size)
    previous, mean = mean, elite_mean(x, elite)
    best, change = misfit.sum(axis=1).min(), np.square(mean - previous).sum()
    if not full:
        return mean, elite_variances(x, elite), best, change
    covariance = smoothing * covariance + (1 - smoothing) * elite_covariance(x, elite)
    return mean, restore_positive_definite(covariance) if per_scan else covariance, best, change

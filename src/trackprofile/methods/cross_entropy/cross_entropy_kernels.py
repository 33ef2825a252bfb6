"""One generation of the cross-entropy method: compiled, arrays in, arrays out (theory, section 6)."""

from __future__ import annotations

import numba
import numpy as np

MINIMUM_EIGENVALUE_RATIO = 1e-6
"""Of the largest variance, below which a direction of pairwise covariances is taken for rounding or worse."""

VARIANCE_FLOOR = 1e-36
"""m², far below the rounding of any elevation."""


@numba.njit(cache=True, nogil=True)
def draw_random_walks(generator, count, mean, deviation):  # pragma: no cover
    """Profiles (count, m) of which each elevation has the one before it as its mean (paper, equation 9)."""
    x = np.empty((count, len(mean)))
    for i in range(count):
        at = mean[0]
        for j in range(len(mean)):
            at += deviation * generator.standard_normal()
            x[i, j] = at
    return x


@numba.njit(cache=True, nogil=True)
def draw_normal(generator, count, mean, covariance):  # pragma: no cover
    """Profiles (count, m), normally distributed."""
    m = len(mean)
    # All but singular, or an elite of equals: a hair of each variance, and of a metre, keeps it positive.
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
def misfits(gain, x, due, weight):  # pragma: no cover
    """Weighted squared differences (count, scans) of G x to what is due (sensors, scans), summed over the sensors."""
    out = np.zeros((x.shape[0], due.shape[1]))
    for s in range(due.shape[0]):
        for i in range(x.shape[0]):
            for t in range(due.shape[1]):
                # G is triangular: no scan feels an elevation that lies ahead.
                difference = -due[s, t]
                for j in range(t + 1):
                    difference += gain[s, t, j] * x[i, j]
                out[i, t] += weight[s] * difference * difference
    return out


@numba.njit(cache=True, nogil=True)
def smallest(values, size):  # pragma: no cover
    """Where the ``size`` least values stand, in their order: by insertion, for an elite is small."""
    found, count = np.empty(size, np.int64), 0
    for i in range(len(values)):
        if count == size and values[i] >= values[found[size - 1]]:
            continue
        count = min(count + 1, size)
        at = count - 1
        while at > 0 and values[found[at - 1]] > values[i]:
            found[at] = found[at - 1]
            at -= 1
        found[at] = i
    return found


@numba.njit(cache=True, nogil=True)
def elite_by_total(misfit, size):  # pragma: no cover
    """The profiles of least O = ΣO_t, the same for each elevation (m, size) (paper, equation 10)."""
    best = smallest(misfit.sum(axis=1), size)
    elite = np.empty((misfit.shape[1], size), np.int64)
    for t in range(misfit.shape[1]):
        elite[t] = best
    return elite


@numba.njit(cache=True, nogil=True)
def elite_by_scan(misfit, size):  # pragma: no cover
    """For each elevation the profiles of least O_t at its scan (m, size) (paper, equation 11)."""
    elite = np.empty((misfit.shape[1], size), np.int64)
    for t in range(misfit.shape[1]):
        elite[t] = smallest(misfit[:, t], size)
    return elite


@numba.njit(cache=True, nogil=True)
def elite_mean(x, elite):  # pragma: no cover
    """Mean of each elevation over its elite (m,)."""
    mean = np.empty(x.shape[1])
    for t in range(x.shape[1]):
        mean[t] = x[elite[t], t].mean()
    return mean


@numba.njit(cache=True, nogil=True)
def elite_variances(x, elite):  # pragma: no cover
    """Variance of each elevation over its elite, as a diagonal matrix (m, m)."""
    size = elite.shape[1]
    covariance = np.zeros((x.shape[1], x.shape[1]))
    for t in range(x.shape[1]):
        covariance[t, t] = x[elite[t], t].var() * size / (size - 1)
    return covariance


@numba.njit(cache=True, nogil=True)
def elite_covariance(x, elite):  # pragma: no cover
    """Covariance (m, m) of the elevations; of a pair over the elite of the later one, whose O_t feels both."""
    m, size = elite.shape
    covariance = np.empty((m, m))
    for i in range(m):
        own = x[elite[i]]
        for j in range(i + 1):
            at_i, at_j = own[:, i].mean(), own[:, j].mean()
            total = 0.0
            for k in range(size):
                total += (own[k, i] - at_i) * (own[k, j] - at_j)
            covariance[i, j] = covariance[j, i] = total / (size - 1)
    return covariance


@numba.njit(cache=True, nogil=True)
def restore_positive_definite(covariance):  # pragma: no cover
    """The same variances, without negative ones in any direction: pairwise covariances need not be a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    mended = (vectors * np.maximum(values, MINIMUM_EIGENVALUE_RATIO * values[-1])) @ vectors.T
    scale = np.sqrt(np.diag(covariance) / np.diag(mended))
    return scale * mended * scale.reshape(-1, 1)


@numba.njit(cache=True, nogil=True)
def update_distribution(
    x, misfit, size, per_scan, full, smoothing, mean, covariance
):  # pragma: no cover
    """Mean (m,) and covariance (m, m) from which the next generation is drawn; O of the best profile, Σ(Δmean)²."""
    elite = elite_by_scan(misfit, size) if per_scan else elite_by_total(misfit, size)
    before, mean = mean, elite_mean(x, elite)
    best, moved = misfit.sum(axis=1).min(), np.square(mean - before).sum()
    if not full:
        return mean, elite_variances(x, elite), best, moved
    covariance = smoothing * covariance + (1 - smoothing) * elite_covariance(x, elite)
    return mean, restore_positive_definite(covariance) if per_scan else covariance, best, moved

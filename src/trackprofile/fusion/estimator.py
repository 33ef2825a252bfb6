"""The level and its rate, given all passes at once: what each pass counts in each wave.

In one wave pass i of vehicle v, τ_i after the mean day, has the estimate m_i = G_i (a + ρ τ_i + u_v + n_i)
of the level a and the rate ρ, with the density λ_i N_i of n_i, N_i = P_i/G_i, and U_v of what all
passes of the vehicle share. All being Gaussian, the estimate is Σ_i k_i m_i, with k from two normal
equations out of which the u_v are eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.spectral_bands import LENGTHS, RANGES
from trackprofile.fusion.stack import PassStack, smooth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

_LEAST = 1e-9  # 1/(m²/(rad/m)), where no pass is: the level is then free
_WIDEST = 10.0  # change over the passes' span, in units of the level, that is not ruled out


@dataclass(frozen=True, eq=False)
class Trust:
    """What is made of the passes' own word.

    Parameters
    ----------
    louder : λ, the variance of each pass's error over the stated (n, waves)
    local : what stretches add to that as a factor (n, ranges, k)
    used : whether a pass is not left out (n)
    shared : ξ, the variance of what passes of one vehicle share, over that of the track (vehicles, ranges)
    hidden : the same over what the passes state, where only they can tell (ranges)
    vehicle : number of each pass's vehicle (n)
    """

    louder: Array
    local: Array
    used: Mask
    shared: Array
    hidden: Array
    vehicle: Indices


@dataclass(frozen=True, eq=False)
class EstimatorWeights:
    """Of one wave, at each place.

    Parameters
    ----------
    level, rate : what a metre of each pass's estimate adds (n, k) [-], [1/day]
    held : of the reference's metre, by the prior (2, k) [-], [1/day]
    variance : of the level, its covariance with the rate, and the rate's (3, k) [m²/(rad/m)], per day, per day²
    standing : variance of the level where the track is known to stand (k) [m²/(rad/m)]
    """

    level: Array
    rate: Array
    held: Array
    variance: Array
    standing: Array


def range_of(wave: int) -> int:
    """Number of the range in which a wave lies."""
    return next(i for i, one in enumerate(RANGES) if wave in one.numbers)


RANGE_OF: Indices = np.array([range_of(wave) for wave in range(LENGTHS.size)])


def weights(laid: PassStack, wave: int, days: Array, trust: Trust, day: float) -> EstimatorWeights:
    """What each pass counts for the level on a day, and for its rate.

    Parameters
    ----------
    days : of the passes (n), about their mean
    day : on which the level is wanted, about the same
    """
    number = RANGE_OF[wave]
    G, S = laid.gain(wave), laid.before(wave)
    step = float(laid.places[1] - laid.places[0])
    local = np.exp(smooth(np.log(trust.local[:, number]), LENGTHS[wave] / step))
    louder = trust.louder[:, wave, None] * local
    error = louder * (laid.stated[:, wave] + G * laid.misplaced(wave))
    # Per metre of the estimate m_i, and per metre of the level itself: a_i = 1/(λ_i N_i) = G_i/(λ_i P_i).
    told = trust.used[:, None] * laid.cover(wave) / error
    a = G * told
    known = a.sum(axis=0) > 0
    shared = _shared(laid, wave, trust)
    of_vehicle = np.eye(shared.shape[0])[trust.vehicle].T
    A, B = of_vehicle @ a, of_vehicle @ (days[:, None] * a)
    k = shared / (1.0 + shared * A)
    J = np.stack([(a.sum(axis=0) - (k * A**2).sum(axis=0)), B.sum(axis=0) - (k * A * B).sum(axis=0),
                  (days[:, None] ** 2 * a).sum(axis=0) - (k * B**2).sum(axis=0)])  # fmt: skip
    J[0] += max(1.0 / S, _LEAST)
    span = float(np.ptp(days))
    J[2] += (max(span, 1.0) / _WIDEST) ** 2 / laid.prior[:, wave].max()
    determinant = J[0] * J[2] - J[1] ** 2
    C = np.stack([J[2], -J[1], J[0]]) / determinant
    # Level on the day asked for: (1, day) of (level on the mean day, rate).
    row = np.stack([C[0] + day * C[1], C[1] + day * C[2]])
    v = trust.vehicle
    h = np.stack([1.0 - (k * A)[v], days[:, None] - (k * B)[v]])
    level = np.where(known, (row[0] * h[0] + row[1] * h[1]) * told, 0.0)
    rate = np.where(known, (C[1] * h[0] + C[2] * h[1]) * told, 0.0)
    variance = np.stack([row[0] + day * row[1], row[1], C[2]])
    alike = laid.alike(wave)
    variance[0] += _not_averaged(level, alike, louder)
    standing = np.where(known, h[0] * told / J[0], 0.0)
    held = np.stack([row[0], C[1]]) / S
    return EstimatorWeights(
        level, rate, held, variance, 1.0 / J[0] + _not_averaged(standing, alike, louder)
    )


def _not_averaged(weight: Array, alike: Array, louder: Array) -> Array:
    """What the prior makes all passes err alike does not average out: what it adds to the variance of their sum."""
    return (weight * np.sqrt(alike)).sum(axis=0) ** 2 - (weight**2 * louder * alike).sum(axis=0)


def _shared(laid: PassStack, wave: int, trust: Trust) -> Array:
    """Density of what the passes of each vehicle share (vehicles, k) [m²/(rad/m)]."""
    number = RANGE_OF[wave]
    by_track = trust.shared[:, number, None] * laid.strength(wave)
    stated = 1.0 / np.mean(1.0 / laid.stated[:, wave], axis=0)
    return by_track + trust.hidden[number] * stated

"""All passes together: the line's level on a day, its rate, and how sure both are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from trackprofile.fusion.change_detection import detect_changes
from trackprofile.fusion.estimator import Trust, weights
from trackprofile.fusion.spectral_bands import ALL, INTEGRALS, LENGTHS, RANGES, WIDTH, Range
from trackprofile.fusion.stack import PassStack, smooth

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Combined:
    """What all passes together say.

    Parameters
    ----------
    level : on the day (m) [m]
    error : its spectrum (waves, k) [m²/(rad/m)]
    rate : (m) [m/day]; 0 where all passes are of one day
    rate_error : its spectrum (waves, k) [(m/day)²/(rad/m)]
    moves : probability that a place moves, in each range (ranges, k)
    """

    level: Array
    error: Array
    rate: Array
    rate_error: Array
    moves: Array


@dataclass(frozen=True, eq=False)
class _Fit:
    """Of one range of waves: the level of track that stands, what a rate adds to it, and the rate.

    With the covariance c of level l and rate ρ, and the variance s² of the rate, track that stands has the level
    l - ρ c/s², and knows it better by c²/s².
    """

    standing: Array
    by_rate: Array
    rate: Array
    error: Array
    error_by_rate: Array
    rate_error: Array


def combine(laid: PassStack, days: Array, trust: Trust, day: float) -> Combined:
    """Weigh all passes, wave by wave, and believe a rate where track moves.

    Parameters
    ----------
    days, day : of the passes (n), and that of the level, about the passes' mean day
    """
    timed = float(np.ptp(days)) > 0
    level, rate = laid.reference.copy(), np.zeros(laid.distance.size)
    error, rate_error = np.zeros((2, LENGTHS.size, laid.places.size))
    moves = np.zeros((len(RANGES), laid.places.size))
    covered = np.asarray((laid.inside > 0).any(axis=0))
    for number, part in enumerate(RANGES):
        fit = _fitted(laid, part, days, trust, day if timed else 0.0)
        error[part.waves] = fit.error
        level += fit.standing
        # Of longer waves no pass says how well it knows them, and they differ by millimetres: they tell no rate.
        if timed and part is not RANGES[-1]:
            width = INTEGRALS[ALL][part.waves]
            found = detect_changes(
                np.interp(laid.places, laid.distance, fit.rate),
                np.sqrt(width @ fit.rate_error),
                covered,
                2 * float(WIDTH[part.waves].sum() * np.ptp(laid.distance)),
            )
            # What is believed must not change sooner than its waves, or it makes new ones: it begins before.
            wide = float(LENGTHS[part.waves][0] / (laid.places[1] - laid.places[0]))
            p = smooth(maximum_filter1d(found.probability, max(1, round(3 * wide))), wide)
            q = smooth(found.kept, wide)
            moves[number] = p
            level += laid.along(p * q) * fit.by_rate
            rate += laid.along(p * q) * fit.rate
            for into, by, value in (
                (error, fit.error_by_rate, fit.by_rate),
                (rate_error, fit.rate_error, fit.rate),
            ):
                # Of a mixture: what each case leaves open, and how far the two cases lie apart.
                apart = np.interp(laid.places, laid.distance, value) ** 2
                into[part.waves] += by * (p * q + p * (1 - p) * q**2 * apart / (width @ by))
    return Combined(level, error, rate, rate_error, moves)


def _fitted(laid: PassStack, part: Range, days: Array, trust: Trust, day: float) -> _Fit:
    standing, by_rate, rate = np.zeros((3, laid.distance.size))
    error, by_error, rate_error = np.zeros((3, len(part.numbers), laid.places.size))
    for row, wave in enumerate(part.numbers):
        one = weights(laid, wave, days, trust, day)
        beside, of_line = laid.beside(wave), laid.whole.wave(wave)
        level = _sum(laid, one.level, beside) - laid.along(one.held[0]) * of_line
        change = _sum(laid, one.rate, beside) - laid.along(one.held[1]) * of_line
        slope = one.variance[1] / one.variance[2]
        moved = laid.along(slope) * change
        standing += level - moved
        by_rate += moved
        rate += change
        by_error[row] = np.maximum(slope * one.variance[1], 1e-300)
        error[row] = one.standing
        rate_error[row] = one.variance[2]
    return _Fit(standing, by_rate, rate, error, by_error, rate_error)


def _sum(laid: PassStack, weight: Array, beside: Array) -> Array:
    return np.sum(laid.along(weight) * beside, axis=0)


def without_each(laid: PassStack, trust: Trust) -> Array:
    """The line as all other passes see it, for each pass; NaN where there is no other (n, m) [m]."""
    still = np.zeros(len(laid.passes))
    found = np.repeat(laid.reference[None], len(laid.passes), axis=0)
    alone = np.zeros(found.shape, bool)
    for wave in range(LENGTHS.size):
        one = weights(laid, wave, still, trust, 0.0)
        G = laid.along(laid.gain(wave))
        told = laid.along(one.level / one.variance[0])
        mine = told * laid.beside(wave)
        rest = (told * G).sum(axis=0) - told * G
        alone |= rest <= 0
        found += (mine.sum(axis=0) - mine) / np.where(rest > 0, rest, np.inf)
    return np.where(alone, np.nan, found)

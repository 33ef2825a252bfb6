"""Level of the line on a day and its rate of change, from all passes by generalised least squares.

The weights of each subband (`generalised_least_squares`) apply to deviations from the reference profile. The rate is
then reduced by the probability that track changes (`change_detection`): unchanged track has no rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from trackprofile.fusion.change_detection import detect_changes
from trackprofile.fusion.generalised_least_squares import PassErrorModel, least_squares_weights
from trackprofile.fusion.spectral_bands import (
    ALL_WAVELENGTHS,
    BAND_INTEGRALS,
    CENTRE_WAVELENGTHS,
    RANGES,
    SUBBAND_WIDTHS,
    WavelengthRange,
)
from trackprofile.fusion.stack import PassStack, moving_average

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CombinedProfile:
    """Estimate of the line from all passes.

    Parameters
    ----------
    level : elevation on the day (points) [m]
    error_density : density of its error (subbands, nodes) [m²/(rad/m)]
    rate : rate of change (points) [m/day]; 0 if all passes are of one day
    rate_error_density : density of its error (subbands, nodes) [(m/day)²/(rad/m)]
    change_probability : probability that track changes, in each range (ranges, nodes)
    """

    level: Array
    error_density: Array
    rate: Array
    rate_error_density: Array
    change_probability: Array


@dataclass(frozen=True, eq=False)
class _RangeFit:
    """Fit of one range of wavelengths: level of unchanged track, contribution of the rate to it, and the rate.

    With the covariance c of level l and rate ρ, and the variance s² of the rate, unchanged track (ρ = 0) has the level
    l - ρ c/s², of a variance that is smaller by c²/s².
    """

    unchanged: Array
    rate_part: Array
    rate: Array
    error_density: Array
    rate_part_error_density: Array
    rate_error_density: Array


def combine(stack: PassStack, days: Array, errors: PassErrorModel, day: float) -> CombinedProfile:
    """Estimate level and rate in each subband, and reduce the rate by the probability that track changes.

    With the probability p of change and the shrinkage factor q, the rate is p q ρ; its error is that of a mixture,
    p q s² + p (1 - p) q² ρ².

    Parameters
    ----------
    stack : the passes
    days : days of the passes, relative to their mean (n) [day]
    errors : error variances of the passes
    day : day of the level, relative to the same mean [day]
    """
    has_rate = float(np.ptp(days)) > 0
    level, rate = stack.reference.copy(), np.zeros(stack.distance.size)
    density, rate_density = np.zeros((2, CENTRE_WAVELENGTHS.size, stack.nodes.size))
    change_probability = np.zeros((len(RANGES), stack.nodes.size))
    for number, part in enumerate(RANGES):
        fit = _fit_range(stack, part, days, errors, day if has_rate else 0.0)
        density[part.subbands] = fit.error_density
        level += fit.unchanged
        # Beyond D3 profiles state no standard deviation and differ by millimetres: these give no rate.
        if has_rate and part is not RANGES[-1]:
            p, q = _change(stack, part, fit)
            change_probability[number] = p
            level += stack.interpolate(p * q) * fit.rate_part
            rate += stack.interpolate(p * q) * fit.rate
            density[part.subbands] += _mixture_density(
                stack, part, p, q, (fit.rate_part_error_density, fit.rate_part)
            )
            rate_density[part.subbands] += _mixture_density(
                stack, part, p, q, (fit.rate_error_density, fit.rate)
            )
    return CombinedProfile(level, density, rate, rate_density, change_probability)


def _change(stack: PassStack, part: WavelengthRange, fit: _RangeFit) -> tuple[Array, Array]:
    """Probability p of change and shrinkage factor q of the rate, smoothed along the line (nodes)."""
    width = BAND_INTEGRALS[ALL_WAVELENGTHS][part.subbands]
    change = detect_changes(
        np.interp(stack.nodes, stack.distance, fit.rate),
        np.sqrt(width @ fit.rate_error_density),
        np.asarray((stack.edge_distance > 0).any(axis=0)),
        2 * float(SUBBAND_WIDTHS[part.subbands].sum() * np.ptp(stack.distance)),
    )
    # A factor that varied faster than the wavelengths would create new ones; it therefore rises before the change.
    spacing = stack.nodes[1] - stack.nodes[0]
    wavelength = float(CENTRE_WAVELENGTHS[part.subbands][0] / spacing)
    widened = maximum_filter1d(change.probability, max(1, round(3 * wavelength)))
    return moving_average(widened, wavelength), moving_average(change.shrinkage, wavelength)


def _mixture_density(
    stack: PassStack, part: WavelengthRange, p: Array, q: Array, fitted: tuple[Array, Array]
) -> Array:
    """Error density of p q x, for x with an error density and a value that is zero on unchanged track."""
    density, value = fitted
    square = np.interp(stack.nodes, stack.distance, value) ** 2
    width = BAND_INTEGRALS[ALL_WAVELENGTHS][part.subbands]
    return density * (p * q + p * (1 - p) * q**2 * square / (width @ density))


def _fit_range(
    stack: PassStack, part: WavelengthRange, days: Array, errors: PassErrorModel, day: float
) -> _RangeFit:
    unchanged, rate_part, rate = np.zeros((3, stack.distance.size))
    density, part_density, rate_density = np.zeros((3, len(part.indices), stack.nodes.size))
    for row, subband in enumerate(part.indices):
        weights = least_squares_weights(stack, subband, days, errors, day)
        deviation = stack.deviation_from_reference(subband)
        reference = stack.reference_decomposition.subband(subband)
        level = (
            _weighted_sum(stack, weights.level, deviation)
            - stack.interpolate(weights.prior[0]) * reference
        )
        change = (
            _weighted_sum(stack, weights.rate, deviation)
            - stack.interpolate(weights.prior[1]) * reference
        )
        slope = weights.variance[1] / weights.variance[2]
        by_rate = stack.interpolate(slope) * change
        unchanged += level - by_rate
        rate_part += by_rate
        rate += change
        part_density[row] = np.maximum(slope * weights.variance[1], 1e-300)
        density[row] = weights.variance_without_rate
        rate_density[row] = weights.variance[2]
    return _RangeFit(unchanged, rate_part, rate, density, part_density, rate_density)


def _weighted_sum(stack: PassStack, weight: Array, deviation: Array) -> Array:
    return np.sum(stack.interpolate(weight) * deviation, axis=0)


def combine_others(stack: PassStack, errors: PassErrorModel) -> Array:
    """Profile of the line from all other passes, for each pass; NaN where there is no other (n, points) [m]."""
    no_rate = np.zeros(len(stack.passes))
    profiles = np.repeat(stack.reference[None], len(stack.passes), axis=0)
    alone = np.zeros(profiles.shape, bool)
    for subband in range(CENTRE_WAVELENGTHS.size):
        weights = least_squares_weights(stack, subband, no_rate, errors, 0.0)
        G = stack.interpolate(stack.gain(subband))
        precision = stack.interpolate(weights.level / weights.variance[0])
        own = precision * stack.deviation_from_reference(subband)
        others = (precision * G).sum(axis=0) - precision * G
        alone |= others <= 0
        profiles += (own.sum(axis=0) - own) / np.where(others > 0, others, np.inf)
    return np.where(alone, np.nan, profiles)

"""Spectral density of a profile's error, from the standard deviations that the profile states.

A profile states the standard deviation s of its error and s_D1, s_D2, s_D3 in the bands. Its error is the posterior
density P of a Gaussian estimate with the prior S and the density N of the measurement error,

    1/P(Ω) = 1/N(Ω) + 1/S(Ω),      ∫|H_D|² P dΩ = s_D²,      ∫P dΩ = s².

log N is piecewise linear in log Ω between the centres of the bands and continues with the outer slopes; S has the form
of the FRA spectra (theory, section 7), 1/S ∝ (1 + Ω²/Ω_1²)(1 + Ω²/Ω_2²), with the level that s requires.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.bands import BANDS
from trackprofile.errors import DataError
from trackprofile.fusion.spectral_bands import (
    ALL_WAVELENGTHS,
    BAND_INTEGRALS,
    CENTRE_FREQUENCIES,
    CENTRE_WAVELENGTHS,
)

Array = NDArray[np.float64]

NODE_SPACING = 5.0
"""Distance between the nodes, at which spectra and weights are computed [m]."""

MIN_STANDARD_DEVIATION = 1e-9
"""Lower bound of a stated standard deviation, for a profile that counts as exact [m]."""

PRIOR_CORNERS = (0.0206, 0.825)
"""Corner frequencies Ω_1, Ω_2 of the prior: flat below the first, Ω^-2, then Ω^-4 above the second [rad/m]."""

_MIN_EXPONENT, _DEFAULT_EXPONENT, _MAX_EXPONENT = 2.0, 4.0, 6.0
"""p of N ∝ Ω^-p outside the bands; 4 is an accelerometer's white noise, integrated twice."""

_MAX_ITERATIONS, _TOLERANCE = 60, 1e-6
"""Iterations, and change of log S at which they end."""

_MIN_NOISE_SHARE = 0.05
"""Lower bound of N in a band, as a share of the density that is constant over the band."""

_MIN_LONG_WAVE_SHARE = 1e-3
"""Lower bound of the share of the whole variance that wavelengths beyond the bands have."""

_BAND_CENTRES = {band.name: np.sqrt(band.shortest * band.longest) for band in BANDS}


@dataclass(frozen=True, eq=False)
class StatedSpectra:
    """Spectral densities that have the standard deviations a profile states.

    Parameters
    ----------
    error : density P of the profile's error (subbands, nodes) [m²/(rad/m)]
    prior : density S of the track before the pass, as the estimate assumed it (subbands) [m²/(rad/m)]
    """

    error: Array
    prior: Array


def spectra_from_standard_deviations(profile: xr.Dataset, nodes: Array, name: str) -> StatedSpectra:
    """Spectral densities of a profile's error along the line, and of its prior.

    Parameters
    ----------
    profile : profile contract
    nodes : distances at which the densities are computed (nodes) [m]
    name : name of the pass, for messages

    Raises
    ------
    DataError : the profile does not state its standard deviation, or not in any band.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> ones = np.ones(400)
    >>> profile = build_profile(
    ...     np.arange(400.0), 0 * ones, kind="posterior", standard_deviation=4e-3 * ones,
    ...     band_standard_deviations={"D1": 3e-5 * ones, "D2": 8e-4 * ones})
    >>> spectra_from_standard_deviations(profile, np.array([200.0]), "may.nc").error.shape
    (27, 1)
    """
    variances = {
        (_band_of(str(variable)) or ALL_WAVELENGTHS): _variance_at(profile, str(variable), nodes)
        for variable in profile.data_vars
        if str(variable).startswith("standard_deviation")
    }
    in_bands = {band.name: variances[band.name] for band in BANDS if band.name in variances}
    if ALL_WAVELENGTHS not in variances or not in_bands:
        raise DataError(
            f"{name}: the profile does not state its standard deviation, or states it in no band, so that it has no "
            "weight; give the profile as infer wrote it, as .nc, or with the columns standard_deviation_m, "
            "standard_deviation_D1_m ..."
        )
    return _fit_spectra(in_bands, variances[ALL_WAVELENGTHS])


def _band_of(variable: str) -> str:
    return variable.removeprefix("standard_deviation").removeprefix("_")


def _variance_at(profile: xr.Dataset, variable: str, nodes: Array) -> Array:
    """Mean variance over one longest wavelength of the band around each node (nodes) [m²].

    The average removes the sampling noise of standard deviations that come from posterior samples.
    """
    distance, deviation = profile["distance"].to_numpy(), profile[variable].to_numpy()
    known = np.isfinite(deviation)
    distance = distance[known]
    variance = np.maximum(deviation[known], MIN_STANDARD_DEVIATION) ** 2
    if distance.size < 2:
        return np.full(nodes.size, MIN_STANDARD_DEVIATION**2)
    cumulative = np.concatenate(
        [[0.0], np.cumsum(0.5 * (variance[1:] + variance[:-1]) * np.diff(distance))]
    )
    half = 0.5 * {band.name: band.longest for band in BANDS}.get(_band_of(variable), 0.0)
    half = max(half, 0.5 * NODE_SPACING)
    centre = np.clip(nodes, distance[0], distance[-1])
    low, high = np.maximum(centre - half, distance[0]), np.minimum(centre + half, distance[-1])
    integral = np.interp(high, distance, cumulative) - np.interp(low, distance, cumulative)
    return integral / (high - low)


def _fit_spectra(band_variances: Mapping[str, Array], total_variance: Array) -> StatedSpectra:
    """Fixed-point iteration that scales N in each band, and the level of S, to the stated variances."""
    centres = np.log([_BAND_CENTRES[name] for name in band_variances])
    target, weight = (
        np.stack([by_band[name] for name in band_variances])
        for by_band in (band_variances, BAND_INTEGRALS)
    )
    longest = max(band.longest for band in BANDS if band.name in band_variances)
    beyond = longest < CENTRE_WAVELENGTHS
    log_noise = np.log(target / weight.sum(axis=1)[:, None])
    min_noise, log_prior = log_noise + np.log(_MIN_NOISE_SHARE), log_noise[-1] + 4.0
    shape = _prior_shape()
    prior = density = np.empty(0)
    for _ in range(_MAX_ITERATIONS):
        prior = np.exp(log_prior) * shape
        density = 1.0 / (np.exp(-_log_density(centres, log_noise)) + 1.0 / prior)
        # Near the ends of a pass a band's error comes from longer wavelengths, which its filter lets through.
        log_noise = np.maximum(log_noise + np.log(target / (weight @ density)), min_noise)
        contributions = BAND_INTEGRALS[ALL_WAVELENGTHS][:, None] * density
        long_waves = contributions[beyond].sum(axis=0)
        required = total_variance - contributions[~beyond].sum(axis=0)
        correction = np.log(
            np.maximum(required, _MIN_LONG_WAVE_SHARE * total_variance) / long_waves
        )
        log_prior += correction
        if np.abs(correction).max(initial=0.0) < _TOLERANCE:
            break
    return StatedSpectra(density, np.median(prior, axis=1))


def _prior_shape() -> Array:
    """1/((1 + Ω²/Ω_1²)(1 + Ω²/Ω_2²)) at the subbands (subbands, 1)."""
    first, second = PRIOR_CORNERS
    omega = CENTRE_FREQUENCIES
    return 1.0 / ((1.0 + (omega / first) ** 2) * (1.0 + (omega / second) ** 2))[:, None]


def _log_density(anchors: Array, heights: Array) -> Array:
    """Logarithm of a density at all subbands (subbands, nodes): piecewise linear between the anchors.

    Outside the outer anchors the slope is the outer one, limited to the range of exponents.
    """
    at = np.log(CENTRE_WAVELENGTHS)
    if anchors.size == 1:
        return heights + _DEFAULT_EXPONENT * (at - anchors)[:, None]
    slopes = np.diff(heights, axis=0) / np.diff(anchors)[:, None]
    piece = np.clip(np.searchsorted(anchors, at) - 1, 0, anchors.size - 2)
    offset = at[:, None] - anchors[piece][:, None]
    line = heights[piece] + slopes[piece] * offset
    for outside, end, slope in (
        (at < anchors[0], 0, slopes[0]),
        (at > anchors[-1], -1, slopes[-1]),
    ):
        limited = np.clip(slope, _MIN_EXPONENT, _MAX_EXPONENT)
        line[outside] = heights[end] + limited * (at[outside] - anchors[end])[:, None]
    return line

"""Decomposition of a profile into half-octave subbands, and standard deviations from spectral densities.

Subband j has the centre wavelength L_j = 2^(j/2) m and the gain

    T_j(Ω) = cos²(π/2 |2 log2(2π/Ω) - j|)  for |2 log2(2π/Ω) - j| < 1, else 0,      Σ_j T_j(Ω) = 1,

so that the subbands of a profile add up to the profile. Passes differ in the wavelengths that they determine well;
fusion therefore estimates variances and weights for each subband.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dst, idst

from trackprofile.arrays import runs
from trackprofile.bands import BANDS, gain

Array = NDArray[np.float64]

CENTRE_WAVELENGTHS = np.asarray(2.0 ** (0.5 * np.arange(27)), np.float64)
"""Centre wavelengths of the subbands [m]; the first and last subband also take all shorter or longer wavelengths."""

CENTRE_FREQUENCIES: Array = 2 * np.pi / CENTRE_WAVELENGTHS
"""Spatial angular frequencies of the centre wavelengths [rad/m]."""

ALL_WAVELENGTHS = "all"
"""Key of the whole elevation, next to the names of the bands D1, D2 and D3."""

_INTEGRATION_GRID = np.concatenate([[0.0], np.geomspace(1e-5, 4 * np.pi, 20001)])
"""Ω from wavelengths far beyond the last subband, where densities are flat, to the shortest of the grid [rad/m]."""


@dataclass(frozen=True)
class WavelengthRange:
    """Neighbouring subbands that share one set of variance components.

    Parameters
    ----------
    name : name of the band (D1, D2, D3) that holds the subbands, or ``shorter`` or ``longer``
    subbands : indices of the subbands
    """

    name: str
    subbands: slice

    @property
    def indices(self) -> range:
        """Indices of the subbands, one by one."""
        return range(self.subbands.start, self.subbands.stop)


def _wavelength_ranges() -> tuple[WavelengthRange, ...]:
    limits = [0.0, *(band.shortest for band in BANDS), BANDS[-1].longest, np.inf]
    names = ["shorter", *(band.name for band in BANDS), "longer"]
    first = np.searchsorted(CENTRE_WAVELENGTHS, limits)
    return tuple(
        WavelengthRange(name, slice(int(start), int(stop)))
        for name, start, stop in zip(names, first[:-1], first[1:], strict=True)
    )


RANGES = _wavelength_ranges()
"""All subbands in five ranges: shorter than D1, D1, D2, D3, longer than D3."""

BAND_RANGES = RANGES[1:-1]
"""Ranges of the bands D1, D2 and D3: a profile states its standard deviation in these only."""


def subband_gains(omega: Array) -> Array:
    """Gain T_j(Ω) of each subband: a squared cosine that falls to zero half an octave from the centre.

    Parameters
    ----------
    omega : spatial angular frequency (n) [rad/m]

    Returns
    -------
    T_j(Ω) (subbands, n) [-]; the sum over the subbands is 1

    Examples
    --------
    >>> print(subband_gains(2 * np.pi / np.array([8.0, 9.0, 5000.0])).sum(axis=0))
    [1. 1. 1.]
    """
    last = CENTRE_WAVELENGTHS.size - 1
    with np.errstate(divide="ignore"):
        position = np.clip(2 * np.log2(2 * np.pi / omega), 0, last)
    offset = np.abs(position - np.arange(CENTRE_WAVELENGTHS.size)[:, None])
    return np.where(offset < 1, np.cos(0.5 * np.pi * np.minimum(offset, 1.0)) ** 2, 0.0)


@dataclass(frozen=True, eq=False)
class SpectralDecomposition:
    """Sine transform of each gap-free piece of a profile, from which any subband follows by one product.

    Parameters
    ----------
    size, spacing : number of points of the profile, and the distance between them [m]
    pieces : of each gap-free piece its indices, its sine transform, and the straight line from end to end that was
        subtracted before the transform
    """

    size: int
    spacing: float
    pieces: tuple[tuple[slice, Array, Array], ...]

    def subband(self, index: int) -> Array:
        """Component of the profile in one subband (size) [unit of the profile]; 0 in gaps."""
        component = np.zeros(self.size)
        for piece, coefficients, line in self.pieces:
            if coefficients.size:
                inside, gains = _coefficient_gains(coefficients.size, self.spacing, index)
                selected = np.zeros(coefficients.size)
                selected[inside] = coefficients[inside] * gains
                component[piece.start + 1 : piece.stop - 1] = np.asarray(idst(selected, type=1))
            # A line from end to end is a quarter of a wavelength four times as long.
            if index == np.argmin(np.abs(CENTRE_WAVELENGTHS - 4 * self.spacing * line.size)):
                component[piece] += line
        return component


def decompose_spectrum(values: Array, spacing: float) -> SpectralDecomposition:
    """Sine transform of a profile, piece by piece between gaps, as the basis of its subbands.

    As in `bands.band_pass`, odd reflection continues each piece beyond its ends.

    Parameters
    ----------
    values : profile, NaN in gaps (n) [any unit]
    spacing : distance between the values [m]

    Examples
    --------
    >>> level = np.cumsum(np.random.default_rng(0).standard_normal(1000))
    >>> decomposition = decompose_spectrum(level, 0.25)
    >>> total = sum(decomposition.subband(index) for index in range(CENTRE_WAVELENGTHS.size))
    >>> bool(np.allclose(total, level))
    True
    """
    pieces = []
    for piece in runs(np.isfinite(values)):
        part = values[piece]
        line = np.linspace(part[0], part[-1], part.size)
        inner = (part - line)[1:-1]
        pieces.append((piece, np.asarray(dst(inner, type=1)) if inner.size else inner, line))
    return SpectralDecomposition(values.size, spacing, tuple(pieces))


def _coefficient_gains(count: int, spacing: float, index: int) -> tuple[slice, Array]:
    """Sine coefficients inside a subband, and the gain of each."""
    # Sine k has k half wavelengths on the length of the piece.
    length = spacing * (count + 1)
    low, high = (length * 2 / CENTRE_WAVELENGTHS[index] * factor for factor in (2**-0.5, 2**0.5))
    last = CENTRE_WAVELENGTHS.size - 1
    first = 1 if index == last else min(int(low) + 1, count + 1)
    after = count + 1 if index == 0 else min(int(high) + 1, count + 1)
    position = np.clip(2 * np.log2(2 * length / np.arange(first, after)), 0, last)
    offset = np.minimum(np.abs(position - index), 1.0)
    return slice(first - 1, after - 1), np.cos(0.5 * np.pi * offset) ** 2


def _squared_gain_integrals() -> Array:
    gains = subband_gains(np.maximum(_INTEGRATION_GRID, 1e-9))
    return np.asarray(np.trapezoid(gains**2, _INTEGRATION_GRID, axis=1))


def _band_integrals() -> Mapping[str, Array]:
    gains = subband_gains(np.maximum(_INTEGRATION_GRID, 1e-9))
    weights = {band.name: gain(band, _INTEGRATION_GRID) ** 2 for band in BANDS}
    weights[ALL_WAVELENGTHS] = np.ones(_INTEGRATION_GRID.size)
    return {
        name: np.asarray(np.trapezoid(weight * gains, _INTEGRATION_GRID, axis=1))
        for name, weight in weights.items()
    }


BAND_INTEGRALS = _band_integrals()
"""∫|H|² T_j dΩ of each band, and ∫T_j dΩ of all wavelengths (subbands) [rad/m].

The product with the density at each subband is that subband's contribution to the variance in the band.
"""

SUBBAND_WIDTHS: Array = BAND_INTEGRALS[ALL_WAVELENGTHS] / (2 * np.pi)
"""Width of each subband [1/m]: on a length X a subband has 2 X times its width independent values."""

SQUARED_GAIN_INTEGRALS = _squared_gain_integrals()
"""∫T_j² dΩ (subbands) [rad/m]: mean square of a subband over the density at the subband."""


def standard_deviations(density: Array) -> dict[str, Array]:
    """Standard deviation in each band of an error with a given spectral density: s² = Σ_j S_j ∫|H|² T_j dΩ.

    Parameters
    ----------
    density : S_j, one-sided spectral density at each subband (subbands, ...) [m²/(rad/m)]

    Returns
    -------
    standard deviation by name of the band, and of `ALL_WAVELENGTHS` (...) [m]

    Examples
    --------
    >>> round(float(standard_deviations(np.full(27, 1e-6))["D1"]), 6)
    0.001375
    """
    return {
        name: np.sqrt(np.tensordot(weight, density, axes=1))
        for name, weight in BAND_INTEGRALS.items()
    }

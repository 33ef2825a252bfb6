"""Spectrum, and with it correlation along the track, of the error of a profile within a wavelength band.

A profile states the standard deviation of its error per band, but not its correlation. The spectrum of the error in and
near a band is modelled by a power law, S ∝ Ω^-p; the ratio of the standard deviations in two neighbouring bands
determines p. White noise of an accelerometer, integrated twice, has p = 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from trackprofile.bands import BANDS, Band, gain

Array = NDArray[np.float64]

DEFAULT_EXPONENT = 4.0
"""p if only one band is stated: white noise of an accelerometer, integrated twice."""

_MIN_EXPONENT, _MAX_EXPONENT = 0.0, 8.0


@dataclass(frozen=True)
class ErrorSpectrum:
    """Spectrum of the error in a band, S ∝ Ω^-p |H(Ω)|².

    Parameters
    ----------
    band : the band
    exponent : p [-]
    """

    band: Band
    exponent: float

    @property
    def wavenumber(self) -> float:
        """RMS wavenumber: standard deviation of the error's slope over that of the error, √(∫Ω²S / ∫S) [rad/m]."""
        omega, density = _density(self.band, self.exponent)
        return float(np.sqrt(np.trapezoid(omega**2 * density, omega)))

    def correlation(self, lag: Array) -> Array:
        """Correlation of the errors at two points at distances `lag`, (n,) [m] from each other, (n,) [-]."""
        omega, density = _density(self.band, self.exponent)
        weight = density * np.gradient(omega)
        return np.cos(np.outer(lag, omega)) @ weight / weight.sum()


def error_spectrum(band: Band, deviations: Mapping[str, float]) -> ErrorSpectrum:
    """Spectrum of the error in a band, from the standard deviations in the band and its neighbour.

    Parameters
    ----------
    band : the band
    deviations : median standard deviations by name of the band [m]; 0 or missing: unknown

    Examples
    --------
    >>> from trackprofile.bands import D1
    >>> error_spectrum(D1, {}).exponent
    4.0
    """
    names = [one.name for one in BANDS]
    if band.name not in names or not deviations.get(band.name, 0.0) > 0:
        return ErrorSpectrum(band, DEFAULT_EXPONENT)
    index = names.index(band.name)
    others = [BANDS[i] for i in (index + 1, index - 1) if 0 <= i < len(BANDS)]
    for other in others:
        if deviations.get(other.name, 0.0) > 0:
            ratio = deviations[other.name] / deviations[band.name]
            return ErrorSpectrum(band, _exponent(band, other, ratio))
    return ErrorSpectrum(band, DEFAULT_EXPONENT)


def _exponent(band: Band, other: Band, ratio: float) -> float:
    """p at which the standard deviation in the other band is `ratio` times that in the band."""

    def excess(exponent: float) -> float:
        return _log_variance(other, exponent) - _log_variance(band, exponent) - 2 * np.log(ratio)

    low, high = excess(_MIN_EXPONENT), excess(_MAX_EXPONENT)
    if low * high > 0:
        return _MIN_EXPONENT if abs(low) < abs(high) else _MAX_EXPONENT
    return root_scalar(excess, bracket=(_MIN_EXPONENT, _MAX_EXPONENT), xtol=1e-3).root


def _log_variance(band: Band, exponent: float) -> float:
    omega = _omega(band)
    return float(np.log(np.trapezoid(omega**-exponent * gain(band, omega) ** 2, omega)))


@lru_cache(maxsize=64)
def _density(band: Band, exponent: float) -> tuple[Array, Array]:
    """Ω, and the spectral density of unit variance."""
    omega = _omega(band)
    density = omega**-exponent * gain(band, omega) ** 2
    return omega, density / np.trapezoid(density, omega)


@lru_cache(maxsize=16)
def _omega(band: Band) -> Array:
    return 2 * np.pi / np.geomspace(6 * band.longest, band.shortest / 4, 600)

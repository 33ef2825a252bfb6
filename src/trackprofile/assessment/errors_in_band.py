"""How the error of a profile is correlated along the track, within a band of wavelengths.

A profile states the standard deviation of its error per band, not how the error goes along. Its
spectrum in and near a band is taken as a power law, S ∝ Ω^-p: the ratio of the standard deviations
in two neighbouring bands tells p. Noise of an accelerometer, integrated twice, has p = 4.
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

USUAL_SLOPE = 4.0
"""p where only one band is stated: white noise of an accelerometer, integrated twice."""

_LEAST_SLOPE, _GREATEST_SLOPE = 0.0, 8.0


@dataclass(frozen=True)
class Colour:
    """The error's spectrum in a band.

    Parameters
    ----------
    band : the band
    slope : p of S ∝ Ω^-p |H(Ω)|² [-]
    """

    band: Band
    slope: float

    @property
    def wavenumber(self) -> float:
        """Standard deviation of the error's slope over that of the error, √(∫Ω²S / ∫S) [rad/m]."""
        omega, density = _density(self.band, self.slope)
        return float(np.sqrt(np.trapezoid(omega**2 * density, omega)))

    def correlation(self, lag: Array) -> Array:
        """Of the errors at two places that stand `lag` (n) [m] apart (n) [-]."""
        omega, density = _density(self.band, self.slope)
        weight = density * np.gradient(omega)
        return np.cos(np.outer(lag, omega)) @ weight / weight.sum()


def colour_of(band: Band, deviations: Mapping[str, float]) -> Colour:
    """The colour of the error in a band, from the standard deviations in it and its neighbour.

    Parameters
    ----------
    band : the band
    deviations : typical ones by band name [m]; those that are 0 or missing tell nothing

    Examples
    --------
    >>> from trackprofile.bands import D1
    >>> colour_of(D1, {}).slope
    4.0
    """
    names = [one.name for one in BANDS]
    if band.name not in names or not deviations.get(band.name, 0.0) > 0:
        return Colour(band, USUAL_SLOPE)
    place = names.index(band.name)
    others = [BANDS[i] for i in (place + 1, place - 1) if 0 <= i < len(BANDS)]
    for other in others:
        if deviations.get(other.name, 0.0) > 0:
            ratio = deviations[other.name] / deviations[band.name]
            return Colour(band, _slope(band, other, ratio))
    return Colour(band, USUAL_SLOPE)


def _slope(band: Band, other: Band, ratio: float) -> float:
    """p at which the standard deviation in the other band is `ratio` times that in the band."""

    def excess(slope: float) -> float:
        return _log_variance(other, slope) - _log_variance(band, slope) - 2 * np.log(ratio)

    low, high = excess(_LEAST_SLOPE), excess(_GREATEST_SLOPE)
    if low * high > 0:
        return _LEAST_SLOPE if abs(low) < abs(high) else _GREATEST_SLOPE
    return root_scalar(excess, bracket=(_LEAST_SLOPE, _GREATEST_SLOPE), xtol=1e-3).root


def _log_variance(band: Band, slope: float) -> float:
    omega = _omega(band)
    return float(np.log(np.trapezoid(omega**-slope * gain(band, omega) ** 2, omega)))


@lru_cache(maxsize=64)
def _density(band: Band, slope: float) -> tuple[Array, Array]:
    """Ω, and the density over it of unit variance."""
    omega = _omega(band)
    density = omega**-slope * gain(band, omega) ** 2
    return omega, density / np.trapezoid(density, omega)


@lru_cache(maxsize=16)
def _omega(band: Band) -> Array:
    return 2 * np.pi / np.geomspace(6 * band.longest, band.shortest / 4, 600)

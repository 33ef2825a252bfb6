"""Probability that the true level exceeds a limit somewhere in a stretch.

The true level is m(x) + e(x): the estimate, and a Gaussian error in the band with the stated standard deviation s(x).
At one point P = Φ((m - L)/s). Over a stretch the error varies, and the level may exceed the limit away from the peak of
the estimate. With u = (L - m)/s and the rate ν at which m + e crosses L upwards (Rice 1945), and crossings of a level
not yet exceeded treated as independent (Cramér and Leadbetter 1967, chapter 13):

    P = 1 - Φ(u_start) exp(-∫ ν/Φ(u) dx)
    ν = (φ(u)/s) E[(e' + m')⁺] = (φ(u)/s) (m'⁺ + σ' ψ(|m'|/σ')),  ψ(t) = φ(t) - t Φ(-t)

where σ' is the standard deviation of e'. Where the estimate rises, the first term integrates exactly to ln Φ(u), so
that for a constant error the probability at the peak remains; ψ is integrated over each step in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

Array = NDArray[np.float64]

_LOG_ROOT_TWO_PI = 0.5 * np.log(2 * np.pi)


def exceedance_probability(
    level: Array, deviation: Array, limit: float, spacing: float, wavenumber: float
) -> float:
    """Probability that level + error exceeds a limit at one of the points or between them.

    Parameters
    ----------
    level : estimated level along the stretch, (n,) [m]
    deviation : standard deviation of its error, (n,) [m]; 0 makes the probability 0 or 1
    limit : limit [m]
    spacing : distance between the points [m]
    wavenumber : RMS wavenumber of the error, see `errors_in_band.ErrorSpectrum` [rad/m]

    Returns
    -------
    probability, 0 to 1

    Examples
    --------
    >>> peak = np.array([0.0, 0.0099, 0.0])
    >>> exact = exceedance_probability(peak, np.zeros(3), 0.01, 0.25, 1.0)
    >>> uncertain = exceedance_probability(peak, np.full(3, 1e-3), 0.01, 0.25, 1.0)
    >>> print(f"{exact:.2f} {uncertain:.2f}")
    0.00 0.46
    """
    if not (deviation > 0).all():
        return float(level.max() > limit)
    u = (limit - level) / deviation
    if u.min() > 8:
        return 0.0
    # Crossing rate per metre due to the error alone, without the factor that depends on the slope.
    hazard = np.exp(-0.5 * u**2 - _LOG_ROOT_TWO_PI - log_ndtr(u)) * wavenumber
    slope = np.gradient(level, spacing) if level.size > 2 else np.zeros(level.size)
    relative = slope / (deviation * wavenumber)
    extra = spacing * np.sum((hazard[1:] + hazard[:-1]) / 2 * _mean_psi(relative))
    return float(-np.expm1(log_ndtr(u.min()) - extra))


def _mean_psi(t: Array) -> Array:
    """Mean of ψ(|t|) over each step between neighbours, with t linear within the step, (n - 1,)."""
    step = np.diff(t)
    middle = np.abs(t[1:] + t[:-1]) / 2
    at_middle = _density(middle) - middle * ndtr(-middle)
    varies = np.abs(step) > 1e-3
    return np.where(varies, np.diff(_integral(t)) / np.where(varies, step, 1.0), at_middle)


def _integral(t: Array) -> Array:
    """∫ ψ(|t|) from 0 to t."""
    size = np.abs(t)
    integral = 0.5 * (ndtr(size) - 0.5) - 0.5 * size**2 * ndtr(-size) + 0.5 * size * _density(size)
    return np.sign(t) * integral


def _density(t: Array) -> Array:
    return np.exp(-0.5 * t**2 - _LOG_ROOT_TWO_PI)

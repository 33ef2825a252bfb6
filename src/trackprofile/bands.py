"""Wavelength bands of longitudinal level, and the band-pass filter.

Results about a profile are given per band (EN 13848-1). The filter is a 4th-order Butterworth band-pass with zero phase
and -3 dB at the limits of the band: its response is the magnitude of the filter applied *once*. Applied forwards and
backwards, the same design has -6 dB at the limits and gives a standard deviation of D1 that is 8 % lower.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dst, idst, irfft, rfftfreq
from scipy.interpolate import CubicSpline

from trackprofile.arrays import runs
from trackprofile.errors import DataError

FILTER_NAME = "4th-order Butterworth, zero phase, -3 dB at the limits"
"""Name of the filter, stored with every filtered result: results of different filters are not comparable."""

FILTER_NAMES = {
    False: FILTER_NAME,
    True: "4th-order Butterworth, forwards and backwards, -6 dB at the limits",
}
"""Name of the filter by `forward_backward`: both conventions are in use."""

_ORDER = 4
_LARGEST_STEP = 3.0  # times the median step; a larger step is a gap
_TAIL_ENERGY = 0.0005


@dataclass(frozen=True)
class Band:
    """A wavelength band.

    Parameters
    ----------
    name : name in the standard
    shortest, longest : wavelengths at which the filter has -3 dB [m]

    Raises
    ------
    DataError : unless 0 < shortest < longest.

    Examples
    --------
    >>> Band("D1", 3.0, 25.0).longest
    25.0
    """

    name: str
    shortest: float
    longest: float

    def __post_init__(self) -> None:
        if not 0 < self.shortest < self.longest < np.inf:
            raise DataError(
                f"Band {self.name}: expected 0 < shortest < longest wavelength, "
                f"got {self.shortest:g} m and {self.longest:g} m."
            )


D1 = Band("D1", 3.0, 25.0)
D2 = Band("D2", 25.0, 70.0)
D3 = Band("D3", 70.0, 200.0)
BANDS = (D1, D2, D3)
"""Bands of EN 13848-1:2019, with an upper wavelength of 200 m for D3."""


def gain(band: Band, omega: ArrayLike) -> NDArray[np.float64]:
    """Magnitude of the frequency response of the filter of a band.

    |H|² = 1 / (1 + ((Ω² - Ωa Ωb) / (Ω (Ωb - Ωa)))⁸), the analogue Butterworth band-pass of
    order 4 on each side, with Ωa = 2π/longest and Ωb = 2π/shortest.

    Parameters
    ----------
    band : wavelength band
    omega : spatial angular frequency, of any shape, not negative [rad/m]

    Returns
    -------
    gain, of the shape of `omega` [-]

    Examples
    --------
    >>> wavelengths = np.array([1.5, 3.0, 25.0, 50.0])
    >>> print(gain(D1, 2 * np.pi / wavelengths).round(3))
    [0.042 0.707 0.707 0.042]
    """
    omega = np.asarray(omega, dtype=float)
    low, high = 2 * np.pi / band.longest, 2 * np.pi / band.shortest
    with np.errstate(divide="ignore", over="ignore"):
        detuning = (omega**2 - low * high) / (omega * (high - low))
        return 1 / np.sqrt(1 + detuning ** (2 * _ORDER))


def band_pass(
    values: ArrayLike, spacing: float, band: Band, *, forward_backward: bool = False
) -> NDArray[np.float64]:
    """Filter a profile, or many samples of one, to a band, without phase shift.

    The straight line through both end values is subtracted, and the remainder is continued beyond each end by repeated
    odd reflection. The sine transform is the Fourier transform of that continuation, so that the filter is exactly one
    product. Within `edge_distance` of an end the result depends on the continuation.

    Parameters
    ----------
    values : profile along the last axis, samples along the others, (..., n) [m, or any unit]
    spacing : distance between two values [m]
    band : wavelength band
    forward_backward : apply the filter forwards and backwards, the other convention, with -6 dB at the limits; False:
        the filter of `FILTER_NAME`

    Returns
    -------
    content of `values` in the band, (..., n) [unit of `values`]

    Raises
    ------
    DataError : a value is not finite; or the profile is shorter than the longest wavelength, or has fewer than two
        values per shortest wavelength.

    Examples
    --------
    >>> distance = np.arange(0.0, 1000.0, 0.25)
    >>> wave = np.sin(2 * np.pi * distance / 10.0)
    >>> bool(np.abs(band_pass(wave + 3.0 + distance, 0.25, D1) - wave)[400:-400].max() < 0.01)
    True
    """
    values = np.asarray(values, dtype=float)
    reason = obstacle(band, spacing, spacing * (values.shape[-1] - 1))
    if reason:
        raise DataError(f"{reason}.")
    if not np.isfinite(values).all():
        first = int(np.argwhere(~np.isfinite(values))[0, -1])
        raise DataError(
            f"Band {band.name}: expected finite values, value {first} is not; filter each piece between gaps with "
            "band_pass_pieces."
        )
    last = values.shape[-1] - 1
    fraction = np.arange(1, last) / last
    line = values[..., :1] * (1 - fraction) + values[..., -1:] * fraction
    sines = np.asarray(dst(values[..., 1:-1] - line, type=1, axis=-1, overwrite_x=True))
    sines *= gain(band, np.pi / spacing * fraction) ** (2 if forward_backward else 1)
    filtered = np.zeros_like(values)
    filtered[..., 1:-1] = idst(sines, type=1, axis=-1, overwrite_x=True)
    return filtered


def obstacle(band: Band, spacing: float, length: float) -> str:
    """Reason why values cannot be filtered to a band; empty if they can.

    Parameters
    ----------
    band : wavelength band
    spacing, length : distance between two values, and from the first to the last [m]

    Examples
    --------
    >>> obstacle(D1, 0.25, 20.0)
    'Band D1 needs at least 25 m in one piece, got 20 m'
    >>> obstacle(D1, 0.25, 100.0)
    ''
    """
    # n values represent n steps, of which n - 1 are between values.
    if length + spacing < band.longest * (1 - 1e-9):
        return f"Band {band.name} needs at least {band.longest:g} m in one piece, got {length:g} m"
    if spacing > band.shortest / 2:
        return (
            f"Band {band.name} needs a value every {band.shortest / 2:g} m or closer, "
            f"got one every {spacing:g} m"
        )
    return ""


@lru_cache
def edge_distance(band: Band) -> float:
    """Distance from an end within which a filtered value depends on what is beyond the end [m].

    Beyond this distance the one-sided impulse response of the filter has less than 0.05 % of its energy. On a typical
    spectrum, where long waves are stronger than short ones, what is beyond the end then changes a value by 6 % of the
    standard deviation in the band.

    Examples
    --------
    >>> [round(edge_distance(band)) for band in BANDS]
    [20, 98, 280]
    """
    step, count = band.shortest / 16, 1 << 16
    magnitude = gain(band, 2 * np.pi * rfftfreq(count, step))
    response = np.asarray(irfft(magnitude, n=count))[: count // 2]
    energy_beyond = np.cumsum(response[::-1] ** 2)[::-1]
    total = 2 * energy_beyond[0] - response[0] ** 2
    return float(step * np.argmax(energy_beyond < _TAIL_ENERGY * total))


def band_pass_pieces(
    values: ArrayLike, spacing: float, band: Band, *, forward_backward: bool = False
) -> NDArray[np.float64]:
    """Filter a profile with gaps to a band: each piece between gaps separately.

    Parameters
    ----------
    values : profile, NaN in gaps, (n,) [any unit]
    spacing, band, forward_backward : see `band_pass`

    Returns
    -------
    (n,) [unit of `values`]; NaN in gaps, and in pieces that are too short for the band

    Examples
    --------
    >>> track = np.sin(np.arange(0.0, 400.0, 0.25))
    >>> track[60:80] = np.nan  # 15 m, a gap of 5 m, 380 m
    >>> int(np.isnan(band_pass_pieces(track, 0.25, D1)).sum())
    80
    """
    values = np.asarray(values, dtype=float)
    filtered = np.full_like(values, np.nan)
    for piece in runs(np.isfinite(values)):
        if not obstacle(band, spacing, spacing * (piece.stop - piece.start - 1)):
            filtered[piece] = band_pass(
                values[piece], spacing, band, forward_backward=forward_backward
            )
    return filtered


def resample(distance: ArrayLike, values: ArrayLike, at: ArrayLike) -> NDArray[np.float64]:
    """Interpolate values at other distances, by a cubic spline through each piece between gaps.

    With six values per wavelength the error of the spline is below 0.5 %; linear interpolation would lose 13 %. The
    spacing of the new distances should not exceed that of the values, otherwise short waves are aliased.

    Parameters
    ----------
    distance : of the values, strictly increasing, (n,) [m]; a step longer than three times the median is a gap
    values : NaN in gaps, (n,) [any unit]
    at : distances at which values are interpolated, increasing, (m,) [m]

    Returns
    -------
    (m,) [unit of `values`]; NaN in gaps and beyond the ends

    Raises
    ------
    DataError : the distances do not strictly increase.

    Examples
    --------
    >>> resample([0.0, 1.0, 3.0, 4.0], [0.0, 1.0, 9.0, 16.0], [2.0, 5.0]).round(9)
    array([ 4., nan])
    """
    distance, values, at = (np.asarray(part, dtype=float) for part in (distance, values, at))
    steps = np.diff(distance)
    if not (steps > 0).all():
        raise DataError(
            "Resampling: expected strictly increasing distances; sort the rows and remove repeated ones."
        )
    result = np.full(at.shape, np.nan)
    if steps.size == 0:
        return result
    known = np.isfinite(values)
    for steps_inside in runs(known[:-1] & known[1:] & (steps <= _LARGEST_STEP * np.median(steps))):
        piece = slice(steps_inside.start, steps_inside.stop + 1)
        first = np.searchsorted(at, distance[steps_inside.start], side="left")
        after = np.searchsorted(at, distance[steps_inside.stop], side="right")
        result[first:after] = CubicSpline(distance[piece], values[piece])(at[first:after])
    return result

"""Wavelength bands of longitudinal level, and the filter that cuts them out.

Every statement about a profile is made per band (EN 13848-1). The filter is a 4th-order
Butterworth band-pass that is 3 dB down at the band's limits, without phase shift: the whole
response is the magnitude of *one* pass. Forwards and backwards with the same design would be
6 dB down, and 8 % lower in the standard deviation of D1.
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
"""Stored with every band-passed result: figures of different filters do not compare."""

FILTER_NAMES = {
    1: FILTER_NAME,
    2: "4th-order Butterworth, forwards and backwards, -6 dB at the limits",
}
"""By the number of passes: both conventions are in use."""

_ORDER = 4
_LARGEST_STEP = 3.0  # of the median step; rows farther apart are rows that are missing
_TAIL_ENERGY = 0.0005


@dataclass(frozen=True)
class Band:
    """A band of wavelengths.

    Parameters
    ----------
    name : as the standard calls it
    shortest, longest : the wavelengths at which the filter is 3 dB down [m]

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
"""EN 13848-1:2019, with D3 taken to 200 m."""


def gain(band: Band, omega: ArrayLike) -> NDArray[np.float64]:
    """Magnitude of the band's filter.

    |H|² = 1 / (1 + ((Ω² - Ωa Ωb) / (Ω (Ωb - Ωa)))⁸), the analogue Butterworth band-pass of
    order 4 at each side, with Ωa = 2π/longest and Ωb = 2π/shortest.

    Parameters
    ----------
    band : the band
    omega : spatial angular frequency, any shape, not negative [rad/m]

    Returns
    -------
    gain, the shape of `omega` [-]

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
    values: ArrayLike, spacing: float, band: Band, passes: int = 1
) -> NDArray[np.float64]:
    """What of a profile, or of many draws of one, lies in a band; no phase shift.

    The straight line from end to end is taken off and the rest continued beyond each end by odd
    reflection, over and over: the sine transform is the Fourier transform of just that, so the
    filter is applied exactly, by one product. Within `edge_distance` of an end the result rests
    on that continuation.

    Parameters
    ----------
    values : along the last axis, any others are draws (..., n) [m, or any unit]
    spacing : distance between the values [m]
    band : the band
    passes : 1 for `FILTER_NAME`; 2 for the other usual convention, forwards and backwards, which is
        -6 dB at the limits

    Returns
    -------
    the part of `values` in the band (..., n) [unit of `values`]

    Raises
    ------
    DataError : where a value is not finite (filter the pieces between gaps apart), or the values
        cannot carry the band: shorter than its longest wavelength, or fewer than two values to
        its shortest.

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
            f"Band {band.name}: value {first} is not finite; filter the pieces between gaps apart."
        )
    last = values.shape[-1] - 1
    along = np.arange(1, last) / last
    line = values[..., :1] * (1 - along) + values[..., -1:] * along
    sines = np.asarray(dst(values[..., 1:-1] - line, type=1, axis=-1, overwrite_x=True))
    sines *= gain(band, np.pi / spacing * along) ** passes
    filtered = np.zeros_like(values)
    filtered[..., 1:-1] = idst(sines, type=1, axis=-1, overwrite_x=True)
    return filtered


def obstacle(band: Band, spacing: float, length: float) -> str:
    """Why values over a length cannot carry a band, in words; empty where they can.

    Parameters
    ----------
    band : the band
    spacing, length : between the values, and from the first to the last [m]

    Examples
    --------
    >>> obstacle(D1, 0.25, 20.0)
    'Band D1 needs at least 25 m in one piece, got 20 m'
    >>> obstacle(D1, 0.25, 100.0)
    ''
    """
    # A stretch of n values stands for n steps, the last of which is not between values.
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
    """How far from an end a band-passed value can be trusted [m].

    The distance beyond which the filter's impulse response, to one side, holds less than 0.05 %
    of its energy. Long waves are stronger on a track than short ones, so this is strict: on a
    usual spectrum whatever lies beyond the end then changes a value by 6 % of the band's standard
    deviation.

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
    values: ArrayLike, spacing: float, band: Band, passes: int = 1
) -> NDArray[np.float64]:
    """The same for values with gaps: each piece between gaps is filtered apart.

    Parameters
    ----------
    values : NaN in gaps (n) [any unit]
    spacing, band, passes : as of `band_pass`

    Returns
    -------
    (n) [unit of `values`]; NaN in gaps, and where a piece is too short for the band

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
            filtered[piece] = band_pass(values[piece], spacing, band, passes)
    return filtered


def resample(distance: ArrayLike, values: ArrayLike, at: ArrayLike) -> NDArray[np.float64]:
    """Values at other places, by a cubic spline through each piece between gaps.

    At six values to a wave the spline is within 0.5 % of it; straight lines would lose 13 %. The
    places should stand no farther apart than the values, or short waves come back as long ones.

    Parameters
    ----------
    distance : where the values stand, strictly increasing (n) [m]; a step longer than three times
        the median is a gap
    values : NaN in gaps (n) [any unit]
    at : where they are wanted, increasing (m) [m]

    Returns
    -------
    (m) [unit of `values`]; NaN in gaps and beyond the ends

    Raises
    ------
    DataError : distances that do not increase.

    Examples
    --------
    >>> resample([0.0, 1.0, 3.0, 4.0], [0.0, 1.0, 9.0, 16.0], [2.0, 5.0]).round(9)
    array([ 4., nan])
    """
    distance, values, at = (np.asarray(part, dtype=float) for part in (distance, values, at))
    steps = np.diff(distance)
    if not (steps > 0).all():
        raise DataError("Resampling: expected distances that strictly increase; sort them first.")
    result = np.full(at.shape, np.nan)
    if steps.size == 0:
        return result
    known = np.isfinite(values)
    for joined in runs(known[:-1] & known[1:] & (steps <= _LARGEST_STEP * np.median(steps))):
        piece = slice(joined.start, joined.stop + 1)
        first = np.searchsorted(at, distance[joined.start], side="left")
        after = np.searchsorted(at, distance[joined.stop], side="right")
        result[first:after] = CubicSpline(distance[piece], values[piece])(at[first:after])
    return result

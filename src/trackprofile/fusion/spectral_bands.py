"""A profile cut into waves of half an octave each, which add up to it, and the spectrum of its error at them.

Passes know some waves better than others, and not the same ones: they are weighed wave by wave. A
profile states its error's standard deviation in all and in the bands; the spectrum at the waves is
taken to run straight between them, in logarithms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.fft import dst, idst

from trackprofile.arrays import runs
from trackprofile.bands import BANDS, gain
from trackprofile.errors import DataError

Array = NDArray[np.float64]

LENGTHS = np.asarray(2.0 ** (0.5 * np.arange(27)), np.float64)
"""Wavelengths on which the waves are centred [m]; the first and last take all that is shorter or longer."""

OMEGA: Array = 2 * np.pi / LENGTHS
"""Their spatial angular frequency [rad/m]."""

ALL = "all"
"""What stands beside the bands' names: the elevation with all its waves."""

STEP = 5.0
"""Between the places at which spectra and weights are held [m]."""

LEAST = 1e-9
"""Standard deviation at least [m]: of a profile that is taken to be exact."""

KNEES = (0.0206, 0.825)
"""Where the usual priors turn from flat to Ω^-2, and to Ω^-4 [rad/m] (theory, section 7)."""

_FLATTEST, _USUAL, _STEEPEST = (
    2.0,
    4.0,
    6.0,
)  # of S ∝ Ω^-p; an accelerometer's white noise, integrated twice
_ROUNDS, _SETTLED = 60, 1e-6  # until the spectrum holds the stated variances
_OWN = 0.05  # share of an even spectrum that a band's own waves have at least
_LEFT = 1e-3  # share of the whole variance that longer waves have at least


@dataclass(frozen=True)
class Range:
    """Neighbouring waves that are weighed and judged together.

    Parameters
    ----------
    name : of the band they lie in, or in words
    waves : numbers of them
    """

    name: str
    waves: slice

    @property
    def numbers(self) -> range:
        """Of its waves, one by one."""
        return range(self.waves.start, self.waves.stop)


def _ranges() -> tuple[Range, ...]:
    ends = [0.0, *(band.shortest for band in BANDS), BANDS[-1].longest, np.inf]
    names = ["shorter", *(band.name for band in BANDS), "longer"]
    first = np.searchsorted(LENGTHS, ends)
    return tuple(
        Range(name, slice(int(a), int(b)))
        for name, a, b in zip(names, first[:-1], first[1:], strict=True)
    )


RANGES = _ranges()
"""All waves: shorter than D1, D1, D2, D3, longer than D3."""

JUDGED = RANGES[1:-1]
"""Those of the bands: only of these a profile says how well it knows them."""


def shares(omega: Array) -> Array:
    """What of a frequency belongs to each wave: cos² over half an octave to each side.

    Parameters
    ----------
    omega : (n) [rad/m]

    Returns
    -------
    (waves, n) [-], of sum 1

    Examples
    --------
    >>> print(shares(2 * np.pi / np.array([8.0, 9.0, 5000.0])).sum(axis=0))
    [1. 1. 1.]
    """
    with np.errstate(divide="ignore"):
        place = np.clip(2 * np.log2(2 * np.pi / omega), 0, LENGTHS.size - 1)
    away = np.abs(place - np.arange(LENGTHS.size)[:, None])
    return np.where(away < 1, np.cos(0.5 * np.pi * np.minimum(away, 1.0)) ** 2, 0.0)


@dataclass(frozen=True, eq=False)
class SpectralDecomposition:
    """A profile's sine transform, piece by piece between gaps.

    Parameters
    ----------
    size, spacing : of the profile: points, and between them [m]
    pieces : where each stands, its transform, and the straight line from end to end taken off before
    """

    size: int
    spacing: float
    pieces: tuple[tuple[slice, Array, Array], ...]

    def wave(self, number: int) -> Array:
        """The part in one wave (size) [unit of the profile]; 0 in gaps."""
        found = np.zeros(self.size)
        for piece, sines, line in self.pieces:
            if sines.size:
                here, share = _shares_of(sines.size, self.spacing, number)
                part = np.zeros(sines.size)
                part[here] = sines[here] * share
                found[piece.start + 1 : piece.stop - 1] = np.asarray(idst(part, type=1))
            # A line from end to end is the quarter of a wave four times as long.
            if number == np.argmin(np.abs(LENGTHS - 4 * self.spacing * line.size)):
                found[piece] += line
        return found


def decompose_spectrum(values: Array, spacing: float) -> SpectralDecomposition:
    """The transform of which every wave is a product away.

    As in `bands.band_pass`, each piece is continued beyond its ends by odd reflection.

    Parameters
    ----------
    values : NaN in gaps (n) [any unit]
    spacing : between them [m]

    Examples
    --------
    >>> level = np.cumsum(np.random.default_rng(0).standard_normal(1000))
    >>> cut = sines(level, 0.25)
    >>> bool(np.allclose(sum(cut.wave(number) for number in range(LENGTHS.size)), level))
    True
    """
    pieces = []
    for piece in runs(np.isfinite(values)):
        part = values[piece]
        line = np.linspace(part[0], part[-1], part.size)
        inner = (part - line)[1:-1]
        pieces.append((piece, np.asarray(dst(inner, type=1)) if inner.size else inner, line))
    return SpectralDecomposition(values.size, spacing, tuple(pieces))


def _shares_of(count: int, spacing: float, number: int) -> tuple[slice, Array]:
    """Which of the sines belong to a wave, and how much of each."""
    # Sine k is k half waves long.
    half = spacing * (count + 1)
    low, high = (half * 2 / LENGTHS[number] * factor for factor in (2**-0.5, 2**0.5))
    first = 1 if number == LENGTHS.size - 1 else min(int(low) + 1, count + 1)
    after = count + 1 if number == 0 else min(int(high) + 1, count + 1)
    place = np.clip(2 * np.log2(2 * half / np.arange(first, after)), 0, LENGTHS.size - 1)
    away = np.minimum(np.abs(place - number), 1.0)
    return slice(first - 1, after - 1), np.cos(0.5 * np.pi * away) ** 2


def _power() -> Array:
    omega = np.concatenate([[0.0], np.geomspace(1e-5, 4 * np.pi, 20001)])
    return np.asarray(np.trapezoid(shares(np.maximum(omega, 1e-9)) ** 2, omega, axis=1))


def _integrals() -> Mapping[str, Array]:
    """∫|H|² T_j dΩ of each band and ∫T_j dΩ of all, by wave j [rad/m]."""
    # From waves far longer than the last, whose density does not rise further, to the grid's shortest.
    omega = np.concatenate([[0.0], np.geomspace(1e-5, 4 * np.pi, 20001)])
    parts = shares(np.maximum(omega, 1e-9))
    weights = {band.name: gain(band, omega) ** 2 for band in BANDS} | {ALL: np.ones(omega.size)}
    return {
        name: np.asarray(np.trapezoid(weight * parts, omega, axis=1))
        for name, weight in weights.items()
    }


INTEGRALS = _integrals()
"""By band, and for all waves together: what a density at each wave adds to the variance (waves) [rad/m]."""

WIDTH: Array = INTEGRALS[ALL] / (2 * np.pi)
"""Of each wave [1/m]: 2 WIDTH L numbers of it are independent along a length L."""

POWER = _power()
"""∫T_j² dΩ: the mean square of a wave over the density at it (waves) [rad/m]."""

_MIDDLES = {band.name: np.sqrt(band.shortest * band.longest) for band in BANDS}


def deviations(density: Array) -> dict[str, Array]:
    """Standard deviations of what has a spectrum.

    Parameters
    ----------
    density : at each wave (waves, ...) [m²/(rad/m)]

    Returns
    -------
    by band, and for all waves (...) [m]
    """
    return {
        name: np.sqrt(np.tensordot(weight, density, axes=1)) for name, weight in INTEGRALS.items()
    }


@dataclass(frozen=True, eq=False)
class Stated:
    """Spectra that follow from the standard deviations that a profile states.

    Parameters
    ----------
    error : of its error (waves, k) [m²/(rad/m)]
    prior : of the track before the pass, as it was taken to be (waves) [m²/(rad/m)]
    """

    error: Array
    prior: Array


def stated_by(profile: xr.Dataset, places: Array, name: str) -> Stated:
    """The spectrum of a profile's error along the line.

    1/P = 1/N + 1/S: the noise N runs straight between the bands, in logarithms, and goes on so beyond them; the prior S
    has the form of FRA's spectra, and is as high as the standard deviation of the whole asks for.

    Parameters
    ----------
    profile : profile contract
    places : (k) [m]
    name : of the pass, for messages

    Raises
    ------
    DataError : it states none, or none in any band.
    """
    stated = {
        (_band_of(str(one)) or ALL): _variance_at(profile, str(one), places)
        for one in profile.data_vars
        if str(one).startswith("standard_deviation")
    }
    bands = {band.name: stated[band.name] for band in BANDS if band.name in stated}
    if ALL not in stated or not bands:
        raise DataError(
            f"{name}: it does not state its standard deviation, or not in any band, and cannot be weighed; give the "
            "profile as infer wrote it, as .nc or with the columns standard_deviation_m, standard_deviation_D1_m ..."
        )
    return _fitted(bands, stated[ALL])


def _band_of(variable: str) -> str:
    return variable.removeprefix("standard_deviation").removeprefix("_")


def _variance_at(profile: xr.Dataset, variable: str, places: Array) -> Array:
    """Mean of the square over a stretch as long as the band's longest wave, which the draws leave uneven."""
    distance, deviation = profile["distance"].to_numpy(), profile[variable].to_numpy()
    known = np.isfinite(deviation)
    distance, square = distance[known], np.maximum(deviation[known], LEAST) ** 2
    if distance.size < 2:
        return np.full(places.size, LEAST**2)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (square[1:] + square[:-1]) * np.diff(distance))])
    half = 0.5 * {band.name: band.longest for band in BANDS}.get(_band_of(variable), 0.0)
    half = max(half, 0.5 * STEP)
    middle = np.clip(places, distance[0], distance[-1])
    low, high = np.maximum(middle - half, distance[0]), np.minimum(middle + half, distance[-1])
    return (np.interp(high, distance, total) - np.interp(low, distance, total)) / (high - low)


def _fitted(bands: Mapping[str, Array], everything: Array) -> Stated:
    """Spectra whose variances are the stated ones: each height is scaled by what its variance lacks, over and over."""
    middles = np.log([_MIDDLES[name] for name in bands])
    target, weight = (np.stack([of[name] for name in bands]) for of in (bands, INTEGRALS))
    longest = max(band.longest for band in BANDS if band.name in bands)
    beyond = longest < LENGTHS
    noise = np.log(target / weight.sum(axis=1)[:, None])
    least, top = noise + np.log(_OWN), noise[-1] + 4.0
    shape = 1.0 / ((1.0 + (OMEGA / KNEES[0]) ** 2) * (1.0 + (OMEGA / KNEES[1]) ** 2))[:, None]
    prior = density = np.empty(0)
    for _ in range(_ROUNDS):
        prior = np.exp(top) * shape
        density = 1.0 / (np.exp(-_straight(middles, noise)) + 1.0 / prior)
        # Near ends a band's error is that of longer waves, which its filter lets through.
        noise = np.maximum(noise + np.log(target / (weight @ density)), least)
        parts = INTEGRALS[ALL][:, None] * density
        rest = parts[beyond].sum(axis=0)
        wanted = everything - parts[~beyond].sum(axis=0)
        more = np.log(np.maximum(wanted, _LEFT * everything) / rest)
        top += more
        if np.abs(more).max(initial=0.0) < _SETTLED:
            break
    return Stated(density, np.median(prior, axis=1))


def _straight(anchors: Array, heights: Array) -> Array:
    """Logarithm of a density at all waves (waves, k), its slopes going on beyond the outer anchors."""
    at = np.log(LENGTHS)
    if anchors.size == 1:
        return heights + _USUAL * (at - anchors)[:, None]
    slopes = np.diff(heights, axis=0) / np.diff(anchors)[:, None]
    piece = np.clip(np.searchsorted(anchors, at) - 1, 0, anchors.size - 2)
    away = at[:, None] - anchors[piece][:, None]
    line = heights[piece] + slopes[piece] * away
    for outside, end, slope in (
        (at < anchors[0], 0, slopes[0]),
        (at > anchors[-1], -1, slopes[-1]),
    ):
        steady = np.clip(slope, _FLATTEST, _STEEPEST)
        line[outside] = heights[end] + steady * (at[outside] - anchors[end])[:, None]
    return line

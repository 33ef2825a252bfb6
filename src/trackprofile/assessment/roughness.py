"""The spectrum of a profile, and which of the known spectra it is nearest to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from trackprofile.arrays import runs
from trackprofile.models.spectrum import PowerLaw, Roughness

Array = NDArray[np.float64]

WINDOW = 200.0
"""Of track under one window of the estimate [m]."""

SHORTEST, LONGEST = 3.0, 70.0
"""Wavelengths between which spectra are compared [m], as far as all of them are known there."""

PER_OCTAVE = 3


@dataclass(frozen=True)
class Nearest:
    """The spectrum of a stretch in words.

    Parameters
    ----------
    start, end : the stretch [m]
    spectrum : name of the nearest of the known spectra
    difference_db : root mean square over third octaves of 10 lg (measured / that spectrum) [dB]
    level_db : mean of it; above 0 the track is rougher than that spectrum [dB]
    """

    start: float
    end: float
    spectrum: str
    difference_db: float
    level_db: float


@dataclass(frozen=True)
class Psd:
    """A power spectral density over third octaves.

    Parameters
    ----------
    spatial_frequency : Ω of the octaves' middles (n) [rad/m]
    density : one-sided (n) [m²/(rad/m)]
    """

    spatial_frequency: Array
    density: Array


def psd(elevation: Array, spacing: float, shortest: float, longest: float) -> Psd | None:
    """The spectrum by Welch's method, over the pieces between gaps; None where all are too short.

    Parameters
    ----------
    elevation : NaN in gaps (n) [m]
    spacing : [m]
    shortest, longest : wavelengths [m]

    Examples
    --------
    >>> white = np.random.default_rng(1).standard_normal(40000)
    >>> found = psd(white, 0.25, 3.0, 50.0)
    >>> bool(np.allclose(found.density, 0.25 / np.pi, rtol=0.2))  # 2 · variance · spacing / 2π
    True
    """
    count = round(WINDOW / spacing)
    total, weight = np.zeros(count // 2 + 1), 0.0
    for piece in runs(np.isfinite(elevation)):
        length = piece.stop - piece.start
        if length >= count:
            _, density = welch(
                elevation[piece], 1 / spacing, nperseg=count, detrend="linear", window="hann"
            )
            total, weight = total + length * density, weight + length
    if not weight:
        return None
    frequency = np.arange(count // 2 + 1) / (count * spacing)
    return _third_octaves(2 * np.pi * frequency, total / weight / (2 * np.pi), shortest, longest)


def _third_octaves(omega: Array, density: Array, shortest: float, longest: float) -> Psd:
    low, high = 2 * np.pi / longest, 2 * np.pi / shortest
    bands = int(PER_OCTAVE * np.log2(high / low))
    edges = low * 2 ** (np.arange(bands + 1) / PER_OCTAVE)
    which = np.digitize(omega, edges) - 1
    filled = [k for k in range(bands) if (which == k).any()]
    means = np.array([density[which == k].mean() for k in filled])
    middles = np.array([omega[which == k].mean() for k in filled])
    return Psd(middles, means)


def common_range(spectra: Mapping[str, Roughness]) -> tuple[float, float]:
    """Wavelengths [m] between `SHORTEST` and `LONGEST` for which all the spectra are known."""
    known = [one for one in spectra.values() if isinstance(one, PowerLaw)]
    return (
        max([SHORTEST, *(one.shortest for one in known)]),
        min([LONGEST, *(one.longest for one in known)]),
    )


def nearest(
    found: Psd, spectra: Mapping[str, Roughness], start: float, end: float
) -> Nearest | None:
    """Which spectrum a stretch is nearest to; None without spectra.

    Parameters
    ----------
    found : of the stretch
    spectra : by name, all known over the wavelengths of `found`
    start, end : the stretch [m]
    """
    candidates = []
    for name, spectrum in spectra.items():
        ratio = 10 * np.log10(found.density / spectrum.density(found.spatial_frequency))
        difference = float(np.sqrt(np.mean(ratio**2)))
        candidates.append(Nearest(start, end, name, difference, float(ratio.mean())))
    return min(candidates, key=lambda one: one.difference_db, default=None)

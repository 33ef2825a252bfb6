"""Roughness spectrum of a profile, and the most similar of several known spectra."""

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
"""Length of the windows of Welch's method [m]."""

SHORTEST, LONGEST = 3.0, 70.0
"""Range of wavelengths over which spectra are compared [m], as far as all of them are defined."""

PER_OCTAVE = 3
"""Number of bands per octave."""


@dataclass(frozen=True)
class SpectrumMatch:
    """The known spectrum that is most similar to that of a stretch.

    Parameters
    ----------
    start, end : ends of the stretch [m]
    spectrum : name of the known spectrum
    difference_db : RMS over third octaves of 10 lg (spectrum of the stretch / known spectrum) [dB]
    level_db : its mean; above 0 the track is rougher than the known spectrum [dB]
    """

    start: float
    end: float
    spectrum: str
    difference_db: float
    level_db: float


@dataclass(frozen=True)
class Psd:
    """Power spectral density, averaged over third octaves.

    Parameters
    ----------
    spatial_frequency : centre of each third octave, (n,) [rad/m]
    density : one-sided density, (n,) [m²/(rad/m)]
    """

    spatial_frequency: Array
    density: Array


def psd(elevation: Array, spacing: float, shortest: float, longest: float) -> Psd | None:
    """Power spectral density by Welch's method over the pieces between gaps; None if all are too short.

    Parameters
    ----------
    elevation : elevation, NaN in gaps, (n,) [m]
    spacing : distance between the values [m]
    shortest, longest : range of wavelengths [m]

    Examples
    --------
    >>> white = np.random.default_rng(1).standard_normal(40000)
    >>> estimate = psd(white, 0.25, 3.0, 50.0)
    >>> bool(np.allclose(estimate.density, 0.25 / np.pi, rtol=0.2))  # 2 · variance · spacing / 2π
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
    """Range of wavelengths between `SHORTEST` and `LONGEST` over which all spectra are defined [m]."""
    known = [one for one in spectra.values() if isinstance(one, PowerLaw)]
    return (
        max([SHORTEST, *(one.shortest for one in known)]),
        min([LONGEST, *(one.longest for one in known)]),
    )


def most_similar_spectrum(
    estimate: Psd, spectra: Mapping[str, Roughness], start: float, end: float
) -> SpectrumMatch | None:
    """The known spectrum that is most similar to that of a stretch; None without known spectra.

    Parameters
    ----------
    estimate : spectrum of the stretch
    spectra : known spectra by name, all defined over the wavelengths of `estimate`
    start, end : ends of the stretch [m]
    """
    candidates = []
    for name, spectrum in spectra.items():
        ratio = 10 * np.log10(estimate.density / spectrum.density(estimate.spatial_frequency))
        difference = float(np.sqrt(np.mean(ratio**2)))
        candidates.append(SpectrumMatch(start, end, name, difference, float(ratio.mean())))
    return min(candidates, key=lambda one: one.difference_db, default=None)

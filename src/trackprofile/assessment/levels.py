"""The level in each band, its standard deviation, and the reasons why stretches are not assessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.assessment.errors_in_band import ErrorSpectrum, error_spectrum
from trackprofile.bands import Band, band_pass_pieces, edge_distance, obstacle, resample
from trackprofile.contracts import Quality
from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class NotAssessedReason(IntFlag):
    """Why a point is not assessed in a band; 0: it is assessed."""

    GAP = 1
    """The elevation is not known."""
    TOO_SHORT = 2
    """The piece between gaps is shorter than the longest wavelength of the band."""
    EDGE = 4
    """So near to an end or gap that the filtered level depends on the profile beyond it."""
    UNCERTAIN = 8
    """The data determine hardly more than the prior."""
    SLOW = 16
    """The train was slow or at a standstill."""
    UNCONVERGED = 32
    """The search for the elevation did not converge."""
    SATURATED = 64
    """A sensor was at the end of its measuring range."""
    UNEXPLAINED = 128
    """The model does not explain the recorded signals."""

    @property
    def text(self) -> str:
        """Names of the reasons, such as ``edge, slow``."""
        return ", ".join(
            str(one.name).lower().replace("_", " ") for one in NotAssessedReason if one & self
        )


# An error of unknown size affects the filtered level as far as the profile beyond an end does.
_WIDENED = {
    Quality.UNCONVERGED: NotAssessedReason.UNCONVERGED,
    Quality.SATURATED: NotAssessedReason.SATURATED,
    Quality.UNEXPLAINED: NotAssessedReason.UNEXPLAINED,
}
_LOCAL = {
    Quality.UNCERTAIN: NotAssessedReason.UNCERTAIN,
    Quality.EDGE: NotAssessedReason.EDGE,
    Quality.SLOW: NotAssessedReason.SLOW,
}


@dataclass(frozen=True)
class BandLevel:
    """A profile in one band, on a uniform grid.

    Parameters
    ----------
    band : the band
    distance : uniformly spaced distance, (n,) [m]
    level : filtered level, (n,) [m]; NaN where it is not defined
    deviation : standard deviation of its error, (n,) [m]; 0 where the profile states none
    reasons : sums of `NotAssessedReason`, (n,)
    error_spectrum : spectrum of the error in the band
    stated : whether the profile states a standard deviation in the band
    """

    band: Band
    distance: Array
    level: Array
    deviation: Array
    reasons: NDArray[np.int16]
    error_spectrum: ErrorSpectrum
    stated: bool

    @property
    def spacing(self) -> float:
        """Spacing of the grid [m]."""
        return float((self.distance[-1] - self.distance[0]) / (self.distance.size - 1))

    @property
    def assessed(self) -> Mask:
        """True where the level is assessed, (n,)."""
        return self.reasons == 0


def band_levels(
    profile: xr.Dataset, bands: Sequence[Band], *, forward_backward: bool = False
) -> tuple[Mapping[str, BandLevel], tuple[str, ...]]:
    """Filter a profile to each band; the second result is one note per band for which it is too short or coarse.

    Parameters
    ----------
    profile : profile contract
    bands : bands to filter to
    forward_backward : see `bands.band_pass`; the stated standard deviations are those of the default filter

    Raises
    ------
    DataError : the profile is too short or coarse for all bands.
    """
    grid, elevation, flags = _on_uniform_grid(profile)
    spacing = float((grid[-1] - grid[0]) / (grid.size - 1))
    deviations = {
        name.removeprefix("standard_deviation_"): _on_grid(profile, name, grid)
        for name in map(str, profile.data_vars)
        if name.startswith("standard_deviation_")
    }
    known = np.isfinite(elevation)
    typical = {name: _median(values[known]) for name, values in deviations.items()}
    levels, notes = {}, []
    for band in bands:
        longest = max((one.stop - one.start for one in runs(known)), default=1)
        reason = obstacle(band, spacing, (longest - 1) * spacing)
        if reason:
            notes.append(f"{reason}: it is not assessed")
            continue
        level = band_pass_pieces(elevation, spacing, band, forward_backward=forward_backward)
        levels[band.name] = BandLevel(
            band,
            grid,
            level,
            np.nan_to_num(deviations.get(band.name, np.zeros(grid.size))),
            _reasons(band, spacing, known, level, flags),
            error_spectrum(band, typical),
            band.name in deviations,
        )
    if not levels:
        raise DataError(
            f"No band can be assessed: {notes[0].removesuffix(': it is not assessed')}; "
            "give a longer or finer profile."
        )
    return levels, tuple(notes)


def _on_uniform_grid(profile: xr.Dataset) -> tuple[Array, Array, NDArray[np.int16]]:
    """Grid, elevation with NaN in gaps, and the flags of the nearest point."""
    distance = profile["distance"].to_numpy()
    flags = profile["quality"].to_numpy().astype(np.int16)
    elevation = np.where(flags & Quality.GAP, np.nan, profile["elevation"].to_numpy())
    spacing = float(np.median(np.diff(distance)))
    count = round(float(distance[-1] - distance[0]) / spacing) + 1
    grid = np.linspace(distance[0], distance[-1], count)
    if distance.size == count and np.abs(grid - distance).max() < 1e-6 * spacing:
        return grid, elevation, flags
    nearest = np.searchsorted((distance[1:] + distance[:-1]) / 2, grid)
    return grid, resample(distance, elevation, grid), flags[nearest]


def _on_grid(profile: xr.Dataset, name: str, grid: Array) -> Array:
    values, distance = profile[name].to_numpy(), profile["distance"].to_numpy()
    known = np.isfinite(values)
    return np.interp(grid, distance[known], values[known]) if known.any() else np.zeros(grid.size)


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else 0.0


def _reasons(
    band: Band, spacing: float, known: Mask, level: Array, flags: NDArray[np.int16]
) -> NDArray[np.int16]:
    reasons = np.zeros(known.size, np.int16)
    reach = int(np.ceil(edge_distance(band) / spacing))
    for piece in runs(known):
        reasons[piece.start : min(piece.start + reach, piece.stop)] = NotAssessedReason.EDGE
        reasons[max(piece.stop - reach, piece.start) : piece.stop] = NotAssessedReason.EDGE
    reasons[np.isnan(level)] = NotAssessedReason.TOO_SHORT
    reasons[~known] = NotAssessedReason.GAP
    for flag, reason in _LOCAL.items():
        reasons[known & (flags & flag != 0)] |= reason
    for flag, reason in _WIDENED.items():
        flagged = flags & flag != 0
        if flagged.any():
            reasons[known & _widened(flagged, reach)] |= reason
    return reasons


def _widened(mask: Mask, reach: int) -> Mask:
    """The mask, extended by `reach` points to each side."""
    wide = np.zeros(mask.size, bool)
    for run in runs(mask):
        wide[max(run.start - reach, 0) : run.stop + reach] = True
    return wide


@dataclass(frozen=True)
class NotAssessed:
    """A stretch that is not assessed in a band.

    Parameters
    ----------
    band : name of the band
    start, end : ends of the stretch [m]
    reasons : one or more reasons
    """

    band: str
    start: float
    end: float
    reasons: NotAssessedReason


def not_assessed(level: BandLevel) -> tuple[NotAssessed, ...]:
    """All stretches that are not assessed in a band, in order of distance."""
    changes = np.flatnonzero(np.diff(level.reasons)) + 1
    edges = [0, *changes.tolist(), level.reasons.size]
    half = level.spacing / 2
    return tuple(
        NotAssessed(
            level.band.name,
            float(level.distance[a]) - half,
            float(level.distance[b - 1]) + half,
            NotAssessedReason(int(level.reasons[a])),
        )
        for a, b in pairwise(edges)
        if level.reasons[a]
    )

"""Agreement of a profile with a reference, band by band.

Both are resampled to one grid, aligned by one lag, filtered to each band and then compared. One error for all
wavelengths would be meaningless, since long waves dominate it; EN 13848-2 also states accuracy per band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from trackprofile.arrays import NORMAL_95, runs
from trackprofile.bands import BANDS, Band, band_pass_pieces, obstacle, resample
from trackprofile.contracts import known_elevation
from trackprofile.errors import DataError

Array = NDArray[np.float64]

_MIN_RMS = 1e-12  # m; less is rounding of a straight line


@dataclass(frozen=True)
class BandComparison:
    """Agreement in one band, over the points at which both profiles are known.

    Parameters
    ----------
    correlation : Pearson correlation of profile and reference [-]
    rms_error_mm : RMS of profile minus reference [mm]
    reference_rms_mm : RMS of the reference [mm]
    gain : <profile, reference> / <reference, reference>; 1 if the amplitude is preserved [-]
    lag_m : distance in the profile minus distance in the reference of the same location, before the alignment [m]
    coverage_95 : share of points with |error| < 1.96 stated standard deviations; None if none is stated
    stated_rms_mm : RMS of the stated standard deviation [mm]; None if none is stated
    """

    correlation: float
    rms_error_mm: float
    reference_rms_mm: float
    gain: float
    lag_m: float
    coverage_95: float | None = None
    stated_rms_mm: float | None = None

    def as_dict(self) -> dict[str, float]:
        """The fields by name, without those that are None."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class Comparison:
    """Agreement of a profile with a reference over one stretch.

    Parameters
    ----------
    bands : agreement by name of the band; None if the stretch does not allow a comparison
    from_m, to_m : compared stretch, in the reference's distance [m]
    notes : one note for each band that is None, and for a lag at the end of the searched range
    """

    bands: Mapping[str, BandComparison | None]
    from_m: float
    to_m: float
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The result as `compare --json` prints it."""
        return {
            "bands": {name: band and band.as_dict() for name, band in self.bands.items()},
            "from_m": self.from_m,
            "to_m": self.to_m,
        }


def compare(
    profile: xr.Dataset,
    reference: xr.Dataset,
    *,
    from_m: float | None = None,
    to_m: float | None = None,
    bands: Sequence[Band] = BANDS,
    max_lag: float = 5.0,
    forward_backward: bool = False,
) -> Comparison:
    """Align a profile with a reference and compare them in each band.

    One lag is used for all bands: the one that maximises the correlation over D1 and D2 together. Both profiles are
    filtered over the whole shared range and then restricted to the stretch, so that filter transients at its ends are
    avoided. A gap in either profile (a flagged point, a missing elevation, missing rows) splits both: the pieces are
    filtered separately, and those too short for a band are omitted in it.

    Parameters
    ----------
    profile, reference : profile contracts
    from_m, to_m : stretch in the reference's distance; None: the whole shared range [m]
    bands : bands to compare
    max_lag : maximum lag that is searched to both sides; 0: no alignment [m]
    forward_backward : see `trackprofile.bands.band_pass`; the stated standard deviations are those of the default
        filter

    Raises
    ------
    DataError : the profiles share no stretch, or no part of the requested one.

    Examples
    --------
    >>> distance = np.arange(0.0, 400.0, 0.25)
    >>> level = 0.003 * np.sin(distance / 2) * np.sin(distance / 40)
    >>> truth = xr.Dataset({"elevation": ("distance", level)}, {"distance": distance})
    >>> estimate = xr.Dataset({"elevation": ("distance", 0.9 * level)}, {"distance": distance + 1.5})
    >>> d1 = compare(estimate, truth).bands["D1"]
    >>> print(f"{d1.correlation:.2f} {d1.gain:.2f} {d1.lag_m:.2f}")
    1.00 0.90 1.50
    """
    spacing = min(_median_spacing(profile, "profile"), _median_spacing(reference, "reference"))
    pair = _on_common_grid(profile, reference, spacing, lag=0.0)
    lag, notes = _best_lag(pair, _stretch(pair.distance, from_m, to_m), max_lag)
    if lag:
        pair = _on_common_grid(profile, reference, spacing, lag)
    inside = _stretch(pair.distance, from_m, to_m)
    compared: dict[str, BandComparison | None] = {}
    for band in bands:
        compared[band.name], reason = _compare_band(pair, band, inside, lag, forward_backward)
        notes += reason
    first, last = float(pair.distance[0]), float(pair.distance[-1])
    return Comparison(
        compared,
        from_m=first if from_m is None else max(first, from_m),
        to_m=last if to_m is None else min(last, to_m),
        notes=notes,
    )


@dataclass(frozen=True)
class _Pair:
    """Profile and reference on one grid; NaN in both if one has a gap."""

    distance: Array
    profile: Array
    reference: Array
    spacing: float
    deviations: Mapping[str, Array]

    def obstacle(self, band: Band) -> str:
        """Why all pieces between gaps are too short or coarse for a band; empty if one is not."""
        pieces = runs(np.isfinite(self.profile))
        longest = max((piece.stop - piece.start for piece in pieces), default=1)
        return obstacle(band, self.spacing, (longest - 1) * self.spacing)

    def in_band(self, band: Band, *, forward_backward: bool = False) -> tuple[Array, Array]:
        """Both filtered to a band; NaN where a piece is too short."""
        return (
            band_pass_pieces(self.profile, self.spacing, band, forward_backward=forward_backward),
            band_pass_pieces(self.reference, self.spacing, band, forward_backward=forward_backward),
        )


def _on_common_grid(
    profile: xr.Dataset, reference: xr.Dataset, spacing: float, lag: float
) -> _Pair:
    """The profile shifted by the lag, and the reference, on one grid."""
    moved = profile.assign_coords(distance=profile["distance"] - lag)
    start = max(float(each["distance"][0]) for each in (moved, reference))
    stop = min(float(each["distance"][-1]) for each in (moved, reference))
    if stop - start < spacing:
        raise DataError(
            f"Profile ({_span(profile)}) and reference ({_span(reference)}) share no stretch; "
            "compare profiles of the same track, with distances from the same origin."
        )
    steps = np.arange(int((stop - start) / spacing + 1e-6) + 1)
    grid = np.minimum(start + spacing * steps, stop, dtype=np.float64)
    elevations = np.stack(
        [resample(each["distance"], known_elevation(each), grid) for each in (moved, reference)]
    )
    elevations[:, np.isnan(elevations).any(axis=0)] = np.nan
    prefix = "standard_deviation_"
    deviations = {
        str(name).removeprefix(prefix): np.interp(grid, moved["distance"], moved[name])
        for name in moved.data_vars
        if str(name).startswith(prefix)
    }
    return _Pair(grid, elevations[0], elevations[1], spacing, deviations)


def _best_lag(
    pair: _Pair, inside: NDArray[np.bool_], max_lag: float
) -> tuple[float, tuple[str, ...]]:
    """The lag of highest correlation, interpolated between samples by a spline [m], and notes."""
    usable = [band for band in BANDS if not pair.obstacle(band)][:2]
    if not usable or max_lag <= 0:
        return 0.0, ()
    profile, reference = pair.in_band(Band("lag", usable[0].shortest, usable[-1].longest))
    reference = np.where(inside, reference, np.nan)
    count = profile.size
    reach = min(int(np.ceil(max_lag / pair.spacing)), count - 2)
    correlation = CubicSpline(
        pair.spacing * np.arange(-reach, reach + 1),
        [
            _correlation(
                profile[max(shift, 0) : count + shift], reference[max(-shift, 0) : count - shift]
            )
            for shift in range(-reach, reach + 1)
        ],
    )
    peaks = correlation.derivative().roots(extrapolate=False)
    lags = np.append(peaks[np.abs(peaks) < max_lag], [0.0, -max_lag, max_lag])
    best = float(lags[np.argmax(correlation(lags))])
    if correlation(best) <= 0:
        return 0.0, (
            "Profile and reference do not correlate at any lag; they were compared without alignment",
        )
    if abs(best) == max_lag:
        return best, (
            f"The lag of highest correlation is at the end of the searched range, {best:g} m: the true lag may be "
            "larger",
        )
    return best, ()


def _correlation(one: Array, other: Array) -> float:
    """Pearson correlation over the points at which both are known; 0 if either is constant."""
    known = np.isfinite(one) & np.isfinite(other)
    if np.count_nonzero(known) < 2:
        return 0.0
    one, other = one[known] - one[known].mean(), other[known] - other[known].mean()
    if min(_rms(one), _rms(other)) < _MIN_RMS:
        return 0.0
    return float(one @ other / np.sqrt((one @ one) * (other @ other)))


def _compare_band(
    pair: _Pair, band: Band, inside: NDArray[np.bool_], lag: float, forward_backward: bool
) -> tuple[BandComparison | None, tuple[str, ...]]:
    reason = pair.obstacle(band)
    if reason:
        return None, (reason,)
    profile, reference = pair.in_band(band, forward_backward=forward_backward)
    usable = inside & np.isfinite(profile)
    if np.count_nonzero(usable) < 2:
        return None, (
            f"Band {band.name}: the stretch is within gaps, or in pieces too short for the band",
        )
    profile, reference = profile[usable], reference[usable]
    if min(_rms(profile), _rms(reference)) < _MIN_RMS:
        return None, (
            f"Band {band.name}: profile or reference is constant, no correlation is defined",
        )
    error = profile - reference
    stated = pair.deviations.get(band.name, np.full(inside.size, np.nan))[usable]
    known = np.isfinite(stated)
    return BandComparison(
        correlation=_correlation(profile, reference),
        rms_error_mm=1e3 * _rms(error),
        reference_rms_mm=1e3 * _rms(reference),
        gain=float(profile @ reference / (reference @ reference)),
        lag_m=lag,
        coverage_95=float(np.mean(np.abs(error) < NORMAL_95 * stated, where=known))
        if known.any()
        else None,
        stated_rms_mm=1e3 * _rms(stated[known]) if known.any() else None,
    ), ()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _stretch(distance: Array, from_m: float | None, to_m: float | None) -> NDArray[np.bool_]:
    """The points of a grid within the stretch."""
    low = -np.inf if from_m is None else from_m
    high = np.inf if to_m is None else to_m
    inside = (distance >= low) & (distance <= high)
    if not inside.any():
        raise DataError(
            f"Profile and reference share {distance[0]:g} to {distance[-1]:g} m, got {low:g} to {high:g} m; "
            "choose a stretch within the shared range."
        )
    return inside


def _median_spacing(profile: xr.Dataset, name: str) -> float:
    distance = profile["distance"].to_numpy()
    if distance.size < 2:
        raise DataError(f"The {name} needs at least two points, got {distance.size}.")
    return float(np.median(np.diff(distance)))


def _span(profile: xr.Dataset) -> str:
    ends = profile["distance"].to_numpy()[[0, -1]]
    return f"{ends[0]:g} to {ends[1]:g} m"

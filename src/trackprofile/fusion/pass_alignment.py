"""Alignment of all passes to the chainage of one line, and detection of passes over other track.

Odometers differ by tens of metres and by a share of the distance. The lag of each pass is first tracked along a
reference pass by the correlation of slopes in windows (Viterbi path), then estimated window by window
(`assessment.alignment`), and last re-estimated against the profile that all other passes give. The line's chainage is
that of the pass with the median lag.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal import fftconvolve

from trackprofile.assessment.alignment import (
    ALIGNMENT_BAND,
    MAX_DRIFT,
    MIN_CORRELATION,
    Alignment,
    align,
)
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, band_pass_pieces, resample
from trackprofile.contracts import known_elevation
from trackprofile.errors import DataError
from trackprofile.fusion.stated_spectra import MIN_STANDARD_DEVIATION

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_LAG = 100.0
"""Lag up to which the passes are searched, in both directions [m]."""

REPORTED_LAG = 30.0
"""Lag above which the distances of a pass are reported as wrong [m]."""

MIN_LAG_DEVIATION = 1e-4
"""Lower bound of the standard deviation of a window's lag [m]."""

TRACKING_WINDOW, ALIGNMENT_WINDOW = 400.0, 150.0
"""Length of the windows in which the lag is tracked first, and estimated last [m]."""

MAX_SCALE_DIFFERENCE = 0.01
"""Share of the distance by which two odometers may differ."""

_STEP = 0.5  # m, of the tracked lags
_EXTRAPOLATION = 5000.0  # m, over which the lag continues with its slope at either end
_MIN_REFERENCE_SHARE = 0.9  # length of the reference pass over that of the longest pass


@dataclass(frozen=True)
class AlignedPass:
    """A pass on the line's chainage.

    Parameters
    ----------
    dated : the pass, its profile's distances being the line's chainage
    lag : mean over the pass of its own distance minus the line's chainage [m]
    at, deviation : standard deviation of the pass's position (m) at some chainages (m) [m]
    """

    dated: DatedProfile
    lag: float
    at: Array
    deviation: Array

    def position_deviation(self, distance: Array) -> Array:
        """Standard deviation of the pass's position along the line, interpolated [m]."""
        return np.interp(distance, self.at, self.deviation)


@dataclass(frozen=True)
class RejectedPass:
    """A pass that does not correlate with the others.

    Parameters
    ----------
    dated : the pass as it was given
    reversed : whether it correlates with the others after its direction of travel is reversed
    """

    dated: DatedProfile
    reversed: bool


def align_passes(
    passes: Sequence[DatedProfile],
) -> tuple[tuple[AlignedPass, ...], tuple[RejectedPass, ...]]:
    """Align passes to the chainage of the one with the median lag, of those that correlate with each other.

    Parameters
    ----------
    passes : two or more, sorted, so that the result does not depend on the order in which they were given

    Returns
    -------
    the aligned passes, and those that do not correlate with the reference

    Raises
    ------
    DataError : at most half of the passes correlate with any one of them.
    """
    slopes = [_slope_of(one) for one in passes]
    longest = max(one.length for one in slopes)
    for reference in sorted(slopes, key=lambda one: -one.length):
        lags = {one.dated.name: _tracked_lag(one, reference) for one in slopes}
        similar = [one for one in slopes if lags[one.dated.name] is not None]
        if 2 * len(similar) > len(slopes):
            break
    else:
        raise DataError(
            f"At most half of the {len(passes)} passes correlate with one another within a lag of {MAX_LAG:g} m; give "
            "passes of the same track, with distances from the same origin."
        )
    long_enough = [one for one in similar if one.length >= _MIN_REFERENCE_SHARE * longest]
    median = _median_pass(long_enough or similar, lags)
    results = [_aligned_to(one, median) for one in slopes]
    return (
        tuple(one for one in results if isinstance(one, AlignedPass)),
        tuple(one for one in results if isinstance(one, RejectedPass)),
    )


def realign_pass(
    one: AlignedPass, line: xr.Dataset, own_weight: float = 0.0
) -> AlignedPass | RejectedPass:
    """Align a pass with the profile of the line that the other passes give.

    If the pass has the weight w in the line, a lag l to the others is a lag (1 - w) l to the line.

    Parameters
    ----------
    one : the pass
    line : profile of the line without the pass
    own_weight : weight w of the pass in the line (0 to 1)
    """
    try:
        alignment = align(
            one.dated.profile,
            line,
            one.dated.name,
            max_lag=MAX_DRIFT,
            band=D1,
            min_standard_deviation=MIN_LAG_DEVIATION,
            window=ALIGNMENT_WINDOW,
        )
    except DataError:
        return RejectedPass(one.dated, reversed=False)
    alignment = Alignment(
        alignment.distance,
        (1 - own_weight) * alignment.lag,
        (1 - own_weight) * alignment.deviation,
    )
    lag = one.lag + _mean_lag(one.dated, alignment)
    return AlignedPass(_shifted(one.dated, alignment), lag, alignment.distance, alignment.deviation)


def _shifted(one: DatedProfile, alignment: Alignment) -> DatedProfile:
    return DatedProfile(alignment.shifted(one.profile), one.day, one.name)


def _mean_lag(one: DatedProfile, alignment: Alignment) -> float:
    """Mean lag of the whole pass [m]."""
    distance = one.profile["distance"].to_numpy()
    return float(np.mean(distance - alignment.shifted(one.profile)["distance"].to_numpy()))


@dataclass(frozen=True)
class _SlopeProfile:
    """Slope of a pass in the wavelengths used for alignment, every `_STEP` from `start`, 0 in gaps."""

    dated: DatedProfile
    start: float
    slope: Array
    known: Mask

    @property
    def length(self) -> float:
        """Length without gaps [m]."""
        return _STEP * float(np.count_nonzero(self.known))

    @property
    def in_reverse(self) -> _SlopeProfile:
        """The same with the direction of travel reversed about the middle of the pass."""
        return _SlopeProfile(self.dated, self.start, -self.slope[::-1], self.known[::-1])


def _slope_of(one: DatedProfile) -> _SlopeProfile:
    """Slopes weight all wavelengths about equally; the longest alone would dominate elevations."""
    distance = one.profile["distance"].to_numpy()
    start = _STEP * np.ceil(distance[0] / _STEP)
    half = 0.5 * _STEP
    grid = np.arange(start, distance[-1], half)
    level = resample(distance, known_elevation(one.profile), grid)
    slope = np.gradient(band_pass_pieces(level, half, ALIGNMENT_BAND), half)[::2]
    known = np.isfinite(slope)
    return _SlopeProfile(one, float(start), np.where(known, slope, 0.0), known)


def _tracked_lag(one: _SlopeProfile, reference: _SlopeProfile) -> Alignment | None:
    """Lag of a pass behind another along the line, to about a metre; None where the two do not correlate."""
    count = min(round(TRACKING_WINDOW / _STEP), reference.slope.size)
    starts = np.arange(0, reference.slope.size - count + 1, max(count // 2, 1))
    correlation = np.stack([_correlation(one, reference, int(start), count) for start in starts])
    path = _viterbi_path(correlation, max(1, round(MAX_SCALE_DIFFERENCE * count / 2)))
    on_path = correlation[np.arange(starts.size), path]
    defined = on_path != 0.0
    if not defined.any() or on_path[defined].mean() < MIN_CORRELATION:
        return None
    centres = np.asarray(reference.start + _STEP * (starts + 0.5 * count), np.float64)
    return _piecewise_linear_lag(
        centres, np.asarray(_STEP * path - MAX_LAG, np.float64), on_path > MIN_CORRELATION
    )


def _correlation(one: _SlopeProfile, reference: _SlopeProfile, start: int, count: int) -> Array:
    """Correlation of a window of the reference with the pass at every lag; 0 where less than half is known."""
    reach = round(MAX_LAG / _STEP)
    first = start + round((reference.start - one.start) / _STEP) - reach
    inside = slice(max(first, 0), max(first + count + 2 * reach, 0))
    b, m = np.zeros((2, count + 2 * reach))
    part = slice(inside.start - first, inside.start - first + one.slope[inside].size)
    b[part], m[part] = one.slope[inside], one.known[inside]
    a, n = reference.slope[start : start + count], reference.known[start : start + count]
    product, power, other_power, common = (
        fftconvolve(x, y[::-1], mode="valid") for x, y in ((b, a), (m, a * a), (b * b, n), (m, n))
    )
    size = np.sqrt(np.maximum(power * other_power, 0.0))
    sufficient = (common > 0.5 * count) & (size > 1e-9 * size.max(initial=1e-300))
    return np.where(sufficient, product / np.where(sufficient, size, 1.0), 0.0)


def _viterbi_path(correlation: Array, max_step: int) -> NDArray[np.intp]:
    """Lag index in each window (windows) with the largest sum of correlations, changing by at most `max_step`."""
    best = [correlation[0]]
    for one in correlation[1:]:
        best.append(one + maximum_filter1d(best[-1], 2 * max_step + 1, mode="nearest"))
    path = [int(np.argmax(best[-1]))]
    for one in best[-2::-1]:
        low = max(path[-1] - max_step, 0)
        path.append(low + int(np.argmax(one[low : path[-1] + max_step + 1])))
    return np.array(path[::-1])


def _piecewise_linear_lag(distance: Array, lag: Array, reliable: Mask) -> Alignment:
    """Piecewise linear fit to the reliable lags, with the fewest pieces within `MAX_DRIFT` / 4, extrapolated."""
    distance, lag = distance[reliable], lag[reliable]
    knots, at_knots = distance[:1], lag[:1]
    for pieces in range(1, distance.size):
        knots = np.linspace(distance[0], distance[-1], pieces + 1)
        hats = np.stack([np.interp(distance, knots, one) for one in np.eye(pieces + 1)], axis=1)
        at_knots = np.asarray(np.linalg.lstsq(hats, lag, rcond=None)[0], np.float64)
        if np.abs(hats @ at_knots - lag).max() < 0.25 * MAX_DRIFT:
            break
    if knots.size == 1:
        return Alignment(knots, at_knots, np.zeros(1))
    slope = np.diff(at_knots)[[0, -1]] / np.diff(knots)[[0, -1]]
    beyond = np.array([-_EXTRAPOLATION, _EXTRAPOLATION])
    ends, at_ends = knots[[0, -1]] + beyond, at_knots[[0, -1]] + slope * beyond
    return Alignment(
        np.concatenate([ends[:1], knots, ends[1:]]),
        np.concatenate([at_ends[:1], at_knots, at_ends[1:]]),
        np.zeros(knots.size + 2),
    )


def _median_pass(
    similar: Sequence[_SlopeProfile], lags: Mapping[str, Alignment | None]
) -> _SlopeProfile:
    """The pass with the median lag, each pass weighted by its precision."""
    mean = {
        one.dated.name: _mean_lag(one.dated, lag)
        for one in similar
        if (lag := lags[one.dated.name])
    }
    ordered = sorted(similar, key=lambda one: mean[one.dated.name])
    weight = np.cumsum([_precision(one.dated) for one in ordered])
    return ordered[int(np.searchsorted(weight, 0.5 * weight[-1] * (1 - 1e-9)))]


def _precision(one: DatedProfile) -> float:
    """Precision of a pass in the shortest band whose standard deviation it states [1/m²]."""
    names = [f"_{band.name}" for band in BANDS] + [""]
    for name in names:
        variable = one.profile.get(f"standard_deviation{name}")
        if variable is not None:
            return 1.0 / max(float(np.nanmedian(variable)), MIN_STANDARD_DEVIATION) ** 2
    return 1.0


def _aligned_to(one: _SlopeProfile, median: _SlopeProfile) -> AlignedPass | RejectedPass:
    """A pass on the chainage of the pass with the median lag."""
    ends = one.dated.profile["distance"].to_numpy()[[0, -1]]
    if one is median:
        return AlignedPass(one.dated, 0.0, ends, np.zeros(2))
    lag = _tracked_lag(one, median)
    if lag is None:
        reverse_lag = _tracked_lag(one.in_reverse, median)
        return RejectedPass(one.dated, reversed=reverse_lag is not None)
    shifted = AlignedPass(_shifted(one.dated, lag), _mean_lag(one.dated, lag), ends, np.zeros(2))
    return realign_pass(shifted, median.dated.profile)

"""All passes on one line's distance: which lie where, which are of this track at all.

Odometers differ by tens of metres and by a share of the distance. First each pass is followed along
a reference by the correlation in windows, then aligned window by window (`assessment.alignment`), at
last with what all others make of the place. The line's distance is that of the pass in the middle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal import fftconvolve

from trackprofile.assessment.alignment import DRIFT, LIKE, SEEN, Alignment, align
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, band_pass_pieces, resample
from trackprofile.contracts import known_elevation
from trackprofile.errors import DataError
from trackprofile.fusion.spectral_bands import LEAST

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FARTHEST = 100.0
"""Lag that is searched to both sides [m]."""

FAR = 30.0
"""Lag beyond which a pass's distances are said to be off [m]."""

SHARPEST = 1e-4
"""Standard deviation at least of a lag that a window tells [m]."""

WINDOW, FINE = 400.0, 150.0
"""Over which passes are followed at first, and one lag is taken at last [m]."""

SCALE = 0.01
"""Share of the distance by which odometers may differ."""

_STEP = 0.5  # m, of lags that are followed
_BEYOND = 5000.0  # m, over which a lag goes on as it ended
_LONG = 0.9  # share of the longest pass from which one may be the reference


@dataclass(frozen=True)
class AlignedPass:
    """A pass on the line's distance.

    Parameters
    ----------
    of : the pass, with the distances of its profile on the line
    lag : how much farther along it had its places, on the whole [m]
    at, deviation : standard deviation of its place (m), at some distances (m) [m]
    """

    of: DatedProfile
    lag: float
    at: Array
    deviation: Array

    def unsure(self, distance: Array) -> Array:
        """Standard deviation of the pass's place [m]."""
        return np.interp(distance, self.at, self.deviation)


@dataclass(frozen=True)
class RejectedPass:
    """A pass that does not look like the others, but perhaps like them turned round."""

    of: DatedProfile
    turned: bool


def align_passes(
    passes: Sequence[DatedProfile],
) -> tuple[tuple[AlignedPass, ...], tuple[RejectedPass, ...]]:
    """Lay the passes on the distance of the one in the middle of those that look alike.

    Parameters
    ----------
    passes : two or more, in an order that does not depend on who asks

    Raises
    ------
    DataError : no more than half of the passes look like any of them.
    """
    seen = [_seen(one) for one in passes]
    longest = max(one.length for one in seen)
    for reference in sorted(seen, key=lambda one: -one.length):
        lags = {one.of.name: _followed(one, reference) for one in seen}
        alike = [one for one in seen if lags[one.of.name] is not None]
        if 2 * len(alike) > len(seen):
            break
    else:
        raise DataError(
            f"Of {len(passes)} passes no more than half look like one another within {FARTHEST:g} m; give passes of "
            "the same track, with distances from the same origin."
        )
    middle = _middle([one for one in alike if one.length >= _LONG * longest] or alike, lags)
    found = [_placed(one, middle) for one in seen]
    return (
        tuple(one for one in found if isinstance(one, AlignedPass)),
        tuple(one for one in found if isinstance(one, RejectedPass)),
    )


def realign_passes(
    one: AlignedPass, others: xr.Dataset, share: float = 0.0
) -> AlignedPass | RejectedPass:
    """A pass on the place that all passes together give it.

    Parameters
    ----------
    others : the line as all others have it
    share : of the line that rests on the pass itself: the others meet it so far
    """
    try:
        found = align(one.of.profile, others, one.of.name, DRIFT, D1, SHARPEST, FINE)
    except DataError:
        return RejectedPass(one.of, turned=False)
    found = Alignment(found.distance, (1 - share) * found.lag, (1 - share) * found.deviation)
    lag = one.lag + _lag(one.of, found)
    return AlignedPass(_moved(one.of, found), lag, found.distance, found.deviation)


def _moved(one: DatedProfile, by: Alignment) -> DatedProfile:
    return DatedProfile(by.moved(one.profile), one.day, one.name)


def _lag(one: DatedProfile, found: Alignment) -> float:
    """Of the whole pass [m]."""
    distance = one.profile["distance"].to_numpy()
    return float(np.mean(distance - found.moved(one.profile)["distance"].to_numpy()))


@dataclass(frozen=True)
class _Seen:
    """The slope of a pass in the waves by which it is aligned, every `_STEP` from `start` on, 0 in gaps."""

    of: DatedProfile
    start: float
    slope: Array
    known: Mask

    @property
    def length(self) -> float:
        """That is known [m]."""
        return _STEP * float(np.count_nonzero(self.known))

    @property
    def turned(self) -> _Seen:
        """As if it had been run the other way, about its middle."""
        return _Seen(self.of, self.start, -self.slope[::-1], self.known[::-1])


def _seen(one: DatedProfile) -> _Seen:
    """Slopes weigh all waves about alike: levels would be compared by the longest alone."""
    distance = one.profile["distance"].to_numpy()
    start = _STEP * np.ceil(distance[0] / _STEP)
    half = 0.5 * _STEP
    grid = np.arange(start, distance[-1], half)
    level = resample(distance, known_elevation(one.profile), grid)
    slope = np.gradient(band_pass_pieces(level, half, SEEN), half)[::2]
    known = np.isfinite(slope)
    return _Seen(one, float(start), np.where(known, slope, 0.0), known)


def _followed(one: _Seen, reference: _Seen) -> Alignment | None:
    """The lag of a pass behind another along the line, to about a metre; None where the two do not look alike."""
    count = min(round(WINDOW / _STEP), reference.slope.size)
    starts = np.arange(0, reference.slope.size - count + 1, max(count // 2, 1))
    likeness = np.stack([_likeness(one, reference, int(start), count) for start in starts])
    path = _likeliest_path(likeness, max(1, round(SCALE * count / 2)))
    found = likeness[np.arange(starts.size), path]
    told = found != 0.0
    if not told.any() or found[told].mean() < LIKE:
        return None
    middles = np.asarray(reference.start + _STEP * (starts + 0.5 * count), np.float64)
    return _simplest(middles, np.asarray(_STEP * path - FARTHEST, np.float64), found > LIKE)


def _likeness(one: _Seen, reference: _Seen, start: int, count: int) -> Array:
    """Correlation of a window of the reference with the pass, at every lag; 0 where less than half is known."""
    reach = round(FARTHEST / _STEP)
    first = start + round((reference.start - one.start) / _STEP) - reach
    inside = slice(max(first, 0), max(first + count + 2 * reach, 0))
    b, m = np.zeros((2, count + 2 * reach))
    here = slice(inside.start - first, inside.start - first + one.slope[inside].size)
    b[here], m[here] = one.slope[inside], one.known[inside]
    a, n = reference.slope[start : start + count], reference.known[start : start + count]
    product, power, other, shared = (
        fftconvolve(x, y[::-1], mode="valid") for x, y in ((b, a), (m, a * a), (b * b, n), (m, n))
    )
    size = np.sqrt(np.maximum(power * other, 0.0))
    enough = (shared > 0.5 * count) & (size > 1e-9 * size.max(initial=1e-300))
    return np.where(enough, product / np.where(enough, size, 1.0), 0.0)


def _likeliest_path(likeness: Array, step: int) -> NDArray[np.intp]:
    """The lag in each window (windows) that adds up to most, if it changes by at most a step to the next (Viterbi)."""
    best = [likeness[0]]
    for one in likeness[1:]:
        best.append(one + maximum_filter1d(best[-1], 2 * step + 1, mode="nearest"))
    path = [int(np.argmax(best[-1]))]
    for one in best[-2::-1]:
        low = max(path[-1] - step, 0)
        path.append(low + int(np.argmax(one[low : path[-1] + step + 1])))
    return np.array(path[::-1])


def _simplest(distance: Array, lag: Array, sure: Mask) -> Alignment:
    """Straight lines through the lags, as few as come within a quarter of what `align` finds, going on at the ends."""
    distance, lag = distance[sure], lag[sure]
    knots, at_knots = distance[:1], lag[:1]
    for pieces in range(1, distance.size):
        knots = np.linspace(distance[0], distance[-1], pieces + 1)
        hats = np.stack([np.interp(distance, knots, one) for one in np.eye(pieces + 1)], axis=1)
        at_knots = np.asarray(np.linalg.lstsq(hats, lag, rcond=None)[0], np.float64)
        if np.abs(hats @ at_knots - lag).max() < 0.25 * DRIFT:
            break
    if knots.size == 1:
        return Alignment(knots, at_knots, np.zeros(1))
    slope = np.diff(at_knots)[[0, -1]] / np.diff(knots)[[0, -1]]
    beyond = np.array([-_BEYOND, _BEYOND])
    ends, at_ends = knots[[0, -1]] + beyond, at_knots[[0, -1]] + slope * beyond
    return Alignment(
        np.concatenate([ends[:1], knots, ends[1:]]),
        np.concatenate([at_ends[:1], at_knots, at_ends[1:]]),
        np.zeros(knots.size + 2),
    )


def _middle(alike: Sequence[_Seen], lags: Mapping[str, Alignment | None]) -> _Seen:
    """The one that has its places neither early nor late: the median, by what each knows."""
    mean = {one.of.name: _lag(one.of, found) for one in alike if (found := lags[one.of.name])}
    ordered = sorted(alike, key=lambda one: mean[one.of.name])
    weight = np.cumsum([_known_by(one.of) for one in ordered])
    return ordered[int(np.searchsorted(weight, 0.5 * weight[-1] * (1 - 1e-9)))]


def _known_by(one: DatedProfile) -> float:
    """Weight of a pass, by the shortest waves of which it states how well it knows them [1/m²]."""
    names = [f"_{band.name}" for band in BANDS] + [""]
    for name in names:
        variable = one.profile.get(f"standard_deviation{name}")
        if variable is not None:
            return 1.0 / max(float(np.nanmedian(variable)), LEAST) ** 2
    return 1.0


def _placed(one: _Seen, middle: _Seen) -> AlignedPass | RejectedPass:
    """A pass on the distance of the one in the middle."""
    ends = one.of.profile["distance"].to_numpy()[[0, -1]]
    if one is middle:
        return AlignedPass(one.of, 0.0, ends, np.zeros(2))
    path = _followed(one, middle)
    if path is None:
        return RejectedPass(one.of, turned=_followed(one.turned, middle) is not None)
    near = AlignedPass(_moved(one.of, path), _lag(one.of, path), ends, np.zeros(2))
    return realign_passes(near, middle.of.profile)

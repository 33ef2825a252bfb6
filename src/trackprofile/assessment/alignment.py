"""Where one profile's places lie in another: its lag along the line, and how sure that is.

Two trains never agree on their distance, and the difference drifts. In each window the lag τ makes
the sum of squared differences Σ (b(x + τ) - a(x))² least; with the residual r and the slope b' its
variance is Σ Σ b' r r b' / (Σ b'²)², the score's long-run variance (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from trackprofile.bands import Band, band_pass_pieces, resample
from trackprofile.contracts import Quality, build_profile, known_elevation
from trackprofile.errors import DataError

Array = NDArray[np.float64]

WINDOW = 250.0
"""Over which one lag is taken [m]."""

LARGEST = 30.0
"""Lag between two passes that is searched for [m]."""

DRIFT = 2.0
"""To which the lag of a window may differ from that of the whole [m]."""

SEEN = Band("alignment", 3.0, 70.0)
"""Wavelengths by which profiles are aligned: longer ones say little of a place."""

LEAST = 1e-3
"""Standard deviation of a lag at least [m]: copies of one profile would know it for certain."""

_SPREAD = "standard_deviation"

LIKE = 0.5
"""Correlation of two windows, below which they do not tell a lag."""


@dataclass(frozen=True)
class Alignment:
    """How much farther along a profile's places stand than those of the first.

    Parameters
    ----------
    distance : middles of windows and the two ends, in the first profile's distance (n) [m]
    lag : there (n) [m]
    deviation : standard deviation of it (n) [m]
    """

    distance: Array
    lag: Array
    deviation: Array

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Lag and its standard deviation at some distances of the first profile (n) [m]."""
        return (
            np.interp(distance, self.distance, self.lag),
            np.interp(distance, self.distance, self.deviation),
        )

    def moved(self, profile: xr.Dataset) -> xr.Dataset:
        """The profile, with its points where the first profile has them."""
        own = profile["distance"].to_numpy()
        first = own - np.interp(own, self.distance + self.lag, self.lag)
        return profile.assign_coords(distance=("distance", first, profile["distance"].attrs))


def on_common_grid(profiles: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """All profiles at the places of the first that all of them know, a gap in one being a gap in all.

    A band's filter feels where a profile ends: of ends that differ it would make a change.
    """
    first = profiles[0]["distance"].to_numpy()
    start = max(float(one["distance"][0]) for one in profiles)
    end = min(float(one["distance"][-1]) for one in profiles)
    grid = first[(first >= start) & (first <= end)]
    levels = [resample(one["distance"], known_elevation(one), grid) for one in profiles]
    unknown = np.isnan(levels).any(axis=0)
    return [
        _at(one, grid, np.where(unknown, np.nan, level))
        for one, level in zip(profiles, levels, strict=True)
    ]


def _at(profile: xr.Dataset, grid: Array, level: Array) -> xr.Dataset:
    """A profile on another grid, with the level it has there."""
    own = profile["distance"].to_numpy()
    nearest = np.searchsorted((own[1:] + own[:-1]) / 2, grid)
    flags = profile["quality"].to_numpy()[nearest]
    spreads = {
        str(name): np.interp(grid, own, profile[name])
        for name in profile.data_vars
        if str(name).startswith(_SPREAD)
    }
    return build_profile(
        grid,
        level,
        kind=profile.attrs["kind"],
        standard_deviation=spreads.pop(_SPREAD, None),
        band_standard_deviations={
            name.removeprefix(f"{_SPREAD}_"): values for name, values in spreads.items()
        },
        quality=np.where(np.isnan(level), flags | Quality.GAP, flags),
        vehicle=profile.attrs["vehicle"],
    )


def align(
    profile: xr.Dataset,
    first: xr.Dataset,
    name: str,
    largest: float = LARGEST,
    seen: Band = SEEN,
    least: float = LEAST,
    window: float = WINDOW,
) -> Alignment:
    """Find the lag of a profile behind the first, window by window.

    Parameters
    ----------
    profile, first : profile contracts
    name : of the profile, for messages
    largest : lag that is searched to both sides [m]
    seen : wavelengths by which they are aligned; the shorter, the sharper, as far as the profiles know them
    least : standard deviation that a window's lag has at least [m]
    window : over which one lag is taken [m]; the shorter, the better a bend is followed, and the less a window tells

    Raises
    ------
    DataError : the two do not overlap, or nowhere look alike.
    """
    spacing = float(np.median(np.diff(first["distance"].to_numpy())))
    grid, a, b = _both(profile, first, name, spacing, seen)
    whole = _whole_lag(a, b, spacing, largest)
    if whole is None:
        raise DataError(
            f"{name}: within {largest:g} m nothing of it looks like the first profile; give profiles of the same "
            "track, with distances from the same origin."
        )
    distance, lags, deviations = [], [], []
    count = min(round(window / spacing), grid.size)
    for start in range(0, grid.size - count + 1, count):
        here = slice(start, start + count)
        told = _window_lag(a, b, here, whole, spacing, round(seen.longest / spacing))
        if told:
            distance.append(float(grid[start : start + count].mean()))
            lags.append(told[0])
            deviations.append(max(told[1], least))
    if not distance:
        raise DataError(
            f"{name}: in no window of {window:g} m does it look like the first profile; the two are of other track, "
            "or too rough to compare."
        )
    wanted = np.unique([grid[0], *distance, grid[-1]])
    return _smooth_lag(np.array(distance), np.array(lags), np.array(deviations), wanted)


def _smooth_lag(distance: Array, lag: Array, deviation: Array, wanted: Array) -> Alignment:
    """The lag as a random walk about a straight line, given each window's.

    How fast it walks is what makes the windows' lags most probable: where track changed, a window is misled, says so
    by its deviation, and is overruled by its neighbours.
    """
    # A wheel worn otherwise makes the lag grow evenly.
    line = np.polyfit(distance, lag, min(1, lag.size - 1), w=1 / deviation)
    off, every = lag - np.polyval(line, distance), np.concatenate([distance, wanted])
    apart = np.abs(every[:, None] - every) / WINDOW
    told = distance.size
    best, found = -np.inf, (np.zeros(wanted.size), np.zeros(wanted.size))
    for walk in np.geomspace(1e-4, 1.0, 13):
        variogram = 0.5 * walk**2 * apart
        # Only differences count in a walk: its level may vary by any large amount.
        prior = max(1.0, float(variogram.max())) - variogram
        factor = cho_factor(prior[:told, :told] + np.diag(deviation**2))
        logarithm = -np.sum(np.log(np.diag(factor[0]))) - 0.5 * float(off @ cho_solve(factor, off))
        if logarithm > best:
            best, cross = logarithm, prior[told:, :told]
            gain = cho_solve(factor, cross.T).T
            spread = np.diag(prior)[told:] - np.einsum("ij,ij->i", gain, cross)
            found = (gain @ off, np.sqrt(np.maximum(spread, 0.0)))
    return Alignment(wanted, np.polyval(line, wanted) + found[0], found[1])


def _both(
    profile: xr.Dataset, first: xr.Dataset, name: str, spacing: float, seen: Band
) -> tuple[Array, Array, Array]:
    """A common grid, and the first profile and the other in the band of alignment, NaN in gaps."""
    ends = [one["distance"].to_numpy()[[0, -1]] for one in (first, profile)]
    start, end = max(one[0] for one in ends), min(one[1] for one in ends)
    if end - start < SEEN.longest:
        spans = " and ".join(f"{one[0]:g} to {one[1]:g} m" for one in ends)
        raise DataError(
            f"{name}: it shares less than {SEEN.longest:g} m with the first profile ({spans}); compare profiles of "
            "the same track, with distances from the same origin."
        )
    grid = np.asarray(start + spacing * np.arange(int((end - start) / spacing) + 1), np.float64)
    a, b = (
        band_pass_pieces(resample(one["distance"], known_elevation(one), grid), spacing, seen)
        for one in (first, profile)
    )
    return grid, a, b


def _whole_lag(a: Array, b: Array, spacing: float, largest: float) -> int | None:
    """Steps of the grid by which the correlation of all is greatest; None where none is."""
    reach = min(round(largest / spacing), a.size // 2)
    steps = np.arange(-reach, reach + 1)
    correlations = [_correlation(*_overlap(a, b, int(step))) for step in steps]
    best = int(np.argmax(correlations))
    return int(steps[best]) if correlations[best] > 0 else None


def _overlap(a: Array, b: Array, step: int) -> tuple[Array, Array]:
    """a, and b that many steps on, where both are known."""
    low, high = max(0, -step), min(a.size, b.size - step)
    one, other = a[low:high], b[low + step : high + step]
    known = np.isfinite(one) & np.isfinite(other)
    return one[known], other[known]


def _correlation(one: Array, other: Array) -> float:
    size = float(np.sqrt(np.dot(one, one) * np.dot(other, other)))
    return float(one @ other) / size if size > 0 else 0.0


def _window_lag(
    a: Array, b: Array, window: slice, whole: int, spacing: float, memory: int
) -> tuple[float, float] | None:
    """Lag and its standard deviation in one window [m]; None where it tells none.

    The residual hangs together over the longest wave, of ``memory`` points.
    """
    reach = round(DRIFT / spacing)
    here = np.arange(window.start, window.stop)
    slope = np.gradient(b, spacing)
    costs = []
    for step in range(whole - reach, whole + reach + 1):
        inside = (here + step >= 0) & (here + step < b.size)
        difference = b[(here + step)[inside]] - a[here[inside]]
        known = np.isfinite(difference)
        if np.count_nonzero(known) < 0.8 * here.size:
            return None
        costs.append(float(np.mean(difference[known] ** 2)))
    best = int(np.argmin(costs))
    if best in (0, len(costs) - 1):
        return None
    step = whole - reach + best
    inside = (here + step >= 0) & (here + step < b.size)
    x, y, s = a[here[inside]], b[(here + step)[inside]], slope[(here + step)[inside]]
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(s)
    x, y, s = x[known], y[known], s[known]
    if _correlation(x, y) < LIKE:
        return None
    power = float(s @ s)
    residual = y - x
    shift = -float(s @ residual) / power
    scores = s * (residual + s * shift)
    variance = _long_run(scores, memory) / power**2
    return step * spacing + shift, float(np.sqrt(variance))


def _long_run(scores: Array, memory: int) -> float:
    """Variance of the sum of scores that hang together over some samples, with Bartlett's weights."""
    total = float(scores @ scores)
    for lag in range(1, min(memory, scores.size - 1)):
        total += 2 * (1 - lag / memory) * float(scores[lag:] @ scores[:-lag])
    return max(total, float(scores @ scores) / scores.size)

"""Alignment of two profiles of the same track: the lag between their distances, with its standard deviation.

Two trains never agree exactly on distance, and the difference drifts. In each window the lag τ minimises the sum of
squared differences Σ (b(x + τ) - a(x))². With the residual r and the slope b', its variance is
Σ Σ b' r r b' / (Σ b'²)², where the double sum is the long-run variance of the score (Newey and West 1987).
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
"""Length of the windows, each with one lag [m]."""

MAX_LAG = 30.0
"""Maximum lag between two passes that is searched [m]."""

MAX_DRIFT = 2.0
"""Maximum difference between the lag of a window and the overall lag [m]."""

ALIGNMENT_BAND = Band("alignment", 3.0, 70.0)
"""Wavelengths used for the alignment: longer ones hardly determine a lag."""

MIN_STANDARD_DEVIATION = 1e-3
"""Minimum standard deviation of a lag [m]; that of two identical profiles would be 0."""

_STANDARD_DEVIATION = "standard_deviation"

MIN_CORRELATION = 0.5
"""Minimum correlation of two windows from which a lag is estimated."""

_MIN_KNOWN_SHARE = 0.8  # of the points of a window


@dataclass(frozen=True)
class Alignment:
    """Lag of a profile's distance behind that of a reference profile.

    Parameters
    ----------
    distance : centres of the windows and both ends, in the reference's distance, (n,) [m]
    lag : the profile's distance minus the reference's distance at the same location, (n,) [m]
    deviation : standard deviation of the lag, (n,) [m]
    """

    distance: Array
    lag: Array
    deviation: Array

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Lag and its standard deviation at distances of the reference, (n,) [m]."""
        return (
            np.interp(distance, self.distance, self.lag),
            np.interp(distance, self.distance, self.deviation),
        )

    def shifted(self, profile: xr.Dataset) -> xr.Dataset:
        """The profile with distances of the reference."""
        own = profile["distance"].to_numpy()
        aligned = own - np.interp(own, self.distance + self.lag, self.lag)
        return profile.assign_coords(distance=("distance", aligned, profile["distance"].attrs))


def resample_to_common_grid(profiles: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Resample profiles to the points of the first within the range that all cover; a gap in one is a gap in all.

    The output of a band filter depends on where a profile ends, so that different ends would appear as a change.
    """
    first = profiles[0]["distance"].to_numpy()
    start = max(float(one["distance"][0]) for one in profiles)
    end = min(float(one["distance"][-1]) for one in profiles)
    grid = first[(first >= start) & (first <= end)]
    levels = [resample(one["distance"], known_elevation(one), grid) for one in profiles]
    unknown = np.isnan(levels).any(axis=0)
    return [
        _resampled(one, grid, np.where(unknown, np.nan, level))
        for one, level in zip(profiles, levels, strict=True)
    ]


def _resampled(profile: xr.Dataset, grid: Array, level: Array) -> xr.Dataset:
    """A profile on another grid, with a given elevation."""
    own = profile["distance"].to_numpy()
    nearest = np.searchsorted((own[1:] + own[:-1]) / 2, grid)
    flags = profile["quality"].to_numpy()[nearest]
    deviations = {
        str(name): np.interp(grid, own, profile[name])
        for name in profile.data_vars
        if str(name).startswith(_STANDARD_DEVIATION)
    }
    return build_profile(
        grid,
        level,
        kind=profile.attrs["kind"],
        standard_deviation=deviations.pop(_STANDARD_DEVIATION, None),
        band_standard_deviations={
            name.removeprefix(f"{_STANDARD_DEVIATION}_"): values
            for name, values in deviations.items()
        },
        quality=np.where(np.isnan(level), flags | Quality.GAP, flags),
        vehicle=profile.attrs["vehicle"],
    )


def align(
    profile: xr.Dataset,
    reference: xr.Dataset,
    name: str,
    *,
    max_lag: float = MAX_LAG,
    band: Band = ALIGNMENT_BAND,
    min_standard_deviation: float = MIN_STANDARD_DEVIATION,
    window: float = WINDOW,
) -> Alignment:
    """Estimate the lag of a profile behind a reference profile, window by window.

    Parameters
    ----------
    profile, reference : profile contracts
    name : name of the profile, for messages
    max_lag : maximum lag that is searched to both sides [m]
    band : wavelengths used; shorter ones determine the lag more precisely, if the profiles contain them
    min_standard_deviation : minimum standard deviation of a window's lag [m]
    window : length of the windows [m]; shorter windows follow a varying lag better, with less data each

    Raises
    ------
    DataError : the two do not overlap, or do not correlate in any window.
    """
    spacing = float(np.median(np.diff(reference["distance"].to_numpy())))
    grid, a, b = _in_band(profile, reference, name, spacing, band)
    overall = _overall_lag(a, b, spacing, max_lag)
    if overall is None:
        raise DataError(
            f"{name}: it does not correlate with the first profile at any lag up to {max_lag:g} m; give profiles of "
            "the same track, with distances from the same origin."
        )
    distance, lags, deviations = [], [], []
    count = min(round(window / spacing), grid.size)
    for start in range(0, grid.size - count + 1, count):
        estimate = _window_lag(
            a, b, slice(start, start + count), overall, spacing, round(band.longest / spacing)
        )
        if estimate:
            distance.append(float(grid[start : start + count].mean()))
            lags.append(estimate[0])
            deviations.append(max(estimate[1], min_standard_deviation))
    if not distance:
        raise DataError(
            f"{name}: it does not correlate with the first profile in any window of {window:g} m; the two are of "
            "different track, or too noisy to compare."
        )
    nodes = np.unique([grid[0], *distance, grid[-1]])
    return _smooth_lag(np.array(distance), np.array(lags), np.array(deviations), nodes)


def _smooth_lag(distance: Array, lag: Array, deviation: Array, nodes: Array) -> Alignment:
    """Gaussian process regression of the windows' lags: a random walk about a straight line.

    The step size of the walk maximises the marginal likelihood of the windows' lags. Where the track changed, the lag
    of a window is wrong, but its standard deviation is large and the neighbours prevail.
    """
    # Different wheel wear makes the lag grow linearly.
    line = np.polyfit(distance, lag, min(1, lag.size - 1), w=1 / deviation)
    residual, points = lag - np.polyval(line, distance), np.concatenate([distance, nodes])
    separation = np.abs(points[:, None] - points) / WINDOW
    count = distance.size
    best = -np.inf
    mean, standard_deviation = np.zeros(nodes.size), np.zeros(nodes.size)
    for step in np.geomspace(1e-4, 1.0, 13):
        variogram = 0.5 * step**2 * separation
        # A random walk determines differences only: the variance of its level is any large value.
        prior = max(1.0, float(variogram.max())) - variogram
        factor = cho_factor(prior[:count, :count] + np.diag(deviation**2))
        log_likelihood = -np.sum(np.log(np.diag(factor[0]))) - 0.5 * float(
            residual @ cho_solve(factor, residual)
        )
        if log_likelihood > best:
            best, cross = log_likelihood, prior[count:, :count]
            gain = cho_solve(factor, cross.T).T
            variance = np.diag(prior)[count:] - np.einsum("ij,ij->i", gain, cross)
            mean, standard_deviation = gain @ residual, np.sqrt(np.maximum(variance, 0.0))
    return Alignment(nodes, np.polyval(line, nodes) + mean, standard_deviation)


def _in_band(
    profile: xr.Dataset, reference: xr.Dataset, name: str, spacing: float, band: Band
) -> tuple[Array, Array, Array]:
    """A common grid, and the reference and the profile in the band, NaN in gaps."""
    ends = [one["distance"].to_numpy()[[0, -1]] for one in (reference, profile)]
    start, end = max(one[0] for one in ends), min(one[1] for one in ends)
    if end - start < ALIGNMENT_BAND.longest:
        spans = " and ".join(f"{one[0]:g} to {one[1]:g} m" for one in ends)
        raise DataError(
            f"{name}: it shares less than {ALIGNMENT_BAND.longest:g} m with the first profile ({spans}); compare "
            "profiles of the same track, with distances from the same origin."
        )
    grid = np.asarray(start + spacing * np.arange(int((end - start) / spacing) + 1), np.float64)
    a, b = (
        band_pass_pieces(resample(one["distance"], known_elevation(one), grid), spacing, band)
        for one in (reference, profile)
    )
    return grid, a, b


def _overall_lag(a: Array, b: Array, spacing: float, max_lag: float) -> int | None:
    """The lag of highest correlation over the whole range, in grid steps; None if no correlation is positive."""
    reach = min(round(max_lag / spacing), a.size // 2)
    steps = np.arange(-reach, reach + 1)
    correlations = [_correlation(*_overlap(a, b, int(step))) for step in steps]
    best = int(np.argmax(correlations))
    return int(steps[best]) if correlations[best] > 0 else None


def _overlap(a: Array, b: Array, step: int) -> tuple[Array, Array]:
    """a, and b shifted by a number of steps, at the points where both are known."""
    low, high = max(0, -step), min(a.size, b.size - step)
    one, other = a[low:high], b[low + step : high + step]
    known = np.isfinite(one) & np.isfinite(other)
    return one[known], other[known]


def _correlation(one: Array, other: Array) -> float:
    size = float(np.sqrt(np.dot(one, one) * np.dot(other, other)))
    return float(one @ other) / size if size > 0 else 0.0


def _window_lag(
    a: Array, b: Array, window: slice, overall: int, spacing: float, memory: int
) -> tuple[float, float] | None:
    """Lag and its standard deviation in one window [m]; None if the window does not determine one.

    The residual is correlated over ``memory`` points, the longest wavelength.
    """
    reach = round(MAX_DRIFT / spacing)
    points = np.arange(window.start, window.stop)
    slope = np.gradient(b, spacing)
    costs = []
    for step in range(overall - reach, overall + reach + 1):
        inside = (points + step >= 0) & (points + step < b.size)
        difference = b[(points + step)[inside]] - a[points[inside]]
        known = np.isfinite(difference)
        if np.count_nonzero(known) < _MIN_KNOWN_SHARE * points.size:
            return None
        costs.append(float(np.mean(difference[known] ** 2)))
    best = int(np.argmin(costs))
    if best in (0, len(costs) - 1):
        return None
    step = overall - reach + best
    inside = (points + step >= 0) & (points + step < b.size)
    x, y, s = a[points[inside]], b[(points + step)[inside]], slope[(points + step)[inside]]
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(s)
    x, y, s = x[known], y[known], s[known]
    if _correlation(x, y) < MIN_CORRELATION:
        return None
    power = float(s @ s)
    residual = y - x
    shift = -float(s @ residual) / power
    scores = s * (residual + s * shift)
    variance = _long_run(scores, memory) / power**2
    return step * spacing + shift, float(np.sqrt(variance))


def _long_run(scores: Array, memory: int) -> float:
    """Variance of the sum of scores that are correlated over `memory` samples, with Bartlett weights."""
    total = float(scores @ scores)
    for lag in range(1, min(memory, scores.size - 1)):
        total += 2 * (1 - lag / memory) * float(scores[lag:] @ scores[:-lag])
    return max(total, float(scores @ scores) / scores.size)

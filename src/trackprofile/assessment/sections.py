"""Standard deviation of the level per section with its interval, and quality class with its probability.

The true level in a band is m + e, the estimate and a Gaussian error with covariance S. Over the n points of a section,
with the mean removed by C = I - 11ᵀ/n, its variance V = |C(m + e)|²/n has the moments

    E V = (mᵀCm + tr CS)/n,    var V = (4 mᵀC S C m + 2 tr (CS)²)/n²

(moments of a quadratic form in Gaussian variables). The standard deviation of a section therefore exceeds that of the
estimate, which is too smooth. V is modelled by a gamma distribution with these two moments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.stats import gamma

from trackprofile.assessment.levels import BandLevel
from trackprofile.assessment.limits import QualityClasses

Array = NDArray[np.float64]

MIN_ASSESSED_SHARE = 0.8
"""Minimum assessed share of a section; a section with less is omitted."""

_INTERVAL = (0.025, 0.975)


@dataclass(frozen=True)
class Section:
    """One section of the track in one band.

    Parameters
    ----------
    band : name of the band
    start, end : ends of the section, multiples of its length [m]
    assessed_share : share of its points that are assessed
    standard_deviation : standard deviation of the true level, the square root of its expected variance [m]
    low, high : ends of its 95 % interval [m]
    estimate_standard_deviation : standard deviation of the estimated level [m]
    probabilities : probability of each quality class, best first; empty if the limit set has no classes
    classes : quality classes at the line speed, if there are any
    """

    band: str
    start: float
    end: float
    assessed_share: float
    standard_deviation: float
    low: float
    high: float
    estimate_standard_deviation: float
    probabilities: Mapping[str, float]
    classes: QualityClasses | None

    @property
    def length(self) -> float:
        """Length from start to end [m]."""
        return self.end - self.start

    @property
    def quality_class(self) -> str:
        """Name of the most probable class; empty without classes."""
        return max(self.probabilities, key=self.probabilities.__getitem__, default="")


def assess_sections(
    level: BandLevel, length: float, classes: QualityClasses | None
) -> tuple[Section, ...]:
    """Assess all sections of a length, in order of distance.

    Parameters
    ----------
    level : level in a band
    length : length of the sections [m]; they begin at its multiples
    classes : quality classes of the band at the line speed

    Examples
    --------
    >>> from trackprofile.assessment.levels import band_levels
    >>> from trackprofile.bands import D1
    >>> from trackprofile.contracts import build_profile
    >>> distance = np.arange(0.0, 900.0, 0.25)
    >>> wave = build_profile(distance, 1e-3 * np.sin(2 * np.pi * distance / 10), kind="truth")
    >>> levels, _ = band_levels(wave, [D1])
    >>> [f"{one.start:.0f} m: {1e3 * one.standard_deviation:.3f} mm"
    ...  for one in assess_sections(levels["D1"], 200.0, None)]
    ['0 m: 0.707 mm', '200 m: 0.707 mm', '400 m: 0.707 mm', '600 m: 0.707 mm']
    """
    count = round(length / level.spacing)
    if count < 2:
        return ()
    moments = _error_moments(level, count)
    first = int(np.floor(level.distance[0] / length))
    last = int(np.ceil(level.distance[-1] / length))
    sections = []
    for number in range(first, last):
        start, end = number * length, (number + 1) * length
        inside = slice(*np.searchsorted(level.distance, [start - 1e-6, end - 1e-6]))
        used = level.assessed[inside]
        share = np.count_nonzero(used) / count
        if share >= MIN_ASSESSED_SHARE:
            sections.append(
                _section(level, inside, (start, end), min(share, 1.0), moments, classes)
            )
    return tuple(sections)


@dataclass(frozen=True)
class _ErrorMoments:
    """Moments of the variance over one section of an error of unit variance.

    Parameters
    ----------
    correlation : correlation matrix R of the error, (n, n)
    mean : expected variance about the section's mean, tr CR/n
    variance : variance of that variance, 2 tr (CR)²/n²
    """

    correlation: Array
    mean: float
    variance: float


def _error_moments(level: BandLevel, count: int) -> _ErrorMoments:
    row = level.error_spectrum.correlation(level.spacing * np.arange(count, dtype=np.float64))
    correlation = toeplitz(row)
    centred = correlation - correlation.mean(axis=0)
    mean = float(np.trace(centred)) / count
    return _ErrorMoments(correlation, mean, 2 * float(np.sum(centred * centred.T)) / count**2)


def _section(
    level: BandLevel,
    inside: slice,
    ends: tuple[float, float],
    share: float,
    error: _ErrorMoments,
    classes: QualityClasses | None,
) -> Section:
    used = level.assessed[inside]
    values, deviation = level.level[inside][used], level.deviation[inside][used]
    centred = values - values.mean()
    weighted = np.zeros(used.size)
    weighted[used] = centred * deviation
    size = min(weighted.size, len(error.correlation))
    cross = float(weighted[:size] @ error.correlation[:size, :size] @ weighted[:size])
    estimated, mean_square = float(np.mean(centred**2)), float(np.mean(deviation**2))
    expected = estimated + mean_square * error.mean
    variance = 4 * cross / values.size**2 + mean_square**2 * error.variance / share
    low, high = _quantiles(expected, variance)
    return Section(
        level.band.name,
        *ends,
        share,
        standard_deviation=float(np.sqrt(expected)),
        low=low,
        high=high,
        estimate_standard_deviation=float(np.sqrt(estimated)),
        probabilities={} if classes is None else _probabilities(expected, variance, classes),
        classes=classes,
    )


def _shape_and_scale(expected: float, variance: float) -> tuple[float, float]:
    return expected**2 / variance, variance / expected


def _certain(expected: float, variance: float) -> bool:
    return variance <= (1e-9 * expected) ** 2 or expected <= 0


def _quantiles(expected: float, variance: float) -> tuple[float, float]:
    """Ends of the 95 % interval of the standard deviation [m]."""
    if _certain(expected, variance):
        return float(np.sqrt(expected)), float(np.sqrt(expected))
    shape, scale = _shape_and_scale(expected, variance)
    low, high = np.sqrt(gamma.ppf(_INTERVAL, shape, scale=scale))
    return float(low), float(high)


def _probabilities(expected: float, variance: float, classes: QualityClasses) -> dict[str, float]:
    bounds = np.array(list(classes.below.values()))
    if _certain(expected, variance):
        below = (np.sqrt(expected) < bounds).astype(float)
    else:
        shape, scale = _shape_and_scale(expected, variance)
        below = gamma.cdf(bounds**2, shape, scale=scale)
    shares = np.diff(np.concatenate([[0.0], below, [1.0]]))
    return dict(zip(classes.names, map(float, shares), strict=True))

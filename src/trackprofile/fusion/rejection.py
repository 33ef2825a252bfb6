"""Detection of passes that contradict the others, along the whole line or on a stretch, and the reason.

A pass contradicts the others in a band if its error variance over the stated one, λ, exceeds `MIN_ERROR_RATIO`² times
the typical one, and the quantile of χ² that good passes exceed in one of ten thousand lines. The reason follows from
the regression of the pass on the line that the others give, subband by subband.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert
from scipy.stats import chi2

from trackprofile.fusion.spectral_bands import (
    BAND_INTEGRALS,
    BAND_RANGES,
    CENTRE_FREQUENCIES,
    WavelengthRange,
    decompose_spectrum,
)
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import (
    CovarianceCells,
    VarianceComponents,
    projection,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

MIN_ERROR_RATIO = 2.0
"""Standard deviation of a pass's error, over the typical one of the passes, from which it contradicts the others."""

FALSE_ALARM_PROBABILITY = 1e-4
"""Probability that good passes are reported to contradict each other anywhere."""

MIN_EXPLAINED_SHARE = 0.5
"""Share of a pass's deviation that the track explains, from which the cause is not noise."""

_MAX_UNEXPLAINED_SHARE = 0.05  # of that share, which one gain or one lag of all subbands may leave
_MIN_GAIN = 0.3  # gain below which a pass does not contain the line
_MAX_ITERATIONS = 5  # in which passes are down-weighted on stretches


class RejectionReason(Enum):
    """Reason why a pass contradicts the others; the value is its text."""

    OTHER_TRACK = "it does not correlate with the others: it is of other track, or too noisy"
    REVERSED = "it correlates with the others in the opposite direction of travel"
    LAG = "its distances are wrong"
    GAIN = "its elevations are too large or too small by one factor"
    VEHICLE = "its deviation follows the track, as with a wrong vehicle model"
    NOISE = "its error is larger than it states"


@dataclass(frozen=True)
class Contradiction:
    """A pass that contradicts the others.

    Parameters
    ----------
    name : name of the pass
    reason : why it contradicts
    start, end : where [m]
    bands : names of the bands; empty for all
    error_ratio : standard deviation of its error over the stated one [-]; None where the two are not comparable
    magnitude : size of the cause: the lag [m] or the gain [-]; None for other reasons
    used : whether the pass is used there, with a smaller weight
    """

    name: str
    reason: RejectionReason
    start: float
    end: float
    bands: tuple[str, ...] = ()
    error_ratio: float | None = None
    magnitude: float | None = None
    used: bool = False


def band_variance_ratio(part: WavelengthRange, stack: PassStack, variance_ratio: Array) -> Array:
    """Variance of each pass's error in a band over the stated one (n) [-].

    Parameters
    ----------
    part : range of the band
    stack : the passes
    variance_ratio : λ (n, subbands of the range)
    """
    return np.sum(_subband_shares(part, stack) * variance_ratio, axis=1)


def degrees_of_freedom(
    part: WavelengthRange, stack: PassStack, components: VarianceComponents
) -> Array:
    """Equivalent number of independent values behind `band_variance_ratio` (n)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / np.sum(_subband_shares(part, stack) ** 2 / components.counts, axis=1)


def _subband_shares(part: WavelengthRange, stack: PassStack) -> Array:
    """Share of each subband in the variance that each pass states for a band (n, subbands of the range)."""
    inside = stack.edge_distance > 0
    mean = (
        np.sum(stack.error_density[:, part.subbands] * inside[:, None], axis=2)
        / np.maximum(inside.sum(axis=1), 1)[:, None]
    )
    weight = BAND_INTEGRALS[part.name][part.subbands] * mean
    return weight / weight.sum(axis=1, keepdims=True)


def outlier_passes(
    stack: PassStack, components: Sequence[VarianceComponents], active: Mask
) -> Mapping[int, Mapping[str, float]]:
    """Passes whose error is far larger than stated and than is typical of the passes.

    Parameters
    ----------
    stack : the passes
    components : variance components of each of `BAND_RANGES`
    active : which passes are used (n)

    Returns
    -------
    by index of the pass, the standard deviation of its error over the stated one, by band
    """
    ratios: dict[int, dict[str, float]] = {}
    level = significance_level(int(active.sum()))
    for part, one in zip(BAND_RANGES, components, strict=True):
        ratio = band_variance_ratio(part, stack, one.variance_ratio)
        typical = max(1.0, float(np.median(ratio[active])))
        freedom = degrees_of_freedom(part, stack, one)
        for i in np.flatnonzero(active & (ratio > MIN_ERROR_RATIO**2 * typical)):
            if ratio[i] / typical > chi2.isf(level, freedom[i]) / freedom[i]:
                ratios.setdefault(int(i), {})[part.name] = float(np.sqrt(ratio[i]))
    return ratios


def significance_level(tests: int) -> float:
    """Significance level of one test, so that all together have `FALSE_ALARM_PROBABILITY` (Bonferroni).

    Examples
    --------
    >>> print(f"{significance_level(10):.2e}")
    3.33e-06
    """
    return FALSE_ALARM_PROBABILITY / max(tests * len(BAND_RANGES), 1)


@dataclass(frozen=True)
class LineRegression:
    """Regression of a pass on the line that the others give, over all subbands of some bands.

    Parameters
    ----------
    explained : share of the difference that the line explains (0 to 1)
    gain, lag : gain of the pass over the line [-], and its lag behind it [m]
    unexplained_by_gain, unexplained_by_lag : share of the explained part that one gain, or one lag, leaves (0 to 1)
    """

    explained: float
    gain: float
    lag: float
    unexplained_by_gain: float
    unexplained_by_lag: float


def regress_on_line(
    stack: PassStack, i: int, line: Array, bands: Container[str], start: float, end: float
) -> LineRegression:
    """Regress each subband of a pass on the same subband of the line and on its Hilbert transform.

    With the analytic signal z_j of the line, subband j of the pass is m_j = Re(β_j z_j) plus noise. A gain g makes all
    β_j = g, a lag δ makes β_j = exp(-iΩ_j δ), and a wrong vehicle model makes any other β_j.

    Parameters
    ----------
    stack : the passes
    i : index of the pass
    line : the line without the pass (points) [m]
    bands : names of the bands
    start, end : ends of the stretch [m]
    """
    inside = (stack.distance >= start) & (stack.distance <= end)
    known = inside & np.isfinite(stack.level[i]) & np.isfinite(line)
    own, others = (
        decompose_spectrum(np.where(known, one, np.nan), stack.spacing)
        for one in (stack.level[i], line)
    )
    subbands = [index for part in BAND_RANGES if part.name in bands for index in part.indices]
    omega = CENTRE_FREQUENCIES[subbands]
    beta, weight = np.zeros(len(subbands), np.complex128), np.zeros(len(subbands))
    difference = 0.0
    for row, index in enumerate(subbands):
        m, z = own.subband(index), np.asarray(hilbert(others.subband(index)))
        stated = float(np.median(stack.error_density[i, index]))
        power = max(float(np.sum(np.abs(z) ** 2)) / 2, 1e-300)
        beta[row], weight[row] = np.vdot(z, m) / power, power / stated
        difference += float(np.sum((m - np.real(z)) ** 2)) / stated
    gain = float(np.sum(weight * np.real(beta)) / weight.sum())
    phase_weight = weight * omega
    lag = -float(np.sum(phase_weight * np.imag(beta)) / np.sum(phase_weight * omega))
    explained, without_gain, without_lag = (
        float(np.sum(weight * np.abs(beta - model) ** 2))
        for model in (1.0, gain, np.exp(-1j * omega * lag))
    )
    explained = max(explained, 1e-300)
    return LineRegression(
        explained / max(difference, 1e-300),
        gain,
        lag,
        without_gain / explained,
        without_lag / explained,
    )


def rejection_reason(regression: LineRegression) -> tuple[RejectionReason, float | None]:
    """Reason of a contradiction, from the regression of the pass on the line, and its magnitude."""
    if regression.explained < MIN_EXPLAINED_SHARE:
        return RejectionReason.NOISE, None
    if regression.gain < _MIN_GAIN:
        return RejectionReason.OTHER_TRACK, None
    if regression.unexplained_by_lag < _MAX_UNEXPLAINED_SHARE:
        return RejectionReason.LAG, regression.lag
    if regression.unexplained_by_gain < _MAX_UNEXPLAINED_SHARE:
        return RejectionReason.GAIN, regression.gain
    return RejectionReason.VEHICLE, None


@dataclass(frozen=True, eq=False)
class OutlierStretches:
    """Stretches on which passes contradict all others, in one range of wavelengths.

    Parameters
    ----------
    start, end : ends of the stretches (stretches) [m]
    variance_ratio : variance of each pass's error over the expected one where it contradicts the others, else 1
        (n, stretches) [-]
    """

    start: Array
    end: Array
    variance_ratio: Array


def find_outlier_stretches(
    cells: CovarianceCells,
    part: WavelengthRange,
    stack: PassStack,
    days: Array,
    vehicle: Indices,
    components: VarianceComponents,
) -> OutlierStretches:
    """Compare each pass on each stretch with its prediction from all other passes.

    The residual of pass i given all others is (Q t)_i/Q_ii, of variance 1/Q_ii (de Jong 1988). One bad pass also
    enlarges the residuals of the others: on each stretch the worst one is down-weighted first, and all are compared
    again.
    """
    _, subband_of_cell = np.unique(cells.subband, return_inverse=True)
    start, stretch_of_cell = np.unique(cells.start, return_inverse=True)
    end = np.zeros(start.size)
    end[stretch_of_cell] = cells.end
    share = (_subband_shares(part, stack) * components.variance_ratio)[:, subband_of_cell].T
    excess = np.ones((days.size, start.size))
    for _ in range(_MAX_ITERATIONS):
        ratio = components.variance_ratio.T[subband_of_cell] * excess.T[stretch_of_cell]
        Q, _ = projection(
            cells, days, vehicle, ratio, components.rate_variance, components.vehicle_variance
        )
        squared, freedom = _residual_ratio(cells, Q, share, stretch_of_cell, start.size)
        quantile = chi2.isf(significance_level(squared.size), freedom) / freedom
        outlying = (squared > MIN_ERROR_RATIO**2) & (squared > quantile)
        outlying &= squared >= np.where(outlying, squared, 0.0).max(axis=1, keepdims=True)
        if not outlying.any():
            break
        excess = np.where(outlying.T, excess * squared.T, excess)
    return OutlierStretches(start, end, excess)


def _residual_ratio(
    cells: CovarianceCells, Q: Array, share: Array, stretch_of_cell: Indices, count: int
) -> tuple[Array, Array]:
    """Squared residual of each pass over the expected one, 0 where undetermined, and its degrees of freedom.

    Returns
    -------
    both (stretches, n) [-]
    """
    residual, expected = (np.einsum("cii->ci", one) for one in (Q @ cells.covariance @ Q, Q))
    determined = cells.informative & (expected > 1e-12)
    ratio = np.where(determined, residual / np.where(determined, expected, 1.0), 0.0)
    weight = np.where(determined, share, 0.0)
    total, weight_sum, square = (
        _sum_by_stretch(one, stretch_of_cell, count)
        for one in (weight * ratio, weight, weight**2 / cells.count[:, None])
    )
    positive = weight_sum > 0
    squared = total / np.where(positive, weight_sum, 1.0)
    freedom = np.where(positive, weight_sum**2 / np.where(positive, square, 1.0), 1.0)
    return np.where(positive, squared, 0.0), freedom


def _sum_by_stretch(values: Array, stretch_of_cell: Indices, count: int) -> Array:
    """Sum of the rows of each stretch (stretches, n)."""
    total = np.zeros((count, values.shape[1]))
    np.add.at(total, stretch_of_cell, values)
    return total

"""Restricted maximum likelihood of the passes' error variances, from the differences between passes.

In each cell (a subband on a stretch of the line) the passes' deviations from the reference, each divided by its stated
standard deviation, t_i = (m_i - G_i r)/√(G_i P_i), have the covariance

    Σ = diag(λ) + Σ_v ξ_v S g_v g_vᵀ + ζ S g_τ g_τᵀ,      (g_v)_i = √(1/N_i) [i in v],      (g_τ)_i = √(1/N_i) τ_i,

with λ_i the variance of pass i over the stated one, ξ_v the variance of the error common to vehicle v's passes over
that of the track, S, and ζ the variance of the rate of change over S. The level, l_i = √(1/N_i), is a fixed effect, so
that the likelihood is that of differences (REML, Patterson and Thompson 1971). The variances maximise it by the
minorise-maximise iteration of Zhou, Hu, Zhou and Lange (2019): with Q = Σ⁻¹ - Σ⁻¹ l (lᵀ Σ⁻¹ l)⁻¹ lᵀ Σ⁻¹ and the mean C
of t tᵀ over ν independent values,

    ξ_v ← ξ_v √(Σ ν S g_vᵀ Q C Q g_v / Σ ν S g_vᵀ Q g_v)      (ζ likewise, for each stretch),
    λ_i ← √((λ_i² Σ ν (Q C Q)_ii + ν_0 λ̄)/(Σ ν Q_ii + ν_0/λ_i)),

where the prior counts as ν_0 independent values of the typical variance ratio λ̄ of the passes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.spectral_bands import (
    CENTRE_WAVELENGTHS,
    SQUARED_GAIN_INTEGRALS,
    SUBBAND_WIDTHS,
    WavelengthRange,
)
from trackprofile.fusion.stack import PassStack

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

PRIOR_COUNT = 10.0
"""ν_0: independent values as which it counts that a pass has the typical variance ratio."""

MIN_STRETCH_LENGTH, STRETCH_WAVELENGTHS = 250.0, 8.0
"""Lower bound of a stretch's length [m], and the same in longest wavelengths of the range."""

MAX_PRODUCTS = 5_000_000
"""Upper bound of the number of products of two passes in one subband; beyond it, stretches are sampled evenly."""

_MAX_ITERATIONS = 200
_TOLERANCE = 1e-4  # largest relative change of a variance ratio in the last iteration
_MIN_RELATIVE_VARIANCE = 1e-12  # lower bound of ξ and of ζ times the squared time span


@dataclass(frozen=True, eq=False)
class CovarianceCells:
    """Sample covariance of the passes in each cell: a subband of one range, on one stretch.

    Parameters
    ----------
    covariance : C, mean of t tᵀ (cells, n, n) [-]
    precision : 1/N_i of each pass, 0 where it determines too little (cells, n) [1/(m²/(rad/m))]
    track_density : density S of the track (cells) [m²/(rad/m)]
    count : number ν of independent values (cells)
    start, end : ends of the stretch (cells) [m]
    subband : index of the subband (cells)
    """

    covariance: Array
    precision: Array
    track_density: Array
    count: Array
    start: Array
    end: Array
    subband: Indices

    @property
    def informative(self) -> Mask:
        """Which passes contribute (cells, n)."""
        return self.precision > 0

    def restricted_to(self, passes: Mask) -> CovarianceCells:
        """The cells with some passes only, in all cells (n) or cell by cell (cells, n)."""
        return replace(self, precision=np.where(passes, self.precision, 0.0))


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Variance components of one range of wavelengths.

    Parameters
    ----------
    variance_ratio : λ of each pass in each subband (n, subbands of the range) [-]
    counts : number of independent values behind each (n, subbands of the range)
    vehicle_variance : ξ of each vehicle (vehicles) [-]
    rate_variance : ζ, variance of the rate over that of the track, in each cell (cells) [1/day²]
    """

    variance_ratio: Array
    counts: Array
    vehicle_variance: Array
    rate_variance: Array


def covariance_cells(stack: PassStack, part: WavelengthRange) -> CovarianceCells:
    """Sample covariances of the passes, on stretches whose length grows with the wavelength."""
    longest = float(CENTRE_WAVELENGTHS[part.subbands][-1])
    length = max(MIN_STRETCH_LENGTH, STRETCH_WAVELENGTHS * longest)
    pieces = max(1, round(float(np.ptp(stack.distance)) / length))
    edges = np.linspace(0, stack.distance.size, pieces + 1).round().astype(int)
    largest = max(1, MAX_PRODUCTS // len(stack.passes) ** 2)
    chosen = np.unique(np.linspace(0, pieces - 1, min(pieces, largest)).round().astype(int))
    by_subband = [_cells_of_subband(stack, index, edges, chosen) for index in part.indices]
    return CovarianceCells(*(np.concatenate(each) for each in zip(*by_subband, strict=True)))


def _cells_of_subband(
    stack: PassStack, subband: int, edges: Indices, chosen: Indices
) -> tuple[Array, ...]:
    """Fields of `CovarianceCells` in one subband, on the chosen stretches between edges."""
    G = stack.gain(subband)
    error = stack.error_density[:, subband] + G * stack.position_error(subband)
    variance = stack.interpolate(G * error) * SQUARED_GAIN_INTEGRALS[subband]
    normalised = stack.deviation_from_reference(subband) / np.sqrt(variance)
    informed = np.asarray((stack.taper(subband) > 0.5) & (stack.edge_distance > 0))
    track_density = stack.track_density(subband)
    covariances, precisions, densities, counts = [], [], [], []
    for number in chosen:
        points = slice(edges[number], edges[number + 1])
        low, high = stack.distance[points.start], stack.distance[points.stop - 1]
        nodes = slice(*np.searchsorted(stack.nodes, [low, high]))
        if nodes.stop == nodes.start:
            nodes = slice(nodes.start, nodes.start + 1)
        informative = np.asarray(informed[:, nodes].all(axis=1))
        values = np.where(informative[:, None], normalised[:, points], 0.0)
        covariances.append(values @ values.T / values.shape[1])
        precisions.append(np.where(informative, (G / error)[:, nodes].mean(axis=1), 0.0))
        densities.append(track_density[nodes].mean())
        counts.append(2 * SUBBAND_WIDTHS[subband] * stack.spacing * values.shape[1])
    starts, ends = stack.distance[edges[chosen]], stack.distance[edges[chosen + 1] - 1]
    columns = (covariances, precisions, densities, counts)
    return (*map(np.array, columns), starts, ends, np.full(chosen.size, subband))


def estimate_variance_components(
    cells: CovarianceCells, days: Array, vehicle: Indices, tied: Indices
) -> VarianceComponents:
    """Variance components with the largest restricted likelihood.

    Most track does not change and some does, so that each stretch has its own variance of the rate.

    Parameters
    ----------
    cells : sample covariances
    days : days of the passes, relative to their mean (n) [day]
    vehicle : index of each pass's vehicle (n)
    tied : index of the variance that each vehicle has, some sharing one (vehicles); empty where the data do not
        determine any
    """
    subbands, subband_of_cell = np.unique(cells.subband, return_inverse=True)
    stretches, stretch_of_cell = np.unique(cells.start, return_inverse=True)
    by_subband, by_stretch = (np.eye(size)[index].T * cells.count for size, index in
                              ((subbands.size, subband_of_cell), (stretches.size, stretch_of_cell)))  # fmt: skip
    pooled = (tied[:, None] == tied).astype(np.float64)
    min_rate_variance = _MIN_RELATIVE_VARIANCE / max(float(np.ptp(days)), 1.0) ** 2
    initial = _initial_variance(cells)
    ratio = np.ones((subbands.size, days.size))
    shared = np.full(tied.size, initial)
    change = np.full(stretches.size, initial / max(float(np.ptp(days)), 1.0) ** 2)
    for _ in range(_MAX_ITERATIONS):
        Q, H = projection(
            cells, days, vehicle, ratio[subband_of_cell], change[stretch_of_cell], shared
        )
        QCQ = Q @ cells.covariance @ Q
        quadratic, trace = (by_subband @ np.einsum("cii->ci", one) for one in (QCQ, Q))
        typical = _typical_ratio(ratio, trace > 0)
        updated = np.sqrt(
            (quadratic * ratio**2 + PRIOR_COUNT * typical) / (trace + PRIOR_COUNT / ratio)
        )
        observed, expected = ((H * (one @ H)).sum(axis=1) for one in (QCQ, Q))
        change *= _update_factor(by_stretch @ observed[:, 0], by_stretch @ expected[:, 0])
        shared *= _update_factor(
            *(pooled @ (cells.count @ one[:, 1:]) for one in (observed, expected))
        )
        change = np.maximum(change, min_rate_variance)
        shared = np.maximum(shared, _MIN_RELATIVE_VARIANCE)
        step, ratio = np.abs(np.log(updated / ratio)).max(initial=0.0), updated
        if step < _TOLERANCE:
            break
    counts = (by_subband @ cells.informative).T
    return VarianceComponents(ratio.T, counts, shared, change[stretch_of_cell])


def _initial_variance(cells: CovarianceCells) -> float:
    """Equal initial value of all ξ and ζ; the first to grow would otherwise take the variance of the others."""
    if not cells.informative.any():
        return 1.0
    signal_to_noise = (cells.precision * cells.track_density[:, None])[cells.informative]
    return 1.0 / max(float(np.median(signal_to_noise)), 1.0)


def _typical_ratio(ratio: Array, determined: Mask) -> Array:
    """λ̄ of each subband (subbands, 1): median over the n passes in logarithms, shrunk by n/(n + 1) towards 1."""
    count = determined.sum(axis=1, keepdims=True)
    ordered = np.sort(np.where(determined, np.log(ratio), np.inf), axis=1)
    halves = [
        np.take_along_axis(ordered, np.maximum(at, 0), axis=1)
        for at in ((count - 1) // 2, count // 2)
    ]
    median = np.where(count > 0, 0.5 * (halves[0] + halves[1]), 0.0)
    return np.exp(count / (count + 1) * median)


def _update_factor(observed: Array, expected: Array) -> Array:
    """Factor of a variance in one iteration, √(observed/expected); 0 where the data do not determine it."""
    positive = expected > 0
    return np.where(positive, np.sqrt(observed / np.where(positive, expected, 1.0)), 0.0)


def projection(
    cells: CovarianceCells,
    days: Array,
    vehicle: Indices,
    ratio: Array,
    change: Array,
    shared: Array,
) -> tuple[Array, Array]:
    """Matrix Q of the restricted likelihood, and the columns H of the rate and of the vehicles.

    Q = Σ⁻¹ - Σ⁻¹ l (lᵀ Σ⁻¹ l)⁻¹ lᵀ Σ⁻¹,      Σ = diag(λ) + H Hᵀ,      l_i = √(1/N_i).

    Parameters
    ----------
    cells : sample covariances
    days : days of the passes, relative to their mean (n) [day]
    vehicle : index of each pass's vehicle (n)
    ratio : λ (cells, n) [-]
    change : ζ (cells) [1/day²]
    shared : ξ (vehicles) [-]

    Returns
    -------
    Q (cells, n, n) and H (cells, n, 1 + vehicles)
    """
    root = np.sqrt(cells.precision)
    scale = np.sqrt(cells.track_density)[:, None] * root
    by_time = (np.sqrt(change)[:, None] * scale * days)[:, :, None]
    by_vehicle = scale[:, :, None] * np.sqrt(shared) * (vehicle[:, None] == np.arange(shared.size))
    H = np.concatenate([by_time, by_vehicle], axis=2)
    level = root / np.maximum(root.max(axis=1, keepdims=True), 1e-300)
    columns = np.concatenate([level[:, :, None], H], axis=2)
    scaled = (cells.informative / ratio)[:, :, None] * columns
    J = np.swapaxes(columns, 1, 2) @ scaled
    prior = np.ones(J.shape[-1])
    prior[0] = 1e-12  # the level is a fixed effect
    J += np.diag(prior)
    inverse = np.eye(days.size) * (cells.informative / ratio)[:, None, :]
    return inverse - scaled @ np.linalg.solve(J, np.swapaxes(scaled, 1, 2)), H

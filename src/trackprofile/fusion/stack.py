"""Passes on one grid, with the spectral densities of their errors and their components in each subband.

Notation (theory, section 14), for pass i and one subband: estimate m_i, density P_i of its stated error, prior density
S, gain G_i = 1 - P_i/S of the estimate, reference profile r. Spectra and weights are computed at nodes along the line,
`NODE_SPACING` apart; profiles are held on a finer grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, uniform_filter1d

from trackprofile.bands import resample
from trackprofile.contracts import Quality, known_elevation
from trackprofile.fusion.pass_alignment import AlignedPass
from trackprofile.fusion.spectral_bands import (
    CENTRE_FREQUENCIES,
    CENTRE_WAVELENGTHS,
    SQUARED_GAIN_INTEGRALS,
    SpectralDecomposition,
    decompose_spectrum,
)
from trackprofile.fusion.stated_spectra import NODE_SPACING, spectra_from_standard_deviations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COMMON_END_DISTANCE = 50.0
"""Passes whose ends lie within this distance of each other count as ending together [m]."""

MIN_MEDIAN_GAIN = 0.25
"""Median gain of the passes in a subband from which the prior is removed; division by a smaller one would amplify."""

_FLAWED = Quality.UNCONVERGED | Quality.SATURATED | Quality.UNEXPLAINED
_MIN_GAIN = 0.05
_MAX_PRIOR_EXCESS = 4.0  # observed density over the stated prior, above which the prior cannot hold
_TAPER_LENGTH = 300.0  # m, of the weights of the reference profile at the ends of a pass


@dataclass(frozen=True, eq=False, kw_only=True)
class PassStack:
    """Passes on one grid.

    Parameters
    ----------
    passes : the n aligned passes
    distance : the grid (points) [m]
    nodes : distances at which spectra and weights are computed (nodes) [m]
    level : elevation of each pass, NaN where it is unknown (n, points) [m]
    flags : sums of `Quality` (n, points)
    error_density : stated density P_i of each pass's error (n, subbands, nodes) [m²/(rad/m)]
    pass_prior : density S of the track before each pass (n, subbands) [m²/(rad/m)]
    position_variance : variance of each pass's position along the line (n, nodes) [m²]
    edge_distance : distance of each node to the nearest gap, flaw or end of each pass (n, nodes) [m]
    reference : reference profile r, NaN where all passes have gaps (points) [m]
    decompositions : subbands of each pass
    reference_decompositions : subbands of the reference, with the gaps of each pass
    reference_decomposition : subbands of the reference
    """

    passes: tuple[AlignedPass, ...]
    distance: Array
    nodes: Array
    level: Array
    flags: NDArray[np.int16]
    error_density: Array
    pass_prior: Array
    position_variance: Array
    edge_distance: Array
    reference: Array
    decompositions: tuple[SpectralDecomposition, ...]
    reference_decompositions: tuple[SpectralDecomposition, ...]
    reference_decomposition: SpectralDecomposition

    @property
    def spacing(self) -> float:
        """Distance between the points of the grid [m]."""
        return float(self.distance[1] - self.distance[0])

    def interpolate(self, values: Array) -> Array:
        """Values at the nodes (..., nodes), interpolated to the grid (..., points)."""
        rows = values.reshape(-1, self.nodes.size)
        on_grid = np.stack([np.interp(self.distance, self.nodes, row) for row in rows])
        return on_grid.reshape(*values.shape[:-1], self.distance.size)

    def taper(self, subband: int) -> Array:
        """Factor of each pass's weight, from 0 at its ends and gaps to 1 one wavelength inside (n, nodes) [-].

        It is relative to the largest one of all passes, so that a line's own ends are not tapered.
        """
        wavelength = CENTRE_WAVELENGTHS[subband]
        ramp = np.sin(0.5 * np.pi * np.minimum(self.edge_distance / wavelength, 1.0)) ** 2
        largest = ramp.max(axis=0)
        return ramp / np.where(largest > 0, largest, 1.0)

    def removes_prior(self, subband: int) -> bool:
        """Whether the prior is removed from the estimates: if the median gain is at least `MIN_MEDIAN_GAIN`."""
        return float(np.median(self._stated_gain(subband).mean(axis=1))) >= MIN_MEDIAN_GAIN

    def gain(self, subband: int) -> Array:
        """Gain G_i = 1 - P_i/S of each pass's estimate (n, nodes) [-]; 1 where the prior is not removed."""
        gain = self._stated_gain(subband)
        return gain if self.removes_prior(subband) else np.ones_like(gain)

    def prior(self, subband: int) -> float:
        """Density S of the track before any pass [m²/(rad/m)]; infinite where the prior is not removed."""
        if not self.removes_prior(subband):
            return np.inf
        return float(np.median(self.pass_prior[:, subband]))

    def common_error(self, subband: int) -> Array:
        """Density (1 - G_i) P_i of the error that the prior causes alike in all passes (n, nodes) [m²/(rad/m)].

        It is 0 where the prior is removed.
        """
        density = (1.0 - self._stated_gain(subband)) * self.error_density[:, subband]
        return np.zeros_like(density) if self.removes_prior(subband) else density

    def _stated_gain(self, subband: int) -> Array:
        ratio = self.error_density[:, subband] / self.pass_prior[:, subband, None]
        return np.maximum(1.0 - ratio, _MIN_GAIN)

    def deviation_from_reference(self, subband: int) -> Array:
        """Deviation of each pass's estimate from the reference, m_i - G_i r, 0 in gaps (n, points) [m]."""
        gain = self.interpolate(self.gain(subband))
        # Most passes share one decomposition of the reference.
        distinct = {id(one): one for one in self.reference_decompositions}
        reference = {key: one.subband(subband) for key, one in distinct.items()}
        deviation = np.stack(
            [
                own.subband(subband) - pass_gain * reference[id(of_reference)]
                for own, of_reference, pass_gain in zip(
                    self.decompositions, self.reference_decompositions, gain, strict=True
                )
            ]
        )
        return np.where(np.isfinite(self.level), deviation, 0.0)

    def track_density(self, subband: int) -> Array:
        """Density of the reference profile around each node (nodes) [m²/(rad/m)]."""
        square = self.reference_decomposition.subband(subband) ** 2
        known = np.isfinite(self.reference).astype(np.float64)
        width = 2 * CENTRE_WAVELENGTHS[subband] / self.spacing
        share = np.maximum(moving_average(known, width), 1e-3)
        mean_square = np.interp(self.nodes, self.distance, moving_average(square, width) / share)
        return mean_square / SQUARED_GAIN_INTEGRALS[subband]

    def position_error(self, subband: int) -> Array:
        """Density of the error that an uncertain position causes, Ω² S σ_x² (n, nodes) [m²/(rad/m)]."""
        slope_density = CENTRE_FREQUENCIES[subband] ** 2 * self.track_density(subband)
        return slope_density * self.position_variance


def moving_average(values: Array, width: float) -> Array:
    """Moving average along the last axis over a width in points, applied three times."""
    size = int(np.clip(round(width), 1, values.shape[-1]))
    for _ in range(3):
        values = uniform_filter1d(values, size, axis=-1, mode="nearest")
    return values


def stack_passes(passes: Sequence[AlignedPass]) -> PassStack:
    """Resample passes to one grid, from the start of the first ones to the end of the last ones.

    Long wavelengths of passes differ by millimetres: a pass that extends alone beyond all others by a few metres would
    cause a step. The grid therefore starts at the last of the starts that lie within `COMMON_END_DISTANCE` of the
    first one, and ends likewise.

    Raises
    ------
    DataError : a pass does not state its standard deviation.
    """
    distance = _common_grid(passes)
    spacing = float(distance[1] - distance[0])
    count = max(2, round(float(np.ptp(distance)) / NODE_SPACING) + 1)
    nodes = np.linspace(distance[0], distance[-1], count)
    level = np.stack([_level_on(one, distance) for one in passes])
    flags = np.stack([_flags_on(one, distance) for one in passes])
    known = np.isfinite(level)
    stated = [
        spectra_from_standard_deviations(one.dated.profile, nodes, one.dated.name) for one in passes
    ]
    error_density = np.stack([_smoothed_density(one.error, nodes) for one in stated])
    edge_distance = np.stack(
        [
            _edge_distance(k & ((f & _FLAWED) == 0), spacing)
            for k, f in zip(known, flags, strict=True)
        ]
    )
    reference = _reference_profile(level, edge_distance, error_density)
    decompositions = tuple(decompose_spectrum(one, spacing) for one in level)
    return PassStack(
        passes=tuple(passes),
        distance=distance,
        nodes=nodes,
        level=level,
        flags=flags,
        error_density=error_density,
        pass_prior=_pass_prior(decompositions, known, np.stack([one.prior for one in stated])),
        position_variance=np.stack([one.position_deviation(nodes) ** 2 for one in passes]),
        edge_distance=np.stack([np.interp(nodes, distance, one) for one in edge_distance]),
        reference=reference,
        decompositions=decompositions,
        reference_decompositions=_decompose_with_gaps(reference, known, spacing),
        reference_decomposition=decompose_spectrum(reference, spacing),
    )


def _common_grid(passes: Sequence[AlignedPass]) -> Array:
    """Grid of all passes, with the smallest spacing of them (points) [m]."""
    spacing = min(float(np.median(np.diff(one.dated.profile["distance"]))) for one in passes)
    ends = [one.dated.profile["distance"].to_numpy()[[0, -1]] for one in passes]
    if len(passes) == 1:
        first, last = ends[0]
        return np.linspace(first, last, round(float(last - first) / spacing) + 1)
    starts, stops = np.array(ends).T
    first_start = starts[starts < starts.min() + COMMON_END_DISTANCE].max()
    last_stop = stops[stops > stops.max() - COMMON_END_DISTANCE].min()
    first = np.ceil(first_start / spacing - 1e-9)
    last = np.floor(last_stop / spacing + 1e-9)
    return spacing * np.arange(first, last + 1)


def _level_on(one: AlignedPass, distance: Array) -> Array:
    own = one.dated.profile["distance"].to_numpy()
    level = known_elevation(one.dated.profile)
    if own.size == distance.size and np.abs(own - distance).max() < 1e-6:
        return level
    return resample(own, level, distance)


def _flags_on(one: AlignedPass, distance: Array) -> NDArray[np.int16]:
    own = one.dated.profile["distance"].to_numpy()
    nearest = np.searchsorted((own[1:] + own[:-1]) / 2, distance)
    return one.dated.profile["quality"].to_numpy().astype(np.int16)[nearest]


def _edge_distance(good: Mask, spacing: float) -> Array:
    """Distance to the nearest point that is not good; beyond the ends none is [m]."""
    padded = np.concatenate([[False], good, [False]])
    return spacing * np.asarray(distance_transform_edt(padded))[1:-1]


def _reference_profile(level: Array, edge_distance: Array, error_density: Array) -> Array:
    """Mean of the passes, weighted by their precision at wavelengths below 25 m and tapered at their ends."""
    short = error_density[:, CENTRE_WAVELENGTHS < 25.0]
    precision = 1.0 / np.median(short, axis=2).mean(axis=1)
    taper = np.maximum(np.minimum(edge_distance / _TAPER_LENGTH, 1.0), 1e-6)
    weight = np.where(np.isfinite(level), precision[:, None] * taper, 0.0)
    total = weight.sum(axis=0)
    mean = np.sum(weight * np.nan_to_num(level), axis=0) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, mean, np.nan)


def _smoothed_density(density: Array, nodes: Array) -> Array:
    """Density of each subband, with its logarithm averaged over the wavelength (subbands, nodes)."""
    step = float(nodes[1] - nodes[0])
    return np.stack(
        [
            np.exp(moving_average(np.log(one), wavelength / step))
            for one, wavelength in zip(density, CENTRE_WAVELENGTHS, strict=True)
        ]
    )


def _pass_prior(
    decompositions: Sequence[SpectralDecomposition], known: Mask, prior: Array
) -> Array:
    """Density of the track before each pass (n, subbands): the stated one, or the observed one if far larger.

    A profile whose long wavelengths were filtered out states too small a standard deviation of the whole.
    """
    observed = np.array(
        [
            [np.mean(one.subband(index)[inside] ** 2) for index in range(CENTRE_WAVELENGTHS.size)]
            for one, inside in zip(decompositions, known, strict=True)
        ]
    )
    observed = observed / SQUARED_GAIN_INTEGRALS
    return np.where(observed > _MAX_PRIOR_EXCESS * prior, observed, prior)


def _decompose_with_gaps(
    reference: Array, known: Mask, spacing: float
) -> tuple[SpectralDecomposition, ...]:
    """Subbands of the reference with the gaps of each pass, so that the effects of ends are equal in both."""
    by_gaps: dict[bytes, SpectralDecomposition] = {}
    for inside in known:
        if inside.tobytes() not in by_gaps:
            by_gaps[inside.tobytes()] = decompose_spectrum(
                np.where(inside, reference, np.nan), spacing
            )
    return tuple(by_gaps[inside.tobytes()] for inside in known)

"""Error variances of all passes, common errors of vehicles, and the passes that are rejected or down-weighted.

The estimation alternates: variance components are estimated (`variance_components`), the worst pass that contradicts
the others is rejected (`rejection`), and all is estimated again, until no pass contradicts.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.fusion.combine import combine_others
from trackprofile.fusion.generalised_least_squares import PassErrorModel, least_squares_weights
from trackprofile.fusion.rejection import (
    Contradiction,
    OutlierStretches,
    RejectionReason,
    band_variance_ratio,
    find_outlier_stretches,
    outlier_passes,
    regress_on_line,
    rejection_reason,
)
from trackprofile.fusion.spectral_bands import BAND_RANGES, RANGES
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import (
    CovarianceCells,
    VarianceComponents,
    covariance_cells,
    estimate_variance_components,
)
from trackprofile.fusion.vehicle_effects import (
    PassVehicles,
    hidden_share,
    pass_vehicles,
    vehicle_notes,
    vehicle_variance,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_PASSES = 3
"""Number of passes from which the contradiction of one of them is identifiable."""

REPORTED_SCATTER = 1.5
"""Standard deviation of the passes' scatter, over the stated one, from which it is reported."""

_MAX_OUTLIER_SHARE = 1 / 3
"""Share of a pass up to which it may contradict the others on stretches without contradicting as a whole."""

_MAX_ITERATIONS = 4  # in which stretches are excluded


@dataclass(frozen=True, eq=False)
class PassWeights:
    """Error variances and weights of the passes.

    Parameters
    ----------
    days : days of the passes, relative to their mean (n) [day]
    active : which passes are used (n)
    errors : error variances of the passes
    error_ratio : by band, standard deviation of each pass's error over the stated one (n) [-]
    share : by band, mean weight of each pass in the line (n) [-]
    contradictions, notes : passes that contradict the others, and remarks in sentences
    """

    days: Array
    active: Mask
    errors: PassErrorModel
    error_ratio: Mapping[str, Array]
    share: Mapping[str, Array]
    contradictions: tuple[Contradiction, ...]
    notes: tuple[str, ...]


def estimate_weights(stack: PassStack) -> PassWeights:
    """Estimate the error variances of the passes by maximum likelihood, rejecting passes that contradict the rest."""
    days = np.array([one.dated.day.toordinal() for one in stack.passes], np.float64)
    days -= days.mean()
    vehicles = pass_vehicles(stack)
    cells = [covariance_cells(stack, part) for part in RANGES]
    active, contradictions = np.ones(days.size, bool), dict[int, Contradiction]()
    error_ratio = {part.name: np.ones(days.size) for part in BAND_RANGES}
    while True:
        components, outliers = _estimate_components(stack, cells, days, vehicles, active)
        for part in BAND_RANGES:
            ratio = band_variance_ratio(part, stack, components[RANGES.index(part)].variance_ratio)
            error_ratio[part.name] = np.where(active, np.sqrt(ratio), error_ratio[part.name])
        errors = _error_model(stack, components, active, vehicles)
        worst = _worst_pass(stack, components, active, contradictions)
        if worst is None:
            break
        i, bands = worst
        contradictions[i] = _contradiction(stack, errors, i, bands, _ends(stack, i))
        active[i] = contradictions[i].used
    local_ratio, local = _local_contradictions(stack, outliers, errors)
    errors = replace(errors, local_ratio=local_ratio)
    return PassWeights(
        days=days,
        active=active,
        errors=errors,
        error_ratio=error_ratio,
        share=_weight_shares(stack, days, errors),
        contradictions=(*contradictions.values(), *local),
        notes=(
            *_scatter_notes(error_ratio, active),
            *vehicle_notes(vehicles, stack, components, active, errors.hidden_share),
        ),
    )


def _estimate_components(
    stack: PassStack,
    cells: Sequence[CovarianceCells],
    days: Array,
    vehicles: PassVehicles,
    active: Mask,
) -> tuple[list[VarianceComponents], dict[int, OutlierStretches]]:
    """Variance components of each range, and by range the stretches on which passes contradict the others.

    A stretch on which a pass contradicts the others is excluded from its variance, unless it contradicts all along.
    """
    included = [np.broadcast_to(active, each.informative.shape) for each in cells]
    components, outliers = list[VarianceComponents](), dict[int, OutlierStretches]()
    tied = vehicles.tied_variances(active)
    for iteration in range(_MAX_ITERATIONS):
        components = [
            # Outside the bands profiles state no standard deviation, and determine no vehicle's error.
            estimate_variance_components(
                each.restricted_to(mask),
                days,
                vehicles.index,
                tied if part in BAND_RANGES else tied[:0],
            )
            for part, each, mask in zip(RANGES, cells, included, strict=True)
        ]
        settled = True
        for part in BAND_RANGES if active.sum() >= MIN_PASSES else ():
            number = RANGES.index(part)
            active_cells, estimate = cells[number].restricted_to(active), components[number]
            if iteration == 0:
                # An error on a few stretches is still part of the pass's variance, and would mask itself.
                typical = np.median(estimate.variance_ratio[active], axis=0)
                estimate = replace(
                    estimate, variance_ratio=np.minimum(estimate.variance_ratio, typical)
                )
            outliers[number] = find_outlier_stretches(
                active_cells, part, stack, days, vehicles.index, estimate
            )
            remaining = active & ~_excluded(outliers[number], active_cells)
            settled &= bool((remaining == included[number]).all()) and iteration > 0
            included[number] = remaining
        if settled:
            break
    return components, outliers


def _excluded(outliers: OutlierStretches, cells: CovarianceCells) -> Mask:
    """Cells that are excluded from the variance of each pass (cells, n)."""
    outlying = outliers.variance_ratio > 1
    outlying &= outlying.mean(axis=1, keepdims=True) < _MAX_OUTLIER_SHARE
    return outlying.T[np.searchsorted(outliers.start, cells.start)]


def _error_model(
    stack: PassStack,
    components: Sequence[VarianceComponents],
    active: Mask,
    vehicles: PassVehicles,
) -> PassErrorModel:
    return PassErrorModel(
        variance_ratio=np.concatenate([one.variance_ratio for one in components], axis=1),
        local_ratio=np.ones((active.size, len(RANGES), stack.nodes.size)),
        used=active,
        vehicle_variance=vehicle_variance(vehicles, components),
        hidden_share=hidden_share(vehicles, stack, components, active),
        vehicle=vehicles.index,
    )


def _worst_pass(
    stack: PassStack,
    components: Sequence[VarianceComponents],
    active: Mask,
    reported: Container[int],
) -> tuple[int, Mapping[str, float]] | None:
    """Index and error ratios of the pass that contradicts the others most, of those not yet reported."""
    if active.sum() < MIN_PASSES:
        return None
    in_bands = [components[RANGES.index(part)] for part in BAND_RANGES]
    outliers = outlier_passes(stack, in_bands, active)
    unreported = {i: ratios for i, ratios in outliers.items() if i not in reported}
    return max(unreported.items(), key=lambda one: max(one[1].values()), default=None)


def _ends(stack: PassStack, i: int) -> tuple[float, float]:
    known = stack.distance[np.isfinite(stack.level[i])]
    return float(known[0]), float(known[-1])


def _contradiction(
    stack: PassStack,
    errors: PassErrorModel,
    i: int,
    ratios: Mapping[str, float],
    ends: tuple[float, float],
) -> Contradiction:
    """Contradiction of a pass between two ends, with its reason; a pass that is only noisy remains in use."""
    line = combine_others(stack, errors)[i]
    reason, magnitude = rejection_reason(regress_on_line(stack, i, line, ratios, *ends))
    return Contradiction(
        stack.passes[i].dated.name,
        reason,
        *ends,
        bands=tuple(ratios),
        error_ratio=max(ratios.values()),
        magnitude=magnitude,
        used=reason is RejectionReason.NOISE,
    )


def _local_contradictions(
    stack: PassStack, outliers: Mapping[int, OutlierStretches], errors: PassErrorModel
) -> tuple[Array, list[Contradiction]]:
    """Factor of the passes' variances along the line (n, ranges, nodes), and the stretches where it exceeds 1."""
    local_ratio, contradictions = np.ones(errors.local_ratio.shape), list[Contradiction]()
    for number, stretches in outliers.items():
        for i in np.flatnonzero((stretches.variance_ratio > 1).any(axis=1)):
            ratio = stretches.variance_ratio[i]
            local_ratio[i, number] = _ratio_at_nodes(stretches, ratio, stack.nodes)
            for run in runs(ratio > 1):
                ends = float(stretches.start[run.start]), float(stretches.end[run.stop - 1])
                ratios = {RANGES[number].name: float(np.sqrt(ratio[run].max()))}
                one = _contradiction(stack, errors, int(i), ratios, ends)
                contradictions.append(replace(one, used=True))
    # Wavelengths outside the bands have the factor of the nearest band.
    local_ratio[:, 0], local_ratio[:, -1] = local_ratio[:, 1], local_ratio[:, -2]
    return local_ratio, contradictions


def _ratio_at_nodes(stretches: OutlierStretches, ratio: Array, nodes: Array) -> Array:
    """The ratio at the nodes: that of the stretch inside it, log-linear to the middle of the next stretch."""
    middle = 0.5 * (stretches.start + stretches.end)
    edges = np.append(stretches.start, stretches.end[-1])
    at_edges = np.maximum(np.append(ratio, 1.0), np.append(1.0, ratio))
    order = np.argsort(np.concatenate([middle, edges]), kind="stable")
    at = np.concatenate([middle, edges])[order]
    return np.exp(np.interp(nodes, at, np.log(np.concatenate([ratio, at_edges])[order])))


def _scatter_notes(error_ratio: Mapping[str, Array], active: Mask) -> list[str]:
    typical = {name: float(np.median(each[active])) for name, each in error_ratio.items()}
    return [
        f"{name}: the passes scatter {one:.2g} times as much as they state, and their variances were increased "
        "accordingly"
        for name, one in typical.items()
        if one > REPORTED_SCATTER
    ]


def _weight_shares(stack: PassStack, days: Array, errors: PassErrorModel) -> dict[str, Array]:
    """Mean weight of each pass in the line on the mean day, by band."""
    shares = {}
    for part in BAND_RANGES:
        in_subbands = [
            (stack.gain(index) * least_squares_weights(stack, index, days, errors, 0.0).level).mean(
                axis=1
            )
            for index in part.indices
        ]
        shares[part.name] = np.mean(in_subbands, axis=0)
    return shares

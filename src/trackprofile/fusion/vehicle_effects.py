"""Errors that all passes of one vehicle have in common, as far as passes of other vehicles reveal them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.rejection import band_variance_ratio, degrees_of_freedom
from trackprofile.fusion.spectral_bands import (
    BAND_INTEGRALS,
    BAND_RANGES,
    RANGES,
    WavelengthRange,
    standard_deviations,
)
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import VarianceComponents

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

REPORTED_SHARE = 0.5
"""Standard deviation of a vehicle's common error, over that of a pass's own error, from which it is reported."""

_MIN_OWN_VARIANCES = 3  # vehicles with several passes, from which each has a variance of its own
_SIGNIFICANCE = 2.0  # standard deviations by which the scatter has to be smaller than stated


@dataclass(frozen=True, eq=False)
class PassVehicles:
    """Vehicles of the passes.

    Parameters
    ----------
    names : names of the vehicles, sorted
    index : index of each pass's vehicle (n)
    """

    names: tuple[str, ...]
    index: Indices

    def tied_variances(self, active: Mask) -> Indices:
        """Index of the variance that each vehicle has (vehicles); empty if all active passes are of one vehicle.

        The common error of a vehicle's passes needs at least two others for comparison: two vehicles share one
        variance, and so do all vehicles with one pass.
        """
        count = np.bincount(self.index[active], minlength=len(self.names))
        if np.count_nonzero(count) < 2:
            return np.zeros(0, np.intp)
        several = count > 1
        if np.count_nonzero(several) < _MIN_OWN_VARIANCES:
            return np.zeros(len(self.names), np.intp)
        return np.where(several, np.cumsum(several), 0)


def pass_vehicles(stack: PassStack) -> PassVehicles:
    """Vehicles of the passes of a stack."""
    names = [str(one.dated.profile.attrs["vehicle"]) for one in stack.passes]
    distinct = sorted(set(names))
    return PassVehicles(tuple(distinct), np.array([distinct.index(one) for one in names], np.intp))


def vehicle_variance(vehicles: PassVehicles, components: Sequence[VarianceComponents]) -> Array:
    """Variance ξ of the error common to each vehicle's passes, over that of the track (vehicles, ranges) [-].

    Wavelengths outside the bands have the value of the nearest band.
    """
    variance = np.zeros((len(vehicles.names), len(RANGES)))
    for number, one in enumerate(components):
        if one.vehicle_variance.size:
            variance[:, number] = one.vehicle_variance
    variance[:, 0], variance[:, -1] = variance[:, 1], variance[:, -2]
    return variance


def hidden_share(
    vehicles: PassVehicles,
    stack: PassStack,
    components: Sequence[VarianceComponents],
    active: Mask,
) -> Array:
    """Share of the stated variance that is common to all passes of a single vehicle (ranges) [-].

    If passes of one vehicle alone scatter less than they state, the remainder 1 - λ̄ of the stated variance counts as
    an error that is equal in all of them, such as that of the vehicle's parameters.
    """
    hidden = np.zeros(len(RANGES))
    if vehicles.tied_variances(active).size or active.sum() < 2:
        return hidden
    for number, (part, one) in enumerate(zip(RANGES, components, strict=True)):
        if part in BAND_RANGES:
            ratio = float(np.mean(band_variance_ratio(part, stack, one.variance_ratio)[active]))
            freedom = float(degrees_of_freedom(part, stack, one)[active].sum())
            freedom *= 1.0 - 1.0 / float(active.sum())
            margin = _SIGNIFICANCE * np.sqrt(2.0 / max(freedom, 1e-9))
            hidden[number] = max(0.0, 1.0 - ratio * (1.0 + margin))
    return hidden


def vehicle_notes(
    vehicles: PassVehicles,
    stack: PassStack,
    components: Sequence[VarianceComponents],
    active: Mask,
    hidden: Array,
) -> list[str]:
    """Sentences about common errors of vehicles, and about what the passes cannot determine."""
    present = sorted({vehicles.names[one] for one in vehicles.index[active]})
    if len(present) == 1:
        bands = [one.name for one, share in zip(RANGES, hidden, strict=True) if share]
        return [_single_vehicle_note(present[0], bands)]
    notes = []
    for part in BAND_RANGES:
        common, threshold = _common_errors(
            vehicles, stack, part, components[RANGES.index(part)], active
        )
        reported = [name for name in present if common[name] > threshold[name]]
        if reported and len(present) == 2:
            first, second = present
            notes.append(
                f"{part.name}: {first!r} and {second!r} differ by {1.4e3 * common[first]:.2g} mm that is not "
                "noise; the passes do not determine which of the two is right"
            )
        else:
            notes += [
                f"{part.name}: passes of {name!r} have a common error of {1e3 * common[name]:.2g} mm that the others "
                "do not have"
                for name in reported
            ]
    return notes


def _single_vehicle_note(name: str, bands: Sequence[str]) -> str:
    text = (
        f"All passes are of one vehicle, {name!r}: an error of its model is equal in all of them, and their "
        "differences do not reveal it"
    )
    if bands:
        text += (
            f"; in {', '.join(bands)} they scatter less than they state, and the rest of the stated variance counts as "
            "a common error"
        )
    return text


def _common_errors(
    vehicles: PassVehicles,
    stack: PassStack,
    part: WavelengthRange,
    components: VarianceComponents,
    active: Mask,
) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviation of each vehicle's common error, and the threshold above which it is reported [m].

    The threshold is `REPORTED_SHARE` of a pass's own error, or twice the standard deviation that a mean over the
    vehicle's passes has by chance, whichever is larger.
    """
    weight = BAND_INTEGRALS[part.name]
    track_variance = sum(
        float(weight[index] * stack.track_density(index).mean()) for index in part.indices
    )
    ratio = band_variance_ratio(part, stack, components.variance_ratio)
    freedom = float(degrees_of_freedom(part, stack, components)[active].mean())
    common, threshold = {}, {}
    for number, name in enumerate(vehicles.names):
        own = active & (vehicles.index == number)
        if own.any():
            stated = [
                standard_deviations(one.mean(axis=1))[part.name] ** 2
                for one in stack.error_density[own]
            ]
            variance = float(np.mean(stated * ratio[own]))
            chance = 2.0 * np.sqrt(2.0 / max(freedom, 1e-9)) * variance / np.count_nonzero(own)
            common[name] = float(np.sqrt(components.vehicle_variance[number] * track_variance))
            threshold[name] = float(np.sqrt(max(REPORTED_SHARE**2 * variance, 2.0 * chance)))
    return common, threshold

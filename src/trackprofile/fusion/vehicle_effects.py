"""What passes of one vehicle have wrong alike, as far as others show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.rejection import freedom_in, louder_in
from trackprofile.fusion.spectral_bands import INTEGRALS, JUDGED, RANGES, Range, deviations
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import Factors

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

SEEN = 0.5
"""Of a pass's own error, from which what its vehicle's passes share is said."""

_OWN = 3  # vehicles of several passes, from which each has a variance of its own
_SURE = 2.0  # standard deviations by which passes have to scatter less than they state


@dataclass(frozen=True, eq=False)
class VehicleEffects:
    """Of the passes.

    Parameters
    ----------
    names : of the vehicles
    number : of each pass's vehicle (n)
    """

    names: tuple[str, ...]
    number: Indices

    def tied(self, active: Mask) -> Indices:
        """Number of the variance that each vehicle has; empty where one vehicle ran alone, and shows nothing.

        What a vehicle's passes share is seen against at least two others: two vehicles have one variance, and so have
        all that passed once.
        """
        count = np.bincount(self.number[active], minlength=len(self.names))
        if np.count_nonzero(count) < 2:
            return np.zeros(0, np.intp)
        several = count > 1
        if np.count_nonzero(several) < _OWN:
            return np.zeros(len(self.names), np.intp)
        return np.where(several, np.cumsum(several), 0)


def vehicle_effects(laid: PassStack) -> VehicleEffects:
    """The vehicles by which the passes were made."""
    names = [str(one.of.profile.attrs["vehicle"]) for one in laid.passes]
    every = sorted(set(names))
    return VehicleEffects(tuple(every), np.array([every.index(one) for one in names], np.intp))


def shared_by(vehicles: VehicleEffects, found: Sequence[Factors]) -> Array:
    """Variance of what passes of each vehicle share, over that of the track (vehicles, ranges).

    What lies beyond the bands goes with the nearest.
    """
    shared = np.zeros((len(vehicles.names), len(RANGES)))
    for number, each in enumerate(found):
        if each.shared.size:
            shared[:, number] = each.shared
    shared[:, 0], shared[:, -1] = shared[:, 1], shared[:, -2]
    return shared


def hidden_by(
    vehicles: VehicleEffects, laid: PassStack, found: Sequence[Factors], active: Mask
) -> Array:
    """Share of what they state that passes of one vehicle alone do not show between each other (ranges).

    They scatter less than they state if a part of the error, that of the vehicle's parameters, is the same in all.
    """
    hidden = np.zeros(len(RANGES))
    if vehicles.tied(active).size or active.sum() < 2:
        return hidden
    for number, (part, each) in enumerate(zip(RANGES, found, strict=True)):
        if part in JUDGED:
            shown = float(np.mean(louder_in(part, laid, each.louder)[active]))
            freedom = float(freedom_in(part, laid, each)[active].sum())
            freedom *= 1.0 - 1.0 / float(active.sum())
            sure = _SURE * np.sqrt(2.0 / max(freedom, 1e-9))
            hidden[number] = max(0.0, 1.0 - shown * (1.0 + sure))
    return hidden


def notes_on(
    vehicles: VehicleEffects, laid: PassStack, found: Sequence[Factors], active: Mask, hidden: Array
) -> list[str]:
    """What the vehicles have wrong, or what nobody can tell, in sentences."""
    seen = sorted({vehicles.names[one] for one in vehicles.number[active]})
    if len(seen) == 1:
        return [
            _of_one(seen[0], [one.name for one, part in zip(RANGES, hidden, strict=True) if part])
        ]
    notes = []
    for part in JUDGED:
        common, own = _sizes(vehicles, laid, part, found[RANGES.index(part)], active)
        loud = [name for name in seen if common[name] > own[name]]
        if loud and len(seen) == 2:
            notes.append(
                f"{part.name}: {seen[0]!r} and {seen[1]!r} differ by {1.4e3 * common[seen[0]]:.2g} mm that is no "
                "noise: which of them is right cannot be told"
            )
        else:
            notes += [
                f"{part.name}: passes of {name!r} share an error of {1e3 * common[name]:.2g} mm that others do not have"
                for name in loud
            ]
    return notes


def _of_one(name: str, less: Sequence[str]) -> str:
    text = f"All passes are of one vehicle, {name!r}: what its model has wrong is in all of them, and shows in none"
    if less:
        text += f"; in {', '.join(less)} they scatter less than they state, and the rest is taken to be shared"
    return text


def _sizes(
    vehicles: VehicleEffects, laid: PassStack, part: Range, found: Factors, active: Mask
) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviation of what each vehicle's passes share, and what that has to exceed to be worth a word [m].

    Worth a word is `SEEN` of a pass's own error, and twice what chance makes of a mean over its passes.
    """
    weight = INTEGRALS[part.name]
    strength = sum(float(weight[wave] * laid.strength(wave).mean()) for wave in part.numbers)
    louder = louder_in(part, laid, found.louder)
    freedom = float(freedom_in(part, laid, found)[active].mean())
    common, least = {}, {}
    for number, name in enumerate(vehicles.names):
        mine = active & (vehicles.number == number)
        if mine.any():
            own = [deviations(one.mean(axis=1))[part.name] ** 2 for one in laid.stated[mine]]
            variance = float(np.mean(own * louder[mine]))
            chance = 2.0 * np.sqrt(2.0 / max(freedom, 1e-9)) * variance / np.count_nonzero(mine)
            common[name] = float(np.sqrt(found.shared[number] * strength))
            least[name] = float(np.sqrt(max(SEEN**2 * variance, 2.0 * chance)))
    return common, least

"""What each pass is worth: how loud it is, what it shares with others, and whether it is to be believed."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.fusion.combine import without_each
from trackprofile.fusion.estimator import Trust, weights
from trackprofile.fusion.rejection import (
    Contradiction,
    RejectionReason,
    Stretches,
    likeness,
    louder_in,
    louder_stretches,
    outlying,
    reason_of,
)
from trackprofile.fusion.spectral_bands import JUDGED, RANGES
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import (
    CovarianceCells,
    Factors,
    covariance_cells,
    factors,
)
from trackprofile.fusion.vehicle_effects import (
    VehicleEffects,
    hidden_by,
    notes_on,
    shared_by,
    vehicle_effects,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

FEWEST = 3
"""Passes from which one of them can be told to contradict the others."""

TELLING = 1.5
"""Standard deviations of the passes' scatter, over the stated, from which it is said."""

_HERE_AND_THERE = (
    1 / 3
)  # of a pass, on which it may contradict the others without doing so as a whole
_ROUNDS = 4  # in which stretches are taken out


@dataclass(frozen=True, eq=False)
class PassWeights:
    """Passes and what they are worth.

    Parameters
    ----------
    days : of the passes, about their mean (n)
    active : passes that are used (n)
    trust : in each
    times : by band, the error of each over what it states, in standard deviations (n)
    share : by band, what of the line rests on each, in the mean (n)
    contradictions, notes : what was found
    """

    days: Array
    active: Mask
    trust: Trust
    times: Mapping[str, Array]
    share: Mapping[str, Array]
    contradictions: tuple[Contradiction, ...]
    notes: tuple[str, ...]


def estimate_weights(laid: PassStack) -> PassWeights:
    """Find the variances that make the passes' differences most probable, and leave out what contradicts the rest."""
    days = np.array([one.of.day.toordinal() for one in laid.passes], np.float64)
    days -= days.mean()
    vehicles = vehicle_effects(laid)
    every = [covariance_cells(laid, part) for part in RANGES]
    active, said = np.ones(days.size, bool), dict[int, Contradiction]()
    times = {part.name: np.ones(days.size) for part in JUDGED}
    while True:
        found, apart = _fitted(laid, every, days, vehicles, active)
        for part in JUDGED:
            over = louder_in(part, laid, found[RANGES.index(part)].louder)
            times[part.name] = np.where(active, np.sqrt(over), times[part.name])
        trust = _trust(laid, found, active, vehicles)
        worst = _worst(laid, found, active, said)
        if worst is None:
            break
        i, bands = worst
        said[i] = _contradiction(laid, trust, i, bands, _ends(laid, i))
        active[i] = said[i].used
    local, places = _stretch_by_stretch(laid, apart, trust)
    trust = replace(trust, local=local)
    notes = (
        *_on_scatter(times, active),
        *notes_on(vehicles, laid, found, active, trust.hidden),
    )
    shares = _shares(laid, days, trust)
    return PassWeights(days, active, trust, times, shares, (*said.values(), *places), notes)


def _fitted(
    laid: PassStack,
    every: Sequence[CovarianceCells],
    days: Array,
    vehicles: VehicleEffects,
    active: Mask,
) -> tuple[list[Factors], dict[int, Stretches]]:
    """The variances, and by range where passes are louder still.

    A stretch where a pass contradicts the others says nothing of the rest of it, unless it does so all along.
    """
    told = [np.broadcast_to(active, each.there.shape) for each in every]
    found, apart = list[Factors](), dict[int, Stretches]()
    tied = vehicles.tied(active)
    for round_ in range(_ROUNDS):
        found = [
            # Of waves beyond the bands no pass says how well it knows them: they show no vehicle.
            factors(each.of(here), days, vehicles.number, tied if part in JUDGED else tied[:0])
            for part, each, here in zip(RANGES, every, told, strict=True)
        ]
        settled = True
        for part in JUDGED if active.sum() >= FEWEST else ():
            number = RANGES.index(part)
            of, one = every[number].of(active), found[number]
            if round_ == 0:
                # What a pass has in a few stretches is in its variance still, and would hide them.
                usual = np.median(one.louder[active], axis=0)
                one = replace(one, louder=np.minimum(one.louder, usual))
            apart[number] = louder_stretches(of, part, laid, days, vehicles.number, one)
            beyond = apart[number].louder > 1
            beyond &= beyond.mean(axis=1, keepdims=True) < _HERE_AND_THERE
            left = active & ~beyond.T[np.searchsorted(apart[number].start, of.start)]
            settled &= bool((left == told[number]).all()) and round_ > 0
            told[number] = left
        if settled:
            break
    return found, apart


def _trust(
    laid: PassStack, found: Sequence[Factors], active: Mask, vehicles: VehicleEffects
) -> Trust:
    return Trust(
        louder=np.concatenate([each.louder for each in found], axis=1),
        local=np.ones((active.size, len(RANGES), laid.places.size)),
        used=active,
        shared=shared_by(vehicles, found),
        hidden=hidden_by(vehicles, laid, found, active),
        vehicle=vehicles.number,
    )


def _worst(
    laid: PassStack, found: Sequence[Factors], active: Mask, said: Container[int]
) -> tuple[int, Mapping[str, float]] | None:
    """The pass that contradicts the others most, of those of which it is not yet said."""
    if active.sum() < FEWEST:
        return None
    judged = [found[RANGES.index(part)] for part in JUDGED]
    every = outlying(laid, judged, active)
    left = {i: times for i, times in every.items() if i not in said}
    return max(left.items(), key=lambda one: max(one[1].values()), default=None)


def _ends(laid: PassStack, i: int) -> tuple[float, float]:
    known = laid.distance[np.isfinite(laid.level[i])]
    return float(known[0]), float(known[-1])


def _contradiction(
    laid: PassStack, trust: Trust, i: int, times: Mapping[str, float], ends: tuple[float, float]
) -> Contradiction:
    """Say why a pass contradicts the others from one place to another; only noise is no reason to leave it out."""
    line = without_each(laid, trust)[i]
    reason, size = reason_of(likeness(laid, i, line, times, *ends))
    return Contradiction(
        laid.passes[i].of.name, reason, *ends, tuple(times), max(times.values()), size,
        used=reason is RejectionReason.NOISE,
    )  # fmt: skip


def _stretch_by_stretch(
    laid: PassStack, apart: Mapping[int, Stretches], trust: Trust
) -> tuple[Array, list[Contradiction]]:
    """How much louder passes are on stretches where they contradict the others (n, ranges, k), and where that is."""
    local, said = np.ones(trust.local.shape), list[Contradiction]()
    for number, judged in apart.items():
        for i in np.flatnonzero((judged.louder > 1).any(axis=1)):
            local[i, number] = _faded(judged, judged.louder[i], laid.places)
            for run in runs(judged.louder[i] > 1):
                ends = float(judged.start[run.start]), float(judged.end[run.stop - 1])
                times = {RANGES[number].name: float(np.sqrt(judged.louder[i, run].max()))}
                one = _contradiction(laid, trust, int(i), times, ends)
                said.append(replace(one, used=True))
    # What lies beyond the bands goes with the nearest.
    local[:, 0], local[:, -1] = local[:, 1], local[:, -2]
    return local, said


def _faded(of: Stretches, louder: Array, places: Array) -> Array:
    """The factor along the line: all of it on its stretch, fading to the middle of the next."""
    middle = 0.5 * (of.start + of.end)
    edges = np.append(of.start, of.end[-1])
    at_edges = np.maximum(np.append(louder, 1.0), np.append(1.0, louder))
    order = np.argsort(np.concatenate([middle, edges]), kind="stable")
    at = np.concatenate([middle, edges])[order]
    return np.exp(np.interp(places, at, np.log(np.concatenate([louder, at_edges])[order])))


def _on_scatter(times: Mapping[str, Array], active: Mask) -> list[str]:
    usual = {name: float(np.median(each[active])) for name, each in times.items()}
    return [
        f"{name}: the passes scatter {one:.2g} times as much as they state, and were taken at that"
        for name, one in usual.items()
        if one > TELLING
    ]


def _shares(laid: PassStack, days: Array, trust: Trust) -> dict[str, Array]:
    """What of the line on the mean day rests on each pass, by band."""
    found = {}
    for part in JUDGED:
        of_waves = [
            (laid.gain(wave) * weights(laid, wave, days, trust, 0.0).level).mean(axis=1)
            for wave in part.numbers
        ]
        found[part.name] = np.mean(of_waves, axis=0)
    return found

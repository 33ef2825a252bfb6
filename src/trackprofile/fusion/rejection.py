"""Which pass contradicts the others: along the whole line or on a stretch, how much, and why."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert
from scipy.stats import chi2

from trackprofile.fusion.spectral_bands import INTEGRALS, JUDGED, OMEGA, Range, decompose_spectrum
from trackprofile.fusion.stack import PassStack
from trackprofile.fusion.variance_components import CovarianceCells, Factors, projection

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

TIMES = 2.0
"""Times what is usual among the passes, from which a pass's error is a contradiction."""

BY_CHANCE = 1e-4
"""That good passes are said to contradict each other somewhere."""

EXPLAINED = 0.5
"""Share of what a pass differs by that goes with the track, from which its vehicle is at fault, not its noise."""

_EVEN = 0.05  # share that a gain or a lag, one for all waves, leaves of that, if it is one
_ROUNDS = 5  # in which passes are weighed down on stretches
_UNLIKE = 0.3  # of a wave, below which a pass does not hold what the line has


class RejectionReason(Enum):
    """Why a pass contradicts the others, in words."""

    ELSEWHERE = "it does not look like the others: of other track, or too noisy to tell"
    TURNED = "it looks like the others run the other way"
    LAG = "its distances are off"
    GAIN = "its levels are too large or too small by one factor"
    VEHICLE = "it differs by what the track itself excites, as a vehicle does that is not the one it was taken for"
    NOISE = "its error is larger than it states"


@dataclass(frozen=True)
class Contradiction:
    """A pass that contradicts the others.

    Parameters
    ----------
    name : of the pass
    reason : why
    start, end : where [m]
    bands : in which, by name; empty for all
    times : its error over what it states, in standard deviations; None where the two cannot be compared
    size : what the reason is about: the lag [m], the gain [-]; None for others
    used : whether the pass is used there, with the weight that it deserves
    """

    name: str
    reason: RejectionReason
    start: float
    end: float
    bands: tuple[str, ...] = ()
    times: float | None = None
    size: float | None = None
    used: bool = False


def louder_in(part: Range, laid: PassStack, louder: Array) -> Array:
    """Variance of each pass's error in a band over the stated one (n) [-].

    Parameters
    ----------
    louder : λ (n, waves of the range)
    """
    weight = _weights(part, laid)
    return np.sum(weight * louder, axis=1)


def freedom_in(part: Range, laid: PassStack, found: Factors) -> Array:
    """Independent waves behind that (n)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / np.sum(_weights(part, laid) ** 2 / found.counts, axis=1)


def _weights(part: Range, laid: PassStack) -> Array:
    """Share of each wave in the variance that each pass states for a band (n, waves of the range)."""
    seen = laid.inside > 0
    mean = (
        np.sum(laid.stated[:, part.waves] * seen[:, None], axis=2)
        / np.maximum(seen.sum(axis=1), 1)[:, None]
    )
    weight = INTEGRALS[part.name][part.waves] * mean
    return weight / weight.sum(axis=1, keepdims=True)


def outlying(
    laid: PassStack, found: Sequence[Factors], active: Mask
) -> Mapping[int, Mapping[str, float]]:
    """Passes whose error is far beyond what they state and what is usual among the passes: how far, by band.

    Parameters
    ----------
    found : of each of `JUDGED`
    active : passes that are not left out (n)
    """
    times: dict[int, dict[str, float]] = {}
    least = chance(int(active.sum()))
    for part, each in zip(JUDGED, found, strict=True):
        over = louder_in(part, laid, each.louder)
        usual = max(1.0, float(np.median(over[active])))
        freedom = freedom_in(part, laid, each)
        for i in np.flatnonzero(active & (over > TIMES**2 * usual)):
            if over[i] / usual > chi2.isf(least, freedom[i]) / freedom[i]:
                times.setdefault(int(i), {})[part.name] = float(np.sqrt(over[i]))
    return times


def chance(tries: int) -> float:
    """Of one try, if so many together are to be wrong by `BY_CHANCE`."""
    return BY_CHANCE / max(tries * len(JUDGED), 1)


@dataclass(frozen=True)
class Likeness:
    """How a pass goes with the line that the others make, in all waves of the bands.

    Parameters
    ----------
    explained : share of the difference that goes with the line (0 to 1)
    gain, lag : of the pass over the line [-], behind it [m]
    left_by_gain, left_by_lag : share of what goes with the line that one of them alone leaves (0 to 1)
    """

    explained: float
    gain: float
    lag: float
    left_by_gain: float
    left_by_lag: float


def likeness(
    laid: PassStack, i: int, others: Array, bands: Container[str], start: float, end: float
) -> Likeness:
    """Regress each wave of a pass on the same of the line and its Hilbert transform.

    A wave of the pass is Re(β z) with the line's analytic signal z: a gain makes all β the same, a lag δ makes them
    exp(-iΩδ), and a vehicle that is not the one it was taken for anything else.

    Parameters
    ----------
    i : number of the pass
    others : the line without it (m) [m]
    bands : in which
    start, end : of the stretch [m]
    """
    inside = (laid.distance >= start) & (laid.distance <= end)
    known = inside & np.isfinite(laid.level[i]) & np.isfinite(others)
    own, line = (
        decompose_spectrum(np.where(known, one, np.nan), laid.spacing)
        for one in (laid.level[i], others)
    )
    waves = [wave for part in JUDGED if part.name in bands for wave in part.numbers]
    beta, weight, difference = np.zeros(len(waves), np.complex128), np.zeros(len(waves)), 0.0
    for row, wave in enumerate(waves):
        y, z = own.wave(wave), np.asarray(hilbert(line.wave(wave)))
        stated = float(np.median(laid.stated[i, wave]))
        power = max(float(np.sum(np.abs(z) ** 2)) / 2, 1e-300)
        beta[row], weight[row] = np.vdot(z, y) / power, power / stated
        difference += float(np.sum((y - np.real(z)) ** 2)) / stated
    gain = float(np.sum(weight * np.real(beta)) / weight.sum())
    turned = weight * OMEGA[waves]
    lag = -float(np.sum(turned * np.imag(beta)) / np.sum(turned * OMEGA[waves]))
    off, by_gain, by_lag = (
        float(np.sum(weight * np.abs(beta - one) ** 2))
        for one in (1.0, gain, np.exp(-1j * OMEGA[waves] * lag))
    )
    off = max(off, 1e-300)
    return Likeness(off / max(difference, 1e-300), gain, lag, by_gain / off, by_lag / off)


def reason_of(found: Likeness) -> tuple[RejectionReason, float | None]:
    """What is wrong with a pass that goes so with the line, and by how much."""
    if found.explained < EXPLAINED:
        return RejectionReason.NOISE, None
    if found.gain < _UNLIKE:
        return RejectionReason.ELSEWHERE, None
    if found.left_by_lag < _EVEN:
        return RejectionReason.LAG, found.lag
    if found.left_by_gain < _EVEN:
        return RejectionReason.GAIN, found.gain
    return RejectionReason.VEHICLE, None


@dataclass(frozen=True, eq=False)
class Stretches:
    """Where passes contradict all others, stretch by stretch of one range.

    Parameters
    ----------
    start, end : (s) [m]
    louder : variance of each pass's error over the expected where it contradicts the others, else 1 (n, s) [-]
    """

    start: Array
    end: Array
    louder: Array


def louder_stretches(
    of: CovarianceCells, part: Range, laid: PassStack, days: Array, vehicle: Indices, found: Factors
) -> Stretches:
    """Compare each pass in each stretch with what all others make of it.

    What is left of pass i given all others has the variance 1/P_ii, and is (P t)_i / P_ii (de Jong 1988). One bad pass
    makes all others depart a little: the worst of each stretch is weighed down first, and all are asked again.
    """
    _, of_wave = np.unique(of.wave, return_inverse=True)
    start, index = np.unique(of.start, return_inverse=True)
    end = np.zeros(start.size)
    end[index] = of.end
    weight = (_weights(part, laid) * found.louder)[:, of_wave].T
    louder = np.ones((days.size, start.size))
    for _ in range(_ROUNDS):
        own = found.louder.T[of_wave] * louder.T[index]
        P, _ = projection(of, days, vehicle, own, found.change, found.shared)
        left, expected = (np.einsum("cii->ci", one) for one in (P @ of.product @ P, P))
        there = of.there & (expected > 1e-12)
        ratio = np.where(there, left / np.where(there, expected, 1.0), 0.0)
        each = np.where(there, weight, 0.0)
        total, sure, square = (
            _summed(one, index, start.size)
            for one in (each * ratio, each, each**2 / of.count[:, None])
        )
        seen = sure > 0
        times = total / np.where(seen, sure, 1.0)
        freedom = np.where(seen, sure**2 / np.where(seen, square, 1.0), 1.0)
        least = chi2.isf(chance(times.size), freedom) / freedom
        beyond = seen & (times > TIMES**2) & (times > least)
        beyond &= times >= np.where(beyond, times, 0.0).max(axis=1, keepdims=True)
        if not beyond.any():
            break
        louder = np.where(beyond.T, louder * times.T, louder)
    return Stretches(start, end, louder)


def _summed(values: Array, index: Indices, size: int) -> Array:
    """Rows added up by stretch (size, n)."""
    found = np.zeros((size, values.shape[1]))
    np.add.at(found, index, values)
    return found

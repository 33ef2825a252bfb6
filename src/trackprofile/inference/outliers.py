"""What the smoother weighted down, told as faults of the channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import Model
from trackprofile.kalman.robust import LOUDER, NoiseWeights
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.preprocessing.faults import Fault, FaultKind

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SINGLE = 2
"""Samples in a row up to which outliers are spikes of the sensor; more may be the track's."""

IN_NOTES = {FaultKind.MOUNTING, FaultKind.EXCHANGED, FaultKind.SIGN, FaultKind.TURNED}
"""Kinds that a sentence of their own tells."""

NAMED = 3
"""Places that are named; of more it is said how many there are."""


def outlier_faults(
    weights: NoiseWeights, data: Observations, model: Model, ride: DiscretisedRun
) -> tuple[Fault, ...]:
    """Outliers, stretches that are louder than their sensor, offsets that jump or drift."""
    found: list[Fault] = []
    for i, sensor in enumerate(model.sensors):
        rows = ride.sensors == i
        at = ride.samples[rows]
        for kind, mask in (
            (FaultKind.OUTLIER, weights.own[rows] > 0.0),
            (FaultKind.LOUD, weights.louder[rows] > 0.8 * LOUDER),
        ):
            found += [
                Fault(kind, sensor.name, int(at[run.start]), int(at[run.stop - 1]))
                for run in runs(mask)
            ]
        found += _offsets(weights, data, ride, i, sensor.name, at)
    return tuple(found)


def _offsets(
    weights: NoiseWeights,
    data: Observations,
    ride: DiscretisedRun,
    i: int,
    name: str,
    at: NDArray[np.int64],
) -> Iterator[Fault]:
    for bay in np.flatnonzero(weights.jumps[:, i]):
        row = int(np.searchsorted(ride.first_row, ride.first_row[bay + 1], side="left"))
        sample = int(
            ride.samples[min(ride.first_row[min(row, len(ride.F))], len(ride.samples) - 1)]
        )
        size = np.sqrt(weights.jumps[bay, i])
        yield Fault(FaultKind.JUMP, name, sample, sample, f"by about {size:.2g}")
    if weights.drift[i] > 0.0:
        rate = np.sqrt(weights.drift[i])
        yield Fault(FaultKind.DRIFT, name, int(at[0]), int(at[-1]), f"{rate:.2g} per root second")


def single_outliers(weights: NoiseWeights, ride: DiscretisedRun) -> Mask:
    """Rows, (rows,), of outliers of which no more than ``SINGLE`` stand in a row."""
    found = np.zeros(len(weights.own), bool)
    for i in range(ride.offsets):
        rows = np.flatnonzero(ride.sensors == i)
        for run in runs(weights.own[rows] > 0.0):
            found[rows[run]] = run.stop - run.start <= SINGLE
    return found


def outlier_mask(faults: Sequence[Fault], data: Observations, model: Model) -> Mask:
    """Samples, (samples, sensors), that count for less because of those faults."""
    found = np.zeros(data.signals.shape, bool)
    names = [sensor.name for sensor in model.sensors]
    for fault in faults:
        found[fault.first : fault.last + 1, names.index(fault.channel)] = True
    return found


def describe_observations(data: Observations) -> tuple[str, ...]:
    """What was found wrong before anything was modelled, and what was done about it, in sentences."""
    return (*data.notes, *describe_faults(data.faults, data.motion.distance))


def describe_faults(faults: Sequence[Fault], distance: Array) -> tuple[str, ...]:
    """One sentence for each kind of fault of each channel: how often, how much, and where.

    Parameters
    ----------
    distance : (samples,), m
    """
    sentences = []
    counted = Counter((one.channel, one.kind) for one in faults if one.kind not in IN_NOTES)
    for (channel, kind), count in counted.items():
        those = [one for one in faults if (one.channel, one.kind) == (channel, kind)]
        samples = sum(one.last - one.first + 1 for one in those)
        places = ", ".join(_place(one, distance) for one in those[:NAMED])
        more = f" and {count - NAMED} more places" if count > NAMED else ""
        of = f"{channel!r}" if channel else "the recording"
        sentences.append(f"{of}: {kind}, {samples} samples, at {places}{more}")
    return tuple(sentences)


def _place(fault: Fault, distance: Array) -> str:
    first, last = distance[fault.first], distance[fault.last]
    extent = f"{first:.1f} m" if last - first < 0.5 else f"{first:.1f} to {last:.1f} m"
    return extent + (f" ({fault.remark})" if fault.remark else "")

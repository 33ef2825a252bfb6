"""Down-weighted samples and offsets of the smoother, reported as faults of the channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import Model
from trackprofile.kalman.reweighting import NOISE_RATIO_THRESHOLD
from trackprofile.kalman.robust import NoiseWeights
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.preprocessing.faults import Fault, FaultKind

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_SPIKE_LENGTH = 2
"""Consecutive outliers up to which they are a spike of the sensor; more may come from the track, samples."""

DESCRIBED_IN_NOTES = {FaultKind.MOUNTING, FaultKind.EXCHANGED, FaultKind.SIGN, FaultKind.REVERSED}
"""Kinds that have a note of their own."""

MAX_LOCATIONS = 3
"""Locations that a sentence lists; the others are counted."""


def outlier_faults(
    weights: NoiseWeights, data: Observations, model: Model, run: DiscretisedRun
) -> tuple[Fault, ...]:
    """Outliers, stretches noisier than their sensor, offsets that jump or drift."""
    faults: list[Fault] = []
    for i, sensor in enumerate(model.sensors):
        rows = run.sensors == i
        at = run.samples[rows]
        for kind, mask in (
            (FaultKind.OUTLIER, weights.outlier_variance[rows] > 0.0),
            (FaultKind.NOISY, weights.variance_ratio[rows] > 0.8 * NOISE_RATIO_THRESHOLD),
        ):
            faults += [
                Fault(kind, sensor.name, int(at[one.start]), int(at[one.stop - 1]))
                for one in runs(mask)
            ]
        faults += _offset_faults(weights, run, i, sensor.name)
    return tuple(faults)


def _offset_faults(
    weights: NoiseWeights, run: DiscretisedRun, i: int, name: str
) -> Iterator[Fault]:
    """Jumps and drift of the offset of sensor ``i``."""
    at = run.samples[run.sensors == i]
    for bay in np.flatnonzero(weights.jump_variance[:, i]):
        row = int(np.searchsorted(run.first_row, run.first_row[bay + 1], side="left"))
        sample = int(run.samples[min(run.first_row[min(row, len(run.F))], len(run.samples) - 1)])
        size = np.sqrt(weights.jump_variance[bay, i])
        yield Fault(FaultKind.JUMP, name, sample, sample, f"by about {size:.2g}")
    if weights.walk_variance[i] > 0.0:
        rate = np.sqrt(weights.walk_variance[i])
        yield Fault(FaultKind.DRIFT, name, int(at[0]), int(at[-1]), f"{rate:.2g} per root second")


def single_outliers(weights: NoiseWeights, run: DiscretisedRun) -> Mask:
    """Rows, (rows,), of outliers in groups of at most ``MAX_SPIKE_LENGTH`` consecutive samples."""
    single = np.zeros(len(weights.outlier_variance), bool)
    for i in range(run.offsets):
        rows = np.flatnonzero(run.sensors == i)
        for group in runs(weights.outlier_variance[rows] > 0.0):
            single[rows[group]] = group.stop - group.start <= MAX_SPIKE_LENGTH
    return single


def outlier_mask(faults: Sequence[Fault], data: Observations, model: Model) -> Mask:
    """Samples, (samples, sensors), that those faults down-weight."""
    mask = np.zeros(data.signals.shape, bool)
    names = [sensor.name for sensor in model.sensors]
    for fault in faults:
        mask[fault.first : fault.last + 1, names.index(fault.channel)] = True
    return mask


def describe_observations(data: Observations) -> tuple[str, ...]:
    """Faults of the recording that preprocessing found, and their treatment, one sentence each."""
    return (*data.notes, *describe_faults(data.faults, data.motion.distance))


def describe_faults(faults: Sequence[Fault], distance: Array) -> tuple[str, ...]:
    """One sentence for each kind of fault of each channel: number of samples and locations.

    Parameters
    ----------
    distance : (samples,), m
    """
    sentences = []
    counted = Counter(
        (one.channel, one.kind) for one in faults if one.kind not in DESCRIBED_IN_NOTES
    )
    for (channel, kind), count in counted.items():
        same = [one for one in faults if (one.channel, one.kind) == (channel, kind)]
        samples = sum(one.last - one.first + 1 for one in same)
        locations = ", ".join(_location(one, distance) for one in same[:MAX_LOCATIONS])
        others = count - MAX_LOCATIONS
        more = f" and {others} more location{'s' if others > 1 else ''}" if others > 0 else ""
        subject = f"{channel!r}" if channel else "the recording"
        plural = "s" if samples > 1 else ""
        sentences.append(f"{subject}: {kind}, {samples} sample{plural}, at {locations}{more}")
    return tuple(sentences)


def _location(fault: Fault, distance: Array) -> str:
    first, last = distance[fault.first], distance[fault.last]
    extent = f"{first:.1f} m" if last - first < 0.5 else f"{first:.1f} to {last:.1f} m"
    return extent + (f" ({fault.remark})" if fault.remark else "")

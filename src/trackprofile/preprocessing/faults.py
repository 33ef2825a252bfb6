"""Faults of a recording, each found by one rule, so that what is wrong is left out and said.

Each rule looks at one signal alone and knows nothing of vehicle or track: what only they can tell (small spikes,
stretches that are too loud, offsets that move) the smoother finds itself, see :mod:`trackprofile.kalman.robust`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntFlag, StrEnum

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, median_filter

from trackprofile.arrays import runs
from trackprofile.contracts import channels
from trackprofile.preprocessing.fault_detectors import (
    at_end_of_range,
    copied,
    resolution,
    spikes,
    step_of_all,
    stuck,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BESIDE = 2
"""Samples beside other faults in which no spike is looked for."""

MOSTLY = 0.7
"""Share of valid samples of a channel from which those that are not are missing; fewer is a slower channel."""

GAP = 1.5
"""Times the usual sampling interval that make a gap."""

AROUND = 51
"""Sampling intervals about one that say what is usual."""


class FaultKind(StrEnum):
    """What can be wrong."""

    GAP = "gap"
    MISSING = "samples missing"
    MOUNTING = "mounted otherwise"
    CLOCK = "clock jump"
    SPEED = "speed missing"
    POSITION = "position off"
    SLIP = "wheel slips"
    REPEATED = "repeated samples"
    SPIKE = "spike"
    OUTLIER = "outlier"
    SATURATED = "end of range"
    STUCK = "stuck"
    COARSE = "loss of resolution"
    LOUD = "louder than its noise"
    JUMP = "offset jumps"
    DRIFT = "offset drifts"
    EXCHANGED = "channels exchanged"
    SIGN = "sign turned"
    TURNED = "runs the other way round"


class ClockFault(IntFlag):
    """Flags of a recording's samples, in its variable ``clock_fault``: what was mended when it was read."""

    JUMP = 1
    """The clock jumped before this sample."""
    REPEATED = 2
    """Rows that stood twice were left out before this sample."""
    SPEED = 4
    """The speed was missing here."""
    POSITION = 8
    """A satellite position or kilometre post here was weighted down."""
    SLIP = 16
    """The wheel that counts the distance slipped here."""


_KIND_OF = {
    ClockFault.JUMP: "CLOCK",
    ClockFault.REPEATED: "REPEATED",
    ClockFault.SPEED: "SPEED",
    ClockFault.POSITION: "POSITION",
    ClockFault.SLIP: "SLIP",
}


@dataclass(frozen=True)
class Fault:
    """Something wrong in samples ``first`` to ``last``, both included, of a channel ("" is the motion's clock).

    ``remark`` says more, in words, where there is more to say.
    """

    kind: FaultKind
    channel: str
    first: int
    last: int
    remark: str = ""


def find_faults(recording: xr.Dataset) -> tuple[Fault, ...]:
    """All that the rules of this module find in the valid samples of a recording.

    Examples
    --------
    >>> from trackprofile.contracts import Channel, build_recording
    >>> signal = np.sin(np.arange(400) / 7.0)
    >>> signal[100] = 50.0
    >>> time = np.arange(400) / 100.0
    >>> floor = Channel("floor", signal, "vertical acceleration", "body", 0.0)
    >>> find_faults(build_recording([floor], time=time, speed=np.full(400, 20.0)))
    (Fault(kind=<FaultKind.SPIKE: 'spike'>, channel='floor', first=100, last=100, remark=''),)
    """
    found = list(_gaps(recording))
    torn = np.zeros(recording.sizes["sample"], bool)
    for gap in found:
        torn[gap.first : gap.last + 1] |= gap.kind is FaultKind.GAP
    parts = channels(recording)
    still = [bool(np.ptp(one.values[np.asarray(one.valid, bool)]) == 0.0) for one in parts]
    for channel in parts:
        valid = np.asarray(channel.valid, bool)
        at = np.flatnonzero(valid)
        if np.mean(valid) > MOSTLY:
            found += [
                Fault(FaultKind.MISSING, channel.name, run.start, run.stop - 1)
                for run in runs(~valid)
            ]
        here = torn[at] | _beside_holes(at)
        for kind, mask in _marks(channel.values[at], here, alive=not all(still)):
            found += [
                Fault(kind, channel.name, int(at[run.start]), int(at[run.stop - 1]))
                for run in runs(mask)
            ]
    return tuple(found)


def _beside_holes(at: NDArray[np.intp]) -> Mask:
    """Which of the valid samples, by their numbers, come before or after some that are not."""
    found = np.zeros(len(at), bool)
    if len(at) > 1:
        apart = np.diff(at)
        hole = apart > GAP * np.median(apart)
        found[:-1] |= hole
        found[1:] |= hole
    return found


def _marks(values: Array, torn: Mask, *, alive: bool) -> Iterator[tuple[FaultKind, Mask]]:
    """Each rule and the samples that it marks.

    ``torn`` are samples beside which others are missing; ``alive`` is whether anything in the recording moved at all.
    """
    flat = {
        FaultKind.SATURATED: at_end_of_range(values),
        FaultKind.STUCK: stuck(values) & alive,
        FaultKind.REPEATED: copied(values),
    }
    yield from flat.items()
    # Where a signal breaks off it bends as at a spike.
    broken = np.asarray(
        binary_dilation(np.any([torn, *flat.values()], axis=0), iterations=BESIDE), bool
    )
    yield FaultKind.SPIKE, spikes(values) & ~broken
    yield FaultKind.COARSE, resolution(values) > step_of_all(values)


LEFT_OUT = frozenset({FaultKind.REPEATED, FaultKind.SPIKE, FaultKind.SATURATED, FaultKind.STUCK})
"""Kinds whose samples tell nothing; those of the others count for less."""


def samples_of(
    faults: Sequence[Fault], channel: str, count: int, kinds: frozenset[FaultKind] | None = None
) -> Mask:
    """Samples, (count,), of a channel that have a fault of these kinds, or of any."""
    mask = np.zeros(count, bool)
    for fault in faults:
        if fault.channel == channel and (kinds is None or fault.kind in kinds):
            mask[fault.first : fault.last + 1] = True
    return mask


def _gaps(recording: xr.Dataset) -> Iterator[Fault]:
    """Steps of the clock, or without one of the distance, that are longer than the usual one."""
    axis = "time" if "time" in recording else "distance"
    steps = np.diff(recording[axis].to_numpy())
    # Those around, since samples at equal distances follow each other slower while the train is slow.
    usual = median_filter(steps, AROUND, mode="nearest") if len(steps) else steps
    for k in np.flatnonzero((steps > GAP * usual) & (usual > 0.0)):
        unit = recording[axis].attrs["units"]
        yield Fault(FaultKind.GAP, "", int(k), int(k) + 1, f"{steps[k]:.3g} {unit} without samples")
    if "clock_fault" in recording:
        flags = recording["clock_fault"].to_numpy()
        for flag, kind in _KIND_OF.items():
            for run in runs((flags & flag) != 0):
                yield Fault(FaultKind[kind], "", run.start, run.stop - 1)

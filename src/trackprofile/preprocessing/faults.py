"""Faults of a recording: kinds, detection by rules on single signals, and masks of faulty samples.

Each rule uses one signal alone, without a model of vehicle or track. Faults that only the model reveals (small
outliers, noisy stretches, offset jumps) are detected by the smoother, see :mod:`trackprofile.kalman.robust`.
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
    coarsely_quantised,
    repeated_rows,
    saturated,
    spikes,
    stuck,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPIKE_MARGIN = 2
"""Samples next to other faults in which no spike is searched for."""

MIN_VALID_SHARE = 0.7
"""Share of valid samples from which the others of a channel are missing; a smaller share is a lower sampling rate."""

GAP_RATIO = 1.5
"""Sampling interval over the median of those around it from which it is a gap."""

MEDIAN_LENGTH = 51
"""Number of sampling intervals over which that median is taken."""


class FaultKind(StrEnum):
    """Kind of a fault."""

    GAP = "gap"
    MISSING = "samples missing"
    MOUNTING = "wrong mounting"
    CLOCK = "clock jump"
    SPEED = "speed missing"
    POSITION = "position outlier"
    SLIP = "wheel slip"
    REPEATED = "repeated samples"
    SPIKE = "spike"
    OUTLIER = "outlier"
    SATURATED = "saturation"
    STUCK = "stuck"
    COARSE = "loss of resolution"
    NOISY = "noisier than stated"
    JUMP = "offset jump"
    DRIFT = "offset drift"
    EXCHANGED = "channels exchanged"
    SIGN = "sign reversed"
    REVERSED = "vehicle reversed"


class ClockFault(IntFlag):
    """Flags of a recording's samples in the variable ``clock_fault``: what was repaired when it was read."""

    JUMP = 1
    """The clock jumped before this sample."""
    REPEATED = 2
    """Rows with a repeated time stamp were dropped before this sample."""
    SPEED = 4
    """The speed was missing and has been interpolated."""
    POSITION = 8
    """A GNSS fix or kilometre post at this sample is an outlier."""
    SLIP = 16
    """The wheel that measures the distance slipped."""


_KIND_OF_FLAG = {
    ClockFault.JUMP: FaultKind.CLOCK,
    ClockFault.REPEATED: FaultKind.REPEATED,
    ClockFault.SPEED: FaultKind.SPEED,
    ClockFault.POSITION: FaultKind.POSITION,
    ClockFault.SLIP: FaultKind.SLIP,
}

EXCLUDED_KINDS = frozenset(
    {FaultKind.REPEATED, FaultKind.SPIKE, FaultKind.SATURATED, FaultKind.STUCK}
)
"""Kinds whose samples are excluded; those of the other kinds are down-weighted or corrected."""


@dataclass(frozen=True)
class Fault:
    """A fault of one channel.

    Parameters
    ----------
    kind : what is wrong
    channel : its name; "" for time, distance and speed
    first, last : numbers of the first and the last faulty sample
    remark : details as text, "" if there are none
    """

    kind: FaultKind
    channel: str
    first: int
    last: int
    remark: str = ""


def find_faults(recording: xr.Dataset) -> tuple[Fault, ...]:
    """Faults that the rules of this module find in the valid samples of a recording.

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
    faults = list(_motion_faults(recording))
    next_to_gap = np.zeros(recording.sizes["sample"], bool)
    for gap in faults:
        next_to_gap[gap.first : gap.last + 1] |= gap.kind is FaultKind.GAP
    parts = channels(recording)
    constant = [bool(np.ptp(one.values[np.asarray(one.valid, bool)]) == 0.0) for one in parts]
    for channel in parts:
        valid = np.asarray(channel.valid, bool)
        at = np.flatnonzero(valid)
        if np.mean(valid) > MIN_VALID_SHARE:
            faults += [
                Fault(FaultKind.MISSING, channel.name, run.start, run.stop - 1)
                for run in runs(~valid)
            ]
        next_to_missing = next_to_gap[at] | _next_to_missing(at)
        masks = _signal_faults(channel.values[at], next_to_missing, any_moves=not all(constant))
        for kind, mask in masks:
            faults += [
                Fault(kind, channel.name, int(at[run.start]), int(at[run.stop - 1]))
                for run in runs(mask)
            ]
    return tuple(faults)


def fault_mask(
    faults: Sequence[Fault], channel: str, count: int, kinds: frozenset[FaultKind] | None = None
) -> Mask:
    """Samples of a channel with a fault.

    Parameters
    ----------
    count : number of samples
    kinds : kinds of faults; None: all

    Returns
    -------
    (count,)
    """
    mask = np.zeros(count, bool)
    for fault in faults:
        if fault.channel == channel and (kinds is None or fault.kind in kinds):
            mask[fault.first : fault.last + 1] = True
    return mask


def _next_to_missing(at: NDArray[np.intp]) -> Mask:
    """Which of the valid samples, by their numbers, lie before or after missing ones."""
    mask = np.zeros(len(at), bool)
    if len(at) > 1:
        steps = np.diff(at)
        gap = steps > GAP_RATIO * np.median(steps)
        mask[:-1] |= gap
        mask[1:] |= gap
    return mask


def _signal_faults(
    values: Array, next_to_missing: Mask, *, any_moves: bool
) -> Iterator[tuple[FaultKind, Mask]]:
    """Mask of the faulty samples by kind.

    Parameters
    ----------
    values, next_to_missing : (n,), valid samples, and whether samples next to them are missing
    any_moves : whether any channel of the recording changes; else a constant one is not stuck
    """
    constant = {
        FaultKind.SATURATED: saturated(values),
        FaultKind.STUCK: stuck(values) & any_moves,
        FaultKind.REPEATED: repeated_rows(values),
    }
    yield from constant.items()
    # A discontinuity of the signal looks like a spike.
    discontinuous = np.any([next_to_missing, *constant.values()], axis=0)
    excluded = np.asarray(binary_dilation(discontinuous, iterations=SPIKE_MARGIN), bool)
    yield FaultKind.SPIKE, spikes(values) & ~excluded
    yield FaultKind.COARSE, coarsely_quantised(values)


def _motion_faults(recording: xr.Dataset) -> Iterator[Fault]:
    """Gaps of the clock, or of the distance without a clock, and the repairs that the recording states."""
    axis = "time" if "time" in recording else "distance"
    steps = np.diff(recording[axis].to_numpy())
    # A local median: samples at equal distances have longer intervals while the train is slow.
    typical = median_filter(steps, MEDIAN_LENGTH, mode="nearest") if len(steps) else steps
    for k in np.flatnonzero((steps > GAP_RATIO * typical) & (typical > 0.0)):
        unit = recording[axis].attrs["units"]
        yield Fault(FaultKind.GAP, "", int(k), int(k) + 1, f"{steps[k]:.3g} {unit} without samples")
    if "clock_fault" in recording:
        flags = recording["clock_fault"].to_numpy()
        for flag, kind in _KIND_OF_FLAG.items():
            for run in runs((flags & flag) != 0):
                yield Fault(kind, "", run.start, run.stop - 1)

"""Faults of a recording, each found by one rule, so that what is wrong is left out and said.

Each rule looks at one signal alone and knows nothing of vehicle or track: what only they can tell (small spikes,
stretches that are too loud, offsets that move) the smoother finds itself, see :mod:`trackprofile.inference.robust`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntFlag, StrEnum
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from trackprofile.bands import runs
from trackprofile.contracts import channels
from trackprofile.motion import recorded_step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FLAT = 3
"""Samples in a row at the end of a range that make a saturation."""

STUCK = 20
"""Times the usual number of equal samples in a row that make a sensor stuck, and at least so many samples."""

BESIDE = 2
"""Samples beside other faults in which no spike is looked for."""

SPIKE = 30.0
"""Times the usual departure from the curve through the samples around that makes a spike."""

ALONE = 5.0
"""Times that it has to be above all other departures nearby: a blow rings on, a spike does not."""

NEARBY = 10
"""Samples to each side that have to be calm about a spike."""

TINY = 1e-300

BLOCK = 512
"""Samples over which a usual value is taken."""

COPIED = 24
"""Samples in a row that are the same as others elsewhere, to the last bit, before they are held for a copy."""

FEWEST_VALUES = 12
"""Different values that such a row has to have: a coarse signal repeats itself by chance."""

RESOLVED = 128
"""Samples over which a resolution is told."""

MOSTLY = 0.7
"""Share of valid samples of a channel from which those that are not are missing; fewer is a slower channel."""

COARSER = 3.0
"""Times the recording's resolution from which a block has lost resolution."""

GAP = 1.5
"""Times the usual sampling interval that make a gap."""


class FaultKind(StrEnum):
    """What can be wrong."""

    GAP = "gap"
    MISSING = "samples missing"
    MOUNTING = "mounted otherwise"
    CLOCK = "clock jump"
    SPEED = "speed missing"
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


class ClockFault(IntFlag):
    """Flags of a recording's samples, in its variable ``clock_fault``: what was mended when it was read."""

    JUMP = 1
    """The clock jumped before this sample."""
    REPEATED = 2
    """Rows that stood twice were left out before this sample."""
    SPEED = 4
    """The speed was missing here."""


_KIND_OF = {
    ClockFault.JUMP: "CLOCK",
    ClockFault.REPEATED: "REPEATED",
    ClockFault.SPEED: "SPEED",
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
    yield FaultKind.COARSE, resolution(values) > recorded_step(values)


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


def at_end_of_range(values: Array) -> Mask:
    """Samples at the greatest or the least value of all, ``FLAT`` times or more in a row.

    A signal that is recorded in coarse steps stays at its greatest value too, but comes there and leaves by single
    steps; one that is cut off arrives with its whole slope.

    Examples
    --------
    >>> signal = np.sin(np.arange(40) / 3.0)
    >>> int(at_end_of_range(signal).sum())
    0
    >>> int(at_end_of_range(np.clip(signal, -2.0, 0.8)).sum())
    8
    """
    found = np.zeros(len(values), bool)
    step = recorded_step(values)
    for end in (np.max(values), np.min(values)) if len(values) else ():
        for run in runs(values == end):
            beside = [values[i] for i in (run.start - 1, run.stop) if 0 <= i < len(values)]
            far = max((abs(value - end) for value in beside), default=0.0)
            if run.stop - run.start >= FLAT and far > 1.5 * step:
                found[run] = True
    return found


def stuck(values: Array) -> Mask:
    """Samples of a value that stays ``STUCK`` times longer than values of this signal usually do, and as many samples.

    It breaks off: at one of its ends the signal steps as far as it usually does. Where it sets out and comes to rest by
    degrees, nothing happened for a while. A signal that never changes is stuck altogether.

    Examples
    --------
    >>> signal = np.sin(np.arange(400) / 3.0)
    >>> signal[200:240] = signal[200]
    >>> int(stuck(signal).sum())
    40
    """
    change = np.abs(np.diff(values))
    if not change.any():
        return np.full(len(values), len(values) >= STUCK)
    starts = np.concatenate([[0], 1 + np.flatnonzero(change)])
    lengths = np.diff(starts, append=len(values))
    # The usual length is that of half the values, not of half the samples, which a stuck sensor could be.
    long = lengths >= STUCK * float(np.median(lengths))
    usual = float(np.median(change[change > 0]))
    step = np.concatenate([[0.0], change[starts[1:] - 1], [0.0]])
    breaks = np.maximum(step[:-1], step[1:]) >= usual
    return np.repeat(long & breaks, lengths)


def spikes(values: Array) -> Mask:
    """Single samples, or two in a row, that none beside them shares.

    Their departure from the cubic through two samples on each side is more than ``SPIKE`` times the usual one of the
    block, and ``ALONE`` times any other within ``NEARBY`` samples that the spike itself has no part in; nearer to an
    end than that many samples nobody can tell.

    Examples
    --------
    >>> signal = np.sin(np.arange(400) / 7.0)
    >>> signal[[100, 300, 301]] += [50.0, -30.0, -20.0]
    >>> np.flatnonzero(spikes(signal))
    array([100, 300, 301])
    """
    found = np.zeros(len(values), bool)
    step = recorded_step(values)
    for width in (1, 2):
        departure = _departure(values, width)
        usual = np.maximum(_block_medians(departure), max(step, TINY))
        inner = slice(NEARBY, len(values) - width - NEARBY)
        for k in NEARBY + np.flatnonzero((departure > SPIKE * usual)[inner]):
            near = np.r_[
                departure[k - NEARBY : k - width - 1], departure[k + width + 2 : k + NEARBY]
            ]
            beside = departure[k - width - 1 : k + width + 2]
            if departure[k] >= np.max(beside) and departure[k] > ALONE * np.max(near, initial=0.0):
                found[k : k + width] = True
    return found


def _departure(values: Array, width: int) -> Array:
    """Least distance of each sample, and the ``width`` - 1 after it, from the cubic through those around, (n,)."""
    departure = np.zeros(len(values))
    inner = len(values) - width - 3
    if inner < 1:
        return departure
    nodes = np.array([-2, -1, width, width + 1])
    around = np.stack([values[2 + node : 2 + node + inner] for node in nodes])
    cubic = [np.linalg.solve(np.vander(nodes).T, np.vander([at], 4)[0]) for at in range(width)]
    each = [np.abs(values[2 + at : 2 + at + inner] - one @ around) for at, one in enumerate(cubic)]
    departure[2 : 2 + inner] = np.min(each, axis=0)
    return departure


def copied(values: Array) -> Mask:
    """Rows of ``COPIED`` samples or more that repeat an earlier row to the last bit: a buffer sent twice.

    Examples
    --------
    >>> signal = np.random.default_rng(1).standard_normal(1000)
    >>> signal[500:600] = signal[400:500]
    >>> runs(copied(signal))
    [slice(500, 600, None)]
    """
    count = len(values) - COPIED + 1
    found = np.zeros(len(values), bool)
    if count < 2:
        return found
    seal = _seals(values)[:count]
    order = np.argsort(seal, kind="stable")
    same = np.flatnonzero(seal[order[1:]] == seal[order[:-1]])
    for earlier, later in zip(order[same], order[same + 1], strict=True):
        row = values[later : later + COPIED]
        if len(np.unique(row)) >= FEWEST_VALUES and np.array_equal(
            row, values[earlier : earlier + COPIED]
        ):
            found[later : later + COPIED] = True
    return found


def resolution(values: Array) -> Array:
    """The step in which each sample was recorded, (n,); 0 where it is as good as continuous.

    That of the whole signal, but of ``RESOLVED`` samples their own where that is ``COARSER`` times as large.

    Examples
    --------
    >>> signal = np.random.default_rng(1).standard_normal(2048)
    >>> signal[1024:] = np.round(signal[1024:])
    >>> np.unique(resolution(signal))
    array([0., 1.])
    """
    whole = recorded_step(values)
    steps = np.full(len(values), whole)
    for block in _blocks(len(values), RESOLVED):
        own = _grid(values[block])
        if own > COARSER * whole:
            steps[block] = own
    return steps


def _grid(values: Array) -> float:
    """The step of a grid that all values lie on; 0 where there is none."""
    step = recorded_step(values)
    if step == 0.0:
        return 0.0
    apart = np.diff(np.unique(values)) / step
    # A grid's own rounding is far below a hundredth of a step; of other numbers two per cent come so close by chance.
    return step if np.all(np.abs(apart - np.round(apart)) < 0.01) else 0.0


def _gaps(recording: xr.Dataset) -> Iterator[Fault]:
    """Steps of the clock, or without one of the distance, that are longer than the usual one."""
    axis = "time" if "time" in recording else "distance"
    steps = np.diff(recording[axis].to_numpy())
    usual = np.median(steps[steps > 0]) if np.any(steps > 0) else 0.0
    for k in np.flatnonzero(steps > GAP * usual):
        unit = recording[axis].attrs["units"]
        yield Fault(FaultKind.GAP, "", int(k), int(k) + 1, f"{steps[k]:.3g} {unit} without samples")
    if "clock_fault" in recording:
        flags = recording["clock_fault"].to_numpy()
        for flag, kind in _KIND_OF.items():
            for run in runs((flags & flag) != 0):
                yield Fault(FaultKind[kind], "", run.start, run.stop - 1)


def _seals(values: Array) -> NDArray[np.uint64]:
    """One number for each row of ``COPIED`` samples, the same for the same rows (a polynomial of their bits)."""
    bits = np.ascontiguousarray(values, np.float64).view(np.uint64)
    bits = (bits ^ (bits >> np.uint64(29))) * np.uint64(0x9E3779B97F4A7C15)
    bits ^= bits >> np.uint64(32)
    seal = np.zeros(len(bits), np.uint64)
    for k in range(COPIED):
        shifted = np.zeros(len(bits), np.uint64)
        shifted[: len(bits) - k] = bits[k:]
        seal = seal * np.uint64(0x100000001B3) + shifted
    return seal


def _blocks(count: int, length: int = BLOCK) -> Iterator[slice]:
    edges = np.linspace(0, count, max(1, count // length) + 1).astype(int)
    for begin, end in pairwise(edges):
        yield slice(int(begin), int(end))


def _block_medians(values: Array) -> Array:
    """Of each sample, the median of its block."""
    medians = np.empty(len(values))
    for block in _blocks(len(values)):
        medians[block] = np.median(values[block])
    return medians

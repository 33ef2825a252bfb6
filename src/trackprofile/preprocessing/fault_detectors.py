"""Rules on one signal's values: which samples lie at the end of its range, stick, stick out, repeat, are coarse."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import recorded_step, runs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FLAT = 3
"""Samples in a row at the end of a range that make a saturation."""

STUCK = 20
"""Times the usual number of equal samples in a row that make a sensor stuck, and at least so many samples."""

CALM = 10.0
"""Times less than usual that a signal changes where it comes to rest."""

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

FAR = 12.0
"""Usual departures from the block's median, above which a sample says nothing of how strong a signal is."""

COARSER = 3.0
"""Times the recording's resolution from which a block has lost resolution."""


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

    It breaks off: at one of its ends the signal steps as far as it usually does; or it moves before and after, and
    nowhere else is it nearly as calm. Where it sets out and comes to rest by degrees, nothing happened for a while. A
    signal that never changes is stuck altogether.

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
    if _never_rests(change[np.repeat(~long, lengths)[1:]], STUCK * int(np.median(lengths))):
        breaks[1:-1] = True
    return np.repeat(long & breaks, lengths)


def _never_rests(change: Array, width: int) -> bool:
    """Whether a signal with these changes moves in all rows of ``width`` of them nearly as it usually does."""
    rows = len(change) // width
    if rows < 2:
        return False
    moves = change[: rows * width].reshape(rows, width).mean(axis=1)
    return bool(np.min(moves) > np.median(moves) / CALM)


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


def outlying(values: Array) -> Mask:
    """Samples ``FAR`` times farther from their block's median than is usual there, and in half of all blocks.

    Examples
    --------
    >>> signal = np.sin(np.arange(2000) / 3.0)
    >>> signal[700:704] = 40.0
    >>> np.flatnonzero(far(signal))
    array([700, 701, 702, 703])
    """
    off = np.abs(values - _block_medians(values))
    usual = _block_medians(off)
    return off > FAR * np.maximum(usual, np.median(usual)) if len(values) else off > 0.0


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
    whole = step_of_all(values)
    steps = np.full(len(values), whole)
    for block in _blocks(len(values), RESOLVED):
        own = _grid(values[block], whole)
        if own > COARSER * whole:
            steps[block] = own
    return steps


def step_of_all(values: Array) -> float:
    """The step in which a signal was recorded, few values or many; 0 where it is as good as continuous."""
    return max(recorded_step(values), _grid(values, 0.0))


def _grid(values: Array, rounding: float) -> float:
    """The step of a grid that all values lie on, but for having been rounded after; 0 where none is coarser."""
    apart = np.diff(np.unique(values))
    step = float(np.min(apart, initial=np.inf))
    if not rounding < step < np.inf:
        return 0.0
    # The least distance of two rounded values is less than their grid's step.
    step = float(np.mean(apart[apart < 1.5 * step]))
    # Distances of nonsense, as in a damaged file, may be beyond all numbers: they lie on no grid.
    with np.errstate(over="ignore", invalid="ignore"):
        multiples = np.maximum(np.round(apart / step), 1.0)
        step = float(np.sum(apart) / np.sum(multiples))
        off = np.abs(apart - multiples * step)
    # A grid's own rounding is far below a hundredth of a step; of other numbers two per cent come so close by chance.
    return step if np.all(off < 0.01 * step + 1.001 * rounding) else 0.0


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

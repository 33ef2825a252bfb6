"""Detectors of faulty samples in one signal: saturated, stuck, spikes, repeated, coarsely quantised, outlying."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import recorded_step, runs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_SATURATED = 3
"""Smallest number of consecutive samples at the end of the range in a saturation."""

STUCK_RATIO = 20
"""Number of equal consecutive samples over the median of such numbers from which a sensor is stuck; also the smallest
number of samples."""

REST_RATIO = 10.0
"""Median over smallest mean change of a signal from which it comes to rest at times."""

SPIKE_RATIO = 30.0
"""Deviation of a spike from the interpolating cubic over the median deviation of the block."""

ISOLATION_RATIO = 5.0
"""Deviation of a spike over all others nearby: an impact is followed by vibration, a spike is not."""

ISOLATION_SAMPLES = 10
"""Samples before and after a spike that have to deviate less."""

MIN_DEVIATION = 1e-300
"""Lower limit of a median deviation, so that it can be a divisor."""

BLOCK_SAMPLES = 512
"""Samples over which medians are taken."""

MIN_REPEATED = 24
"""Smallest number of consecutive samples that repeat earlier ones bit for bit."""

MIN_DISTINCT = 12
"""Smallest number of distinct values among them: a coarsely quantised signal repeats itself by chance."""

RESOLUTION_SAMPLES = 128
"""Samples over which a resolution is determined."""

OUTLYING_RATIO = 12.0
"""Deviation from the block's median, over the median deviation, from which a sample is excluded from RMS values."""

COARSER_RATIO = 3.0
"""Resolution of a block over that of the recording from which the block has lost resolution."""

MAX_GRID_ERROR = 0.01
"""Largest deviation from multiples of the step, in steps, on a grid. The rounding of a grid is far smaller; 2 % of
other numbers come as close by chance."""


def saturated(values: Array) -> Mask:
    """Samples at the largest or smallest value, at least `MIN_SATURATED` consecutive ones.

    A coarsely quantised signal also stays at its largest value, but reaches and leaves it by single steps; a clipped
    signal reaches it with its full slope.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,)

    Examples
    --------
    >>> signal = np.sin(np.arange(40) / 3.0)
    >>> int(saturated(signal).sum())
    0
    >>> int(saturated(np.clip(signal, -2.0, 0.8)).sum())
    8
    """
    mask = np.zeros(len(values), bool)
    step = recorded_step(values)
    for limit in (np.max(values), np.min(values)) if len(values) else ():
        for run in runs(values == limit):
            neighbours = [values[i] for i in (run.start - 1, run.stop) if 0 <= i < len(values)]
            jump = max((abs(value - limit) for value in neighbours), default=0.0)
            if run.stop - run.start >= MIN_SATURATED and jump > 1.5 * step:
                mask[run] = True
    return mask


def stuck(values: Array) -> Mask:
    """Samples of a value that stays much longer than values of this signal typically do.

    It must start or end abruptly: by a step of at least the median change at one of its ends, or in a signal that
    nowhere else comes nearly to rest. A signal that comes to rest and leaves it gradually is not stuck. A constant
    signal is stuck altogether.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,)

    Examples
    --------
    >>> signal = np.sin(np.arange(400) / 3.0)
    >>> signal[200:240] = signal[200]
    >>> int(stuck(signal).sum())
    40
    """
    change = np.abs(np.diff(values))
    if not change.any():
        return np.full(len(values), len(values) >= STUCK_RATIO)
    starts = np.concatenate([[0], 1 + np.flatnonzero(change)])
    lengths = np.diff(starts, append=len(values))
    # The median over the values, not over the samples: half of the samples may be stuck.
    long = lengths >= STUCK_RATIO * float(np.median(lengths))
    typical = float(np.median(change[change > 0]))
    step = np.concatenate([[0.0], change[starts[1:] - 1], [0.0]])
    abrupt = np.maximum(step[:-1], step[1:]) >= typical
    moving = change[np.repeat(~long, lengths)[1:]]
    if _never_rests(moving, STUCK_RATIO * int(np.median(lengths))):
        abrupt[1:-1] = True
    return np.repeat(long & abrupt, lengths)


def _never_rests(change: Array, length: int) -> bool:
    """Whether the mean change over every ``length`` samples is nearly as large as their median."""
    rows = len(change) // length
    if rows < 2:
        return False
    means = change[: rows * length].reshape(rows, length).mean(axis=1)
    return bool(np.min(means) > np.median(means) / REST_RATIO)


def spikes(values: Array) -> Mask:
    """Isolated deviations of one sample or of two consecutive ones.

    The deviation from the cubic through the two samples before and the two after is more than `SPIKE_RATIO` times the
    block's median, and `ISOLATION_RATIO` times any other within `ISOLATION_SAMPLES` that does not depend on the spike.
    Closer to an end of the signal, spikes are not detected.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,)

    Examples
    --------
    >>> signal = np.sin(np.arange(400) / 7.0)
    >>> signal[[100, 300, 301]] += [50.0, -30.0, -20.0]
    >>> np.flatnonzero(spikes(signal))
    array([100, 300, 301])
    """
    mask = np.zeros(len(values), bool)
    step = recorded_step(values)
    for width in (1, 2):
        deviation = _deviation_from_cubic(values, width)
        typical = np.maximum(_block_medians(deviation), max(step, MIN_DEVIATION))
        inner = slice(ISOLATION_SAMPLES, len(values) - width - ISOLATION_SAMPLES)
        for k in ISOLATION_SAMPLES + np.flatnonzero((deviation > SPIKE_RATIO * typical)[inner]):
            around = np.r_[
                deviation[k - ISOLATION_SAMPLES : k - width - 1],
                deviation[k + width + 2 : k + ISOLATION_SAMPLES],
            ]
            dependent = deviation[k - width - 1 : k + width + 2]
            isolated = deviation[k] > ISOLATION_RATIO * np.max(around, initial=0.0)
            if deviation[k] >= np.max(dependent) and isolated:
                mask[k : k + width] = True
    return mask


def _deviation_from_cubic(values: Array, width: int) -> Array:
    """Smallest deviation, (n,), of each sample and the ``width`` - 1 after it from the cubic through those around."""
    deviation = np.zeros(len(values))
    inner = len(values) - width - 3
    if inner < 1:
        return deviation
    nodes = np.array([-2, -1, width, width + 1])
    around = np.stack([values[2 + node : 2 + node + inner] for node in nodes])
    cubic = [np.linalg.solve(np.vander(nodes).T, np.vander([at], 4)[0]) for at in range(width)]
    each = [np.abs(values[2 + at : 2 + at + inner] - one @ around) for at, one in enumerate(cubic)]
    deviation[2 : 2 + inner] = np.min(each, axis=0)
    return deviation


def outlying(values: Array) -> Mask:
    """Samples much farther from their block's median than the block's or the median block's samples are.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,)

    Examples
    --------
    >>> signal = np.sin(np.arange(2000) / 3.0)
    >>> signal[700:704] = 40.0
    >>> np.flatnonzero(outlying(signal))
    array([700, 701, 702, 703])
    """
    deviation = np.abs(values - _block_medians(values))
    if not len(values):
        return deviation > 0.0
    typical = _block_medians(deviation)
    return deviation > OUTLYING_RATIO * np.maximum(typical, np.median(typical))


def repeated_rows(values: Array) -> Mask:
    """Samples that repeat at least `MIN_REPEATED` consecutive earlier ones bit for bit: a buffer that was sent twice.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,)

    Examples
    --------
    >>> signal = np.random.default_rng(1).standard_normal(1000)
    >>> signal[500:600] = signal[400:500]
    >>> runs(repeated_rows(signal))
    [slice(500, 600, None)]
    """
    count = len(values) - MIN_REPEATED + 1
    mask = np.zeros(len(values), bool)
    if count < 2:
        return mask
    hashes = _rolling_hashes(values)[:count]
    order = np.argsort(hashes, kind="stable")
    same = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
    for earlier, later in zip(order[same], order[same + 1], strict=True):
        row = values[later : later + MIN_REPEATED]
        if len(np.unique(row)) >= MIN_DISTINCT and np.array_equal(
            row, values[earlier : earlier + MIN_REPEATED]
        ):
            mask[later : later + MIN_REPEATED] = True
    return mask


def resolution(values: Array) -> Array:
    """Quantisation step of each sample; 0 if continuous.

    It is that of the whole signal, except in blocks of `RESOLUTION_SAMPLES` with a step of more than `COARSER_RATIO`
    times that.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    (n,), in the unit of the values

    Examples
    --------
    >>> signal = np.random.default_rng(1).standard_normal(2048)
    >>> signal[1024:] = np.round(signal[1024:])
    >>> np.unique(resolution(signal))
    array([0., 1.])
    """
    return _resolution(values, _signal_step(values))


def coarsely_quantised(values: Array) -> Mask:
    """Samples, (n,), with a coarser quantisation step than that of the whole signal."""
    step = _signal_step(values)
    return _resolution(values, step) > step


def _resolution(values: Array, signal_step: float) -> Array:
    steps = np.full(len(values), signal_step)
    for block in _blocks(len(values), RESOLUTION_SAMPLES):
        step = _grid_step(values[block], signal_step)
        if step > COARSER_RATIO * signal_step:
            steps[block] = step
    return steps


def _signal_step(values: Array) -> float:
    """Quantisation step of the whole signal; 0 if continuous."""
    return max(recorded_step(values), _grid_step(values, 0.0))


def _grid_step(values: Array, rounding: float) -> float:
    """Step of the grid on which all values lie, apart from a finer rounding afterwards; 0 if there is no such grid."""
    differences = np.diff(np.unique(values))
    step = float(np.min(differences, initial=np.inf))
    if not rounding < step < np.inf:
        return 0.0
    # The smallest difference of rounded values is smaller than the step: their mean is not.
    step = float(np.mean(differences[differences < 1.5 * step]))
    # Differences of values in a damaged file may overflow: such values are on no grid.
    with np.errstate(over="ignore", invalid="ignore"):
        multiples = np.maximum(np.round(differences / step), 1.0)
        step = float(np.sum(differences) / np.sum(multiples))
        error = np.abs(differences - multiples * step)
    return step if np.all(error < MAX_GRID_ERROR * step + 1.001 * rounding) else 0.0


def _rolling_hashes(values: Array) -> NDArray[np.uint64]:
    """Hash of each row of `MIN_REPEATED` samples from their bits (a polynomial modulo 2⁶⁴)."""
    bits = np.ascontiguousarray(values, np.float64).view(np.uint64)
    bits = (bits ^ (bits >> np.uint64(29))) * np.uint64(0x9E3779B97F4A7C15)
    bits ^= bits >> np.uint64(32)
    hashes = np.zeros(len(bits), np.uint64)
    for k in range(MIN_REPEATED):
        shifted = np.zeros(len(bits), np.uint64)
        shifted[: len(bits) - k] = bits[k:]
        hashes = hashes * np.uint64(0x100000001B3) + shifted
    return hashes


def _blocks(count: int, length: int = BLOCK_SAMPLES) -> Iterator[slice]:
    """Slices of about equal length over so many samples."""
    edges = np.linspace(0, count, max(1, count // length) + 1).astype(int)
    for start, end in pairwise(edges):
        yield slice(int(start), int(end))


def _block_medians(values: Array) -> Array:
    """Median of each sample's block, (n,)."""
    medians = np.empty(len(values))
    for block in _blocks(len(values)):
        medians[block] = np.median(values[block])
    return medians

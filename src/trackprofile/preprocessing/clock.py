"""Repair of a logger's clock: time stamps that repeat, jump, are too coarse or missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import integral
from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REPAIR_PREFIX = "repaired: "
"""Prefix of the provenance steps that state what was wrong with a recording and how it was repaired."""

COARSE_SHARE = 0.2
"""Share of time stamps that repeat the one before from which the clock is coarser than the sampling interval."""

JUMP_RATIO = 5.0
"""Step of the clock over the median sampling interval from which it is a jump or a gap."""

MAX_DISTANCE_RATIO = 0.3
"""Largest ratio of the distance moved in a step to speed times step of the clock at which the clock has jumped."""


@dataclass(frozen=True)
class RepairedClock:
    """A clock that increases.

    Parameters
    ----------
    kept : (n,), rows that are kept
    time : (kept,), s
    jumped, repeated : (kept,), samples before which the clock jumped, or rows with the same time stamp were dropped
    notes : sentences about the repairs
    """

    kept: Mask
    time: Array
    jumped: Mask
    repeated: Mask
    notes: tuple[str, ...]


def repair_clock(
    time: Array, distance: Array | None = None, speed: Array | None = None
) -> RepairedClock:
    """Make a clock's time stamps increase.

    Missing time stamps are interpolated. Stamps that are coarser than the sampling interval are refined by distance and
    speed, or evenly. A row that repeats the time stamp of the one before is dropped. Where the clock is set back it
    continues at the median sampling interval. Where it jumps forward although distance and speed show that no time
    passed, the jump is removed; any other forward jump is a gap in the recording and remains.

    Parameters
    ----------
    time : (n,), s; NaN: missing
    distance, speed : (n,), m and m/s

    Raises
    ------
    DataError : fewer than two rows have a time stamp, or all stamps are equal.

    Examples
    --------
    >>> repaired = repair_clock(np.array([0.0, 0.1, 0.2, 0.2, 0.3, 7.4, 7.5, 1.0, 1.1]))
    >>> repaired.time.round(3)
    array([0. , 0.1, 0.2, 0.3, 7.4, 7.5, 7.6, 7.7])
    >>> repaired.notes
    ('1 row repeats the time stamp before it: dropped', 'the clock jumps once: jump removed')
    """
    time, notes = _interpolated_stamps(time)
    same = np.diff(time, prepend=-np.inf) == 0.0
    if np.mean(same) > COARSE_SHARE:
        changes = np.flatnonzero(~same)
        time, method = _refined_stamps(time, changes, _time_by_motion(distance, speed))
        notes.append(f"the clock is coarser than the sampling interval: refined {method}")
        same = np.zeros(len(time), bool)
    kept = ~same
    if same.any():
        count = np.count_nonzero(same)
        rows = "1 row repeats" if count == 1 else f"{count} rows repeat"
        notes.append(f"{rows} the time stamp before {'it' if count == 1 else 'them'}: dropped")
    repeated = np.zeros(len(time), bool)
    repeated[1:] = same[:-1]
    steps = np.diff(time[kept])
    interval = _median_interval(steps)
    jumps = steps <= 0.0
    if distance is not None and speed is not None:
        jumps |= _jumps_without_motion(steps, interval, distance[kept], speed[kept])
    repaired = time[kept]
    if jumps.any():
        count = np.count_nonzero(jumps)
        notes.append(
            f"the clock jumps {'once: jump' if count == 1 else f'{count} times: jumps'} removed"
        )
        even = np.where(jumps, interval, steps)
        repaired = float(repaired[0]) + np.concatenate([[0.0], np.cumsum(even)])
    jumped = np.concatenate([[False], jumps])
    return RepairedClock(kept, repaired, jumped, repeated[kept], tuple(notes))


def _interpolated_stamps(time: Array) -> tuple[Array, list[str]]:
    """Time stamps without missing ones, and notes."""
    known = np.isfinite(time)
    if np.count_nonzero(known) < 2:
        raise DataError(
            "The time column has fewer than two time stamps, expected one in most rows; choose another column."
        )
    if known.all():
        return time, []
    rows = np.arange(len(time))
    count = np.count_nonzero(~known)
    note = "1 time stamp is" if count == 1 else f"{count} time stamps are"
    return np.interp(rows, rows[known], time[known]), [f"{note} missing: interpolated"]


def _median_interval(steps: Array) -> float:
    """Median of the positive steps, s."""
    positive = steps[steps > 0]
    if not len(positive):
        raise DataError(_CONSTANT)
    return float(np.median(positive))


_CONSTANT = "The time never increases, expected increasing time stamps; choose another column."


def _refined_stamps(
    time: Array, changes: NDArray[np.intp], by_motion: Array | None
) -> tuple[Array, str]:
    """Refined coarse time stamps, and by what method.

    A line over the time by distance and speed, or over the row numbers for even sampling, if it deviates by less than
    the largest step of the clock; else linear interpolation between the rows at which the stamp changes.

    Parameters
    ----------
    changes : rows with a new time stamp
    by_motion : (n,), time that passed by distance and speed, s; None: not known
    """
    stamps = time[changes]
    if len(changes) < 2:
        raise DataError(_CONSTANT)
    rows = np.arange(len(time), dtype=np.float64)
    for base, method in ((by_motion, "by distance and speed"), (rows, "evenly")):
        if base is None:
            continue
        slope, intercept = np.polyfit(base, time, 1)
        line = slope * base + intercept
        if slope > 0 and np.max(np.abs(time - line)) < np.max(np.diff(stamps)):
            return line - line[0] + time[0], method
    interval = np.median(np.diff(stamps) / np.diff(changes))
    ends = np.append(changes, len(time))
    at_ends = np.append(stamps, stamps[-1] + interval * (len(time) - changes[-1]))
    return np.interp(rows, ends, at_ends), "evenly"


def _time_by_motion(distance: Array | None, speed: Array | None) -> Array | None:
    """Time that passed, ∫ ds/v, (n,) s; None if the train stops or the distance does not increase."""
    if distance is None or speed is None or np.any(speed <= 0.0):
        return None
    passed = integral(1.0 / speed, distance)
    return passed if np.all(np.diff(passed) > 0.0) else None


def _jumps_without_motion(steps: Array, interval: float, distance: Array, speed: Array) -> Mask:
    """Forward jumps of the clock in which the train moved much less than its speed requires."""
    mean = 0.5 * (speed[1:] + speed[:-1])
    moved = np.diff(distance)
    jump = (steps > JUMP_RATIO * interval) & (mean * steps > JUMP_RATIO * mean * interval)
    return jump & (mean > 0) & (np.abs(moved) < MAX_DISTANCE_RATIO * mean * steps)

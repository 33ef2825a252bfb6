"""A logger's clock, mended: stamps that repeat, jump, are too coarse or missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import integral
from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MENDED = "mended: "
"""Begins a step of a recording's provenance that says what was wrong and what was done about it."""

COARSE = 0.2
"""Share of stamps that are the same as the one before, from which the clock is coarser than the sampling."""

JUMP = 5.0
"""Usual intervals from which a step of the clock is a jump or a gap."""

MISMATCH = 0.3
"""Share by which a distance may differ from what speed and clock make of it, before the clock is to blame."""


@dataclass(frozen=True)
class Mended:
    """A clock that increases.

    Parameters
    ----------
    kept : (n,), rows that stay
    time : (kept,), s
    jumped, repeated : (kept,), before which sample the clock jumped, or rows stood twice
    notes : what was done, in sentences
    """

    kept: Mask
    time: Array
    jumped: Mask
    repeated: Mask
    notes: tuple[str, ...]


def repair_clock(time: Array, driven: Array | None = None, speed: Array | None = None) -> Mended:
    """A clock's stamps, (n,) in s, made to increase.

    Stamps that are missing lie evenly between those beside them, and stamps that are coarser than the sampling are
    spread as the train drove (``driven``, m, at that ``speed``, m/s), or evenly. A row that repeats the stamp of the
    one before is left out. Where the clock is set back it goes on at the usual interval; where it leaps ahead and the
    distance at that speed shows that no time passed, it is set back; else the rows between are missing, and stay so.

    Raises
    ------
    DataError : fewer than two rows have a stamp.

    Examples
    --------
    >>> mended = mend(np.array([0.0, 0.1, 0.2, 0.2, 0.3, 7.4, 7.5, 1.0, 1.1]))
    >>> mended.time.round(3), mended.notes
    (array([0. , 0.1, 0.2, 0.3, 7.4, 7.5, 7.6, 7.7]), ('1 row stands twice: left out', 'the clock jumps once: mended'))
    """
    known = np.isfinite(time)
    if np.count_nonzero(known) < 2:
        raise DataError("time: fewer than two rows have a time; choose another column.")
    rows, notes = np.arange(len(time)), []
    if not known.all():
        time = np.interp(rows, rows[known], time[known])
        notes.append(f"{np.count_nonzero(~known)} times are missing: taken from those beside")
    same = np.diff(time, prepend=-np.inf) == 0.0
    if np.mean(same) > COARSE:
        firsts = np.flatnonzero(~same)
        time, how = _spread(time, firsts, _passed(driven, speed))
        notes.append(f"the clock is coarser than the sampling: its stamps were spread {how}")
        same = np.zeros(len(time), bool)
    kept = ~same
    if same.any():
        count = np.count_nonzero(same)
        notes.append(f"{count} row{'s stand' if count > 1 else ' stands'} twice: left out")
    repeated = np.zeros(len(time), bool)
    repeated[1:] = same[:-1]
    steps = np.diff(time[kept])
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    if usual == 0.0:
        raise DataError("time: it never increases; choose another column.")
    wrong = steps <= 0.0
    if driven is not None and speed is not None:
        wrong |= _no_time_passed(steps, usual, driven[kept], speed[kept])
    even = np.where(wrong, usual, steps)
    if wrong.any():
        count = np.count_nonzero(wrong)
        notes.append(f"the clock jumps {'once' if count == 1 else f'{count} times'}: mended")
    first = float(time[kept][0])
    mended = first + np.concatenate([[0.0], np.cumsum(even)]) if wrong.any() else time[kept]
    return Mended(kept, mended, np.concatenate([[False], wrong]), repeated[kept], tuple(notes))


def _spread(time: Array, firsts: NDArray[np.intp], passed: Array | None) -> tuple[Array, str]:
    """Coarse stamps, finer, and how: on a line over the time that ``passed`` by distance and speed, or over the rows as
    of even sampling, if all lie within a step of it; else evenly from each to the next.
    """
    stamps = time[firsts]
    if len(firsts) < 2:
        raise DataError("time: it never increases; choose another column.")
    rows = np.arange(len(time), dtype=np.float64)
    for over, how in ((passed, "by distance and speed"), (rows, "evenly")):
        if over is None:
            continue
        slope, height = np.polyfit(over, time, 1)
        line = slope * over + height
        if slope > 0 and np.max(np.abs(time - line)) < np.max(np.diff(stamps)):
            return line - line[0] + time[0], how
    rate = np.median(np.diff(stamps) / np.diff(firsts))
    ends = np.append(firsts, len(time))
    beyond = np.append(stamps, stamps[-1] + rate * (len(time) - firsts[-1]))
    return np.interp(rows, ends, beyond), "evenly"


def _passed(driven: Array | None, speed: Array | None) -> Array | None:
    """The time that passed, (n,) s, by distance and speed; None where they do not tell or the train stood."""
    if driven is None or speed is None or np.any(speed <= 0.0):
        return None
    passed = integral(1.0 / speed, driven)
    return passed if np.all(np.diff(passed) > 0.0) else None


def _no_time_passed(steps: Array, usual: float, driven: Array, speed: Array) -> Mask:
    """Leaps of the clock over which the train moved no farther than in one usual interval."""
    mean = 0.5 * (speed[1:] + speed[:-1])
    moved = np.diff(driven)
    leap = (steps > JUMP * usual) & (mean * steps > JUMP * mean * usual) & (mean > 0)
    return leap & (np.abs(moved) < MISMATCH * mean * steps)

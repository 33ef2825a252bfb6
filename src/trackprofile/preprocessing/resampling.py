"""Channels of different rates and clocks on one time base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAME = 0.02
"""Share of the shortest interval within which two stamps are one."""


@dataclass(frozen=True)
class Series:
    """Values (n,) at times (n,), s."""

    time: Array
    values: Array


def resample_to_one_clock(
    sensors: Mapping[str, Series], motion: Mapping[str, Series]
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """All stamps of the sensors together, s; the sensors at them, NaN between their own; the motion, interpolated.

    A sensor is not interpolated: what it did not measure is not there. The base begins and ends where all motion is
    known.

    Raises
    ------
    DataError : the clocks have no time in common.

    Examples
    --------
    >>> fast = Series(np.array([0.0, 0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0, 4.0]))
    >>> slow = Series(np.array([0.0, 0.2]), np.array([5.0, 6.0]))
    >>> speed = Series(np.array([0.0, 0.3]), np.array([10.0, 13.0]))
    >>> on_one_base({"fast": fast, "slow": slow}, {"speed": speed})[1]["slow"]
    array([ 5., nan,  6., nan])
    """
    stamps = np.unique(np.concatenate([one.time for one in sensors.values()]))
    interval = min(float(np.median(np.diff(one.time))) for one in sensors.values())
    base = stamps[np.concatenate([[True], np.diff(stamps) > SAME * interval])]
    begin = max((one.time[0] for one in motion.values()), default=-np.inf)
    end = min((one.time[-1] for one in motion.values()), default=np.inf)
    base = base[(base >= begin - SAME * interval) & (base <= end + SAME * interval)]
    if len(base) < 2:
        raise DataError(
            f"The sensors ({stamps[0]:g} to {stamps[-1]:g} s) and what says how the train moved "
            f"({begin:g} to {end:g} s) have no time in common; check the clocks."
        )
    placed = {}
    for name, one in sensors.items():
        at = np.searchsorted(base, one.time - SAME * interval)
        here = (at < len(base)) & (
            np.abs(base[np.minimum(at, len(base) - 1)] - one.time) <= SAME * interval
        )
        placed[name] = np.full(len(base), np.nan)
        placed[name][at[here]] = one.values[here]
    moved = {name: np.interp(base, one.time, one.values) for name, one in motion.items()}
    return base, placed, moved

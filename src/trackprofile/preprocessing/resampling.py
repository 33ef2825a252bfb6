"""Channels with different sampling rates and clocks on one time base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAME_TIME_SHARE = 0.02
"""Difference of two time stamps, relative to the shortest sampling interval, below which they are the same."""


@dataclass(frozen=True)
class Series:
    """Values (n,) at times (n,), s."""

    time: Array
    values: Array


def resample_to_one_clock(
    sensors: Mapping[str, Series], motion: Mapping[str, Series]
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """Put sensors and motion on the union of the sensors' time stamps.

    Sensors are not interpolated: between their own samples they are NaN. The motion is interpolated; the time base is
    cut to the times at which all motion is known.

    Parameters
    ----------
    sensors, motion : series by name

    Returns
    -------
    time : (n,), s
    sensors : (n,) by name, NaN between samples
    motion : (n,) by name

    Raises
    ------
    DataError : the clocks have no time in common.

    Examples
    --------
    >>> fast = Series(np.array([0.0, 0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0, 4.0]))
    >>> slow = Series(np.array([0.0, 0.2]), np.array([5.0, 6.0]))
    >>> speed = Series(np.array([0.0, 0.3]), np.array([10.0, 13.0]))
    >>> resample_to_one_clock({"fast": fast, "slow": slow}, {"speed": speed})[1]["slow"]
    array([ 5., nan,  6., nan])
    """
    stamps = np.unique(np.concatenate([one.time for one in sensors.values()]))
    interval = min(float(np.median(np.diff(one.time))) for one in sensors.values())
    tolerance = SAME_TIME_SHARE * interval
    base = stamps[np.concatenate([[True], np.diff(stamps) > tolerance])]
    start = max((one.time[0] for one in motion.values()), default=-np.inf)
    end = min((one.time[-1] for one in motion.values()), default=np.inf)
    base = base[(base >= start - tolerance) & (base <= end + tolerance)]
    if len(base) < 2:
        raise DataError(
            f"The sensors' clock runs from {stamps[0]:g} to {stamps[-1]:g} s and that of the motion from {start:g} to "
            f"{end:g} s, expected a common time; check the clocks."
        )
    sampled = {name: _sampled_at(base, one, tolerance) for name, one in sensors.items()}
    moved = {name: np.interp(base, one.time, one.values) for name, one in motion.items()}
    return base, sampled, moved


def _sampled_at(base: Array, series: Series, tolerance: float) -> Array:
    """Values of a series at the times of the base, NaN where it has none."""
    at = np.searchsorted(base, series.time - tolerance)
    near = np.abs(base[np.minimum(at, len(base) - 1)] - series.time) <= tolerance
    matched = (at < len(base)) & near
    values = np.full(len(base), np.nan)
    values[at[matched]] = series.values[matched]
    return values

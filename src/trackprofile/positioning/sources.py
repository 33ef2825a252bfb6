"""Position sources of a recording: GNSS fixes, wheel odometry, kilometre posts and displayed speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]

POSITION_PREFIX = "positions: "
"""Prefix of the provenance steps that state how the position of the train was estimated."""

WHEEL_SCALE_STD = 0.03
"""Default standard deviation of the logarithm of a wheel's true over its nominal diameter: wheels wear by 8 %."""

COUNTER_RANGES = (2.0**8, 2.0**16, 2.0**24, 2.0**32, 1e4, 1e5, 1e6)
"""Numbers of values after which a counter starts again at 0."""

MIN_WRAP_SHARE = 0.9
"""Smallest share of its range that a counter which wraps must have reached."""

MIN_RESET_SHARE = 0.5
"""Smallest share of its value by which a counter falls in a reset; a smaller fall is a wheel that rolled back."""


@dataclass(frozen=True)
class GnssFixes:
    """GNSS fixes at n times.

    Parameters
    ----------
    time : (n,), s
    latitude, longitude : (n,), °, WGS 84; NaN without a fix
    speed : (n,), m/s, Doppler speed; None if not recorded
    std : standard deviation of a fix along the line about the bias of the receiver, m; None: estimated
    bias_std : standard deviation of the bias, an error that lasts for minutes, m; None: estimated
    delay : time by which a fix is recorded too late, s
    antenna_offset : distance of the antenna behind the leading wheel, m
    """

    time: Array
    latitude: Array
    longitude: Array
    speed: Array | None = None
    std: float | None = None
    bias_std: float | None = None
    delay: float = 0.0
    antenna_offset: float = 0.0


@dataclass(frozen=True)
class WheelOdometry:
    """Distance that a wheel rolled, computed with its nominal diameter.

    Parameters
    ----------
    time, distance : (n,), s and m, from any origin
    step : distance between two pulses, m
    scale_std : standard deviation of the logarithm of the true over the nominal diameter
    """

    time: Array
    distance: Array
    step: float
    scale_std: float


@dataclass(frozen=True)
class KilometrePosts:
    """Passages of kilometre posts.

    Parameters
    ----------
    time, kilometre : (n,), s and km
    std : standard deviation of a post's location, m
    time_std : standard deviation of the time of a passage, s
    detector_offset : distance of the detector of the posts behind the leading wheel, m
    """

    time: Array
    kilometre: Array
    std: float
    time_std: float
    detector_offset: float = 0.0


@dataclass(frozen=True)
class DisplayedSpeed:
    """Speed that the train displays, measured at a wheel.

    Parameters
    ----------
    time, speed : (n,), s and m/s
    step : quantisation step of the record, m/s; 0: continuous
    scale_std : standard deviation of the logarithm of the true over the nominal wheel diameter
    """

    time: Array
    speed: Array
    step: float
    scale_std: float


@dataclass(frozen=True)
class Sources:
    """Position sources of a recording and the chainage table of the line; None where there is none."""

    gnss: GnssFixes | None = None
    odometry: WheelOdometry | None = None
    posts: KilometrePosts | None = None
    displayed_speed: DisplayedSpeed | None = None
    chainage: ChainageTable | None = None


def unwrap_counter(counter: Array) -> tuple[Array, int]:
    """Total count of a counter that wraps at the end of its range or is reset.

    A fall from near the end of a range is a wrap. Another fall by most of the value is a reset; the counts during a
    reset are lost. Missing values stay missing.

    Parameters
    ----------
    counter : (n,), values of the counter, upwards or downwards; NaN: missing

    Returns
    -------
    total : (n,), counts since the first value
    resets : number of resets

    Raises
    ------
    DataError : fewer than two values are known.

    Examples
    --------
    >>> unwrap_counter(np.array([65530.0, 65534.0, 2.0, 6.0]))
    (array([ 0.,  4.,  8., 12.]), 0)
    >>> unwrap_counter(np.array([100.0, 104.0, 0.0, 3.0]))
    (array([0., 4., 4., 7.]), 1)
    """
    known = np.isfinite(counter)
    values = counter[known]
    if len(values) < 2:
        raise DataError(
            "The odometer has fewer than two known values, expected a count in most rows; choose another column."
        )
    steps = np.diff(values)
    if np.any(steps != 0) and np.median(steps[steps != 0]) < 0:
        steps = -steps  # the counter counts downwards
    falls = steps < 0
    resets = 0
    if falls.any():
        largest = float(np.max(values))
        size = next((one for one in COUNTER_RANGES if MIN_WRAP_SHARE * one <= largest < one), 0.0)
        wraps = falls & (np.abs(steps) > 0.5 * size) & (size > 0.0)
        reset = np.abs(steps) > MIN_RESET_SHARE * np.maximum(values[:-1], values[1:])
        reset &= falls & ~wraps
        steps = np.where(wraps, steps + size, np.where(reset, 0.0, steps))
        resets = int(np.count_nonzero(reset))
    total = np.full(len(counter), np.nan)
    total[known] = np.concatenate([[0.0], np.cumsum(steps)])
    return total, resets

"""What a train records of where it was: satellite positions, pulses of a wheel, kilometre posts, a speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLACED = "placed: "
"""Begins a step of a recording's provenance that says where the train was, and how that was found."""

NOMINAL = 0.03
"""Standard deviation of the logarithm of a wheel's true diameter over its nominal one: they wear by 8 %."""

WRAPS = (2.0**8, 2.0**16, 2.0**24, 2.0**32, 1e4, 1e5, 1e6)
"""Where counters begin again."""

FULL = 0.9
"""Share of that, which one that begins again has to come to."""

RESET = 0.5
"""Share of its reading, below which one that falls otherwise was reset; above, the wheel rolled back."""


@dataclass(frozen=True)
class GnssFixes:
    """Satellite positions.

    Parameters
    ----------
    time : (n,), s
    latitude, longitude : (n,), °, WGS 84; NaN where there was no fix
    speed : (n,), m/s, by Doppler; None where it is not recorded
    deviation : standard deviation of a fix along the line about the error that fixes have in common, m; None: found
        from the data
    wander : standard deviation of that error, which stays for minutes, m; None: found from the data
    delay : s by which a fix is recorded late
    behind : m by which the antenna stands behind the leading wheel
    """

    time: Array
    latitude: Array
    longitude: Array
    speed: Array | None = None
    deviation: float | None = None
    wander: float | None = None
    delay: float = 0.0
    behind: float = 0.0


@dataclass(frozen=True)
class WheelOdometry:
    """How far a wheel rolled, by its nominal diameter.

    Parameters
    ----------
    time, distance : (n,), s and m, from any beginning
    step : m between two pulses
    deviation : of the logarithm of the true diameter over the nominal one
    """

    time: Array
    distance: Array
    step: float
    deviation: float


@dataclass(frozen=True)
class KilometrePosts:
    """Kilometre posts passed.

    Parameters
    ----------
    time, kilometre : (n,), s and km
    deviation : m by which a post stands elsewhere than it says
    timing : s by which its passing is marked early or late
    behind : m by which what passes it stands behind the leading wheel
    """

    time: Array
    kilometre: Array
    deviation: float
    timing: float
    behind: float = 0.0


@dataclass(frozen=True)
class DisplayedSpeed:
    """A speed that the train shows, by a wheel: (n,), s and m/s; ``step`` in which it is recorded, m/s."""

    time: Array
    speed: Array
    step: float
    deviation: float


@dataclass(frozen=True)
class Sources:
    """All that is known of where a train was, and the way that it took."""

    fixes: GnssFixes | None = None
    rolled: WheelOdometry | None = None
    posts: KilometrePosts | None = None
    shown: DisplayedSpeed | None = None
    way: ChainageTable | None = None


def unwrapped(counter: Array) -> tuple[Array, int]:
    """A counter's readings, (n,), as if it had never begun again, from 0; and how often it was reset.

    Where it falls from near the end of a range it wrapped; where it falls otherwise it was reset, and what it counted
    in between is lost. Missing readings stay as they are.

    Examples
    --------
    >>> unwrapped(np.array([65530.0, 65534.0, 2.0, 6.0]))
    (array([ 0.,  4.,  8., 12.]), 0)
    >>> unwrapped(np.array([100.0, 104.0, 0.0, 3.0]))
    (array([0., 4., 4., 7.]), 1)
    """
    known = np.isfinite(counter)
    readings = counter[known]
    if len(readings) < 2:
        raise DataError("the odometer: fewer than two readings are known; choose another column.")
    steps = np.diff(readings)
    if np.any(steps != 0) and np.median(steps[steps != 0]) < 0:
        steps = -steps  # it counts down
    falls = steps < 0
    resets = 0
    if falls.any():
        most = float(np.max(readings))
        range_ = next((one for one in WRAPS if FULL * one <= most < one), 0.0)
        wrapped = falls & (np.abs(steps) > 0.5 * range_) & (range_ > 0.0)
        lost = falls & ~wrapped & (np.abs(steps) > RESET * np.maximum(readings[:-1], readings[1:]))
        steps = np.where(wrapped, steps + range_, np.where(lost, 0.0, steps))
        resets = int(np.count_nonzero(lost))
    found = np.full(len(counter), np.nan)
    found[known] = np.concatenate([[0.0], np.cumsum(steps)])
    return found, resets

"""From what was recorded to readings that a smoother takes, each with its own noise; and when a train stood."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from trackprofile.arrays import runs
from trackprofile.positioning.sources import (
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    WheelOdometry,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
StandstillInterval = tuple[float, float]

CELL = 0.25
"""s: of anything that is recorded more often, what comes later says the same again."""

PULSE = 0.005
"""m by which a pulse comes early or late."""

SHOWS = 0.05
"""m/s by which a speed that is shown is off, beside its steps."""

DOPPLER = 0.1
"""m/s: usual standard deviation of a speed by Doppler."""

FIX = 3.0
"""m: usual standard deviation of a satellite position along a line, beside the errors that stay for minutes."""

CREEP = 0.3
"""m/s, below which a train is not told from one that stands."""

STILL = 3.0
"""s that a train stands at least."""

PASSED = 50.0
"""m between two fixes, beyond any of their errors, from which a train ran whatever its wheel says."""


class Source(StrEnum):
    """What can say where a train is or how fast it goes."""

    FIX = "satellite positions"
    FIX_SPEED = "satellite speed"
    ROLLED = "odometer"
    SHOWN = "speed"
    POST = "kilometre posts"
    STANDING = "standing"


@dataclass(frozen=True)
class PositionObservations:
    """What one source said: (n,) each.

    Parameters
    ----------
    time : s, rising
    value : m or m/s; of a wheel by its nominal diameter
    variance : of its noise
    stated : whether that is known; else the data say how much of it there is
    """

    source: Source
    time: Array
    value: Array
    variance: Array
    stated: bool = True


def odometry_observations(rolled: WheelOdometry) -> PositionObservations:
    """One reading in each cell: at the last pulse in it, else at its end.

    A pulse between two samples tells the place to what rolled meanwhile; without one it is told to a pulse.
    """
    time, counted, step = rolled.time, rolled.distance, rolled.step
    fresh = np.diff(counted, prepend=counted[:1]) > 0
    cell = np.floor((time - time[0]) / CELL).astype(np.int64)
    index = np.arange(len(time))
    last = np.flatnonzero(np.diff(cell, append=cell[-1] + 1))
    first = np.concatenate([[0], last[:-1] + 1])
    latest = np.maximum.accumulate(np.where(fresh, index, -1))[last]
    pulsed = latest >= first
    at = np.where(pulsed, latest, last)
    speed = np.gradient(counted[at], time[at]) if len(at) > 1 else np.zeros(len(at))
    interval = np.diff(time, prepend=2 * time[0] - time[min(1, len(time) - 1)])
    since = np.minimum(step, np.abs(speed) * interval[at])
    width = np.where(pulsed, since, step)
    value = counted[at] + 0.5 * width
    return PositionObservations(Source.ROLLED, time[at], value, width**2 / 12.0 + PULSE**2)


def displayed_speed_observations(shown: DisplayedSpeed) -> PositionObservations:
    """Means over a cell; what stays in one step says so once.

    A display shows zero where it cannot tell, below some walking speed.
    """
    at, speed = _cell_means(shown.time, shown.speed, 1.0)
    value = np.round(speed / shown.step) if shown.step > 0 else np.arange(float(len(speed)))
    starts = np.concatenate([[True], np.diff(value) != 0])
    count = np.bincount(np.cumsum(starts) - 1)[np.cumsum(starts) - 1]
    noise = shown.step**2 / 12.0 + SHOWS**2 + np.where(speed == 0.0, CREEP**2, 0.0)
    return PositionObservations(Source.SHOWN, at, speed, noise * count)


def gnss_speed_observations(fixes: GnssFixes) -> PositionObservations:
    """The speed by Doppler, where there is one."""
    assert fixes.speed is not None
    known = np.isfinite(fixes.speed)
    fresh = known & (np.diff(np.where(known, fixes.speed, -1.0), prepend=-1.0) != 0)
    kept = _thinned(fixes.time, fresh)
    value = fixes.speed[kept]
    return PositionObservations(
        Source.FIX_SPEED,
        fixes.time[kept] - fixes.delay,
        value,
        np.full(len(value), DOPPLER**2),
        stated=False,
    )


def gnss_observations(
    fixes: GnssFixes, kept: NDArray[np.intp], along: Array
) -> PositionObservations:
    """Fixes that were brought to a line, at ``along`` m."""
    deviation = FIX if fixes.deviation is None else fixes.deviation
    return PositionObservations(
        Source.FIX,
        fixes.time[kept] - fixes.delay,
        along + fixes.behind,
        np.full(len(along), deviation**2),
        stated=fixes.deviation is not None,
    )


def post_observations(posts: KilometrePosts, distance: Array, speed: Array) -> PositionObservations:
    """Posts that stand at ``distance`` m, passed at ``speed`` m/s."""
    variance = posts.deviation**2 + (speed * posts.timing) ** 2
    return PositionObservations(Source.POST, posts.time, distance + posts.behind, variance)


def fresh_fixes(fixes: GnssFixes) -> NDArray[np.intp]:
    """Fixes that are there, and are not the one before written again."""
    there = np.isfinite(fixes.latitude) & np.isfinite(fixes.longitude)
    # Receivers without a fix say the Gulf of Guinea.
    there &= (fixes.latitude != 0.0) | (fixes.longitude != 0.0)
    at = np.flatnonzero(there)
    again = np.zeros(len(fixes.time), bool)
    again[at[1:]] = (np.diff(fixes.latitude[at]) == 0) & (np.diff(fixes.longitude[at]) == 0)
    return _thinned(fixes.time, there & ~again)


def odometry_standstills(rolled: WheelOdometry) -> list[StandstillInterval]:
    """From when to when no pulse came for longer than a creeping train would leave between some of them, s."""
    counted = np.diff(rolled.distance) > 0
    at = rolled.time[np.concatenate([[0], 1 + np.flatnonzero(counted), [len(rolled.time) - 1]])]
    least = max(STILL, 3 * rolled.step / CREEP)
    # The last pulse before a stop, and the first after, are some time off from it.
    rest = np.sqrt(2 * rolled.step / CREEP)
    return [(float(a + rest), float(b - rest)) for a, b in pairwise(at) if b - a > least + 2 * rest]


def speed_standstills(time: Array, speed: Array) -> list[StandstillInterval]:
    """From when to when a speed, (n,), was none but for noise, s."""
    at, mean = _cell_means(time, speed, 1.0)
    slow = median_filter(mean, 5, mode="nearest") < CREEP
    found = [(float(at[run.start]), float(at[run.stop - 1])) for run in runs(slow)]
    return [(a + 0.5, b - 0.5) for a, b in found if b - a > STILL + 1.0]


def ran(stand: StandstillInterval, fixes: PositionObservations | None) -> bool:
    """Whether fixes show that a train ran while its wheel said that it stood."""
    if fixes is None:
        return False
    inside = (fixes.time >= stand[0]) & (fixes.time <= stand[1])
    values = fixes.value[inside]
    if len(values) < 6:
        return False
    third = len(values) // 3
    return bool(abs(np.median(values[-third:]) - np.median(values[:third])) > PASSED)


def _thinned(time: Array, there: Mask) -> NDArray[np.intp]:
    """Those that are there, the first in each cell."""
    at = np.flatnonzero(there)
    if not len(at):
        return at
    cell = np.floor((time[at] - time[at[0]]) / CELL + 1e-6)
    return at[np.concatenate([[True], np.diff(cell) > 0])]


def _cell_means(time: Array, values: Array, cell: float) -> tuple[Array, Array]:
    known = np.isfinite(values)
    number = np.floor((time[known] - time[0]) / cell).astype(np.int64)
    count = np.bincount(number)
    there = count > 0
    mean_time, mean = (
        np.bincount(number, one)[there] / count[there] for one in (time[known], values[known])
    )
    return mean_time, mean

"""Observations of position and speed with their noise, from each source; intervals of standstill."""

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
"""First and last time of a standstill, s."""

CELL = 0.25
"""s; of a source that is recorded more often, one value per cell of this duration is used."""

PULSE_STD = 0.005
"""m, standard deviation of the location of a pulse."""

DISPLAY_STD = 0.05
"""m/s, standard deviation of a displayed speed besides its quantisation."""

GNSS_SPEED_STD = 0.1
"""m/s, initial standard deviation of a Doppler speed."""

GNSS_POSITION_STD = 3.0
"""m, initial standard deviation of a GNSS fix along the line about the bias of the receiver."""

CREEP_SPEED = 0.3
"""m/s, speed below which a moving train is not distinguished from one at standstill."""

MIN_STANDSTILL = 3.0
"""s, shortest standstill."""

MIN_MOVEMENT = 50.0
"""m between GNSS fixes, beyond any of their errors, that proves a movement against the odometer."""

MIN_FIXES = 6
"""Number of GNSS fixes that prove a movement."""


class Source(StrEnum):
    """Kind of an observation of position or speed."""

    GNSS_POSITION = "GNSS fixes"
    GNSS_SPEED = "GNSS speed"
    ODOMETRY = "odometer"
    DISPLAYED_SPEED = "displayed speed"
    POST = "kilometre posts"
    STANDSTILL = "standstill"


@dataclass(frozen=True)
class PositionObservations:
    """Observations of one source.

    Parameters
    ----------
    source : what measured them
    time : (n,), s, increasing
    value : (n,), m or m/s; of a wheel with its nominal diameter
    variance : (n,), noise variance, m² or m²/s²
    stated : whether the variance is known; else it is a first value and the data determine it
    """

    source: Source
    time: Array
    value: Array
    variance: Array
    stated: bool = True


def odometry_observations(odometry: WheelOdometry) -> PositionObservations:
    """One observation per cell of 0.25 s: at its last pulse, or at its end if it has none.

    A pulse lies somewhere between the sample that counts it and the one before; without a pulse the distance is
    somewhere within one pulse. Both are uniform errors, of variance width²/12.
    """
    time, distance, step = odometry.time, odometry.distance, odometry.step
    counts = np.diff(distance, prepend=distance[:1]) > 0
    cell = np.floor((time - time[0]) / CELL).astype(np.int64)
    index = np.arange(len(time))
    last = np.flatnonzero(np.diff(cell, append=cell[-1] + 1))
    first = np.concatenate([[0], last[:-1] + 1])
    latest = np.maximum.accumulate(np.where(counts, index, -1))[last]
    has_pulse = latest >= first
    at = np.where(has_pulse, latest, last)
    speed = np.gradient(distance[at], time[at]) if len(at) > 1 else np.zeros(len(at))
    interval = np.diff(time, prepend=2 * time[0] - time[min(1, len(time) - 1)])
    since_sample = np.minimum(step, np.abs(speed) * interval[at])
    width = np.where(has_pulse, since_sample, step)
    value = distance[at] + 0.5 * width
    return PositionObservations(Source.ODOMETRY, time[at], value, width**2 / 12.0 + PULSE_STD**2)


def displayed_speed_observations(displayed: DisplayedSpeed) -> PositionObservations:
    """Mean speed of each second; n means in one quantisation step have n times the variance, as they are one value.

    A displayed zero may be any speed up to `CREEP_SPEED`: wheel sensors do not measure slow rotation.
    """
    time, speed = _cell_means(displayed.time, displayed.speed, 1.0)
    level = np.round(speed / displayed.step) if displayed.step > 0 else np.arange(float(len(speed)))
    starts = np.concatenate([[True], np.diff(level) != 0])
    count = np.bincount(np.cumsum(starts) - 1)[np.cumsum(starts) - 1]
    zero = np.where(speed == 0.0, CREEP_SPEED**2, 0.0)
    noise = displayed.step**2 / 12.0 + DISPLAY_STD**2 + zero
    return PositionObservations(Source.DISPLAYED_SPEED, time, speed, noise * count)


def gnss_speed_observations(fixes: GnssFixes) -> PositionObservations:
    """Doppler speeds, without repeated ones."""
    assert fixes.speed is not None
    known = np.isfinite(fixes.speed)
    new = known & (np.diff(np.where(known, fixes.speed, -1.0), prepend=-1.0) != 0)
    rows = _first_of_each_cell(fixes.time, new)
    value = fixes.speed[rows]
    return PositionObservations(
        Source.GNSS_SPEED,
        fixes.time[rows] - fixes.delay,
        value,
        np.full(len(value), GNSS_SPEED_STD**2),
        stated=False,
    )


def gnss_observations(
    fixes: GnssFixes, rows: NDArray[np.intp], distance: Array
) -> PositionObservations:
    """GNSS fixes matched to a line.

    Parameters
    ----------
    rows : (n,), numbers of the fixes
    distance : (n,), their distance along the line, m
    """
    std = GNSS_POSITION_STD if fixes.std is None else fixes.std
    return PositionObservations(
        Source.GNSS_POSITION,
        fixes.time[rows] - fixes.delay,
        distance + fixes.antenna_offset,
        np.full(len(distance), std**2),
        stated=fixes.std is not None,
    )


def post_observations(posts: KilometrePosts, distance: Array, speed: Array) -> PositionObservations:
    """Kilometre posts at distances, (n,) m, passed at speeds, (n,) m/s."""
    variance = posts.std**2 + (speed * posts.time_std) ** 2
    return PositionObservations(Source.POST, posts.time, distance + posts.detector_offset, variance)


def valid_fixes(fixes: GnssFixes) -> NDArray[np.intp]:
    """Numbers of the fixes that exist and do not repeat the one before, at most one per cell of 0.25 s."""
    valid = np.isfinite(fixes.latitude) & np.isfinite(fixes.longitude)
    # Receivers without a fix report 0° N 0° E.
    valid &= (fixes.latitude != 0.0) | (fixes.longitude != 0.0)
    at = np.flatnonzero(valid)
    repeated = np.zeros(len(fixes.time), bool)
    repeated[at[1:]] = (np.diff(fixes.latitude[at]) == 0) & (np.diff(fixes.longitude[at]) == 0)
    return _first_of_each_cell(fixes.time, valid & ~repeated)


def odometry_standstills(odometry: WheelOdometry) -> list[StandstillInterval]:
    """Intervals without a pulse that are longer than those of a train at `CREEP_SPEED`."""
    counts = np.diff(odometry.distance) > 0
    rows = np.concatenate([[0], 1 + np.flatnonzero(counts), [len(odometry.time) - 1]])
    shortest = max(MIN_STANDSTILL, 3 * odometry.step / CREEP_SPEED)
    # The last pulse before a standstill and the first one after it are this far from it in time.
    margin = np.sqrt(2 * odometry.step / CREEP_SPEED)
    return [
        (float(a + margin), float(b - margin))
        for a, b in pairwise(odometry.time[rows])
        if b - a > shortest + 2 * margin
    ]


def speed_standstills(time: Array, speed: Array) -> list[StandstillInterval]:
    """Intervals in which a speed, (n,) m/s, does not exceed its noise."""
    at, mean = _cell_means(time, speed, 1.0)
    slow = median_filter(mean, 5, mode="nearest") < CREEP_SPEED
    intervals = [(float(at[run.start]), float(at[run.stop - 1])) for run in runs(slow)]
    return [(a + 0.5, b - 0.5) for a, b in intervals if b - a > MIN_STANDSTILL + 1.0]


def moved_by_gnss(interval: StandstillInterval, fixes: PositionObservations | None) -> bool:
    """Whether GNSS fixes prove that the train moved in an interval in which its wheel stood still."""
    if fixes is None:
        return False
    inside = (fixes.time >= interval[0]) & (fixes.time <= interval[1])
    values = fixes.value[inside]
    if len(values) < MIN_FIXES:
        return False
    third = len(values) // 3
    return bool(abs(np.median(values[-third:]) - np.median(values[:third])) > MIN_MOVEMENT)


def _first_of_each_cell(time: Array, valid: Mask) -> NDArray[np.intp]:
    """Numbers of the first valid row in each cell."""
    at = np.flatnonzero(valid)
    if not len(at):
        return at
    cell = np.floor((time[at] - time[at[0]]) / CELL + 1e-6)
    return at[np.concatenate([[True], np.diff(cell) > 0])]


def _cell_means(time: Array, values: Array, cell: float) -> tuple[Array, Array]:
    """Means of times and of known values in each cell, s, that holds any."""
    known = np.isfinite(values)
    number = np.floor((time[known] - time[0]) / cell).astype(np.int64)
    count = np.bincount(number)
    filled = count > 0
    mean_time, mean = (
        np.bincount(number, one)[filled] / count[filled] for one in (time[known], values[known])
    )
    return mean_time, mean

"""Motion of the train at each sample: time, distance, speed and acceleration.

Speeds are often recorded in steps, in whole km/h for example. Between two changes such a record says little: its error
is constant. At a change the speed is known well: it lies halfway between both steps. The speed is estimated from the
changes by a penalised least-squares spline, whose penalty is a random walk of the acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import pchip_interpolate
from scipy.linalg import solveh_banded

from trackprofile.arrays import integral, recorded_step
from trackprofile.errors import DataError
from trackprofile.models.kinematics import Motion

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ACCELERATION_WALK = 0.1
"""m/s² per √s, strength of the random walk of a train's acceleration (a jerk of 0.1 to 0.5 m/s³ for some seconds)."""

FILL_MEAN_LENGTH = 0.5
"""s or m, length over which known speeds are averaged before missing ones are interpolated."""

ERROR_CORRELATION_TIME = 10.0
"""s, longest time over which the readings of one quantisation step have the same error."""

CHANGE_STD = 0.2
"""Standard deviation of the speed at a change of the record, in quantisation steps."""

MAX_OUTSIDE_SHARE = 0.05
"""Largest share of smoothed readings outside their quantisation step; more means that readings were noisy before
quantisation."""

OUTSIDE = 0.55
"""Deviation, in quantisation steps, from which a smoothed reading lies outside its step."""

MIN_CHANGES = 12
"""Smallest number of intervals between changes from which the update interval is estimated."""


@dataclass(frozen=True)
class _QuantisedRecord:
    """A record in quantisation steps.

    Parameters
    ----------
    values, step : (n,), recorded values and their quantisation step
    at : (n,), positions of the readings, s or m
    interval : (n,), sampling interval of each reading, s
    updates : (m,), numbers of the readings at which the record was updated
    walk : (n - 2,), variance of the change of slope at the inner readings
    """

    values: Array
    step: Array
    at: Array
    interval: Array
    updates: Indices
    walk: Array


def motion(recording: xr.Dataset) -> Motion:
    """Motion of the train from two or three of time, distance and speed.

    A speed that was recorded in steps is smoothed first.

    Raises
    ------
    DataError : the recording has only one of time, distance and speed.
    """
    time, distance, speed = (_variable(recording, name) for name in ("time", "distance", "speed"))
    if time is not None and speed is not None:
        speed = smoothed_speed_over_time(speed, time)
        if distance is None:
            distance = integral(speed, time)
    elif distance is not None and speed is not None:
        speed = smoothed_speed_over_distance(speed, distance)
        time = integral(1.0 / speed, distance)
    elif time is not None and distance is not None:
        speed = np.clip(np.gradient(distance, time), 0.0, None)
    else:
        raise DataError(
            "The recording has only one of time, distance and speed, expected two of them; add a second one."
        )
    return Motion(time, distance, speed, np.gradient(speed, time))


def smoothed_speed_over_time(speed: Array, time: Array) -> Array:
    """Speed without its quantisation; unchanged if it was not recorded in steps.

    Parameters
    ----------
    speed, time : (n,), m/s and s
    """
    step = recorded_step(speed)
    if step == 0.0:
        return speed
    return np.clip(_dequantised(_speed_record(speed, time, step)), 0.0, None)


def smoothed_speed_over_distance(speed: Array, distance: Array) -> Array:
    """Speed without its quantisation; unchanged if it was not recorded in steps.

    The kinetic energy per mass, v²/2, is smoothed: its slope over the distance is the acceleration.

    Parameters
    ----------
    speed, distance : (n,), m/s and m
    """
    step = recorded_step(speed)
    if step == 0.0:
        return speed
    # A recorded 0 while the distance increases is a speed between 0 and half a step.
    speed = np.maximum(speed, 0.25 * step)
    energy, interval = 0.5 * speed**2, np.gradient(distance) / speed
    record = _QuantisedRecord(
        energy,
        step * speed,
        distance,
        interval,
        _updates(energy, interval),
        _slope_change_variance(distance) / speed[1:-1],
    )
    lowest = 0.5 * (0.25 * step) ** 2
    return np.sqrt(2.0 * np.maximum(_dequantised(record), lowest))


def dead_reckoning_std(speed: Array, time: Array) -> Array | None:
    """Standard deviation of the distance that is integrated from a quantised speed; None for a continuous speed.

    Between two changes of the record, a time T apart, the error of the mean speed is the smaller of the quantisation
    error step/√12 and of √(W² T³/120), that of a random walk of the acceleration whose speed is known at both ends.

    Parameters
    ----------
    speed, time : (n,), m/s and s

    Returns
    -------
    (n,), m

    Examples
    --------
    >>> time = np.arange(0.0, 60.0, 0.1)
    >>> dead_reckoning_std(np.round(10.0 + 0.2 * time), time)[[0, 300, 599]].round(2)
    array([0. , 1.2, 1.7])
    """
    step = recorded_step(speed)
    if step == 0.0:
        return None
    record = _speed_record(speed, time, step)
    interval = record.interval
    if _smoothed_if_independent(record) is not None:
        return np.sqrt(np.cumsum(np.square(interval * (speed > 0.0))) * step**2 / 12.0)
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(speed))])
    edges = np.append(time[starts], time[-1])
    durations = np.diff(edges)
    # The record changes up to one update interval after the speed.
    late = step * (time[-1] - time[0]) / len(record.updates)
    late = late / np.maximum(durations, interval[starts])
    walk_std = np.hypot(ACCELERATION_WALK * np.sqrt(durations**3 / 120.0), late / np.sqrt(12.0))
    mean_std = np.where(speed[starts] > 0.0, np.minimum(step / np.sqrt(12.0), walk_std), 0.0)
    variance = np.concatenate([[0.0], np.cumsum(np.square(mean_std * durations))])
    return np.sqrt(np.interp(time, edges, variance))


def fill_speed(speed: Array, at: Array) -> Array:
    """Fill missing speeds by monotone cubic interpolation between means of the known ones.

    Before the first and after the last mean the value is constant, so that the result is negative nowhere if the known
    speeds are not.

    Parameters
    ----------
    speed : (n,), m/s; NaN: missing
    at : (n,), time, s, or distance, m

    Raises
    ------
    DataError : fewer than two values are known.

    Examples
    --------
    >>> fill_speed(np.array([10.0, 11.0, np.nan, 13.0]), np.arange(4.0)).round(3)
    array([10., 11., 12., 13.])
    """
    known = np.isfinite(speed)
    if np.count_nonzero(known) < 2:
        raise DataError(
            "The speed has fewer than two known values, expected one in most rows; choose another column."
        )
    if known.all():
        return speed
    first, last = at[known][[0, -1]]
    share = (np.clip(at, first, last) - first) / (last - first)
    count = min((last - first) / FILL_MEAN_LENGTH, np.count_nonzero(known))
    position, value = _means(share[known], speed[known], max(2, int(count)))
    inside = np.clip(share, position[0], position[-1])
    return np.where(known, speed, pchip_interpolate(position, value, inside))


def _speed_record(speed: Array, time: Array, step: float) -> _QuantisedRecord:
    interval = np.gradient(time)
    return _QuantisedRecord(
        speed,
        np.full(len(speed), step),
        time,
        interval,
        _updates(speed, interval),
        _slope_change_variance(time),
    )


def _means(position: Array, values: Array, count: int) -> tuple[Array, Array]:
    """Mean positions, 0 to 1, and values of equal parts of that range, without empty parts."""
    part = np.minimum((position * count).astype(np.int64), count - 1)
    number = np.bincount(part, minlength=count)
    filled = number > 0
    mean_position, mean = (
        np.bincount(part, each, minlength=count)[filled] / number[filled]
        for each in (position, values)
    )
    return mean_position, mean


def _dequantised(record: _QuantisedRecord) -> Array:
    """Smoothed values, (n,), of a record, by the changes from one step to the next."""
    independent = _smoothed_if_independent(record)
    if independent is not None:
        return independent
    estimate, noise = record.values.copy(), np.full(len(record.values), np.inf)
    updates = record.updates
    durations = np.diff(np.cumsum(record.interval)[updates], append=np.sum(record.interval))
    estimate[updates], noise[updates] = _values_at_changes(
        record.values[updates], record.step[updates], durations
    )
    return _smooth(estimate, noise, record)


def _values_at_changes(values: Array, step: Array, interval: Array) -> tuple[Array, Array]:
    """Value and noise variance of each update: halfway between both steps at a change, else the middle of the step.

    Readings between two changes have the same error, so that all of them count as one.

    Parameters
    ----------
    values, step : (n,), recorded values and quantisation steps
    interval : (n,), time until the next update, s
    """
    estimate, noise = values.copy(), step**2 / 12.0
    before = np.flatnonzero(np.diff(values))
    count = np.diff(before, prepend=-1, append=len(values) - 1)
    durations = np.repeat(count, count) * interval
    correlated = np.minimum(durations, ERROR_CORRELATION_TIME) / np.maximum(interval, 1e-6)
    # Zero speeds are standstills: each reading is new information.
    noise = noise * np.where(values > 0.0, np.maximum(correlated, 1.0), 1.0)
    # The times at which several steps were passed at once are unknown; a single reading lies in its own step.
    one_step = np.abs(np.diff(values)[before]) < 1.5 * step[before]
    before = before[one_step & (np.minimum(count[:-1], count[1:]) > 1)]
    for at in (before, before + 1):
        # The time of the change between two readings is unknown.
        between = step[at] * np.minimum(interval[at] / durations[at], 1.0)
        noise[at] = 2.0 * ((CHANGE_STD * step[at]) ** 2 + between**2 / 12.0)
        estimate[at] = 0.5 * (values[before] + values[before + 1])
    return estimate, noise


def _updates(values: Array, interval: Array) -> Indices:
    """Numbers of the readings at which the record was updated.

    Some records repeat each value until the next update. The update interval is found if most intervals between changes
    are multiples of one that is longer than the sampling interval, and not all are equal; else each reading is an
    update.

    Parameters
    ----------
    values, interval : (n,), recorded values, and sampling interval, s

    Examples
    --------
    >>> speeds = [3.0, 4.0, 6.0, 5.0, 5.0, 7.0, 8.0, 9.0, 11.0, 10.0, 9.0, 8.0, 9.0, 7.0, 6.0, 5.0]
    >>> _updates(np.repeat(speeds, 5), np.full(80, 0.1))
    array([ 0,  5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75])
    """
    time = np.cumsum(interval)
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(values))])
    gaps = np.diff(time[starts[1:]])
    every = np.arange(len(values))
    if len(gaps) < MIN_CHANGES:
        return every
    update = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
    multiples = gaps / update
    regular = np.mean(np.abs(multiples - np.round(multiples)) < 0.15) > 0.8
    longer = update > 1.5 * float(np.median(interval))
    if not (regular and longer and np.max(multiples) > 1.5):
        return every
    counts = np.diff(starts, append=len(values))
    durations = np.diff(time[starts], append=time[-1])
    updates = np.maximum(np.round(durations / update), 1.0).astype(int)
    return np.concatenate(
        [
            first + np.arange(n) * count // n
            for first, n, count in zip(starts, updates, counts, strict=True)
        ]
    )


def _smoothed_if_independent(record: _QuantisedRecord) -> Array | None:
    """Values smoothed with independent quantisation errors, if many then lie outside their steps; else None.

    They do if the readings were noisy before quantisation, which makes their errors independent.
    """
    updates = record.updates
    noise = np.full(len(record.values), np.inf)
    noise[updates] = record.step[updates] ** 2 / 12.0
    smoothed = _smooth(record.values, noise, record)
    outside = np.abs(smoothed - record.values)[updates] > OUTSIDE * record.step[updates]
    return smoothed if np.mean(outside) > MAX_OUTSIDE_SHARE else None


def _slope_change_variance(time: Array) -> Array:
    """Variance of the change of acceleration at each inner reading, (n - 2,), from a random walk over time, s."""
    return ACCELERATION_WALK**2 * 0.5 * (time[2:] - time[:-2])


def _smooth(values: Array, noise: Array, record: _QuantisedRecord) -> Array:
    """Minimise Σ (w - y)²/noise + Σ (change of slope)²/walk over w, (n,): a pentadiagonal system."""
    spacing = np.diff(record.at)
    before, after = 1.0 / spacing[:-1], 1.0 / spacing[1:]
    stencil = np.stack([before, -before - after, after]) / np.sqrt(record.walk)
    n = len(values)
    bands = np.zeros((3, n))
    bands[2] = 1.0 / noise
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j : n - 2 + j] += stencil[i] * stencil[j]
    return solveh_banded(bands, values / noise)


def _variable(recording: xr.Dataset, name: str) -> Array | None:
    return recording[name].to_numpy().astype(np.float64) if name in recording else None

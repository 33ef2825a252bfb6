"""How the train moved: time, distance, speed and acceleration at each sample, from what was recorded."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import pchip_interpolate as pchip
from scipy.linalg import solveh_banded

from trackprofile.arrays import integral, recorded_step
from trackprofile.errors import DataError
from trackprofile.models.kinematics import Motion

Array = NDArray[np.float64]

ACCELERATION_WALK = 0.1
"""m/s² per √s: how fast a train's acceleration wanders (a jerk of 0.1 to 0.5 m/s³ for some seconds)."""

AVERAGED = 0.5
"""s, or m, of known speeds that are averaged before missing ones are filled in: steps of the record are no slopes."""

REMEMBERED = 10.0
"""s over which the speed of a train errs alike that was recorded in steps and does not reach the next one."""

CROSSED = 0.2
"""Of a step: how well the speed is known where its record changes to the next one."""

FLICKERS = 0.05
"""Share of readings more than ``OUTSIDE`` steps off, from which the speed was noisy before it was recorded in steps."""

OUTSIDE = 0.55

FEWEST = 12
"""Times between changes of a record that tell how often it is renewed."""


def motion(recording: xr.Dataset) -> Motion:
    """The train's motion, from time or distance or both, with or without speed.

    Speed that was recorded in steps (whole km/h, say) is smoothed first.

    Raises
    ------
    DataError
        Where the recording has no two of time, distance and speed.
    """
    time, distance, speed = (_variable(recording, name) for name in ("time", "distance", "speed"))
    if time is not None and speed is not None:
        speed = speed_over_time(speed, time)
        if distance is None:
            distance = integral(speed, time)
    elif distance is not None and speed is not None:
        speed = speed_over_distance(speed, distance)
        time = integral(1.0 / speed, distance)
    elif time is not None and distance is not None:
        speed = np.clip(np.gradient(distance, time), 0.0, None)
    else:
        raise DataError(
            "the recording has only one of time, distance and speed, which does not say how the train "
            "moved; add a second one"
        )
    return Motion(time, distance, speed, np.gradient(speed, time))


def speed_over_time(speed: Array, time: Array) -> Array:
    """Speed (m/s) recorded in steps over time (s), smoothed; as it is where there are no steps."""
    step = recorded_step(speed)
    if step == 0.0:
        return speed
    smoothed = _within_steps(speed, time, np.full(len(speed), step), np.gradient(time), _walk(time))
    return np.clip(smoothed, 0.0, None)


def speed_over_distance(speed: Array, distance: Array) -> Array:
    """Speed (m/s) recorded in steps over distance (m), smoothed; as it is where there are no steps.

    Smoothed is the kinetic energy per mass, v²/2: its slope over distance is the acceleration.
    """
    step = recorded_step(speed)
    if step == 0.0:
        return speed
    # A speed recorded as 0 while the distance goes on lies between 0 and half a step.
    speed = np.maximum(speed, 0.25 * step)
    walk, interval = _walk(distance) / speed[1:-1], np.gradient(distance) / speed
    energy = _within_steps(0.5 * speed**2, distance, step * speed, interval, walk)
    return np.sqrt(2.0 * np.maximum(energy, 0.5 * (0.25 * step) ** 2))


def deviation_of_counting(speed: Array, time: Array) -> Array | None:
    """How far a distance that is counted from such a speed may be off, (n,) m; None where there are no steps.

    Over a time T between two changes of the record, at which it is known, the mean speed is known to the least of what
    the step leaves open, and what the train's acceleration can do: √(W² T³/120), of a walk that is held at its ends.

    Examples
    --------
    >>> time = np.arange(0.0, 60.0, 0.1)
    >>> deviation_of_counting(np.round(10.0 + 0.2 * time), time)[[0, 300, 599]].round(2)
    array([0. , 1.2, 1.7])
    """
    step = recorded_step(speed)
    if step == 0.0:
        return None
    interval = np.gradient(time)
    new, steps = _renewed(speed, interval), np.full(len(speed), step)
    if _if_independent(speed, time, steps, new, _walk(time)) is not None:
        return np.sqrt(np.cumsum(np.square(interval * (speed > 0.0))) * step**2 / 12.0)
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(speed))])
    edges = np.append(time[starts], time[-1])
    lasts = np.diff(edges)
    # A record that is renewed every so often changes later than the speed did.
    late = step * (time[-1] - time[0]) / len(new) / np.maximum(lasts, interval[starts])
    of_walk = np.hypot(ACCELERATION_WALK * np.sqrt(lasts**3 / 120.0), late / np.sqrt(12.0))
    of_mean = np.where(speed[starts] > 0.0, np.minimum(step / np.sqrt(12.0), of_walk), 0.0)
    variance = np.concatenate([[0.0], np.cumsum(np.square(of_mean * lasts))])
    return np.sqrt(np.interp(time, edges, variance))


def fill_speed(speed: Array, at: Array) -> Array:
    """Speed (m/s) over time (s) or distance (m), with its missing values, NaN, on a smooth way between the others.

    The way goes through means of the known values, monotonously from each to the next, and holds the first and the
    last of them beyond; so it is never below zero where they are not.

    Raises
    ------
    DataError : fewer than two values are known.

    Examples
    --------
    >>> filled(np.array([10.0, 11.0, np.nan, 13.0]), np.arange(4.0)).round(3)
    array([10., 11., 12., 13.])
    """
    known = np.isfinite(speed)
    if np.count_nonzero(known) < 2:
        raise DataError("speed: fewer than two values are known; choose another column.")
    if known.all():
        return speed
    first, last = at[known][[0, -1]]
    share = (np.clip(at, first, last) - first) / (last - first)
    most = min((last - first) / AVERAGED, np.count_nonzero(known))
    place, value = _means(share[known], speed[known], max(2, int(most)))
    return np.where(known, speed, pchip(place, value, np.clip(share, place[0], place[-1])))


def _means(at: Array, values: Array, count: int) -> tuple[Array, Array]:
    """Means, of places from 0 to 1 and of values, over as many equal parts; of those parts that hold any."""
    part = np.minimum((at * count).astype(np.int64), count - 1)
    number = np.bincount(part, minlength=count)
    there = number > 0
    place, value = (
        np.bincount(part, each, minlength=count)[there] / number[there] for each in (at, values)
    )
    return place, value


def _within_steps(values: Array, at: Array, step: Array, interval: Array, walk: Array) -> Array:
    """What was recorded in steps, smoothed: by where its record changes, which is halfway from one step to the next.

    Parameters
    ----------
    values, step, interval : (n,), what was recorded, in which step, and the time that a reading stands for, s
    at : (n,), s or m
    walk : (n - 2,), variance of the change of slope
    """
    new = _renewed(values, interval)
    independent = _if_independent(values, at, step, new, walk)
    if independent is not None:
        return independent
    told, noise = values.copy(), np.full(len(values), np.inf)
    lasts = np.diff(np.cumsum(interval)[new], append=np.sum(interval))
    told[new], noise[new] = _told_by_changes(values[new], step[new], lasts)
    return _smooth(told, at, noise, walk)


def _told_by_changes(values: Array, step: Array, interval: Array) -> tuple[Array, Array]:
    """What readings say, and its variance, each (n,): those beside a change that they lie halfway between both.

    Between changes readings err alike, and tell no more than one of them.
    """
    told, noise = values.copy(), step**2 / 12.0
    before = np.flatnonzero(np.diff(values))
    count = np.diff(before, prepend=-1, append=len(values) - 1)
    lasts = np.repeat(count, count) * interval
    alike = np.minimum(lasts, REMEMBERED) / np.maximum(interval, 1e-6)
    # A train that shows no speed stands: that each reading says anew.
    noise = noise * np.where(values > 0.0, np.maximum(alike, 1.0), 1.0)
    # Of several steps at once nobody knows when each was crossed; and a reading alone lies in its own step.
    one_step = np.abs(np.diff(values)[before]) < 1.5 * step[before]
    before = before[one_step & (np.minimum(count[:-1], count[1:]) > 1)]
    for beside in (before, before + 1):
        # Nor when one was, between two readings.
        unseen = step[beside] * np.minimum(interval[beside] / lasts[beside], 1.0)
        noise[beside] = 2.0 * ((CROSSED * step[beside]) ** 2 + unseen**2 / 12.0)
        told[beside] = 0.5 * (values[before] + values[before + 1])
    return told, noise


def _renewed(values: Array, interval: Array) -> NDArray[np.intp]:
    """The readings that are new ones, by number: where a record is renewed every so often, only those tell anything.

    It is, if most times between changes are whole multiples of one that is longer than a reading's, and not all alike.

    Examples
    --------
    >>> speeds = [3.0, 4.0, 6.0, 5.0, 5.0, 7.0, 8.0, 9.0, 11.0, 10.0, 9.0, 8.0, 9.0, 7.0, 6.0, 5.0]
    >>> _renewed(np.repeat(speeds, 5), np.full(80, 0.1))
    array([ 0,  5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75])
    """
    time = np.cumsum(interval)
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(values))])
    gaps = np.diff(time[starts[1:]])
    if len(gaps) >= FEWEST:
        usual = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
        times = gaps / usual
        whole = np.mean(np.abs(times - np.round(times)) < 0.15) > 0.8
        if whole and usual > 1.5 * float(np.median(interval)) and np.max(times) > 1.5:
            counts = np.diff(starts, append=len(values))
            lasts = np.diff(time[starts], append=time[-1])
            number = np.maximum(np.round(lasts / usual), 1.0).astype(int)
            return np.concatenate(
                [
                    first + np.arange(n) * count // n
                    for first, n, count in zip(starts, number, counts, strict=True)
                ]
            )
    return np.arange(len(values))


def _if_independent(
    values: Array, at: Array, step: Array, new: NDArray[np.intp], walk: Array
) -> Array | None:
    """The ``new`` readings taken for independent and smoothed, if they are: noisy before they were rounded.

    Then what comes of it lies outside their steps.
    """
    noise = np.full(len(values), np.inf)
    noise[new] = step[new] ** 2 / 12.0
    smoothed = _smooth(values, at, noise, walk)
    outside = np.abs(smoothed - values)[new] > OUTSIDE * step[new]
    return smoothed if np.mean(outside) > FLICKERS else None


def _walk(at: Array) -> Array:
    """Variance of the change of acceleration at each inner node, for steps in s."""
    return ACCELERATION_WALK**2 * 0.5 * (at[2:] - at[:-2])


def _smooth(values: Array, at: Array, noise: Array, walk: Array) -> Array:
    """Minimise Σ (w - y)²/noise + Σ (change of slope)²/walk: a pentadiagonal system."""
    spacing = np.diff(at)
    before, after = 1.0 / spacing[:-1], 1.0 / spacing[1:]
    stencil = np.stack([before, -before - after, after]) / np.sqrt(walk)
    n = len(values)
    bands = np.zeros((3, n))
    bands[2] = 1.0 / noise
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j : n - 2 + j] += stencil[i] * stencil[j]
    return solveh_banded(bands, values / noise)


def _variable(recording: xr.Dataset, name: str) -> Array | None:
    return recording[name].to_numpy().astype(np.float64) if name in recording else None

"""How the train moved: time, distance, speed and acceleration at each sample, from what was recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from trackprofile.errors import DataError

Array = NDArray[np.float64]

ACCELERATION_WALK = 0.1
"""m/s² per √s: how fast a train's acceleration wanders (a jerk of 0.1 to 0.5 m/s³ for some seconds)."""

MOST_DISTINCT = 0.2
"""Share of distinct values up to which a channel counts as recorded in steps."""


@dataclass(frozen=True)
class Motion:
    """Time (s), distance (m), speed (m/s) and acceleration (m/s²) at the samples, each (n,)."""

    time: Array
    distance: Array
    speed: Array
    acceleration: Array


def along_track(recorded: Motion, origin: float, scale: float) -> Motion:
    """The motion with ``scale`` true metres to a recorded one, of a point ``origin`` m ahead."""
    return Motion(
        recorded.time,
        scale * recorded.distance + origin,
        scale * recorded.speed,
        scale * recorded.acceleration,
    )


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
            distance = _integral(speed, time)
    elif distance is not None and speed is not None:
        speed = speed_over_distance(speed, distance)
        time = _integral(1.0 / speed, distance)
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
    noise = np.full(len(speed), step**2 / 12.0)
    walk = ACCELERATION_WALK**2 * 0.5 * (time[2:] - time[:-2])
    return np.clip(_smooth(speed, time, noise, walk), 0.0, None)


def speed_over_distance(speed: Array, distance: Array) -> Array:
    """Speed (m/s) recorded in steps over distance (m), smoothed; as it is where there are no steps.

    Smoothed is the kinetic energy per mass, v²/2: its slope over distance is the acceleration.
    """
    step = recorded_step(speed)
    if step == 0.0:
        return speed
    # A speed recorded as 0 while the distance goes on lies between 0 and half a step.
    speed = np.maximum(speed, 0.25 * step)
    noise = (step * speed) ** 2 / 12.0
    walk = ACCELERATION_WALK**2 * 0.5 * (distance[2:] - distance[:-2]) / speed[1:-1]
    energy = _smooth(0.5 * speed**2, distance, noise, walk)
    return np.sqrt(2.0 * np.maximum(energy, 0.5 * (0.25 * step) ** 2))


def filled(speed: Array, at: Array) -> Array:
    """Speed (m/s) over time (s) or distance (m) with its missing values, NaN, on the smoothest way between the others.

    The change of its slope is least, so that an acceleration goes on for a while, as a train's does; never below zero.

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
    spacing = np.maximum(np.diff(at), 1e-9)
    at = np.concatenate([[0.0], np.cumsum(spacing)])
    noise = np.where(known, 1e-6, 1e6)
    smooth = _smooth(np.where(known, speed, 0.0), at, noise, 0.5 * (at[2:] - at[:-2]))
    return np.where(known, speed, np.clip(smooth, 0.0, None))


def recorded_step(values: Array) -> float:
    """The step in which values were recorded; 0 where they are as good as continuous.

    Examples
    --------
    >>> recorded_step(np.repeat([10.0, 10.5, 11.0, 11.5], 10))
    0.5
    """
    distinct = np.unique(values)
    if len(distinct) < 2 or len(distinct) > MOST_DISTINCT * len(values):
        return 0.0
    return float(np.min(np.diff(distinct)))


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


def _integral(values: Array, at: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.diff(at) * 0.5 * (values[1:] + values[:-1]))])

"""Scans of a recording: the evenly spaced samples that the search reproduces, one per elevation.

"Scan" is the term of O'Brien et al. 2017 for one sample of all sensors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import tilt_acceleration
from trackprofile.methods.cross_entropy.search_settings import SearchSettings
from trackprofile.models.kinematics import Motion, along_track
from trackprofile.models.sensor import Installation

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-3
"""Maximum deviation of a sampling interval as a share of the median; smaller than a 1 ms clock's at 500 Hz."""


@dataclass(frozen=True)
class Scans:
    """The samples that the search reproduces.

    Parameters
    ----------
    step : time between scans, s
    position, speed : (scans + 1,), of the leading wheel, m and m/s; the first is the start
    signals : (scans, sensors), m/s² or rad/s
    samples : (scans,), indices of the scans in the recording
    channels : names of the sensors
    """

    step: float
    position: Array
    speed: Array
    signals: Array
    samples: NDArray[np.intp]
    channels: tuple[str, ...]


def select_scans(
    data: Observations, installation: Installation, search: SearchSettings
) -> tuple[Scans, tuple[str, ...]]:
    """Select every k-th sample so that a phase has the requested length.

    Parameters
    ----------
    installation : installation of the sensors on the vehicle
    search : settings of the search

    Returns
    -------
    the scans, and notes on what is assumed

    Raises
    ------
    DataError
        Where samples are invalid or uneven in time, the train is at standstill, or a window exceeds the recording.
    """
    motion = along_track(data.motion, installation.origin, installation.distance_scale)
    interval = _check_samples(data, motion)
    spacing = float(np.mean(np.diff(motion.distance)))
    every, notes = _stride(spacing, search)
    used = np.arange(0, len(motion.time), every)
    if len(used) <= search.unknowns:
        raise DataError(
            f"A window of {search.unknowns} elevations, {search.unknowns * every * spacing:.2f} m, exceeds the "
            f"recording of {motion.distance[-1] - motion.distance[0]:.2f} m; use a longer recording or fewer unknowns."
        )
    scans = Scans(
        interval * every,
        motion.distance[used],
        motion.speed[used],
        (data.signals - tilt_acceleration(data.sensors, motion))[used[1:]],
        used[1:],
        tuple(sensor.name for sensor in data.sensors),
    )
    start = (
        f"the train is assumed to start at {scans.position[0]:.2f} m in static equilibrium on level track, and the "
        "sensors to have no offset"
    )
    return scans, (*notes, start)


def _check_samples(data: Observations, motion: Motion) -> float:
    """The sampling interval, s; raises DataError where the samples cannot be used."""
    missing = np.flatnonzero(~np.all(data.valid, axis=1))
    if missing.size:
        raise DataError(
            f"Cross-entropy needs every sample valid, but {_describe_missing(data, int(missing[0]))}; "
            "cut the recording there (--from, --to), remove the channel, or use the smoother."
        )
    steps = np.diff(motion.time)
    interval = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - interval) > TIME_TOLERANCE * interval)
    if uneven.size:
        raise DataError(
            f"Cross-entropy needs evenly sampled data, but the step after data row {uneven[0] + 1} is "
            f"{1e3 * steps[uneven[0]]:.4g} ms instead of {1e3 * interval:.4g} ms; resample, or use the smoother."
        )
    standstill = np.flatnonzero(np.diff(motion.distance) <= 0)
    if standstill.size:
        raise DataError(
            f"Cross-entropy needs a moving train, but it is at standstill at {motion.distance[standstill[0]]:.2f} m; "
            "cut the recording there (--from, --to), or use the smoother."
        )
    return interval


def _describe_missing(data: Observations, sample: int) -> str:
    """Text on the channel that is invalid at a sample, and the reason."""
    channel = int(np.argmin(data.valid[sample]))
    name = data.sensors[channel].name
    kinds = [
        str(one.kind)
        for one in data.faults
        if one.channel == name and one.first <= sample <= one.last
    ]
    return (
        f"{name!r} is invalid in data row {sample + 1} ({', '.join(kinds) or 'marked as invalid'})"
    )


def _stride(spacing: float, search: SearchSettings) -> tuple[int, tuple[str, ...]]:
    """Number of samples per scan; a note where the phases do not have the requested length."""
    if search.length is None:
        return 1, ()
    requested = search.length / search.unknowns
    every = max(round(requested / spacing), 1)
    if abs(every * spacing - requested) <= 0.01 * requested:
        return every, ()
    return every, (
        f"phases are {search.unknowns * every * spacing:.3g} m long instead of {search.length:g} m, because the "
        f"samples are {spacing:.3g} m apart",
    )

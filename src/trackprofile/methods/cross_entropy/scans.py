"""The scans of a recording that the cross-entropy method reproduces: one to an elevation, evenly in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import tilt_acceleration
from trackprofile.methods.cross_entropy.search import Search
from trackprofile.models.kinematics import along_track
from trackprofile.models.sensor import Installation

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-3
"""Of the sampling interval, by which scans may stray: below what a clock of 1 ms resolution does at 500 Hz."""


@dataclass(frozen=True)
class Scans:
    """What is to be reproduced.

    Parameters
    ----------
    step : s between scans
    position, speed : (scans + 1,), m and m/s of the leading wheel; the first is where it starts
    signals : (scans, sensors)
    samples : (scans,), which of the recording's samples they are
    channels : names of the sensors
    """

    step: float
    position: Array
    speed: Array
    signals: Array
    samples: NDArray[np.intp]
    channels: tuple[str, ...]


def select_scans(
    data: Observations, installation: Installation, search: Search
) -> tuple[Scans, tuple[str, ...]]:
    """Every so manieth sample, so that a phase has the length that is asked for.

    Parameters
    ----------
    installation : of the sensors, on the vehicle

    Raises
    ------
    DataError
        Where samples are invalid or uneven in time, the train stands, or a window is longer than the recording.
    """
    motion = along_track(data.motion, installation.origin, installation.distance_scale)
    missing = np.flatnonzero(~np.all(data.valid, axis=1))
    if missing.size:
        raise DataError(
            f"Cross-entropy needs every sample, and {_missing(data, int(missing[0]))}; "
            "cut the recording there (--from, --to), leave the channel out, or take the smoother."
        )
    steps = np.diff(motion.time)
    interval = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - interval) > TIME_TOLERANCE * interval)
    if uneven.size:
        raise DataError(
            f"Cross-entropy needs samples evenly in time, and after data row {uneven[0] + 1} come "
            f"{1e3 * steps[uneven[0]]:.4g} ms instead of {1e3 * interval:.4g} ms; resample, or take the smoother."
        )
    stands = np.flatnonzero(np.diff(motion.distance) <= 0)
    if stands.size:
        raise DataError(
            f"Cross-entropy needs a train that runs, and it stands at {motion.distance[stands[0]]:.2f} m; "
            "cut the recording there (--from, --to), or take the smoother."
        )
    spacing = float(np.mean(np.diff(motion.distance)))
    every, notes = _stride(spacing, search)
    used = np.arange(0, len(motion.time), every)
    if len(used) <= search.unknowns:
        raise DataError(
            f"A window of {search.unknowns} elevations, {search.unknowns * every * spacing:.2f} m, is longer than the "
            f"recording of {motion.distance[-1] - motion.distance[0]:.2f} m; record more, or ask for fewer unknowns."
        )
    scans = Scans(
        interval * every,
        motion.distance[used],
        motion.speed[used],
        (data.signals - tilt_acceleration(data.sensors, motion))[used[1:]],
        used[1:],
        tuple(sensor.name for sensor in data.sensors),
    )
    assumed = (
        f"taken to start at {scans.position[0]:.2f} m at rest on level track, with sensors without offset",
    )
    return scans, notes + assumed


def _missing(data: Observations, sample: int) -> str:
    """What has no value there, and why, in words."""
    channel = int(np.argmin(data.valid[sample]))
    name = data.sensors[channel].name
    kinds = [
        str(one.kind)
        for one in data.faults
        if one.channel == name and one.first <= sample <= one.last
    ]
    return f"{name!r} has none in data row {sample + 1} ({', '.join(kinds) or 'marked invalid'})"


def _stride(spacing: float, search: Search) -> tuple[int, tuple[str, ...]]:
    """Every so manieth sample is a scan; in words where the phases get another length than was asked for."""
    if search.length is None:
        return 1, ()
    wanted = search.length / search.unknowns
    every = max(round(wanted / spacing), 1)
    if abs(every * spacing - wanted) <= 0.01 * wanted:
        return every, ()
    return every, (
        f"phases are {search.unknowns * every * spacing:.3g} m long, not {search.length:g} m: the samples lie "
        f"{spacing:.3g} m apart",
    )

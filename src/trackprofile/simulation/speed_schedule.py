"""Motion of a simulated train: constant speed, a schedule of speeds, or a recorded motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from trackprofile.errors import DataError, ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpeedSchedule:
    """Speeds at given times, with constant acceleration in between and constant speed after the last.

    Parameters
    ----------
    times : s, increasing, the first 0
    speeds : m/s, above 0

    Raises
    ------
    ModelError : times and speeds differ in number, times do not increase from 0, or a speed is not above 0.

    Examples
    --------
    >>> SpeedSchedule((0.0, 10.0), (20.0, 30.0)).at(np.array([0.0, 5.0, 10.0, 11.0]))
    array([[  0. ,  20. ,   1. ],
           [112.5,  25. ,   1. ],
           [250. ,  30. ,   0. ],
           [280. ,  30. ,   0. ]])
    """

    times: tuple[float, ...]
    speeds: tuple[float, ...]

    def __post_init__(self) -> None:
        increasing = all(a < b for a, b in zip(self.times, self.times[1:], strict=False))
        if len(self.times) != len(self.speeds) or not self.times or self.times[0] != 0:
            raise ModelError(
                "A speed schedule needs as many speeds as times, the first at 0 s, got "
                f"{len(self.times)} times and {len(self.speeds)} speeds."
            )
        if not increasing or not all(np.isfinite(v) and v > 0 for v in self.speeds):
            raise ModelError(
                f"A speed schedule needs increasing times and speeds above 0 m/s, got times {self.times} and "
                f"speeds {self.speeds}."
            )

    def at(self, time: Array) -> Array:
        """Distance run (m), speed (m/s) and acceleration (m/s²) at times (n,) from 0 s on, (n, 3)."""
        times, speeds = np.array(self.times), np.array(self.speeds)
        acceleration = np.append(np.diff(speeds) / np.diff(times), 0.0)
        starts = np.concatenate(
            [[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))]
        )
        i = np.maximum(np.searchsorted(times, time, side="right") - 1, 0)
        elapsed = time - times[i]
        speed = speeds[i] + acceleration[i] * elapsed
        distance = starts[i] + speeds[i] * elapsed + 0.5 * acceleration[i] * elapsed**2
        return np.stack([distance, speed, acceleration[i]], axis=1)

    def duration(self, length: float) -> float:
        """Time to run ``length`` (m), s."""
        times, speeds = np.array(self.times), np.array(self.speeds)
        starts = self.at(times)[:, 0]
        i = max(int(np.searchsorted(starts, length, side="right")) - 1, 0)
        remaining, v = length - starts[i], speeds[i]
        if i == len(times) - 1:
            return float(times[i] + remaining / v)
        a = (speeds[i + 1] - v) / (times[i + 1] - times[i])
        # This form of the quadratic's root has no cancellation as a tends to 0.
        return float(times[i] + 2 * remaining / (v + np.sqrt(v**2 + 2 * a * remaining)))


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A recorded motion, preceded by ``lead`` m at its first speed; the distance is a cubic between samples.

    Parameters
    ----------
    time, distance, speed : (n,), s, m and m/s, as recorded
    lead : distance run before the first sample, m

    Raises
    ------
    DataError : a speed is not above 0.

    Examples
    --------
    >>> recorded = RecordedMotion(np.array([0.0, 1.0]), np.array([5.0, 15.0]), np.array([10.0, 10.0]), 20.0)
    >>> recorded.at(np.array([2.5])), recorded.duration(30.0)
    (array([[25., 10.,  0.]]), 3.0)
    """

    time: Array
    distance: Array
    speed: Array
    lead: float

    def __post_init__(self) -> None:
        minimum = float(np.min(self.speed))
        if not minimum > 0:
            raise DataError(
                f"A recorded run can be simulated only while it moves, got a speed of {minimum:g} m/s; choose a "
                "section without stops."
            )

    def at(self, time: Array) -> Array:
        """Distance run (m), speed (m/s) and acceleration (m/s²) at times (n,) from 0 s on, (n, 3)."""
        spline = CubicHermiteSpline(self.time, self.distance, self.speed)
        elapsed = time - self.lead / self.speed[0]
        at = np.clip(elapsed, 0.0, None) + self.time[0]
        in_lead = elapsed < 0
        run = np.where(in_lead, self.speed[0] * time, self.lead + spline(at) - self.distance[0])
        speed = np.where(in_lead, self.speed[0], spline(at, 1))
        return np.stack([run, speed, np.where(in_lead, 0.0, spline(at, 2))], axis=1)

    def duration(self, length: float) -> float:
        """Time to run ``length`` (m), at most that of the record, s."""
        lead_duration = self.lead / self.speed[0]
        if length <= self.lead:
            return float(length / self.speed[0])
        end = self.distance[0] + length - self.lead
        return float(lead_duration + np.interp(end, self.distance, self.time) - self.time[0])


def constant_speed(speed: float) -> SpeedSchedule:
    """The schedule of a train at constant speed.

    Parameters
    ----------
    speed : m/s

    Examples
    --------
    >>> constant_speed(20.0).duration(100.0)
    5.0
    """
    return SpeedSchedule((0.0,), (speed,))

"""How a simulated train runs: constant speed, or speeds that change evenly between given times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from trackprofile.errors import DataError, ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpeedSchedule:
    """Speeds (m/s) at times (s) from 0 on; between them the acceleration is constant, after them the speed.

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
                "A drive needs as many speeds as times, the first at 0 s, got "
                f"{len(self.times)} times and {len(self.speeds)} speeds."
            )
        if not increasing or not all(np.isfinite(v) and v > 0 for v in self.speeds):
            raise ModelError(
                f"A drive needs times that increase and speeds above 0 m/s, got times {self.times} and "
                f"speeds {self.speeds}."
            )

    def at(self, time: Array) -> Array:
        """Way run (m), speed (m/s) and acceleration (m/s²) at times (n,) from 0 on, (n, 3)."""
        times, speeds = np.array(self.times), np.array(self.speeds)
        gained = np.append(np.diff(speeds) / np.diff(times), 0.0)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))])
        piece = np.maximum(np.searchsorted(times, time, side="right") - 1, 0)
        since = time - times[piece]
        speed = speeds[piece] + gained[piece] * since
        run = way[piece] + speeds[piece] * since + 0.5 * gained[piece] * since**2
        return np.stack([run, speed, gained[piece]], axis=1)

    def duration(self, length: float) -> float:
        """Time to run ``length`` m, s."""
        times, speeds = np.array(self.times), np.array(self.speeds)
        ways = self.at(times)[:, 0]
        piece = max(int(np.searchsorted(ways, length, side="right")) - 1, 0)
        rest, v = length - ways[piece], speeds[piece]
        if piece == len(times) - 1:
            return float(times[piece] + rest / v)
        a = (speeds[piece + 1] - v) / (times[piece + 1] - times[piece])
        # Of the two forms of the root, the one that stays exact as a tends to 0.
        return float(times[piece] + 2 * rest / (v + np.sqrt(v**2 + 2 * a * rest)))


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A recorded motion, after ``lead`` m at its first speed: position is a cubic between samples.

    Parameters
    ----------
    time, distance, speed : (n,), s, m and m/s, as recorded
    lead : m run before the first sample

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
        slowest = float(np.min(self.speed))
        if not slowest > 0:
            raise DataError(
                f"A recorded run can be simulated only while it moves, got a speed of {slowest:g} m/s; choose a "
                "stretch without stops."
            )

    def at(self, time: Array) -> Array:
        """Way run (m), speed (m/s) and acceleration (m/s²), (n, 3)."""
        way = CubicHermiteSpline(self.time, self.distance, self.speed)
        since = time - self.lead / self.speed[0]
        at = np.clip(since, 0.0, None) + self.time[0]
        early = since < 0
        run = np.where(early, self.speed[0] * time, self.lead + way(at) - self.distance[0])
        speed = np.where(early, self.speed[0], way(at, 1))
        return np.stack([run, speed, np.where(early, 0.0, way(at, 2))], axis=1)

    def duration(self, length: float) -> float:
        """Time to run ``length`` m, s; at most that of the record."""
        lasted = self.lead / self.speed[0]
        if length <= self.lead:
            return float(length / self.speed[0])
        reached = self.distance[0] + length - self.lead
        return float(lasted + np.interp(reached, self.distance, self.time) - self.time[0])


def constant_speed(speed: float) -> SpeedSchedule:
    """A train that keeps its speed, m/s.

    Examples
    --------
    >>> constant_speed(20.0).duration(100.0)
    5.0
    """
    return SpeedSchedule((0.0,), (speed,))

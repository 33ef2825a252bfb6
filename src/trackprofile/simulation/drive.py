"""How a simulated train runs: constant speed, or speeds that change evenly between given times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """Speeds (m/s) at times (s) from 0 on; between them the acceleration is constant, after them the speed.

    Examples
    --------
    >>> Drive((0.0, 10.0), (20.0, 30.0)).at(np.array([0.0, 5.0, 10.0, 11.0]))
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


def steady(speed: float) -> Drive:
    """A train that keeps its speed, m/s.

    Examples
    --------
    >>> steady(20.0).duration(100.0)
    5.0
    """
    return Drive((0.0,), (speed,))

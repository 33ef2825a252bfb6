"""The motion of a point of the train along the track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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

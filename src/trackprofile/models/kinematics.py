"""Motion of a point of the train along the track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Motion of one point along the track at n samples.

    Parameters
    ----------
    time : (n,), s
    distance : (n,), m
    speed : (n,), m/s
    acceleration : (n,), m/s²
    """

    time: Array
    distance: Array
    speed: Array
    acceleration: Array


def along_track(recorded: Motion, origin: float, scale: float) -> Motion:
    """Motion of a point ahead of the recorded one, with the scale of the recorded distance corrected.

    Parameters
    ----------
    recorded : motion as recorded
    origin : how far ahead the point is, m
    scale : true distance per recorded distance
    """
    return Motion(
        recorded.time,
        scale * recorded.distance + origin,
        scale * recorded.speed,
        scale * recorded.acceleration,
    )

"""How a sensor is mounted, as far as its own signal tells: gravity, sign and angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Channel
from trackprofile.models.sensor import DEFAULT_OFFSET, VERTICAL_ACCELERATION
from trackprofile.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

GRAVITY = 0.5
"""Share of gravity in the mean from which an accelerometer is taken to measure it: 60° off the vertical."""

UPRIGHT = 0.05
"""Share by which that may differ from the whole of it, before an angle is worth a correction: 18°."""

TOO_FAR = 5.0
"""Usual offsets from which one is said and taken off."""


@dataclass(frozen=True)
class MountingCorrection:
    """A signal, (n,), upwards and without gravity or a great offset.

    ``said`` tells what was done, "" if nothing; ``doubt`` is the relative standard deviation of a gain that was
    corrected, for an unknown offset looks like a part of gravity; ``by_gravity`` whether that told which way is up.
    """

    values: Array
    said: str = ""
    doubt: float = 0.0
    by_gravity: bool = False


def correct_mounting(channel: Channel, valid: NDArray[np.bool_]) -> MountingCorrection:
    """What an accelerometer's mean says of how it is mounted, put right.

    At rest an accelerometer that measures upwards reads +g, one that hangs upside down -g, and one at an angle ε to
    the vertical g cos ε, and cos ε of every vertical acceleration.

    Examples
    --------
    >>> hanging = Channel("floor", np.array([-9.9, -9.8, -9.7]), "vertical acceleration", "body", 0.0)
    >>> put_right = freed_of_gravity(hanging, np.ones(3, bool))
    >>> put_right.values.round(3), put_right.said
    (array([ 0.1, -0. , -0.1]), "'floor' reads gravity, -9.8 m/s²: turned upside down, and taken off")
    """
    values = np.asarray(channel.values, np.float64)
    mean = float(np.median(values[valid]))
    if abs(mean) <= TOO_FAR * DEFAULT_OFFSET[channel.quantity]:
        return MountingCorrection(values)
    share = abs(mean) / STANDARD_GRAVITY
    if channel.quantity != VERTICAL_ACCELERATION or share < GRAVITY:
        return MountingCorrection(
            values - mean, f"{channel.name!r} has an offset of {mean:.3g}, taken off: check it"
        )
    said = f"{channel.name!r} reads gravity, {mean:.3g} m/s²: "
    turned = "turned upside down, and " if mean < 0 else ""
    if share > 1.0 - UPRIGHT:
        put_right = np.sign(mean) * (values - mean)
        return MountingCorrection(put_right, f"{said}{turned}taken off", by_gravity=True)
    angle = np.degrees(np.arccos(share))
    said += f"{turned}taken off, and corrected for {angle:.0f}° between the sensor and the vertical"
    doubt = DEFAULT_OFFSET[channel.quantity] / (share * STANDARD_GRAVITY)
    return MountingCorrection(np.sign(mean) * (values - mean) / share, said, doubt, by_gravity=True)

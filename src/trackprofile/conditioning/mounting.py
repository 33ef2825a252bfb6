"""How a sensor is mounted, as far as its own signal tells: gravity, sign and angle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Channel
from trackprofile.sensor import OFFSET, VERTICAL_ACCELERATION
from trackprofile.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

GRAVITY = 0.5
"""Share of gravity in the mean from which an accelerometer is taken to measure it: 60° off the vertical."""

UPRIGHT = 0.05
"""Share by which that may differ from the whole of it, before an angle is worth a correction: 18°."""

TOO_FAR = 5.0
"""Usual offsets from which one is said and taken off."""


def freed_of_gravity(channel: Channel, valid: NDArray[np.bool_]) -> tuple[Array, str]:
    """A signal, (n,), upwards and without gravity or a great offset, and a sentence that says so if anything was done.

    At rest an accelerometer that measures upwards reads +g, one that hangs upside down -g, and one at an angle ε to
    the vertical g cos ε, and cos ε of every vertical acceleration.

    Examples
    --------
    >>> hanging = Channel("floor", np.array([-9.9, -9.8, -9.7]), "vertical acceleration", "body", 0.0)
    >>> values, said = freed_of_gravity(hanging, np.ones(3, bool))
    >>> values.round(3), said
    (array([ 0.1, -0. , -0.1]), "'floor' reads gravity, -9.8 m/s²: turned upside down, and taken off")
    """
    values = np.asarray(channel.values, np.float64)
    mean = float(np.median(values[valid]))
    if abs(mean) <= TOO_FAR * OFFSET[channel.quantity]:
        return values, ""
    share = abs(mean) / STANDARD_GRAVITY
    if channel.quantity != VERTICAL_ACCELERATION or share < GRAVITY:
        return values - mean, f"{channel.name!r} has an offset of {mean:.3g}, taken off: check it"
    said = f"{channel.name!r} reads gravity, {mean:.3g} m/s²: "
    turned = "turned upside down, and " if mean < 0 else ""
    if share > 1.0 - UPRIGHT:
        return np.sign(mean) * (values - mean), f"{said}{turned}taken off"
    angle = np.degrees(np.arccos(share))
    said += f"{turned}taken off, and corrected for {angle:.0f}° between the sensor and the vertical"
    return np.sign(mean) * (values - mean) / share, said

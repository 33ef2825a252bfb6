"""Mounting of an accelerometer, determined from gravity in its own signal: sign, tilt and offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Channel
from trackprofile.models.sensor import DEFAULT_OFFSET, VERTICAL_ACCELERATION
from trackprofile.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

MIN_GRAVITY_SHARE = 0.5
"""Smallest mean over gravity at which an accelerometer is taken to measure gravity: a tilt of 60°."""

UPRIGHT_TOLERANCE = 0.05
"""Largest 1 - cos ε of a tilt ε that is not corrected: 18°."""

MAX_OFFSET_RATIO = 5.0
"""Mean over the sensor's standard offset from which the mean is reported and subtracted."""


@dataclass(frozen=True)
class MountingCorrection:
    """A signal upwards, without gravity and large offset.

    Parameters
    ----------
    values : (n,)
    note : what was corrected; "" if nothing
    gain_std : relative standard deviation of the gain after a tilt correction, since an offset looks like a tilt;
        else 0
    by_gravity : whether gravity determined the sign of the signal
    """

    values: Array
    note: str = ""
    gain_std: float = 0.0
    by_gravity: bool = False


def correct_mounting(channel: Channel, valid: NDArray[np.bool_]) -> MountingCorrection:
    """Subtract gravity and a large offset, and correct sign and tilt of an accelerometer.

    At rest a vertical accelerometer measures +g, an inverted one -g, and one with a tilt ε measures g cos ε; then it
    measures cos ε of each vertical acceleration.

    Parameters
    ----------
    channel : signal of n samples
    valid : (n,), samples whose median is taken

    Examples
    --------
    >>> inverted = Channel("floor", np.array([-9.9, -9.8, -9.7]), "vertical acceleration", "body", 0.0)
    >>> corrected = correct_mounting(inverted, np.ones(3, bool))
    >>> corrected.values.round(3), corrected.note
    (array([ 0.1, -0. , -0.1]), "'floor' measures gravity, -9.8 m/s²: inverted, gravity subtracted")
    """
    values = np.asarray(channel.values, np.float64)
    mean = float(np.median(values[valid]))
    if abs(mean) <= MAX_OFFSET_RATIO * DEFAULT_OFFSET[channel.quantity]:
        return MountingCorrection(values)
    share = abs(mean) / STANDARD_GRAVITY
    if channel.quantity != VERTICAL_ACCELERATION or share < MIN_GRAVITY_SHARE:
        note = f"{channel.name!r} has an offset of {mean:.3g}: subtracted; check the sensor"
        return MountingCorrection(values - mean, note)
    inverted = "inverted, " if mean < 0 else ""
    note = f"{channel.name!r} measures gravity, {mean:.3g} m/s²: {inverted}gravity subtracted"
    if share > 1.0 - UPRIGHT_TOLERANCE:
        return MountingCorrection(np.sign(mean) * (values - mean), note, by_gravity=True)
    tilt = np.degrees(np.arccos(share))
    note += f", corrected for a tilt of {tilt:.0f}° from the vertical"
    gain_std = DEFAULT_OFFSET[channel.quantity] / (share * STANDARD_GRAVITY)
    corrected = np.sign(mean) * (values - mean) / share
    return MountingCorrection(corrected, note, gain_std, by_gravity=True)

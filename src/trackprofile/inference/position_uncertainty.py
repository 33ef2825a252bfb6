"""How well the places of a profile are known, and by which scale its distance is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts.validation import DEVIATION
from trackprofile.models.sensor import Installation
from trackprofile.preprocessing.motion import deviation_of_counting

Array = NDArray[np.float64]

LEAST = 2e-4
"""Of a scale's logarithm, from which it is asked whose it is."""

NORMAL_95 = 1.96
"""Standard deviations to each side that hold 95 %."""


def correct_wheel_scale(
    installation: Installation, recording: xr.Dataset
) -> tuple[Installation, tuple[str, ...]]:
    """The installation without a distance scale that positions have put right already, and a sentence on that.

    A calibration on a recording whose wheel was not told finds the wheel's scale; where positions have told it, the
    distance is true, and the scale that is nearer to the wheel's than to 1 is not applied again.
    """
    stated = float(np.log(installation.distance_scale))
    wheel = float(np.log(recording.attrs.get("wheel_scale", 1.0)))
    if abs(stated) < LEAST or abs(stated - wheel) >= abs(stated):
        return installation, ()
    return replace(installation, distance_scale=1.0), (
        f"the calibration's distance scale, {installation.distance_scale:.5f}, is the wheel's, by which positions have "
        f"put the distance right ({recording.attrs['wheel_scale']:.5f}): not applied again",
    )


def position_standard_deviation(
    place: Array, run: Array, recording: xr.Dataset
) -> tuple[Array | None, tuple[str, ...]]:
    """Standard deviation of where points are, (n,) m, and a sentence on it; None where nobody can say.

    What the recording says of its places; or what is left open by a speed in steps from which they are counted.

    Parameters
    ----------
    place : (n,), m
    run : (samples,), where the leading wheel stood, m
    """
    stated, counted = recording.get(DEVIATION), ""
    known = _of_counting(recording) if stated is None else stated.to_numpy()
    if known is None:
        return None, ()
    if stated is None:
        counted = " from where the recording starts, counted by its speed in steps"
    found = np.interp(place, run, known)
    usual, worst = NORMAL_95 * float(np.median(found)), NORMAL_95 * float(np.max(found))
    at_worst = f", at worst ±{worst:.2g} m" if worst > 1.5 * usual else ""
    return found, (f"places are known to ±{usual:.2g} m (95 %){at_worst}{counted}",)


def _of_counting(recording: xr.Dataset) -> Array | None:
    if "distance" in recording:
        return None
    speed, time = (recording[name].to_numpy().astype(np.float64) for name in ("speed", "time"))
    return deviation_of_counting(speed, time)

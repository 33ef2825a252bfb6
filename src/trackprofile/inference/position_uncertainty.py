"""Standard deviation of the positions of a profile, and the scale of its distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.arrays import NORMAL_95
from trackprofile.contracts.validation import DISTANCE_DEVIATION
from trackprofile.models.sensor import Installation
from trackprofile.preprocessing.motion import dead_reckoning_std

Array = NDArray[np.float64]

MIN_SCALE = 2e-4
"""Logarithm of a distance scale from which it is compared with the wheel's scale, dimensionless."""


def correct_wheel_scale(
    installation: Installation, recording: xr.Dataset
) -> tuple[Installation, tuple[str, ...]]:
    """The installation without a distance scale that positioning has corrected already, and a sentence on it.

    A calibration on a recording with an uncorrected odometer estimates the scale of its wheel. Where positioning has
    corrected the distance, a calibrated scale that is nearer to the wheel's than to 1 is not applied again.
    """
    stated = float(np.log(installation.distance_scale))
    wheel = float(np.log(recording.attrs.get("wheel_scale", 1.0)))
    if abs(stated) < MIN_SCALE or abs(stated - wheel) >= abs(stated):
        return installation, ()
    return replace(installation, distance_scale=1.0), (
        f"the calibrated distance scale {installation.distance_scale:.5f} is that of the wheel, which positioning has "
        f"corrected already ({recording.attrs['wheel_scale']:.5f}): it is not applied again",
    )


def position_standard_deviation(
    position: Array, sample_distance: Array, recording: xr.Dataset
) -> tuple[Array | None, tuple[str, ...]]:
    """Standard deviation of positions, (n,) m, and a sentence on it; None where it is unknown.

    It is the recording's own ``distance_deviation``, or the uncertainty of integrating a quantised speed.

    Parameters
    ----------
    position : (n,), m
    sample_distance : (samples,), position of the leading wheel, m
    """
    stated, counted = recording.get(DISTANCE_DEVIATION), ""
    known = _integration_deviation(recording) if stated is None else stated.to_numpy()
    if known is None:
        return None, ()
    if stated is None:
        counted = " relative to the start of the recording, integrated from a quantised speed"
    deviation = np.interp(position, sample_distance, known)
    median, largest = NORMAL_95 * float(np.median(deviation)), NORMAL_95 * float(np.max(deviation))
    at_most = f", at most ±{largest:.2g} m" if largest > 1.5 * median else ""
    return deviation, (f"positions are known to ±{median:.2g} m (95 %){at_most}{counted}",)


def _integration_deviation(recording: xr.Dataset) -> Array | None:
    if "distance" in recording:
        return None
    speed, time = (recording[name].to_numpy().astype(np.float64) for name in ("speed", "time"))
    return dead_reckoning_std(speed, time)

"""A recording as read from a file, where positions along the track have yet to be estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import build_recording
from trackprofile.io import table
from trackprofile.positioning.sources import POSITION_PREFIX, Sources

Array = NDArray[np.float64]

DIRECTIONS = ("with the kilometrage", "against the kilometrage")
"""Directions of travel that position sources can confirm or correct."""


@dataclass(frozen=True, eq=False)
class UnlocatedRecording:
    """Channels over time, and the position sources from which their distance is estimated.

    `trackprofile.reader.locate_recording` makes a recording of it.

    Parameters
    ----------
    data : table that was read, for messages
    columns : its column by variable, for messages
    sources : GNSS positions, wheel odometry, kilometre posts, displayed speed and chainage table
    fields : arguments of `build_recording` by name, without those that positions give
    """

    data: Path
    columns: Mapping[str, str]
    sources: Sources
    fields: Mapping[str, Any]

    @property
    def time(self) -> Array:
        """Times of the samples, (samples,) [s]."""
        return self.fields["time"]

    def located(
        self,
        *,
        distance: Array,
        speed: Array,
        distance_deviation: Array,
        wheel_scale: float,
        faults: NDArray[np.int8],
        direction: str,
        notes: Sequence[str],
    ) -> xr.Dataset:
        """Recording with estimated positions, validated.

        Parameters
        ----------
        distance, speed, distance_deviation : at the samples, (samples,) [m, m/s, m]
        wheel_scale : true diameter of the wheel over its nominal diameter
        faults : (samples,), sums of `trackprofile.preprocessing.faults.ClockFault`
        direction : estimated direction of travel, one of `DIRECTIONS`; "" where it is not determined
        notes : sentences on the estimation

        Raises
        ------
        DataError : see `validate_recording`.
        """
        fields, stated = dict(self.fields), self.fields["direction"]
        steps = [*fields.pop("provenance"), *(POSITION_PREFIX + note for note in notes)]
        if direction:
            if stated in DIRECTIONS and stated != direction:
                steps.append(f"{POSITION_PREFIX}the train runs {direction}, not {stated} as stated")
            if stated in {"", *DIRECTIONS}:
                fields["direction"] = direction
        fields |= {"distance": distance, "speed": speed, "wheel_scale": wheel_scale}
        fields |= {"distance_deviation": distance_deviation}
        fields["clock_fault"] = fields["clock_fault"] + faults
        with table.error_location(self.data, self.columns):
            return build_recording(**fields, provenance=steps)

"""Which end of a vehicle leads: as the recording says, or as the order in which its sensors feel the track."""

from __future__ import annotations

import xarray as xr

from trackprofile.contracts.recording import LAST, leading_end
from trackprofile.errors import DataError
from trackprofile.inference.measured import Measured
from trackprofile.inference.wiring import rewired, turned_sensors
from trackprofile.track import PointTrack
from trackprofile.vehicle import Vehicle, turned_round


def facing(
    data: Measured, recording: xr.Dataset, vehicle: Vehicle, track: PointTrack
) -> tuple[Measured, Vehicle]:
    """What was measured, with what was exchanged put right, and the vehicle with the end first that leads.

    Raises
    ------
    DataError
        See :func:`trackprofile.inference.wiring.rewired`.
    """
    if leading_end(recording) == LAST:
        data = turned_sensors(data)
    found = rewired(data, turned_round(vehicle) if data.turned else vehicle, track)
    return found, turned_round(vehicle) if found.turned else vehicle


def expect_as_described(recording: xr.Dataset, verb: str) -> None:
    """Refuse a recording whose vehicle ran the other way round.

    Raises
    ------
    DataError
        The verb knows the vehicle only as it is described.
    """
    if leading_end(recording) == LAST:
        raise DataError(
            f"The last wheel of the vehicle leads (leading_end), which {verb} does not know; expected the first: take "
            "a recording of the other direction."
        )

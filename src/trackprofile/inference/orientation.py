"""Which end of a vehicle leads: as the recording says, or as the order in which its sensors feel the track."""

from __future__ import annotations

from dataclasses import replace

import xarray as xr

from trackprofile.contracts.recording import LAST, leading_end
from trackprofile.errors import DataError
from trackprofile.inference.channel_assignment import assign_channels, turned_sensors
from trackprofile.inference.observations import Observations
from trackprofile.inference.rail_decomposition import RailDecomposition, decompose_rails
from trackprofile.models.sensor import Installation
from trackprofile.models.track import PointTrack
from trackprofile.models.vehicle import Vehicle, reversed_vehicle


def orient(
    data: Observations, recording: xr.Dataset, vehicle: Vehicle, track: PointTrack, installation: Installation
) -> tuple[RailDecomposition, Vehicle]:  # fmt: skip
    """What was measured, taken apart, with what was exchanged put right, and the vehicle with the end first that leads.

    Raises
    ------
    DataError
        See `trackprofile.inference.channel_assignment.assign_channels` and
        `trackprofile.inference.rail_decomposition.decompose_rails`.
    """

    def ahead(turned: bool) -> Vehicle:
        return reversed_vehicle(vehicle) if turned else vehicle

    if leading_end(recording) == LAST:
        data = turned_sensors(data)
    sides = decompose_rails(data, ahead(data.turned), track, installation)
    mean = assign_channels(sides.mean, ahead(data.turned), track)
    if mean.turned != data.turned:
        # What stood to the left stands to the right.
        sides = decompose_rails(turned_sensors(data), ahead(mean.turned), track, installation)
    return replace(sides, mean=mean), ahead(mean.turned)


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

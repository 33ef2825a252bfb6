"""Leading end of the vehicle: as the recording states, or from the order in which the sensors pass over the track."""

from __future__ import annotations

from dataclasses import replace

import xarray as xr

from trackprofile.contracts.recording import LAST_END, leading_end
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
    """Observations decomposed by rails, with exchanged channels corrected, and the vehicle with its leading end first.

    Raises
    ------
    DataError
        See `trackprofile.inference.channel_assignment.assign_channels` and
        `trackprofile.inference.rail_decomposition.decompose_rails`.
    """

    def oriented(turned: bool) -> Vehicle:
        return reversed_vehicle(vehicle) if turned else vehicle

    if leading_end(recording) == LAST_END:
        data = turned_sensors(data)
    rails = decompose_rails(data, oriented(data.turned), track, installation)
    mean = assign_channels(rails.mean, oriented(data.turned), track)
    if mean.turned != data.turned:
        # The left side has become the right side.
        rails = decompose_rails(turned_sensors(data), oriented(mean.turned), track, installation)
    return replace(rails, mean=mean), oriented(mean.turned)


def expect_as_described(recording: xr.Dataset, verb: str) -> None:
    """Refuse a recording whose vehicle ran with its last wheel leading.

    Raises
    ------
    DataError
        Where the last wheel leads; ``verb`` names the operation that does not support it.
    """
    if leading_end(recording) == LAST_END:
        raise DataError(
            f"The last wheel of the vehicle leads (leading_end), which {verb} does not support; expected the first "
            "wheel: use a recording of the other direction."
        )

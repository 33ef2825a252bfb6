"""The vehicle that carried a recording's sensors: the one that was named, else the one that the recording names."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from trackprofile.errors import FileError
from trackprofile.io.model_toml import presets, read_vehicle
from trackprofile.models.sensor import Installation
from trackprofile.models.vehicle import Vehicle


def vehicle_of_recording(
    recording: xr.Dataset, path: Path, given: str | None
) -> tuple[Vehicle, Installation]:
    """The vehicle that was given, else the one that the recording names, beside it or a preset.

    Parameters
    ----------
    path : of the recording
    given : a preset's name or a path

    Raises
    ------
    FileError : there is none, or it cannot be read.
    TrackprofileError : as of `read_vehicle`.
    """
    if given is not None:
        return read_vehicle(given)
    named = recording.attrs.get("vehicle", "")
    if not named:
        raise FileError(
            f"{path}: it names no vehicle; say which (--vehicle, or in a manifest): the TOML of one, "
            f"or one of the presets {', '.join(presets('vehicle'))}."
        )
    beside = path.parent / named
    return read_vehicle(beside if beside.is_file() else named)

"""Vehicle of a recording: the given one, else the one that the recording names."""

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
    """Vehicle of a recording: the given one, else the one that the recording names, a file next to it or a preset.

    Parameters
    ----------
    path : file of the recording
    given : name of a preset or path of a TOML; None: the one that the recording names

    Raises
    ------
    FileError : neither is given, or the file cannot be read.
    TrackprofileError : see `read_vehicle`.
    """
    if given is not None:
        return read_vehicle(given)
    named = recording.attrs.get("vehicle", "")
    if not named:
        raise FileError(
            f"{path}: the recording names no vehicle; give one (--vehicle, or in a manifest): the path of a TOML, or "
            f"one of the presets {', '.join(presets('vehicle'))}."
        )
    file = path.parent / named
    return read_vehicle(file if file.is_file() else named)

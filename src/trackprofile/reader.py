"""Reading recordings and profiles from files: `trackprofile.io` reads, `trackprofile.positioning` then estimates."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from trackprofile import io
from trackprofile.io import inspection
from trackprofile.io.inspection import Inspection
from trackprofile.io.table import error_location
from trackprofile.io.unlocated_recording import UnlocatedRecording


def read(path: str | Path) -> xr.Dataset:
    """The recording or profile in a file, in SI units, validated.

    A recording gets its identity from the raw content of the file. Positions are estimated after that, where the
    file has position sources (GNSS, wheel odometry, kilometre posts) instead of a distance.

    Parameters
    ----------
    path : file in one of the formats of `trackprofile.io`

    Raises
    ------
    FileError : the file does not exist, or does not hold what its suffix promises.
    DataError : its contents cannot be used; the message names file, column and row.

    Examples
    --------
    >>> read("run.docx")
    Traceback (most recent call last):
    trackprofile.errors.FileError: run.docx: expected a file that ends in .nc, .csv, ...
    """
    content = io.read(path)
    return locate_recording(content) if isinstance(content, UnlocatedRecording) else content


def locate_recording(recording: UnlocatedRecording) -> xr.Dataset:
    """A recording with positions estimated from its position sources, validated.

    Raises
    ------
    DataError : the sources do not determine the position, or contradict each other.
    """
    # Numba, which this imports, takes a third of a second; most recordings do without.
    from trackprofile.positioning.locate import locate

    with error_location(recording.data, recording.columns):
        estimate = locate(recording.sources, recording.time)
    return recording.located(
        distance=estimate.distance,
        speed=estimate.speed,
        distance_deviation=estimate.standard_deviation,
        wheel_scale=estimate.wheel_scale,
        faults=estimate.clock_fault,
        direction=estimate.direction,
        notes=estimate.notes,
    )


def inspect(path: str | Path) -> Inspection:
    """Columns of a logger's file, a TOML that describes them, and the recording that it gives.

    Raises
    ------
    FileError : the file does not exist, is not readable, or is of an unknown format.
    """
    return inspection.inspect(path, locate_recording)

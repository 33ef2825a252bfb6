"""Reading and writing, by suffix; one small module per format.

======================  ===================================================================
suffix                  what it holds
======================  ===================================================================
``.nc``                 either contract, whole
``.csv``, ``.parquet``  a profile: ``distance_m``, ``elevation_m``, ``standard_deviation_m`` ...
``.toml``               a recording: which column of the table beside it is what
``.csv``, ``.parquet``  that table itself, if its TOML stands beside it under the same name
======================  ===================================================================

A new format is a new module with the six names of `Format`, and one more line in `FORMATS`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import xarray as xr

from trackprofile.contracts import validate
from trackprofile.errors import FileError
from trackprofile.io import netcdf, profile_table, recording_toml
from trackprofile.io.unlocated_recording import UnlocatedRecording as UnlocatedRecording


class Format(Protocol):
    """What a module must have to be a format.

    ``NAME`` says what it holds, ``HOLDS`` which contracts, ``SUFFIXES`` how its files may end.
    `sniff` tells whether a file with such a suffix is of this format.
    """

    @property
    def NAME(self) -> str: ...
    @property
    def HOLDS(self) -> tuple[str, ...]: ...
    @property
    def SUFFIXES(self) -> tuple[str, ...]: ...
    def sniff(self, path: Path) -> bool: ...
    def read(self, path: Path) -> xr.Dataset | UnlocatedRecording: ...
    def write(self, dataset: xr.Dataset, path: Path) -> tuple[Path, ...]: ...


FORMATS: tuple[Format, ...] = (netcdf, profile_table, recording_toml)


def read(path: str | Path) -> xr.Dataset | UnlocatedRecording:
    """The recording or profile in a file, in SI units, validated; nothing is estimated.

    A file with position sources (GNSS, wheel odometry, kilometre posts) gives an `UnlocatedRecording`, of which
    `trackprofile.read` estimates the positions.

    Raises
    ------
    FileError : there is no such file, or it is not what its suffix promises.
    DataError : its contents cannot be used; the message names file, column and row.

    Examples
    --------
    >>> read("run.docx")
    Traceback (most recent call last):
    trackprofile.errors.FileError: run.docx: expected a file that ends in .nc, .csv, ...
    """
    path = Path(path)
    formats = _formats(path)
    if not path.is_file():
        raise FileError(f"{path}: there is no such file; check the path.")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty; copy or record it again.")
    try:
        for one in formats:
            if one.sniff(path):
                return one.read(path)
    except OSError as error:
        # The libraries raise it too, without a reason of the system's, for what they cannot read.
        reason = error.strerror or "damaged or cut short; copy it again"
        raise FileError(f"{path}: cannot be read ({reason}).") from error
    raise FileError(
        f"{path}: expected {', or '.join(one.NAME for one in formats)}; found something else."
    )


def write(dataset: xr.Dataset, path: str | Path) -> tuple[Path, ...]:
    """Write a recording or profile in the format of the path's suffix; all of it, or nothing.

    Returns
    -------
    The files written: a recording as a table has two, the table and the TOML that explains it.

    Raises
    ------
    FileError : the suffix is unknown or cannot hold this contract, or the place is not writable.
    DataError : the dataset does not keep its contract.
    """
    path = Path(path)
    return format_to_write(validate(dataset).attrs["kind_of_data"], path).write(dataset, path)


def format_to_write(kind: str, path: Path) -> Format:
    """The format in which `write` would put a recording or profile there, before there is one.

    Raises
    ------
    FileError : the suffix is unknown or cannot hold it.
    """
    for one in FORMATS:
        if kind in one.HOLDS and path.suffix.lower() in one.SUFFIXES:
            return one
    suffixes = [end for one in FORMATS if kind in one.HOLDS for end in one.SUFFIXES]
    raise FileError(f"{path}: a {kind} is written to a file that ends in {', '.join(suffixes)}.")


def _formats(path: Path) -> tuple[Format, ...]:
    formats = tuple(one for one in FORMATS if path.suffix.lower() in one.SUFFIXES)
    if not formats:
        known = dict.fromkeys(suffix for one in FORMATS for suffix in one.SUFFIXES)
        raise FileError(f"{path}: expected a file that ends in {', '.join(known)}.")
    return formats

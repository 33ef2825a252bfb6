"""Files: reading and writing, by suffix, with one small module per format. Nothing is estimated here.

======================  =======================================================================
suffix                  content
======================  =======================================================================
``.nc``                 a recording or a profile, complete
``.csv``, ``.parquet``  a profile: ``distance_m``, ``elevation_m``, ``standard_deviation_m`` ...
``.toml``               a recording: description of the columns of a table in the same folder
``.csv``, ``.parquet``  that table itself, if its TOML has the same name
======================  =======================================================================

To add a format, add a module with the six names of `Format`, and list it in `FORMATS`.
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
    """Names that a module of a format defines.

    ``NAME`` describes the format for messages, ``HOLDS`` lists its contracts, ``SUFFIXES`` the suffixes of its files.
    `sniff` returns whether a file with such a suffix is of this format.
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
    FileError : the file does not exist, or is not of the format of its suffix.
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
        raise FileError(f"{path}: the file does not exist; check the path.")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty; copy or record it again.")
    try:
        for candidate in formats:
            if candidate.sniff(path):
                return candidate.read(path)
    except OSError as error:
        # Libraries raise it too, without a reason of the operating system, for a file that they cannot read.
        reason = error.strerror or "damaged or cut short; copy it again"
        raise FileError(f"{path}: cannot be read ({reason}).") from error
    raise FileError(
        f"{path}: expected {', or '.join(one.NAME for one in formats)}; choose another file, or correct its columns."
    )


def write(dataset: xr.Dataset, path: str | Path) -> tuple[Path, ...]:
    """Write a recording or profile in the format of the suffix; completely or not at all.

    Returns
    -------
    files written: of a recording as a table both the table and the TOML that describes it

    Raises
    ------
    FileError : the suffix is unknown or is not one of this contract, or the file cannot be written.
    DataError : the dataset violates its contract.
    """
    path = Path(path)
    return format_to_write(validate(dataset).attrs["kind_of_data"], path).write(dataset, path)


def format_to_write(kind: str, path: Path) -> Format:
    """Format in which `write` writes a recording or profile to a path.

    Raises
    ------
    FileError : the suffix is unknown or is not one of this contract.
    """
    for one in FORMATS:
        if kind in one.HOLDS and path.suffix.lower() in one.SUFFIXES:
            return one
    suffixes = [end for one in FORMATS if kind in one.HOLDS for end in one.SUFFIXES]
    raise FileError(
        f"{path}: a {kind} is written to a file that ends in {', '.join(suffixes)}; change the suffix."
    )


def _formats(path: Path) -> tuple[Format, ...]:
    formats = tuple(one for one in FORMATS if path.suffix.lower() in one.SUFFIXES)
    if not formats:
        known = dict.fromkeys(suffix for one in FORMATS for suffix in one.SUFFIXES)
        raise FileError(f"{path}: expected a file that ends in {', '.join(known)}.")
    return formats

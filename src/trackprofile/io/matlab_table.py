"""One-dimensional arrays of numbers in MATLAB files: version 5 to 7 by SciPy, version 7.3 as HDF5.

SciPy reads arrays only: functions and objects in a file are not executed.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat, whosmat
from scipy.io.matlab import MatReadError

from trackprofile.errors import DataError, FileError
from trackprofile.io import hdf5_table
from trackprofile.io.column_info import Column, ColumnInfo, check_size, to_numbers
from trackprofile.io.subprocess_reader import columns_in_subprocess, headings_in_subprocess

SUFFIXES = (".mat",)

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NUMERIC = {
    "double",
    "single",
    "logical",
    *(f"{u}int{b}" for u in ("", "u") for b in (8, 16, 32, 64)),
}
_READ_ERRORS = (
    MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, NotImplementedError, MemoryError,
    OverflowError, AttributeError, struct.error, zlib.error, OSError,
)  # fmt: skip
"""Errors that SciPy raises for files that it cannot read."""

MAX_NAME_LENGTH = 31
"""Maximum number of characters in the name of a variable, version 5."""


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Arrays of numbers in a file; structures and cell arrays are ignored."""
    return headings_in_subprocess(path, __name__)


def read(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """Read arrays by name.

    Raises
    ------
    FileError : the file is damaged, or states more content than it can hold.
    """
    return columns_in_subprocess(path, __name__, names)


def headings_in_process(path: Path) -> tuple[ColumnInfo, ...]:
    """See `headings`; in this process."""
    if _is_hdf5(path):
        return hdf5_table.headings_in_process(path)
    try:
        variables = whosmat(path)
    except _READ_ERRORS as error:
        raise _unreadable_table(path) from error
    return tuple(
        ColumnInfo(name, rows=int(np.prod(shape, dtype=float)))
        for name, shape, kind in variables
        if kind in _NUMERIC and sum(length != 1 for length in shape) == 1
    )


def read_in_process(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """See `read`; in this process."""
    if _is_hdf5(path):
        return hdf5_table.read_in_process(path, names)
    rows = {one.name: one.rows for one in headings_in_process(path) if one.name in names}
    check_size(path, 8.0 * sum(rows.values()))
    try:
        arrays = loadmat(path, variable_names=list(rows), squeeze_me=False)
    except _READ_ERRORS as error:
        raise _unreadable_table(path) from error
    return {name: to_numbers(path, name, np.ravel(arrays[name])) for name in rows if name in arrays}


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write each column as a variable in version 5, which cannot hold units.

    Raises
    ------
    DataError : a name is not a valid name in MATLAB.
    """
    for name in columns:
        if not (name.isidentifier() and name.isascii() and len(name) <= MAX_NAME_LENGTH):
            raise DataError(
                f"{path}: column {name!r}: a name in MATLAB has up to {MAX_NAME_LENGTH} letters, digits and "
                "underscores; rename it, or write another format."
            )
    savemat(path, {name: values[:, None] for name, values in columns.items()}, do_compression=True)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        if file.read(8) == _HDF5_SIGNATURE:
            return True
        file.seek(512)  # MATLAB writes a text of 512 bytes first
        return file.read(8) == _HDF5_SIGNATURE


def _unreadable_table(path: Path) -> FileError:
    return FileError(f"{path}: not a readable MATLAB file; copy or export it again.")

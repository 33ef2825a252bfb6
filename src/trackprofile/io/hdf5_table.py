"""One-dimensional arrays of numbers in HDF5, NetCDF 4 and MATLAB files of version 7.3 or later, which are HDF5."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from trackprofile.errors import FileError
from trackprofile.io.column_info import Column, ColumnInfo, check_size, to_numbers
from trackprofile.io.subprocess_reader import columns_in_subprocess, headings_in_subprocess

SUFFIXES = (".h5", ".hdf5", ".hdf", ".nc")

_UNITS = ("units", "unit", "Units", "Unit")
_MAX_DEPTH = 8


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Arrays of numbers in a file, by path; groups and matrices are ignored."""
    return headings_in_subprocess(path, __name__)


def read(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """Read arrays by name.

    Raises
    ------
    FileError : the file is damaged, or states more content than it can hold.
    """
    return columns_in_subprocess(path, __name__, names)


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write each column as a dataset of the same name, with its unit."""
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values)
            if name in units:
                file[name].attrs["units"] = units[name]


def headings_in_process(path: Path) -> tuple[ColumnInfo, ...]:
    """See `headings`; in this process."""
    with open_hdf5(path) as file:
        return tuple(
            ColumnInfo(name, _unit(one), int(one.size or 0), _clock(file, one))
            for name, one in _rows(file)
        )


def read_in_process(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """See `read`; in this process."""
    with open_hdf5(path) as file:
        rows = {name: one for name, one in _rows(file) if name in names}
        check_size(path, 8.0 * sum(int(one.size or 0) for one in rows.values()))
        return {name: to_numbers(path, name, np.ravel(one[()])) for name, one in rows.items()}


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open a file; errors of the library become a `FileError`."""
    try:
        with h5py.File(path) as file:
            yield file
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, MemoryError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: not a readable HDF5 file; copy or export it again.") from error


def _rows(group: h5py.Group, above: str = "", depth: int = 0) -> Iterator[tuple[str, h5py.Dataset]]:
    """Datasets of numbers with one dimension longer than 1; links to other files are not followed."""
    for key in group:
        name = f"{above}{key}"
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        item = group[key]
        if isinstance(item, h5py.Group):
            # MATLAB keeps the content of cell arrays in groups with this prefix.
            if depth < _MAX_DEPTH and not str(key).startswith("#"):
                yield from _rows(item, f"{name}/", depth + 1)
        elif isinstance(item, h5py.Dataset) and _is_row(item):
            yield name, item


def _is_row(item: h5py.Dataset) -> bool:
    if item.dtype.kind not in "fiub" or item.shape is None or item.external:
        return False
    return sum(length != 1 for length in item.shape) == 1


def _unit(item: h5py.Dataset) -> str:
    for key in _UNITS:
        value = item.attrs.get(key)
        if isinstance(value, bytes):
            return value.decode("utf-8", "replace")
        if isinstance(value, str):
            return value
    return ""


def _clock(file: h5py.File, item: h5py.Dataset) -> str:
    """Name of the coordinate along the dimension of an array, as in NetCDF, if it is a time; else ""."""
    try:
        scales = [one for one in item.dims[0].values() if one.name]
    except (RuntimeError, KeyError):
        return ""
    names = [str(one.name).lstrip("/") for one in scales if "time" in str(one.name).lower()]
    same = [name for name in names if getattr(file[name], "shape", None) == item.shape]
    return same[0] if same else ""

"""Recordings and profiles in NetCDF 4, complete."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import xarray as xr

from trackprofile.contracts import validate
from trackprofile.errors import FileError
from trackprofile.io.atomic import whole_files
from trackprofile.io.column_info import Column
from trackprofile.io.recording_identity import with_content, without_content
from trackprofile.io.subprocess_reader import columns_in_subprocess
from trackprofile.io.table import error_location

NAME = "a recording or profile in NetCDF"
HOLDS = ("recording", "profile")
SUFFIXES = (".nc",)

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def sniff(path: Path) -> bool:
    """Whether the file is HDF5, as NetCDF 4 is."""
    with path.open("rb") as file:
        return file.read(8) == _HDF5_SIGNATURE


def read(path: Path) -> xr.Dataset:
    """Dataset in the file, in memory, validated."""
    columns_in_subprocess(path, __name__, ())
    dataset = _loaded(path)
    with error_location(path):
        return validate(without_content(dataset))


def read_in_process(path: Path, _names: Sequence[str]) -> dict[str, Column]:
    """Read the whole file, to check that reading ends."""
    _loaded(path)
    return {}


def write(dataset: xr.Dataset, path: Path) -> tuple[Path, ...]:
    """Write the dataset with all attributes."""
    dataset = with_content(dataset)
    with whole_files(path) as (file,):
        dataset.to_netcdf(file, engine="h5netcdf")
    return (path,)


def _loaded(path: Path) -> xr.Dataset:
    try:
        # First without h5netcdf, which also writes to standard error if the file is damaged.
        with h5py.File(path) as file:
            dict(file.attrs)
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as file:
            dataset = file.load()
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise FileError(f"{path}: damaged or cut short; copy it again.") from error
    dataset.encoding = {}
    return dataset

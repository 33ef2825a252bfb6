"""Channels of logger files in ASAM MDF 3 and 4, by the library asammdf, which the extra ``mdf`` installs.

Only linear conversions of a channel are applied: MDF also allows formulas as text, which must not be executed.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trackprofile.errors import DataError, FileError
from trackprofile.io.column_info import (
    Column,
    ColumnInfo,
    check_size,
    to_numbers,
    with_unique_names,
)
from trackprofile.io.subprocess_reader import columns_in_subprocess, headings_in_subprocess

SUFFIXES = (".mf4", ".mdf", ".dl3")

_LINEAR_CONVERSIONS = {None, 0, 1, 65535}
"""Conversion types that are none or linear, in both versions; linear is 0 in version 3 and 1 in version 4."""


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Channels of a file, each with the clock of its group."""
    return headings_in_subprocess(path, __name__)


def read(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """Read channels by name, in the units that the file states.

    Raises
    ------
    FileError : asammdf is not installed, or the file is damaged.
    DataError : a channel does not hold numbers, or has a conversion that is not linear.
    """
    return columns_in_subprocess(path, __name__, names)


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write columns of equal length as a group of version 4; its clock is ``time``, or else the row number."""
    asammdf = _library(path)
    count = len(next(iter(columns.values())))
    clock = np.asarray(columns.get("time", np.arange(count)), np.float64)
    signals = [
        asammdf.Signal(np.asarray(values), clock, name=name, unit=units.get(name, ""))
        for name, values in columns.items()
        if name != "time"
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals, comment="trackprofile")
        file.save(path, overwrite=True)


def headings_in_process(path: Path) -> tuple[ColumnInfo, ...]:
    """See `headings`; in this process."""
    with _open_file(path) as file:
        return tuple(heading for heading, _ in _channels(file))


def read_in_process(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """See `read`; in this process."""
    with _open_file(path) as file:
        chosen = [(one, place) for one, place in _channels(file) if one.name in names]
        check_size(path, 8.0 * sum(one.rows for one, _ in chosen))
        return {one.name: _values(path, file, one.name, *place) for one, place in chosen}


@contextmanager
def _open_file(path: Path) -> Iterator[Any]:
    asammdf = _library(path)
    try:
        with path.open("rb") as stream, asammdf.MDF(stream, process_bus_logging=False) as file:
            yield file
    except (DataError, FileError):
        raise
    # The library raises any exception for a damaged file.
    except Exception as error:
        raise FileError(f"{path}: not a readable MDF file; copy or export it again.") from error


def _library(path: Path) -> Any:
    try:
        import asammdf
        from asammdf.blocks import mdf_v3, mdf_v4
    except ImportError as error:
        raise FileError(
            f"{path}: MDF files need the library asammdf; install it: pip install 'trackprofile[mdf]'."
        ) from error
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    for version in (mdf_v3.MDF3, mdf_v4.MDF4):
        # Its own destructor closes what a damaged file never opened, and reports that on standard error.
        version.__del__ = _close_scratch_file
    return asammdf


def _close_scratch_file(self: Any) -> None:
    if (scratch := getattr(self, "_tempfile", None)) is not None:
        scratch.close()


def _channels(file: Any) -> list[tuple[ColumnInfo, tuple[int, int]]]:
    """All channels, with the number of their group and their number in it."""
    found, groups, places = [], [], []
    for g, group in enumerate(file.groups):
        master = file.masters_db.get(g)
        clock = "" if master is None else group.channels[master].name
        for c, channel in enumerate(group.channels):
            rows = int(group.channel_group.cycles_nr)
            found.append(
                ColumnInfo(channel.name, channel.unit or "", rows, "" if c == master else clock)
            )
            groups.append(str(g))
            places.append((g, c))
    return list(zip(with_unique_names(found, groups), places, strict=True))


def _values(path: Path, file: Any, name: str, group: int, number: int) -> Column:
    channel = file.groups[group].channels[number]
    if file.masters_db.get(group) == number:
        return to_numbers(path, name, file.get_master(group))
    conversion = channel.conversion
    kind = None if conversion is None else conversion.conversion_type
    if kind not in _LINEAR_CONVERSIONS:
        raise DataError(
            f"{path}: channel {name!r}: expected a linear conversion; export the channel in physical units."
        )
    raw = to_numbers(path, name, file.get(group=group, index=number, raw=True).samples)
    if conversion is None or kind == 65535 or not hasattr(conversion, "a"):
        return raw
    return conversion.a * raw + conversion.b

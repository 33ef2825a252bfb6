"""Channels of logger files in TDMS, by the library npTDMS, which the extra ``tdms`` installs."""

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

SUFFIXES = (".tdms",)

CLOCK_SUFFIX = " (time)"
"""Suffix of the name of the column with the times of a channel that states only a start and an interval."""


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Channels of a file, and a column of times for each that is sampled at a constant interval."""
    with _open_file(path) as file:
        return tuple(heading for heading, _ in _channels(file))


def read(path: Path, names: Sequence[str]) -> dict[str, Column]:
    """Read channels by name.

    Raises
    ------
    FileError : npTDMS is not installed, or the file is damaged.
    DataError : a channel does not hold numbers.
    """
    with _open_file(path) as file:
        chosen = [(one, channel) for one, channel in _channels(file) if one.name in names]
        check_size(path, 8.0 * sum(one.rows for one, _ in chosen))
        return {
            one.name: to_numbers(
                path, one.name, channel.time_track() if _is_clock(one) else channel[:]
            )
            for one, channel in chosen
        }


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write each column as a channel of one group, with its unit."""
    nptdms = _library(path)
    channels = [
        nptdms.ChannelObject(
            "recording",
            name,
            np.asarray(values, np.uint8) if values.dtype == bool else np.asarray(values),
            properties={"unit_string": units.get(name, "")},
        )
        for name, values in columns.items()
    ]
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


@contextmanager
def _open_file(path: Path) -> Iterator[Any]:
    nptdms = _library(path)
    try:
        with path.open("rb") as stream, nptdms.TdmsFile.open(stream) as file:
            yield file
    except (DataError, FileError):
        raise
    # The library raises any exception for a damaged file.
    except Exception as error:
        raise FileError(f"{path}: not a readable TDMS file; copy or export it again.") from error


def _library(path: Path) -> Any:
    try:
        import nptdms
        from nptdms.log import log_manager
    except ImportError as error:
        raise FileError(
            f"{path}: TDMS files need the library npTDMS; install it: pip install 'trackprofile[tdms]'."
        ) from error
    log_manager.set_level(logging.CRITICAL)
    return nptdms


def _channels(file: Any) -> list[tuple[ColumnInfo, Any]]:
    """All channels, each preceded by its clock."""
    found, groups, channels = [], [], []
    for group in file.groups():
        for channel in group.channels():
            unit = str(channel.properties.get("unit_string", ""))
            even = float(channel.properties.get("wf_increment", 0.0) or 0.0) > 0.0
            clock = channel.name + CLOCK_SUFFIX if even else ""
            if even:
                found.append(ColumnInfo(clock, "s", len(channel)))
            found.append(ColumnInfo(channel.name, unit, len(channel), clock))
            groups += [group.name] * (1 + even)
            channels += [channel] * (1 + even)
    return list(zip(with_unique_names(found, groups), channels, strict=True))


def _is_clock(heading: ColumnInfo) -> bool:
    return heading.name.endswith(CLOCK_SUFFIX)

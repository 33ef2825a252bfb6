"""Information about the columns of a table, which every format gives before they are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError, FileError

Column = NDArray[Any]

UNCHECKED_SIZE = 1 << 28
"""Size of content up to which the stated size is not checked [B]; above, it is at most `MAX_COMPRESSION` times the
size of the file."""

MAX_COMPRESSION = 1000
"""Compression ratio of a channel that hardly changes."""


@dataclass(frozen=True)
class ColumnInfo:
    """A column of a table, or a channel of a file of a logger.

    Parameters
    ----------
    name : unique name
    unit : as the file states it; "": not stated
    rows : number of values; 0: known only after reading
    clock : name of the column with the times of its values; "": not stated
    form : of text: one of `trackprofile.io.timestamps.TIMESTAMP_FORMS`, or "text"; "": numbers
    """

    name: str
    unit: str = ""
    rows: int = 0
    clock: str = ""
    form: str = ""


def with_unique_names(
    headings: Sequence[ColumnInfo], groups: Sequence[str]
) -> tuple[ColumnInfo, ...]:
    """Column information in which a name that occurs in several groups is preceded by its group.

    Examples
    --------
    >>> columns = (ColumnInfo("a", clock="t"), ColumnInfo("t"), ColumnInfo("a", clock="t"), ColumnInfo("t"))
    >>> [(one.name, one.clock) for one in with_unique_names(columns, ("1", "1", "2", "2"))]
    [('1/a', '1/t'), ('1/t', ''), ('2/a', '2/t'), ('2/t', '')]
    """
    names = [one.name for one in headings]

    def full(name: str, group: str) -> str:
        return f"{group}/{name}" if names.count(name) > 1 else name

    return tuple(
        replace(one, name=full(one.name, group), clock=one.clock and full(one.clock, group))
        for one, group in zip(headings, groups, strict=True)
    )


def check_size(path: Path, stated_size: float) -> None:
    """Refuse a file that states more content than it can contain.

    Raises
    ------
    FileError : the stated size is impossible; a damaged length could otherwise exhaust the memory.
    """
    if stated_size > max(UNCHECKED_SIZE, MAX_COMPRESSION * path.stat().st_size):
        raise FileError(
            f"{path}: the file states a content of {stated_size / 1e9:.3g} GB, more than its "
            f"{path.stat().st_size / 1e6:.3g} MB can hold: damaged; copy it again."
        )


def to_numbers(path: Path, name: str, values: Any) -> Column:
    """Values of a column as float64.

    Raises
    ------
    DataError : it does not hold numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiub" or array.ndim != 1:
        raise DataError(
            f"{path}: column {name!r}: expected a one-dimensional array of numbers, got {array.dtype} of shape "
            f"{array.shape}; choose another column."
        )
    return array.astype(np.float64, copy=False)

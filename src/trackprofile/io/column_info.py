"""What every format of a table says of its columns before they are read."""

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
"""That a file may claim to hold whatever its size; beyond, no more than ``MAX_COMPRESSION`` times its size."""

MAX_COMPRESSION = 1000
"""What compression makes of a channel that hardly changes."""


@dataclass(frozen=True)
class ColumnInfo:
    """A column of a table, or a channel of a logger's file.

    Parameters
    ----------
    name : by which it is asked for; unique
    unit : as the file states it, "" where it does not
    rows : values it has; 0 where that is known only by reading
    clock : the name of the column with the times of its values; "" where the file does not say
    form : of a text: one of `trackprofile.io.timestamps.TIMESTAMP_FORMS` or "text"; "" is a number
    """

    name: str
    unit: str = ""
    rows: int = 0
    clock: str = ""
    form: str = ""


def with_unique_names(
    headings: Sequence[ColumnInfo], groups: Sequence[str]
) -> tuple[ColumnInfo, ...]:
    """Headings with the group before each name that another group has too.

    Examples
    --------
    >>> two = (ColumnInfo("a", clock="t"), ColumnInfo("t"), ColumnInfo("a", clock="t"), ColumnInfo("t"))
    >>> [(one.name, one.clock) for one in with_unique_names(two, ("1", "1", "2", "2"))]
    [('1/a', '1/t'), ('1/t', ''), ('2/a', '2/t'), ('2/t', '')]
    """
    names = [one.name for one in headings]

    def full(name: str, group: str) -> str:
        return f"{group}/{name}" if names.count(name) > 1 else name

    return tuple(
        replace(one, name=full(one.name, group), clock=one.clock and full(one.clock, group))
        for one, group in zip(headings, groups, strict=True)
    )


def check_size(path: Path, claimed: float) -> None:
    """Refuse a file that claims to hold more bytes than can be in it.

    Raises
    ------
    FileError : a damaged length would make a small file fill the memory.
    """
    if claimed > max(UNCHECKED_SIZE, MAX_COMPRESSION * path.stat().st_size):
        raise FileError(
            f"{path}: it claims to hold {claimed / 1e9:.3g} GB, more than can be packed into its "
            f"{path.stat().st_size / 1e6:.3g} MB: damaged; copy it again."
        )


def to_numbers(path: Path, name: str, values: Any) -> Column:
    """A column as float64.

    Raises
    ------
    DataError : it holds something else.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiub" or array.ndim != 1:
        raise DataError(
            f"{path}: column {name!r} does not hold numbers in a row (it is {array.dtype} of shape {array.shape}); "
            "choose another."
        )
    return array.astype(np.float64, copy=False)

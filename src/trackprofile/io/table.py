"""Tables of numbers, by column, in every format that has one: what profiles and recordings share.

================================================  ============================================================
suffix                                            format
================================================  ============================================================
``.csv``, ``.txt``, ``.tsv``, ``.dat``, ``.asc``  CSV in any dialect: :mod:`trackprofile.io.csv_dialect`
``.parquet``                                      Parquet
``.h5``, ``.hdf5``, ``.hdf``, ``.nc``             HDF5 and NetCDF 4: rows of numbers by their path
``.mat``                                          MATLAB, version 5 to 7.3
``.mf4``, ``.mdf``                                ASAM MDF, with the extra ``mdf``
``.tdms``                                         TDMS, with the extra ``tdms``
================================================  ============================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow as pa

from trackprofile.errors import DataError, FileError, RowError
from trackprofile.io import (
    csv_table,
    hdf5_table,
    matlab_table,
    mdf_table,
    parquet_table,
    tdms_table,
)
from trackprofile.io.column_info import Column, ColumnInfo

_ARROW = (csv_table, parquet_table)
_ROWS = (hdf5_table, matlab_table, mdf_table, tdms_table)

SUFFIXES = (*csv_table.SUFFIXES[:1], *parquet_table.SUFFIXES)
"""Of tables that speak for themselves, by their columns' names."""

LOGGER_SUFFIXES = tuple(
    dict.fromkeys(suffix for module in (*_ARROW, *_ROWS) for suffix in module.SUFFIXES)
)
"""Of all that a TOML can explain."""


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """The columns of a table, and what it says of them.

    Raises
    ------
    FileError : it is not a table, or its suffix is none of `LOGGER_SUFFIXES`.
    """
    return _module(path).headings(path)


def column_names(path: Path) -> list[str]:
    """The columns of a table.

    Raises
    ------
    FileError : it is not a table.
    """
    return [heading.name for heading in headings(path)]


def read_columns(
    path: Path, numbers: Sequence[str], flags: Sequence[str] = (), texts: Sequence[str] = ()
) -> dict[str, Column]:
    """Some columns of a table, by name: numbers as float (empty is NaN), flags as bool, texts as they stand.

    Raises
    ------
    DataError : a column is missing or there twice, or a row is cut short or holds no number.
    FileError : the file is not a table.
    """
    names = column_names(path)
    for name in (*numbers, *flags, *texts):
        if names.count(name) != 1:
            found = "is there twice" if name in names else "is missing"
            raise DataError(f"{path}: column {name!r} {found}; the columns are {', '.join(names)}.")
    module = _module(path)
    if module in _ROWS:
        return _read_rows(path, module, numbers, flags, texts)
    schema = pa.schema(
        dict.fromkeys(numbers, pa.float64())
        | dict.fromkeys(flags, pa.bool_())
        | dict.fromkeys(texts, pa.string())
    )
    table = module.read(path, schema)
    return {name: _array(path, name, table[name]) for name in schema.names}


def write_columns(
    path: Path, columns: Mapping[str, Column], units: Mapping[str, str] | None = None
) -> None:
    """Write columns of equal length, with their units where the format has a place for them.

    Raises
    ------
    DataError : the format cannot have a column of that name.
    """
    _module(path).write(path, columns, units or {})


@contextmanager
def error_location(where: Path | str, columns: Mapping[str, str] | None = None) -> Iterator[None]:
    """Errors about data, raised inside, gain the place, and the column in place of the variable."""
    try:
        yield
    except RowError as error:
        column = (columns or {}).get(error.variable, error.variable)
        raise RowError(f"{where}: column {column!r}", error.row, error.problem) from error
    except DataError as error:
        raise type(error)(f"{where}: {error}") from error


def _module(path: Path) -> ModuleType:
    for module in (*_ARROW, *_ROWS):
        if path.suffix.lower() in module.SUFFIXES:
            return module
    raise FileError(f"{path}: expected a table that ends in {', '.join(LOGGER_SUFFIXES)}.")


def _read_rows(
    path: Path,
    module: ModuleType,
    numbers: Sequence[str],
    flags: Sequence[str],
    texts: Sequence[str],
) -> dict[str, Column]:
    if texts:
        raise DataError(f"{path}: column {texts[0]!r} holds numbers, no text; give its unit.")
    reading: Callable[[Path, Sequence[str]], dict[str, Column]] = module.read
    found = reading(path, [*numbers, *flags])
    for name in flags:
        wrong = ~np.isin(found[name], (0.0, 1.0))
        if wrong.any():
            row = int(np.argmax(wrong))
            problem = f"expected 1 or 0, found {found[name][row]:g}."
            raise RowError(f"{path}: column {name!r}", row + 1, problem)
        found[name] = found[name].astype(bool)
    return found


def _array(path: Path, name: str, column: pa.ChunkedArray) -> Column:
    if pa.types.is_boolean(column.type) and column.null_count:
        row = int(np.argmax(column.is_null().to_numpy())) + 1
        raise RowError(f"{path}: column {name!r}", row, "expected 1 or 0, found an empty cell.")
    return column.to_numpy()

"""Tables of numbers by column, in all formats; used for profiles and recordings.

================================================  ============================================================
suffix                                            format
================================================  ============================================================
``.csv``, ``.txt``, ``.tsv``, ``.dat``, ``.asc``  CSV in any dialect: :mod:`trackprofile.io.csv_dialect`
``.parquet``                                      Parquet
``.h5``, ``.hdf5``, ``.hdf``, ``.nc``             HDF5 and NetCDF 4: arrays of numbers by path
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
"""Suffixes of tables whose column names are sufficient."""

LOGGER_SUFFIXES = tuple(
    dict.fromkeys(suffix for module in (*_ARROW, *_ROWS) for suffix in module.SUFFIXES)
)
"""Suffixes of all tables that a TOML can describe."""


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Information about the columns of a table.

    Raises
    ------
    FileError : the file is not a table, or its suffix is not one of `LOGGER_SUFFIXES`.
    """
    return _module(path).headings(path)


def column_names(path: Path) -> list[str]:
    """Names of the columns of a table.

    Raises
    ------
    FileError : the file is not a table.
    """
    return [heading.name for heading in headings(path)]


def read_columns(
    path: Path, numbers: Sequence[str], flags: Sequence[str] = (), texts: Sequence[str] = ()
) -> dict[str, Column]:
    """Read columns of a table by name: numbers as float64 (an empty cell is NaN), flags as bool, texts unchanged.

    Raises
    ------
    DataError : a column is missing or occurs twice, or a row is cut short or does not hold a number.
    FileError : the file is not a table.
    """
    names = column_names(path)
    for name in (*numbers, *flags, *texts):
        if names.count(name) != 1:
            problem = "occurs twice" if name in names else "is missing"
            raise DataError(
                f"{path}: column {name!r} {problem}; the columns are {', '.join(names)}."
            )
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
    """Write columns of equal length, with their units where the format can hold them.

    Raises
    ------
    DataError : a column name is not valid in the format.
    """
    _module(path).write(path, columns, units or {})


@contextmanager
def error_location(where: Path | str, columns: Mapping[str, str] | None = None) -> Iterator[None]:
    """Add the file to the message of a data error that is raised inside, and replace its variable by the column."""
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
        raise DataError(f"{path}: column {texts[0]!r} holds numbers and not text; give its unit.")
    reading: Callable[[Path, Sequence[str]], dict[str, Column]] = module.read
    values = reading(path, [*numbers, *flags])
    for name in flags:
        wrong = ~np.isin(values[name], (0.0, 1.0))
        if wrong.any():
            row = int(np.argmax(wrong))
            problem = f"expected 1 or 0, got {values[name][row]:g}; correct the row."
            raise RowError(f"{path}: column {name!r}", row + 1, problem)
        values[name] = values[name].astype(bool)
    return values


def _array(path: Path, name: str, column: pa.ChunkedArray) -> Column:
    if pa.types.is_boolean(column.type) and column.null_count:
        row = int(np.argmax(column.is_null().to_numpy())) + 1
        raise RowError(
            f"{path}: column {name!r}", row, "expected 1 or 0, got an empty cell; fill it in."
        )
    return column.to_numpy()

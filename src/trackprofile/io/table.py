"""Tables of numbers, in CSV or Parquet: what profiles and recordings share."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
from numpy.typing import NDArray

from trackprofile.errors import DataError, FileError, RowError

Column = NDArray[Any]

SUFFIXES = (".csv", ".parquet")


def column_names(path: Path) -> list[str]:
    """The columns of a table.

    Raises
    ------
    FileError : it is not a table.
    """
    try:
        if _is_parquet(path):
            return parquet.read_schema(path).names
        with path.open(encoding="utf-8-sig", newline="") as file:
            names = [name.strip() for name in next(csv.reader(file), [])]
    except (pa.ArrowException, UnicodeDecodeError, csv.Error) as error:
        raise _no_table(path) from error
    if not all(name.isprintable() for name in names):
        raise _no_table(path)
    return names


def read_columns(
    path: Path, numbers: Sequence[str], flags: Sequence[str] = ()
) -> dict[str, Column]:
    """Some columns of a table, by name: numbers as float (empty is NaN), flags as bool.

    Raises
    ------
    DataError : a column is missing or there twice, or a row is cut short or holds no number.
    FileError : the file is not a table.
    """
    names = column_names(path)
    for name in (*numbers, *flags):
        if names.count(name) != 1:
            found = "is there twice" if name in names else "is missing"
            raise DataError(f"{path}: column {name!r} {found}; the columns are {', '.join(names)}.")
    schema = pa.schema(dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(flags, pa.bool_()))
    table = (_read_parquet if _is_parquet(path) else _read_csv)(path, names, schema)
    return {name: _array(path, name, table[name]) for name in schema.names}


def write_columns(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns of equal length; NaN becomes an empty cell."""
    table = pa.table({name: pa.array(one, from_pandas=True) for name, one in columns.items()})
    if _is_parquet(path):
        parquet.write_table(table, path)
        return
    with path.open("wb") as file:
        file.write((",".join(map(_quoted, columns)) + "\n").encode())
        arrow_csv.write_csv(table, file, arrow_csv.WriteOptions(include_header=False))


@contextmanager
def located(where: Path | str, columns: Mapping[str, str] | None = None) -> Iterator[None]:
    """Errors about data, raised inside, gain the place, and the column in place of the variable."""
    try:
        yield
    except RowError as error:
        column = (columns or {}).get(error.variable, error.variable)
        raise RowError(f"{where}: column {column!r}", error.row, error.problem) from error
    except DataError as error:
        raise type(error)(f"{where}: {error}") from error


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() == ".parquet"


def _no_table(path: Path) -> FileError:
    kind = "Parquet table" if _is_parquet(path) else "CSV table in UTF-8"
    return FileError(f"{path}: not a readable {kind}; copy or export it again.")


def _read_csv(path: Path, names: list[str], schema: pa.Schema) -> pa.Table:
    short: list[arrow_csv.InvalidRow] = []

    def note(row: arrow_csv.InvalidRow) -> str:
        short.append(row)
        return "error"

    try:
        return arrow_csv.read_csv(
            path,
            # One thread: only then does Arrow know the number of a row that it cannot read.
            arrow_csv.ReadOptions(column_names=names, skip_rows=1, use_threads=False),
            arrow_csv.ParseOptions(invalid_row_handler=note),
            arrow_csv.ConvertOptions(include_columns=schema.names, column_types=schema),
        )
    except pa.ArrowInvalid as error:
        if short:
            row = short[0]
            number = (row.number or 2) - 1  # Arrow counts the header
            problem = (
                f"expected {row.expected_columns} values, found {row.actual_columns}; "
                "the file is cut short or damaged: copy it again, or remove the row."
            )
            raise RowError(str(path), number, problem) from error
        raise _unreadable(path, names, str(error)) from error


def _unreadable(path: Path, names: list[str], message: str) -> DataError:
    found = re.search(r"column #(\d+): (?:Row #(\d+): )?.*invalid value '(.*)'", message, re.DOTALL)
    if found is None or found[2] is None:
        reason = " ".join(message.split())
        return DataError(f"{path}: not a whole CSV table; copy or export it again ({reason}).")
    column = names[int(found[1])]
    problem = f"expected a number, found {found[3]!r}; mend the cell, or leave it empty."
    return RowError(f"{path}: column {column!r}", int(found[2]) - 1, problem)


def _read_parquet(path: Path, names: list[str], schema: pa.Schema) -> pa.Table:
    try:
        table = parquet.read_table(path, columns=schema.names)
    except (pa.ArrowException, OSError) as error:
        raise _no_table(path) from error
    try:
        return table.cast(schema)
    except pa.ArrowException as error:
        reason = " ".join(str(error).split())
        raise DataError(f"{path}: a column does not hold numbers ({reason}).") from error


def _array(path: Path, name: str, column: pa.ChunkedArray) -> Column:
    if pa.types.is_boolean(column.type) and column.null_count:
        row = int(np.argmax(column.is_null().to_numpy())) + 1
        raise RowError(f"{path}: column {name!r}", row, "expected 1 or 0, found an empty cell.")
    return column.to_numpy()


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\r\n') else name

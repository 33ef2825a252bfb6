"""Tables in CSV, in any dialect."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv

from trackprofile.errors import DataError, RowError
from trackprofile.io.column_info import Column, ColumnInfo
from trackprofile.io.csv_dialect import MISSING, Dialect, find_dialect, is_number, unreadable_table
from trackprofile.io.timestamps import timestamp_form

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc")


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Information about the columns of a table."""
    dialect = _dialect(path)
    return tuple(
        ColumnInfo(
            name, unit, form="" if is_number(first, dialect.decimal) else timestamp_form(first)
        )
        for name, unit, first in zip(dialect.names, dialect.units, dialect.first, strict=True)
    )


def read(path: Path, schema: pa.Schema) -> pa.Table:
    """Read the columns of a schema, by name and type.

    Raises
    ------
    DataError : the file is cut short, or a cell is not of the type in the schema; the message names the row.
    """
    dialect = _dialect(path)
    incomplete: list[arrow_csv.InvalidRow] = []

    def note(row: arrow_csv.InvalidRow) -> str:
        incomplete.append(row)
        return "error"

    source, separator = path, dialect.separator
    if separator == " ":
        single_spaced = re.sub(r"[ \t]+", " ", path.read_text(dialect.encoding))
        source = pa.BufferReader(re.sub(r"(?m)^ | $", "", single_spaced).encode())
    try:
        return arrow_csv.read_csv(
            source,
            arrow_csv.ReadOptions(
                column_names=dialect.names,
                skip_rows=dialect.skipped,
                encoding="utf-8" if separator == " " else dialect.encoding,
                # Only with one thread does Arrow report the number of a row that it cannot read.
                use_threads=False,
            ),
            arrow_csv.ParseOptions(delimiter=separator, invalid_row_handler=note),
            arrow_csv.ConvertOptions(
                include_columns=schema.names,
                column_types=schema,
                decimal_point=dialect.decimal,
                null_values=list(MISSING),
            ),
        )
    except pa.ArrowInvalid as error:
        if incomplete:
            row = incomplete[0]
            number = (row.number or dialect.skipped + 1) - dialect.skipped
            problem = (
                f"expected {row.expected_columns} values, got {row.actual_columns}; "
                "the file is cut short or damaged: copy it again, or remove the row."
            )
            raise RowError(str(path), number, problem) from error
        raise _unreadable(path, dialect, str(error)) from error
    except UnicodeError as error:
        raise unreadable_table(path) from error


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write columns with commas and decimal points; NaN becomes an empty cell, units are not written."""
    table = pa.table({name: pa.array(one, from_pandas=True) for name, one in columns.items()})
    with path.open("wb") as file:
        file.write((",".join(map(_quoted, columns)) + "\n").encode())
        arrow_csv.write_csv(table, file, arrow_csv.WriteOptions(include_header=False))


def _dialect(path: Path) -> Dialect:
    try:
        return find_dialect(path)
    except csv.Error as error:
        raise unreadable_table(path) from error


def _unreadable(path: Path, dialect: Dialect, message: str) -> DataError:
    match = re.search(r"column #(\d+): (?:Row #(\d+): )?.*invalid value '(.*)'", message, re.DOTALL)
    if match is None or match[2] is None:
        reason = " ".join(message.split())
        return DataError(f"{path}: not a complete CSV table ({reason}); copy or export it again.")
    column = dialect.names[int(match[1])]
    problem = f"expected a number, got {match[3]!r}; correct the cell, or leave it empty."
    return RowError(f"{path}: column {column!r}", int(match[2]) - dialect.skipped, problem)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\r\n') else name

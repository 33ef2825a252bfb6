"""Tables in Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as parquet

from trackprofile.errors import DataError, FileError
from trackprofile.io.column_info import Column, ColumnInfo, check_size

SUFFIXES = (".parquet",)


def headings(path: Path) -> tuple[ColumnInfo, ...]:
    """Information about the columns of a table; units are in the metadata of the fields."""
    try:
        with parquet.ParquetFile(path) as file:
            rows, schema = file.metadata.num_rows, file.schema_arrow
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _unreadable_table(path) from error
    check_size(path, 8.0 * rows * len(schema))
    units = [
        (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for field in schema
    ]
    return tuple(
        ColumnInfo(name, unit, max(rows, 0)) for name, unit in zip(schema.names, units, strict=True)
    )


def read(path: Path, schema: pa.Schema) -> pa.Table:
    """Read the columns of a schema, by name and type.

    Raises
    ------
    FileError : the file is not Parquet, or is damaged.
    DataError : a column is not of the type in the schema.
    """
    try:
        table = parquet.read_table(path, columns=schema.names)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _unreadable_table(path) from error
    try:
        return table.select(schema.names).cast(schema)
    except pa.ArrowException as error:
        reason = " ".join(str(error).split())
        raise DataError(
            f"{path}: a column does not hold numbers ({reason}); choose another column."
        ) from error


def write(path: Path, columns: Mapping[str, Column], units: Mapping[str, str]) -> None:
    """Write columns of equal length, with their units in the metadata of the fields."""
    arrays = {name: pa.array(one, from_pandas=True) for name, one in columns.items()}
    fields = [
        pa.field(name, one.type, metadata={"unit": units[name]} if name in units else None)
        for name, one in arrays.items()
    ]
    parquet.write_table(pa.table(list(arrays.values()), schema=pa.schema(fields)), path)


def _unreadable_table(path: Path) -> FileError:
    return FileError(f"{path}: not a readable Parquet table; copy or export it again.")

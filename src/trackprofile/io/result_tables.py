"""Result tables as files: CSV and Parquet, one per table, and GeoJSON of places on a map."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet

from trackprofile.errors import FileError
from trackprofile.io.atomic import check_writable, whole_files

SUFFIXES = (".csv", ".parquet")
GEOJSON_SUFFIX = ".geojson"


def table_files(path: str | Path, names: Sequence[str]) -> tuple[Path, ...]:
    """The files that `write_tables` would write: the path's name, a dash, and the table's.

    Raises
    ------
    FileError : the suffix is none of tables, or a file could not be written there.

    Examples
    --------
    >>> [path.name for path in table_files("may.csv", ["defects", "sections"])]
    ['may-defects.csv', 'may-sections.csv']
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileError(f"{path}: tables go to a file that ends in {', '.join(SUFFIXES)}.")
    files = tuple(path.with_name(f"{path.stem}-{name}{path.suffix}") for name in names)
    check_writable(*files)
    return files


def write_tables(
    tables: Mapping[str, Mapping[str, Sequence[Any]]], path: str | Path
) -> tuple[Path, ...]:
    """Write each table into a file of its own; all of them, or none.

    Raises
    ------
    FileError : as of `table_files`.
    """
    files = table_files(path, list(tables))
    with whole_files(*files) as parts:
        for part, columns in zip(parts, tables.values(), strict=True):
            made = pa.table({name: pa.array(list(column)) for name, column in columns.items()})
            if part.suffix.lower() == ".parquet":
                parquet.write_table(made, part)
            else:
                arrow_csv.write_csv(made, part)
    return files


def write_geojson(collection: Mapping[str, Any], path: str | Path) -> Path:
    """Write a collection of features (RFC 7946), whole or not at all.

    Raises
    ------
    FileError : the suffix is another, or it cannot be written there.
    """
    path = Path(path)
    if path.suffix.lower() != GEOJSON_SUFFIX:
        raise FileError(f"{path}: a map goes to a file that ends in {GEOJSON_SUFFIX}.")
    with whole_files(path) as (part,):
        part.write_text(
            json.dumps(collection, ensure_ascii=False, allow_nan=False), encoding="utf-8"
        )
    return path

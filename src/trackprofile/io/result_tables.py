"""Result tables as files: CSV or Parquet, one file per table, and GeoJSON for locations on a map."""

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
    """Files that `write_tables` writes: the name of the path, a hyphen, and the name of the table.

    Raises
    ------
    FileError : the suffix is not that of a table, or a file cannot be written there.

    Examples
    --------
    >>> [path.name for path in table_files("may.csv", ["defects", "sections"])]
    ['may-defects.csv', 'may-sections.csv']
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileError(
            f"{path}: tables are written to files that end in {', '.join(SUFFIXES)}; change the suffix."
        )
    files = tuple(path.with_name(f"{path.stem}-{name}{path.suffix}") for name in names)
    check_writable(*files)
    return files


def write_tables(
    tables: Mapping[str, Mapping[str, Sequence[Any]]], path: str | Path
) -> tuple[Path, ...]:
    """Write each table to a separate file; all of them, or none.

    Raises
    ------
    FileError : see `table_files`.
    """
    files = table_files(path, list(tables))
    with whole_files(*files) as parts:
        for part, columns in zip(parts, tables.values(), strict=True):
            arrow_table = pa.table(
                {name: pa.array(list(column)) for name, column in columns.items()}
            )
            if part.suffix.lower() == ".parquet":
                parquet.write_table(arrow_table, part)
            else:
                arrow_csv.write_csv(arrow_table, part)
    return files


def write_geojson(collection: Mapping[str, Any], path: str | Path) -> Path:
    """Write a collection of GeoJSON features (RFC 7946), completely or not at all.

    Raises
    ------
    FileError : the suffix is not .geojson, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != GEOJSON_SUFFIX:
        raise FileError(
            f"{path}: a map is written to a file that ends in {GEOJSON_SUFFIX}; change the suffix."
        )
    with whole_files(path) as (part,):
        part.write_text(
            json.dumps(collection, ensure_ascii=False, allow_nan=False), encoding="utf-8"
        )
    return path

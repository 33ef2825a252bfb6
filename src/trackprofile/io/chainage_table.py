"""Chainage table in CSV or Parquet: kilometre posts and coordinates along a line.

Columns: ``distance_m``, and ``kilometre`` or the pair ``latitude_deg``, ``longitude_deg`` or both. A cell may be empty:
a row is a post, a point, or both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackprofile.errors import DataError, FileError, RowError
from trackprofile.io.table import SUFFIXES, column_names, read_columns
from trackprofile.positioning.chainage import ChainageTable

POST, NORTH, EAST = "kilometre", "latitude_deg", "longitude_deg"


def read_chainage(path: str | Path) -> ChainageTable:
    """Read a chainage table.

    Raises
    ------
    FileError : the file does not exist, or is not a table.
    DataError : a column is missing, or a row cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        raise FileError(
            f"{path}: expected a chainage table, in a file that ends in {', '.join(SUFFIXES)}; check the path."
        )
    names = column_names(path)
    has_posts, has_points = POST in names, NORTH in names and EAST in names
    if not (has_posts or has_points):
        raise DataError(
            f"{path}: expected a column {POST!r}, or the two {NORTH!r} and {EAST!r}; "
            f"got the columns {', '.join(names)}; rename or add a column."
        )
    wanted = ["distance_m", *([POST] if has_posts else []), *([NORTH, EAST] if has_points else [])]
    table = read_columns(path, wanted)
    distance = table["distance_m"]
    if not np.isfinite(distance).all():
        row = int(np.argmin(np.isfinite(distance))) + 1
        raise DataError(
            f"{path}: column 'distance_m', data row {row}: expected a number, got an empty cell; fill it in."
        )
    posts = np.isfinite(table[POST]) if has_posts else np.zeros(distance.size, bool)
    points = np.zeros(distance.size, bool)
    if has_points:
        points = np.isfinite(table[NORTH]) & np.isfinite(table[EAST])
    columns = {name: table.get(name, np.empty(0)) for name in (POST, NORTH, EAST)}
    try:
        return ChainageTable(
            distance[posts],
            columns[POST][posts[: columns[POST].size]],
            distance[points],
            columns[NORTH][points[: columns[NORTH].size]],
            columns[EAST][points[: columns[EAST].size]],
        )
    except RowError as error:
        rows = np.flatnonzero(posts if error.variable == POST else points)
        where = f"{path}: column {error.variable!r}"
        raise RowError(where, int(rows[error.row - 1]) + 1, error.problem) from error

"""Tables of an assessment as Parquet files, with the same columns of the same types in every file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from trackprofile.store.columns import table_to_parquet
from trackprofile.store.layout import PassKey

_NUMBER_SUFFIXES = ("_m", "_mm", "_kilometre", "_deg", "_dB", "_share")


def assessment_table_to_parquet(
    columns: Mapping[str, Sequence[Any]], entry: str, key: PassKey
) -> bytes:
    """A table of `trackprofile.assessment.tables` as a Parquet file, with its entry and pass in each row.

    Parameters
    ----------
    columns : columns of equal length, by name
    entry : identifier of the entry
    key : line, direction, day and run
    """
    count = len(next(iter(columns.values())))
    constants = {
        "entry": (pa.string(), entry),
        "line": (pa.string(), key.line),
        "direction": (pa.string(), key.direction),
        "day": (pa.date32(), key.day),
        "run": (pa.string(), key.run),
    }
    arrays = {name: pa.array([value] * count, kind) for name, (kind, value) in constants.items()}
    arrays |= {name: pa.array(list(one), _column_type(name)) for name, one in columns.items()}
    return table_to_parquet(pa.table(arrays))


def _column_type(name: str) -> pa.DataType:
    """Type of a column, from its name, so that an empty column has the same type."""
    if name.endswith(_NUMBER_SUFFIXES) or name.startswith("probability_"):
        return pa.float64()
    return pa.bool_() if name.endswith("_verified") else pa.string()

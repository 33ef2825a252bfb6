"""An assessment's tables as Parquet: the same columns of the same types in every file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from trackprofile.store.columns import written
from trackprofile.store.layout import PassKey

_NUMBERS = ("_m", "_mm", "_kilometre", "_deg", "_dB", "_share")


def table_bytes(rows: Mapping[str, Sequence[Any]], entry: str, place: PassKey) -> bytes:
    """A table of `trackprofile.assessment.tables` as a Parquet file, with what it is of in each row."""
    count = len(next(iter(rows.values())))
    of_place = {
        "entry": (pa.string(), entry),
        "line": (pa.string(), place.line),
        "direction": (pa.string(), place.direction),
        "day": (pa.date32(), place.day),
        "run": (pa.string(), place.run),
    }
    arrays = {name: pa.array([value] * count, kind) for name, (kind, value) in of_place.items()}
    arrays |= {name: pa.array(list(column), _kind(name)) for name, column in rows.items()}
    return written(pa.table(arrays))


def _kind(name: str) -> pa.DataType:
    """Of a column, by its name, so that an empty one has it too."""
    if name.endswith(_NUMBERS) or name.startswith("probability_"):
        return pa.float64()
    return pa.bool_() if name.endswith("_verified") else pa.string()

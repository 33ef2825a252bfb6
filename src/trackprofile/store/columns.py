"""A profile as columns of Parquet, and back.

What is kept, and how exactly:

=============================  ======================================================================
``distance_m``                 to the bit
``elevation..._m``             to the nearest 2⁻²³ m (0.12 µm): 6e-8 m at most beside it
``level_<band>_m``             the same; null where the band is not carried
``standard_deviation..._m``    to 11 significant binary digits: 0.05 % of it at most beside it
``quality`` and other flags    to the bit
=============================  ======================================================================

The digits that are left out tell nothing that a sensor can, and are four fifths of what would have to be stored.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import xarray as xr
from numpy.typing import NDArray

from trackprofile.assessment.levels import BandLevel
from trackprofile.bands import resample
from trackprofile.errors import DataError

Array = NDArray[np.float64]

QUANTUM = 2.0**-23
"""Of elevations and levels [m]."""

ROWS = 8192
"""In a group, which is read as a whole: 2 km."""

ATTRIBUTES = b"trackprofile"
"""Under which a profile's attributes stand in the file's metadata, as JSON."""

ELEVATION, LEVEL, SPREAD = "elevation", "level_", "standard_deviation"

_EFFORT = 6  # of zstd: 5 % smaller than at its usual 3; beyond it hardly more
_DROPPED = np.uint32(13)  # of the 23 binary digits after the first of a float32


def profile_columns(
    profile: xr.Dataset, levels: Mapping[str, BandLevel]
) -> dict[str, NDArray[Any]]:
    """All columns of a profile, rounded to what is kept.

    Raises
    ------
    DataError : it has a variable that is neither in metres nor flags.
    """
    distance = profile["distance"].to_numpy().astype(np.float64)
    columns: dict[str, NDArray[Any]] = {"distance_m": distance}
    for name, variable in profile.data_vars.items():
        values = variable.to_numpy()
        if values.dtype.kind in "iu" and variable.dims == ("distance",):
            columns[str(name)] = values.astype(np.int16)
        elif variable.attrs.get("units") == "m" and variable.dims == ("distance",):
            columns[f"{name}_m"] = _shortened(values) if SPREAD in str(name) else _rounded(values)
        else:
            raise DataError(
                f"{name}: a store keeps what is in metres along a profile, and flags; drop the variable."
            )
    for name, level in sorted(levels.items()):
        columns[f"{LEVEL}{name}_m"] = _rounded(_at(level, distance)).astype(np.float32)
    return columns


def parquet_bytes(columns: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> bytes:
    """Columns as a Parquet file; the same columns give the same bytes.

    Parameters
    ----------
    columns : of equal length; NaN is written as null
    about : for the file's metadata, as JSON
    """
    arrays = [pa.array(one, from_pandas=True) for one in columns.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": "m"} if name.endswith("_m") else None)
        for name, array in zip(columns, arrays, strict=True)
    ]
    said = json.dumps(about, ensure_ascii=True, sort_keys=True).encode()
    return written(pa.table(arrays, schema=pa.schema(fields, metadata={ATTRIBUTES: said})))


def written(table: pa.Table) -> bytes:
    """A table as a Parquet file."""
    sink = pa.BufferOutputStream()
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    settings: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": _EFFORT,
        "use_dictionary": [name for name in table.schema.names if name not in numbers],
        "use_byte_stream_split": numbers,
        "write_page_checksum": True,
    }
    parquet.write_table(table, sink, row_group_size=ROWS, **settings)
    return sink.getvalue().to_pybytes()


def attributes_of(profile: xr.Dataset) -> dict[str, Any]:
    """A profile's attributes as JSON can hold them.

    Raises
    ------
    DataError : one of them is neither text nor numbers.
    """
    plain = {
        str(name): value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for name, value in profile.attrs.items()
    }
    for name, value in plain.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            raise DataError(
                f"Attribute {name!r}: expected text or numbers, got {value!r}; drop it."
            ) from error
    return plain


def _at(level: BandLevel, distance: Array) -> Array:
    """A band's level where the profile's points are; its own grid is even."""
    if level.distance.size == distance.size and np.allclose(
        level.distance, distance, rtol=0, atol=1e-6 * level.spacing
    ):
        return level.level
    return resample(level.distance, level.level, distance)


def _rounded(values: NDArray[Any]) -> Array:
    """To the quantum, halves to even; what is larger than 2²⁹ m stays as it is."""
    values = values.astype(np.float64)
    return np.rint(values / QUANTUM) * QUANTUM


def _shortened(values: NDArray[Any]) -> NDArray[np.float32]:
    """To 11 significant binary digits."""
    bits = values.astype(np.float32).view(np.uint32)
    half, low = np.uint32(1) << (_DROPPED - np.uint32(1)), (np.uint32(1) << _DROPPED) - np.uint32(1)
    near = ((bits + half) & ~low).view(np.float32)
    return np.where(np.isfinite(values), near, values).astype(np.float32)

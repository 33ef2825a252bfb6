"""Profiles as columns of Parquet files.

Precision of the stored columns:

=============================  ======================================================================
``distance_m``                 exact
``elevation..._m``             rounded to multiples of 2⁻²³ m (0.12 µm): an error of at most 6e-8 m
``level_<band>_m``             the same; null where the profile does not cover the band
``standard_deviation..._m``    rounded to 11 significant binary digits: an error of at most 0.05 %
``quality`` and other flags    exact
=============================  ======================================================================

The digits that are dropped are far below the resolution of any sensor and would take four fifths of the storage.
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

RESOLUTION = 2.0**-23
"""Resolution of stored elevations and band levels [m]."""

ROW_GROUP_SIZE = 8192
"""Rows in a group of a Parquet file, which is read as a whole: 2 km at 0.25 m."""

METADATA_KEY = b"trackprofile"
"""Key of the JSON document in a Parquet file's metadata that holds the profile's attributes."""

ELEVATION, LEVEL, STANDARD_DEVIATION = "elevation", "level_", "standard_deviation"

_COMPRESSION_LEVEL = (
    6  # of zstd: files are 5 % smaller than at its default 3, and hardly smaller beyond
)
_DROPPED_BITS = np.uint32(13)  # of the 23 bits of a float32's fraction


def profile_columns(
    profile: xr.Dataset, levels: Mapping[str, BandLevel]
) -> dict[str, NDArray[Any]]:
    """All columns of a profile, rounded to the stored precision.

    Parameters
    ----------
    profile : profile contract
    levels : level in each band, by the band's name

    Raises
    ------
    DataError : the profile has a variable that is neither in metres nor flags.
    """
    distance = profile["distance"].to_numpy().astype(np.float64)
    columns: dict[str, NDArray[Any]] = {"distance_m": distance}
    for name, variable in profile.data_vars.items():
        values = variable.to_numpy()
        if values.dtype.kind in "iu" and variable.dims == ("distance",):
            columns[str(name)] = values.astype(np.int16)
        elif variable.attrs.get("units") == "m" and variable.dims == ("distance",):
            is_deviation = STANDARD_DEVIATION in str(name)
            columns[f"{name}_m"] = _short_float(values) if is_deviation else _rounded(values)
        else:
            raise DataError(
                f"{name}: a store keeps variables in metres along the profile, and flags; remove the variable."
            )
    for name, level in sorted(levels.items()):
        at_points = _level_at(level, distance)
        columns[f"{LEVEL}{name}_m"] = _rounded(at_points).astype(np.float32)
    return columns


def columns_to_parquet(columns: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> bytes:
    """Columns as a Parquet file; the same columns give the same bytes.

    Parameters
    ----------
    columns : arrays of equal length; NaN becomes null
    metadata : document for the file's metadata, as JSON
    """
    arrays = [pa.array(one, from_pandas=True) for one in columns.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": "m"} if name.endswith("_m") else None)
        for name, array in zip(columns, arrays, strict=True)
    ]
    text = json.dumps(metadata, ensure_ascii=True, sort_keys=True).encode()
    return table_to_parquet(
        pa.table(arrays, schema=pa.schema(fields, metadata={METADATA_KEY: text}))
    )


def table_to_parquet(table: pa.Table) -> bytes:
    """A table as a Parquet file."""
    sink = pa.BufferOutputStream()
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    settings: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": _COMPRESSION_LEVEL,
        "use_dictionary": [name for name in table.schema.names if name not in numbers],
        "use_byte_stream_split": numbers,
        "write_page_checksum": True,
    }
    parquet.write_table(table, sink, row_group_size=ROW_GROUP_SIZE, **settings)
    return sink.getvalue().to_pybytes()


def json_attributes(profile: xr.Dataset) -> dict[str, Any]:
    """Attributes of a profile in the types of JSON.

    Raises
    ------
    DataError : an attribute is neither text nor numbers.
    """
    attributes = {
        str(name): value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for name, value in profile.attrs.items()
    }
    for name, value in attributes.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            raise DataError(
                f"Attribute {name!r}: expected text or numbers, got {value!r}; remove it."
            ) from error
    return attributes


def _level_at(level: BandLevel, distance: Array) -> Array:
    """Level in a band at the profile's points; the level's own grid is equidistant."""
    if level.distance.size == distance.size and np.allclose(
        level.distance, distance, rtol=0, atol=1e-6 * level.spacing
    ):
        return level.level
    return resample(level.distance, level.level, distance)


def _rounded(values: NDArray[Any]) -> Array:
    """Values rounded to `RESOLUTION`, halves to even; values above 2²⁹ m do not change."""
    values = values.astype(np.float64)
    return np.rint(values / RESOLUTION) * RESOLUTION


def _short_float(values: NDArray[Any]) -> NDArray[np.float32]:
    """Values rounded to 11 significant binary digits."""
    bits = values.astype(np.float32).view(np.uint32)
    half = np.uint32(1) << (_DROPPED_BITS - np.uint32(1))
    mask = (np.uint32(1) << _DROPPED_BITS) - np.uint32(1)
    rounded = ((bits + half) & ~mask).view(np.float32)
    return np.where(np.isfinite(values), rounded, values).astype(np.float32)

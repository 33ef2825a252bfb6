"""A profile as a table, in CSV or Parquet.

Columns: ``distance_m``, ``elevation_m`` and, where known, ``standard_deviation_m``, the same per
band (``standard_deviation_D1_m`` ...), ``distance_deviation_m`` and ``quality``; for a profile per rail, the same of
``elevation_left``, ``elevation_right`` and ``elevation_difference``; for a fusion of passes, ``rate_m_per_day``,
``rate_deviation_m_per_day`` and the latter per band. Other columns are ignored. A table cannot hold the attributes: its
profile is of the kind posterior if it has a standard deviation, else of the kind point.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from trackprofile.contracts import SEPARATE_RAILS, Quality, RailLevel, build_profile, with_rails
from trackprofile.contracts.rails import DIFFERENCE_QUALITY, rail_variable
from trackprofile.contracts.rates import (
    FUSION_METHOD,
    RATE,
    RATE_DEVIATION,
    RATE_UNIT,
    rate_variables,
    validate_rate,
)
from trackprofile.contracts.validation import DISTANCE_DEVIATION
from trackprofile.errors import RowError
from trackprofile.io.atomic import whole_files
from trackprofile.io.table import SUFFIXES as SUFFIXES
from trackprofile.io.table import column_names, error_location, read_columns, write_columns

NAME = "a profile as a table with the columns distance_m and elevation_m"
HOLDS = ("profile",)

_DEVIATION = "standard_deviation"
_PER_DAY = "_m_per_day"


def sniff(path: Path) -> bool:
    """Whether the table has a column ``elevation_m``."""
    return "elevation_m" in column_names(path)


def read(path: Path) -> xr.Dataset:
    """Read the profile in a table."""
    names = column_names(path)
    band_columns = {
        match[1]: name for name in names if (match := re.fullmatch(f"{_DEVIATION}_(.+)_m", name))
    }
    candidates = (f"{_DEVIATION}_m", f"{DISTANCE_DEVIATION}_m", "quality")
    optional = [name for name in candidates if name in names]
    of_rails = [name for name in names if _is_rail_column(name)]
    rates = [name for name in names if _is_rate_column(name)]
    columns = ["distance_m", "elevation_m", *optional, *band_columns.values(), *of_rails, *rates]
    table = read_columns(path, columns)
    deviation = table.get(f"{_DEVIATION}_m")
    with error_location(
        path, {name.removesuffix(_PER_DAY).removesuffix("_m"): name for name in columns}
    ):
        profile = build_profile(
            table["distance_m"],
            table["elevation_m"],
            kind="point" if deviation is None else "posterior",
            method=f"{FUSION_METHOD} passes" if rates else "",
            standard_deviation=deviation,
            band_standard_deviations={band: table[name] for band, name in band_columns.items()},
            quality=_flags(table["quality"]) if "quality" in table else None,
            provenance=[f"read from {path.name}"],
            distance_deviation=table.get(f"{DISTANCE_DEVIATION}_m"),
        )
        profile = _with_rails(profile, table) if of_rails else profile
        return _with_rates(profile, table) if rates else profile


def write(dataset: xr.Dataset, path: Path) -> tuple[Path, ...]:
    """Write the variables of a profile, without its attributes."""
    own = {DISTANCE_DEVIATION, *(rail_variable(rail) for rail in SEPARATE_RAILS)}
    more = (str(name) for name in dataset if _DEVIATION in str(name) or name in own)
    columns = {f"{name}_m": dataset[name].to_numpy() for name in ("distance", "elevation", *more)}
    flags = {
        name: dataset[name].to_numpy()
        for name in ("quality", DIFFERENCE_QUALITY)
        if name in dataset
    }
    rates = {f"{name}{_PER_DAY}": dataset[name].to_numpy() for name in rate_variables(dataset)}
    with whole_files(path) as (file,):
        write_columns(file, columns | rates | flags)
    return (path,)


def _is_rail_column(column: str) -> bool:
    """Whether a column is of the left rail, the right rail or their difference."""
    names = "|".join(rail_variable(rail) for rail in SEPARATE_RAILS)
    return bool(
        re.fullmatch(rf"(?:{names})(?:_{_DEVIATION}(?:_.+)?)?_m|{DIFFERENCE_QUALITY}", column)
    )


def _is_rate_column(column: str) -> bool:
    """Whether a column is the rate or one of its standard deviations."""
    return bool(re.fullmatch(f"(?:{RATE}|{RATE_DEVIATION}(?:_.+)?){_PER_DAY}", column))


def _with_rates(profile: xr.Dataset, table: Mapping[str, np.ndarray]) -> xr.Dataset:
    unit = {"units": RATE_UNIT}
    return validate_rate(
        profile.assign(
            {
                name.removesuffix(_PER_DAY): ("distance", values, unit)
                for name, values in table.items()
                if _is_rate_column(name)
            }
        )
    )


def _with_rails(profile: xr.Dataset, table: Mapping[str, np.ndarray]) -> xr.Dataset:
    levels = {}
    for rail in (one for one in SEPARATE_RAILS if f"{rail_variable(one)}_m" in table):
        own = f"{rail_variable(rail)}_{_DEVIATION}"
        deviations = {
            match[1]: values
            for name, values in table.items()
            if (match := re.fullmatch(f"{own}_(.+)_m", name))
        }
        levels[rail] = RailLevel(
            table[f"{rail_variable(rail)}_m"], table.get(f"{own}_m"), deviations
        )
    flags = table.get(DIFFERENCE_QUALITY)
    return with_rails(profile, levels, None if flags is None else _flags(flags, DIFFERENCE_QUALITY))


def _flags(values: np.ndarray, column: str = "quality") -> np.ndarray:
    largest = 2 * max(Quality) - 1
    wrong = ~np.isin(values, np.arange(largest + 1))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise RowError(
            column,
            row + 1,
            f"expected a sum of flags, 0 to {largest}, got {values[row]:g}; correct the row.",
        )
    return values.astype(np.int16)

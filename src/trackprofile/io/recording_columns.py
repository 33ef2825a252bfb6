"""From the columns that a TOML document describes to signals in SI units, each with its clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import QUANTITIES, Channel
from trackprofile.errors import DataError
from trackprofile.io import table
from trackprofile.io.chainage_table import read_chainage
from trackprofile.io.recording_document import (
    ColumnReference,
    RecordingDocument,
    RecordingTable,
    SensorColumn,
)
from trackprofile.io.recording_identity import RawTables
from trackprofile.io.recording_position import (
    GNSS_VALID,
    has_position_sources,
    position_columns,
    position_factor,
    read_post_table,
)
from trackprofile.io.timestamps import TIMESTAMP_FORMS, timestamp_seconds
from trackprofile.units import unit_factor

Array = NDArray[np.float64]

MOTION_DIMENSIONS = {"distance": "length", "speed": "speed", "distance_deviation": "length"}
"""Keys of ``[recording]`` that name columns of the train's motion, with their dimension."""


@dataclass(frozen=True, eq=False)
class Signals:
    """What was read, in SI units.

    Parameters
    ----------
    motion : by the keys of `MOTION_DIMENSIONS`; empty where positions have to be estimated
    channels : of the sensors
    positions : columns that tell the train's position, by the keys of `position_columns`
    clock_of : clock of each of these, by name; None: none, the rows count
    clocks : times of each clock [s]
    """

    motion: Mapping[str, Array]
    channels: tuple[Channel, ...]
    positions: Mapping[str, Array]
    clock_of: Mapping[str, ColumnReference | None]
    clocks: Mapping[ColumnReference, Array]


@dataclass(frozen=True, eq=False)
class ColumnPlan:
    """Which columns of a table are read, with the SI value of one unit of each, and which clock they have.

    The mappings are by key, or by channel name for ``sensor_factors`` and ``clock_of``.
    """

    head: RecordingTable
    sensors: tuple[SensorColumn, ...]
    motion: Mapping[str, ColumnReference]
    positions: Mapping[str, ColumnReference]
    factors: Mapping[str, float]
    sensor_factors: Mapping[str, float]
    clock_of: Mapping[str, ColumnReference | None]
    clock_factors: Mapping[ColumnReference, float]

    @property
    def clocks(self) -> list[ColumnReference]:
        """All clocks, each once."""
        return [clock for clock in dict.fromkeys(self.clock_of.values()) if clock]

    @property
    def numbers(self) -> list[str]:
        """Names of the columns of numbers, each once."""
        references = [*self.motion.values(), *self.sensors, *self.clock_factors]
        return list(dict.fromkeys(one.column for one in [*references, *self.positions.values()]))

    @property
    def flags(self) -> list[str]:
        """Names of the columns of flags, each once."""
        gnss = self.head.gnss
        valid = [one.valid for one in self.sensors] + [gnss.valid if gnss else None]
        return list(dict.fromkeys(name for name in valid if name))

    @property
    def texts(self) -> list[str]:
        """Names of the clocks that hold times as text."""
        return [clock.column for clock in self.clocks if clock not in self.clock_factors]


def plan_columns(description: Path, data: Path, document: RecordingDocument) -> ColumnPlan:
    """Columns of the table ``data`` that a document names, with their units and clocks.

    Raises
    ------
    UnitError : a unit is unknown or of another dimension.
    DataError : a quantity is unknown, or keys contradict each other.
    """
    head, sensors = document.recording, tuple(document.sensor)
    file_clocks = {info.name: info.clock for info in table.headings(data)}
    motion = {name: one for name in MOTION_DIMENSIONS if (one := getattr(head, name)) is not None}

    def clock(column: str, own: ColumnReference | None = None) -> ColumnReference | None:
        in_file = file_clocks.get(column)
        return own or head.time or (ColumnReference(column=in_file, unit="s") if in_file else None)

    with table.error_location(description):
        positions = position_columns(head)
        factors = {name: _factor(one, MOTION_DIMENSIONS[name]) for name, one in motion.items()}
        factors |= {
            name: _factor(one, dimension) for name, (one, _, dimension) in positions.items()
        }
        sensor_factors = {channel_name(one.column): _sensor_factor(one) for one in sensors}
        clock_of = {channel_name(one.column): clock(one.column, one.time) for one in sensors}
        clock_of |= {name: clock(one.column) for name, one in motion.items()}
        clock_of |= {name: clock(one.column, own) for name, (one, own, _) in positions.items()}
        if head.gnss and head.gnss.valid:
            clock_of[GNSS_VALID] = clock_of["gnss.latitude"]
        clocks = [one for one in dict.fromkeys(clock_of.values()) if one]
        clock_factors = {
            one: _factor(one, "time") for one in clocks if one.unit not in TIMESTAMP_FORMS
        }
    return ColumnPlan(
        head,
        sensors,
        motion,
        {name: one for name, (one, _, _) in positions.items()},
        factors,
        sensor_factors,
        clock_of,
        clock_factors,
    )


def read_raw_tables(description: Path, data: Path, plan: ColumnPlan) -> RawTables:
    """The planned columns, the table of kilometre posts and the chainage table, as the files hold them.

    Raises
    ------
    DataError : a column is missing or does not hold what it should; the message names it.
    FileError : a file is missing, or is not a table.
    """
    head = plan.head
    return RawTables(
        table.read_columns(data, plan.numbers, plan.flags, plan.texts),
        read_post_table(description, head.posts) if head.posts else {},
        None if head.chainage is None else read_chainage(description.parent / head.chainage),
    )


def signals(data: Path, plan: ColumnPlan, columns: Mapping[str, Any]) -> Signals:
    """Raw columns of the table ``data`` in SI units.

    Raises
    ------
    RowError : a text is not a time.
    """
    motion = {name: plan.factors[name] * columns[one.column] for name, one in plan.motion.items()}
    positions = {
        name: plan.factors[name] * columns[one.column] for name, one in plan.positions.items()
    }
    if plan.head.gnss and plan.head.gnss.valid:
        positions[GNSS_VALID] = columns[plan.head.gnss.valid].astype(np.float64)
    if has_position_sources(plan.head):
        # Distance and speed are then two of several position sources.
        motion, positions = {}, motion | positions
    clocks = {
        one: plan.clock_factors[one] * columns[one.column]
        if one in plan.clock_factors
        else timestamp_seconds(data, one.column, columns[one.column], one.unit)
        for one in plan.clocks
    }
    channels = tuple(
        _channel(one, plan.sensor_factors[channel_name(one.column)], columns)
        for one in plan.sensors
    )
    return Signals(motion, channels, positions, plan.clock_of, clocks)


def channel_name(column: str) -> str:
    """Name of the channel of a column: a slash would be a group in NetCDF.

    Examples
    --------
    >>> channel_name("bogie/acceleration")
    'bogie_acceleration'
    """
    return column.replace("/", "_")


def _channel(sensor: SensorColumn, factor: float, columns: Mapping[str, Any]) -> Channel:
    values = factor * columns[sensor.column]
    return Channel(
        name=channel_name(sensor.column),
        values=values,
        quantity=sensor.quantity,
        body=sensor.body,
        position=sensor.position,
        lateral=sensor.lateral,
        noise_density=None if sensor.noise_density is None else factor * sensor.noise_density,
        bandwidth=sensor.bandwidth,
        flicker=None if sensor.flicker is None else factor * sensor.flicker,
        # With a column of flags every valid sample must be a number; without one, an empty cell is a missing sample.
        valid=np.isfinite(values) if sensor.valid is None else columns[sensor.valid],
    )


def _factor(reference: ColumnReference, dimension: str) -> float:
    with table.error_location(f"column {reference.column!r}"):
        return position_factor(reference, dimension)


def _sensor_factor(sensor: SensorColumn) -> float:
    if sensor.quantity not in QUANTITIES:
        raise DataError(
            f"column {sensor.column!r}: expected a quantity out of {', '.join(QUANTITIES)}, "
            f"got {sensor.quantity!r}; correct the key 'quantity'."
        )
    with table.error_location(f"column {sensor.column!r}"):
        return unit_factor(sensor.unit, QUANTITIES[sensor.quantity][1])

"""The position sources of a recording: GNSS positions, wheel odometry, kilometre posts and displayed speed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import recorded_step
from trackprofile.errors import DataError
from trackprofile.io import table
from trackprofile.io.column_info import Column
from trackprofile.io.recording_document import (
    ColumnReference,
    Odometer,
    PostColumns,
    RecordingTable,
)
from trackprofile.io.recording_identity import RawTables
from trackprofile.io.timestamps import TIMESTAMP_FORMS, timestamp_seconds
from trackprofile.positioning.sources import (
    WHEEL_SCALE_STD,
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    Sources,
    WheelOdometry,
    unwrap_counter,
)
from trackprofile.preprocessing.resampling import Series
from trackprofile.units import unit_factor

Array = NDArray[np.float64]

PULSES = "pulses"
"""Unit of an odometer that counts pulses."""

GNSS_VALID = "gnss.valid"
"""Key of the flags of valid GNSS positions, among the position columns."""


def has_position_sources(head: RecordingTable) -> bool:
    """Whether a recording has position sources other than its distance and its speed."""
    return not (head.gnss is None and head.odometer is None and head.posts is None)


def position_columns(
    head: RecordingTable,
) -> dict[str, tuple[ColumnReference, ColumnReference | None, str]]:
    """Columns of the position sources in the recording's table, by key: reference, own clock and dimension.

    Raises
    ------
    DataError : keys contradict each other.
    """
    columns: dict[str, tuple[ColumnReference, ColumnReference | None, str]] = {}
    if (gnss := head.gnss) is not None:
        columns["gnss.latitude"] = (gnss.latitude, gnss.time, "angle")
        columns["gnss.longitude"] = (gnss.longitude, gnss.time, "angle")
        if gnss.speed is not None:
            columns["gnss.speed"] = (gnss.speed, gnss.time, "speed")
    if (odometer := head.odometer) is not None:
        _check_odometer(head, odometer)
        columns["odometer"] = (_reference(odometer), odometer.time, "length")
    if (posts := head.posts) is not None and posts.data is None:
        columns["posts"] = (_reference(posts), posts.time, "length")
    return columns


def position_factor(reference: ColumnReference, dimension: str) -> float:
    """SI value of one unit of a column; 1 for pulses."""
    return 1.0 if reference.unit == PULSES else unit_factor(reference.unit, dimension)


def read_post_table(description: Path, posts: PostColumns) -> dict[str, Column]:
    """Raw columns of the kilometre posts' own table; empty where they are in the recording's table.

    Raises
    ------
    DataError : the key of the time is missing, or a column is; the message names it.
    """
    if posts.data is None:
        return {}
    if posts.time is None:
        raise DataError(
            f"{description}: posts: the table {posts.data!r} needs the key 'time', the column with the times at which "
            "the posts were passed; add it."
        )
    is_text = posts.time.unit in TIMESTAMP_FORMS
    numbers = [posts.column] if is_text else [posts.column, posts.time.column]
    texts = [posts.time.column] if is_text else []
    return table.read_columns(description.parent / posts.data, numbers, texts=texts)


def position_sources(
    description: Path,
    head: RecordingTable,
    raw: RawTables,
    columns: Mapping[str, Series],
    epoch: float,
) -> tuple[Sources, list[str]]:
    """Position sources of a recording, and sentences on what was repaired in them.

    Parameters
    ----------
    description : file of the TOML document
    raw : tables as read
    columns : by the keys of `position_columns`, and ``distance`` and ``speed`` [SI]
    epoch : time of the clock at which the recording's time is 0 [s]

    Raises
    ------
    DataError : a value is impossible.
    """
    odometry, notes = _odometry(head, columns)
    posts = head.posts
    sources = Sources(
        None if head.gnss is None else _gnss_fixes(head, columns),
        odometry,
        None if posts is None else _kilometre_posts(description, posts, raw, columns, epoch),
        _displayed_speed(columns["speed"]) if "speed" in columns else None,
        raw.chainage,
    )
    return sources, notes


def _gnss_fixes(head: RecordingTable, columns: Mapping[str, Series]) -> GnssFixes:
    assert head.gnss is not None
    latitude, longitude = columns["gnss.latitude"], columns["gnss.longitude"]
    north, east = np.degrees(latitude.values), np.degrees(longitude.values)
    if GNSS_VALID in columns:
        north = np.where(columns[GNSS_VALID].values > 0.0, north, np.nan)
    for name, values, limit in (("latitude", north, 90.0), ("longitude", east, 180.0)):
        outside = np.abs(values) > limit
        if outside.any():
            raise DataError(
                f"gnss.{name}: expected -{limit:g} to {limit:g}°, got {values[outside][0]:g}°; correct its unit, or "
                "choose another column."
            )
    speed = columns.get("gnss.speed")
    return GnssFixes(
        latitude.time,
        north,
        east,
        None if speed is None else speed.values,
        head.gnss.std,
        head.gnss.bias_std,
        head.gnss.delay,
        head.gnss.antenna_offset,
    )


def _odometry(
    head: RecordingTable, columns: Mapping[str, Series]
) -> tuple[WheelOdometry | None, list[str]]:
    """Distance that a wheel rolled, by its pulses, its counter, or the recorded distance."""
    if (odometer := head.odometer) is None:
        if (distance := columns.get("distance")) is None:
            return None, []
        known = np.isfinite(distance.values)
        values = distance.values[known]
        return WheelOdometry(
            distance.time[known], values, recorded_step(values), WHEEL_SCALE_STD
        ), []
    counts = columns["odometer"]
    per_count = 1.0
    if odometer.unit == PULSES:
        assert odometer.per_revolution is not None
        assert odometer.wheel_diameter is not None
        per_count = np.pi * odometer.wheel_diameter / odometer.per_revolution
    values, resets = counts.values, 0
    if odometer.incremental:
        values = np.cumsum(np.where(np.isfinite(values), values, 0.0))
    else:
        values, resets = unwrap_counter(values)
    known = np.isfinite(values)
    step = per_count if odometer.unit == PULSES else recorded_step(values[known])
    times = "once" if resets == 1 else f"{resets} times"
    return (
        WheelOdometry(
            counts.time[known], per_count * values[known], float(step), odometer.scale_std
        ),
        [f"the odometer was reset {times}: its count was continued"] if resets else [],
    )


def _displayed_speed(speed: Series) -> DisplayedSpeed:
    known = np.isfinite(speed.values)
    values = speed.values[known]
    return DisplayedSpeed(speed.time[known], values, recorded_step(values), WHEEL_SCALE_STD)


def _kilometre_posts(
    description: Path,
    posts: PostColumns,
    raw: RawTables,
    columns: Mapping[str, Series],
    epoch: float,
) -> KilometrePosts:
    if posts.data is None:
        passed = _marked_posts(columns["posts"])
    else:
        passed = _listed_posts(description, posts, raw.posts, epoch)
    return KilometrePosts(
        passed.time, passed.values / 1000.0, posts.std, posts.time_std, posts.detector_offset
    )


def _marked_posts(column: Series) -> Series:
    """Posts of a column that holds each post's location where it was passed, or from there until the next post."""
    known = np.isfinite(column.values)
    time, values = column.time[known], column.values[known]
    is_new = np.concatenate([[not known.all()], np.diff(values) != 0.0])[: len(time)]
    return Series(time[is_new], values[is_new])


def _listed_posts(
    description: Path, posts: PostColumns, columns: Mapping[str, Column], epoch: float
) -> Series:
    """Posts of a table of their own, in the order of their times."""
    assert posts.data is not None
    assert posts.time is not None
    path, clock = description.parent / posts.data, posts.time
    with table.error_location(description):
        location = unit_factor(posts.unit, "length") * columns[posts.column]
        time = (
            timestamp_seconds(path, clock.column, columns[clock.column], clock.unit)
            if clock.unit in TIMESTAMP_FORMS
            else unit_factor(clock.unit, "time") * columns[clock.column]
        )
    known = np.isfinite(time) & np.isfinite(location)
    order = np.argsort(time[known], kind="stable")
    return Series(time[known][order] - epoch, location[known][order])


def _check_odometer(head: RecordingTable, odometer: Odometer) -> None:
    if head.distance is not None:
        raise DataError(
            "[recording]: expected one of the keys 'distance' and 'odometer', got both, which describe the same wheel; "
            "remove one."
        )
    is_complete = odometer.per_revolution is not None and odometer.wheel_diameter is not None
    if odometer.unit == PULSES and not is_complete:
        raise DataError(
            "[recording.odometer]: pulses need the keys 'per_revolution' and 'wheel_diameter' (in m); add them."
        )


def _reference(keys: Any) -> ColumnReference:
    return ColumnReference(column=keys.column, unit=keys.unit)

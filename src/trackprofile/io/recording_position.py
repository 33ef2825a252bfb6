"""What a recording's columns say of where the train was, and the distance that comes of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import recorded_step
from trackprofile.errors import DataError
from trackprofile.io import table
from trackprofile.io.chainage_table import read_chainage
from trackprofile.io.recording_document import ColumnReference, Head, Odometer
from trackprofile.io.recording_document import PostColumns as PostKeys
from trackprofile.io.timestamps import FORMS, seconds
from trackprofile.positioning.sources import (
    NOMINAL,
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    Sources,
    WheelOdometry,
    unwrapped,
)
from trackprofile.preprocessing.resampling import Series
from trackprofile.units import unit_factor

Array = NDArray[np.float64]

PULSES = "pulses"
"""The unit of an odometer that counts them."""

GOOD = "gnss.valid"
"""The name of the column that says which positions are good, among the others."""


def has_places(head: Head) -> bool:
    """Whether anything but a distance and a speed says where the train was."""
    return not (head.gnss is None and head.odometer is None and head.posts is None)


def place_columns(head: Head) -> dict[str, tuple[ColumnReference, ColumnReference | None, str]]:
    """By their keys the columns that say where the train was, each with a clock of its own and its dimension.

    Raises
    ------
    DataError : the keys contradict each other.
    """
    found: dict[str, tuple[ColumnReference, ColumnReference | None, str]] = {}
    if (gnss := head.gnss) is not None:
        found["gnss.latitude"] = (gnss.latitude, gnss.time, "angle")
        found["gnss.longitude"] = (gnss.longitude, gnss.time, "angle")
        if gnss.speed is not None:
            found["gnss.speed"] = (gnss.speed, gnss.time, "speed")
    if (odometer := head.odometer) is not None:
        _check_odometer(head, odometer)
        found["odometer"] = (_quantity(odometer), odometer.time, "length")
    if (posts := head.posts) is not None and posts.data is None:
        found["posts"] = (_quantity(posts), posts.time, "length")
    return found


def place_factor(described: ColumnReference, dimension: str) -> float:
    """SI value of one unit of a column, pulses aside."""
    return 1.0 if described.unit == PULSES else unit_factor(described.unit, dimension)


def sources(
    explained: Path, head: Head, columns: Mapping[str, Series], epoch: float
) -> tuple[Sources, list[str]]:
    """All that says where the train was, and sentences on what was mended.

    Parameters
    ----------
    columns : by the keys of `place_columns`, and ``distance`` and ``speed``, in SI
    epoch : s of the clock, at which the recording's time is 0
    """
    rolled, notes = _rolled(head, columns)
    speed = columns.get("speed")
    way = None if head.way is None else read_chainage(explained.parent / head.way)
    found = Sources(
        None if head.gnss is None else _fixes(head, columns),
        rolled,
        None if head.posts is None else _posts(explained, head.posts, columns, epoch),
        None if speed is None else _shown(speed),
        way,
    )
    return found, notes


def _fixes(head: Head, columns: Mapping[str, Series]) -> GnssFixes:
    assert head.gnss is not None
    latitude, longitude = columns["gnss.latitude"], columns["gnss.longitude"]
    north, east = np.degrees(latitude.values), np.degrees(longitude.values)
    if GOOD in columns:
        north = np.where(columns[GOOD].values > 0.0, north, np.nan)
    for name, values, most in (("latitude", north, 90.0), ("longitude", east, 180.0)):
        wrong = np.abs(values) > most
        if wrong.any():
            raise DataError(
                f"gnss.{name}: expected -{most:g} to {most:g}°, found {values[wrong][0]:g}°; correct its unit, or "
                "choose another column."
            )
    speed = columns.get("gnss.speed")
    keys = head.gnss
    return GnssFixes(
        latitude.time,
        north,
        east,
        None if speed is None else speed.values,
        keys.deviation,
        keys.wander,
        keys.delay,
        keys.behind,
    )


def _rolled(head: Head, columns: Mapping[str, Series]) -> tuple[WheelOdometry | None, list[str]]:
    """How far a wheel rolled, by its pulses or by the distance that it made of them."""
    if (odometer := head.odometer) is None:
        if (distance := columns.get("distance")) is None:
            return None, []
        known = np.isfinite(distance.values)
        values = distance.values[known]
        return WheelOdometry(distance.time[known], values, recorded_step(values), NOMINAL), []
    counted = columns["odometer"]
    per_count = 1.0
    if odometer.unit == PULSES:
        assert odometer.per_revolution is not None
        assert odometer.wheel_diameter is not None
        per_count = np.pi * odometer.wheel_diameter / odometer.per_revolution
    values, resets = counted.values, 0
    if odometer.each_row:
        values = np.cumsum(np.where(np.isfinite(values), values, 0.0))
    else:
        values, resets = unwrapped(values)
    known = np.isfinite(values)
    step = per_count if odometer.unit == PULSES else recorded_step(values[known])
    again = "once" if resets == 1 else f"{resets} times"
    return (
        WheelOdometry(
            counted.time[known], per_count * values[known], float(step), odometer.scale_deviation
        ),
        [f"the odometer was reset {again}: it goes on"] if resets else [],
    )


def _shown(speed: Series) -> DisplayedSpeed:
    known = np.isfinite(speed.values)
    values = speed.values[known]
    return DisplayedSpeed(speed.time[known], values, recorded_step(values), NOMINAL)


def _posts(
    explained: Path, keys: PostKeys, columns: Mapping[str, Series], epoch: float
) -> KilometrePosts:
    found = _marked(columns["posts"]) if keys.data is None else _listed(explained, keys, epoch)
    return KilometrePosts(
        found.time, found.values / 1000.0, keys.deviation, keys.timing, keys.behind
    )


def _marked(column: Series) -> Series:
    """Posts of a column that holds each where it was passed, or from there until the next."""
    known = np.isfinite(column.values)
    time, values = column.time[known], column.values[known]
    fresh = np.concatenate([[not known.all()], np.diff(values) != 0.0])
    return Series(time[fresh[: len(time)]], values[fresh[: len(time)]])


def _listed(explained: Path, keys: PostKeys, epoch: float) -> Series:
    """Posts of a table of their own."""
    assert keys.data is not None
    path = explained.parent / keys.data
    if keys.time is None:
        raise DataError(
            f"{explained}: posts: the table {keys.data!r} needs a key 'time' that says which column holds when each "
            "was passed; add it."
        )
    written = keys.time.unit in FORMS
    numbers = [keys.column] if written else [keys.column, keys.time.column]
    read = table.read_columns(path, numbers, texts=[keys.time.column] if written else [])
    with table.located(explained):
        kilometre = unit_factor(keys.unit, "length") * read[keys.column]
        time = (
            seconds(path, keys.time.column, read[keys.time.column], keys.time.unit)
            if written
            else unit_factor(keys.time.unit, "time") * read[keys.time.column]
        )
    known = np.isfinite(time) & np.isfinite(kilometre)
    order = np.argsort(time[known], kind="stable")
    return Series(time[known][order] - epoch, kilometre[known][order])


def _check_odometer(head: Head, odometer: Odometer) -> None:
    if head.distance is not None:
        raise DataError(
            "[recording]: distance and odometer both say how far the wheel rolled; keep one of them."
        )
    given = odometer.per_revolution is not None and odometer.wheel_diameter is not None
    if odometer.unit == PULSES and not given:
        raise DataError(
            "[recording.odometer]: of pulses expected per_revolution, and wheel_diameter in m; add them."
        )


def _quantity(described: Any) -> ColumnReference:
    return ColumnReference(column=described.column, unit=described.unit)

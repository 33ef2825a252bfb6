"""From the columns that a TOML explains to a recording: units, clocks, what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import QUANTITIES, Channel, build_recording
from trackprofile.errors import DataError
from trackprofile.io import table
from trackprofile.io.recording_document import ColumnReference, Document, SensorColumn
from trackprofile.io.recording_position import (
    GOOD,
    has_places,
    place_columns,
    place_factor,
    sources,
)
from trackprofile.io.timestamps import FORMS, seconds
from trackprofile.positioning.sources import PLACED, Sources
from trackprofile.preprocessing.clock import MENDED, repair_clock
from trackprofile.preprocessing.faults import ClockFault
from trackprofile.preprocessing.motion import fill_speed
from trackprofile.preprocessing.resampling import Series, resample_to_one_clock
from trackprofile.units import unit_factor

Array = NDArray[np.float64]

DIMENSIONS = {"distance": "length", "speed": "speed", "distance_deviation": "length"}
WORDS = ("line", "direction", "source", "vehicle")
DIRECTIONS = ("with the kilometrage", "against the kilometrage")


@dataclass(frozen=True)
class Columns:
    """What was read, in SI: how the train moved, the channels, what says where it was, whether that has to be found,
    and the clock of each by name; None: the rows.
    """

    motion: dict[str, Array]
    channels: tuple[Channel, ...]
    places: dict[str, Array]
    placed: bool
    clock_of: Mapping[str, ColumnReference | None]
    clocks: Mapping[ColumnReference, Array]


def recording_of(explained: Path, data: Path, document: Document) -> xr.Dataset:
    """The recording that the TOML ``explained`` describes in the table ``data``.

    Raises
    ------
    DataError : a column, unit or value cannot be used; the message names it.
    """
    read = _read(explained, data, document)
    head = document.recording
    columns = {_name(one.column): one.column for one in document.sensor}
    for name in ("time", *DIMENSIONS):
        if (one := getattr(head, name)) is not None:
            columns[name] = one.column
    said = {word: getattr(head, word) for word in WORDS}
    with table.located(data, columns):
        together = len(set(read.clock_of.values())) == 1
        found, notes, epoch = _on_one_clock(read) if together else _on_many_clocks(read)
        steps = [*head.provenance, f"read from {data.name}", *(MENDED + note for note in notes)]
        found |= {"wheel_scale": head.wheel_scale, "leading_end": head.leading_end or ""}
        places = found.pop("places")
        if has_places(head):
            steps += _located(found, said, *sources(explained, head, places, epoch))
        return build_recording(**found, **said, provenance=steps)


def _located(
    found: dict[str, Any], said: dict[str, str], sources: Sources, mended: Sequence[str]
) -> Iterator[str]:
    """Put the distance, and how well it is known, into what was found; steps of the provenance on that."""
    # Numba, which this imports, takes a third of a second; most recordings do without.
    from trackprofile.positioning.locate import locate

    yield from (MENDED + note for note in mended)
    where = locate(sources, found["time"])
    yield from (PLACED + note for note in where.notes)
    found |= {"distance": where.distance, "speed": where.speed}
    found |= {"distance_deviation": where.deviation, "wheel_scale": where.scale}
    found["clock_fault"] = found["clock_fault"] + where.doubted
    if where.direction:
        if said["direction"] in DIRECTIONS and said["direction"] != where.direction:
            yield f"{PLACED}the train runs {where.direction}, not {said['direction']} as stated"
        if said["direction"] in {"", *DIRECTIONS}:
            said["direction"] = where.direction


def _read(explained: Path, data: Path, document: Document) -> Columns:
    head, sensors = document.recording, document.sensor
    stated = {one.name: one.clock for one in table.headings(data)}
    moves = {name: one for name in DIMENSIONS if (one := getattr(head, name)) is not None}

    def clock(column: str, own: ColumnReference | None = None) -> ColumnReference | None:
        by_file = stated.get(column)
        return own or head.time or (ColumnReference(column=by_file, unit="s") if by_file else None)

    with table.located(explained):
        places = place_columns(head)
        factors = {name: _factor(one, DIMENSIONS[name]) for name, one in moves.items()}
        factors |= {name: _factor(one, dimension) for name, (one, _, dimension) in places.items()}
        sensor_factors = [_factor(one, _dimension(one)) for one in sensors]
    clock_of = {_name(one.column): clock(one.column, one.time) for one in sensors}
    clock_of |= {name: clock(one.column) for name, one in moves.items()}
    clock_of |= {name: clock(one.column, own) for name, (one, own, _) in places.items()}
    clocks = [one for one in dict.fromkeys(clock_of.values()) if one]
    with table.located(explained):
        rates = {one: _factor(one, "time") for one in clocks if one.unit not in FORMS}
    placing = {name: one for name, (one, _, _) in places.items()}
    good = head.gnss.valid if head.gnss else None
    flags = [one.valid for one in sensors if one.valid] + ([good] if good else [])
    values = table.read_columns(
        data,
        list(
            dict.fromkeys(
                one.column for one in [*moves.values(), *sensors, *rates, *placing.values()]
            )
        ),
        list(dict.fromkeys(flags)),
        [one.column for one in clocks if one not in rates],
    )
    moved = {name: factors[name] * values[one.column] for name, one in moves.items()}
    found = {name: factors[name] * values[one.column] for name, one in placing.items()}
    if good:
        found[GOOD] = values[good].astype(np.float64)
        clock_of[GOOD] = clock_of["gnss.latitude"]
    if has_places(head):
        # What says how the train moved is one source among others.
        found, moved = moved | found, {}
    return Columns(
        moved,
        tuple(_channel(one, f, values) for one, f in zip(sensors, sensor_factors, strict=True)),
        found,
        has_places(head),
        clock_of,
        {
            one: rates[one] * values[one.column]
            if one in rates
            else seconds(data, one.column, values[one.column], one.unit)
            for one in clocks
        },
    )


def _on_one_clock(read: Columns) -> tuple[dict[str, Any], list[str], float]:
    """What `build_recording` takes, with the clock and the speed mended; sentences on that; when the time is 0."""
    (clock,) = set(read.clock_of.values())
    _check_lengths(read, None if clock is None else len(read.clocks[clock]))
    motion, notes, faults = dict(read.motion), _missing(read.channels), None
    channels, places = read.channels, {}
    if clock is not None:
        time = read.clocks[clock]
        mended = repair_clock(time, motion.get("distance"), motion.get("speed"))
        notes += mended.notes
        motion = {name: values[mended.kept] for name, values in motion.items()}
        motion["time"] = mended.time
        places = {
            name: Series(mended.time, values[mended.kept]) for name, values in read.places.items()
        }
        channels = tuple(
            replace(one, values=one.values[mended.kept], valid=_kept(one, mended.kept))
            for one in channels
        )
        faults = ClockFault.JUMP * mended.jumped + ClockFault.REPEATED * mended.repeated
    elif read.placed:
        raise DataError(
            "Without a time nothing says where the train was at a sample; add the key 'time'."
        )
    speed, at = motion.get("speed"), motion.get("time", motion.get("distance"))
    if speed is not None and at is not None and not np.all(np.isfinite(speed)):
        dropped = ~np.isfinite(speed)
        motion["speed"] = fill_speed(speed, at)
        notes.append(f"the speed is missing in {np.count_nonzero(dropped)} rows: filled")
        faults = (0 if faults is None else faults) + ClockFault.SPEED * dropped
    return {"channels": channels, **motion, "clock_fault": faults, "places": places}, notes, 0.0


def _on_many_clocks(read: Columns) -> tuple[dict[str, Any], list[str], float]:
    """The same of channels that have clocks of their own."""
    if None in read.clock_of.values():
        without = [name for name, clock in read.clock_of.items() if clock is None]
        raise DataError(
            f"{', '.join(map(repr, without))} has no clock, others have; give it one (time), or leave it out."
        )
    notes, mended = _missing(read.channels), {}
    for clock, time in read.clocks.items():
        mended[clock] = repair_clock(time)
        notes += [f"{clock.column}: {note}" for note in mended[clock].notes]
    epoch = min(float(one.time[0]) for one in mended.values())

    def series(name: str, values: Array) -> Series:
        clock = read.clock_of[name]
        assert clock is not None
        if len(values) != len(mended[clock].kept):
            raise DataError(
                f"{name!r} has {len(values)} values and its clock {clock.column!r} {len(mended[clock].kept)}; "
                "choose its own clock."
            )
        kept = values[mended[clock].kept]
        return Series(mended[clock].time - epoch, kept)

    sensors = {
        one.name: series(one.name, np.where(_kept(one, slice(None)), one.values, np.nan))
        for one in read.channels
    }
    motion = {name: _finite(series(name, values)) for name, values in read.motion.items()}
    places = {name: series(name, values) for name, values in read.places.items()}
    base, values, moved = resample_to_one_clock(sensors, motion)
    channels = tuple(
        replace(one, values=values[one.name], valid=np.isfinite(values[one.name]))
        for one in read.channels
    )
    notes.append(f"{len(mended)} clocks were brought to one")
    found = {"channels": channels, "time": base, **moved, "clock_fault": 0, "places": places}
    return found, notes, epoch


def _check_lengths(read: Columns, count: int | None) -> None:
    """All columns of one clock are equally long."""
    lengths = {one.name: len(one.values) for one in read.channels}
    lengths |= {name: len(values) for name, values in (read.motion | read.places).items()}
    expected = count if count is not None else next(iter(lengths.values()))
    for name, length in lengths.items():
        if length != expected:
            raise DataError(
                f"{name!r} has {length} values where there are {expected} rows: cut short, or on a clock of its own; "
                "copy the file again, or name the clock (time)."
            )


def _finite(series: Series) -> Series:
    known = np.isfinite(series.values)
    return Series(series.time[known], series.values[known])


def _missing(channels: tuple[Channel, ...]) -> list[str]:
    return [
        f"{np.count_nonzero(~np.isfinite(one.values))} samples of {one.name!r} are missing"
        for one in channels
        if one.valid is not None and not np.isfinite(one.values[~one.valid]).all()
    ]


def _kept(channel: Channel, rows: Any) -> NDArray[np.bool_]:
    valid = np.ones(len(channel.values), bool) if channel.valid is None else channel.valid
    return valid[rows]


def _channel(sensor: SensorColumn, factor: float, values: Mapping[str, Any]) -> Channel:
    signal = factor * values[sensor.column]
    return Channel(
        name=_name(sensor.column),
        values=signal,
        quantity=sensor.quantity,
        body=sensor.body,
        position=sensor.position,
        lateral=sensor.lateral,
        noise_density=None if sensor.noise_density is None else factor * sensor.noise_density,
        bandwidth=sensor.bandwidth,
        flicker=None if sensor.flicker is None else factor * sensor.flicker,
        # What says of itself which samples are good has to be right; else an empty cell is a missing sample.
        valid=np.isfinite(signal) if sensor.valid is None else values[sensor.valid],
    )


def _name(column: str) -> str:
    return column.replace("/", "_")  # a slash would be a group in NetCDF


def _dimension(sensor: SensorColumn) -> str:
    if sensor.quantity not in QUANTITIES:
        raise DataError(
            f"column {sensor.column!r}: its quantity is one of {', '.join(QUANTITIES)}, "
            f"got {sensor.quantity!r}."
        )
    return QUANTITIES[sensor.quantity][1]


def _factor(described: ColumnReference | SensorColumn, dimension: str) -> float:
    with table.located(f"column {described.column!r}"):
        if isinstance(described, SensorColumn):
            return unit_factor(described.unit, dimension)
        return place_factor(described, dimension)

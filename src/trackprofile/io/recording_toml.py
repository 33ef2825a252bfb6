"""A recording as a table (CSV or Parquet), and a small TOML beside it that says what is what.

[recording]
data = "run.csv"                                   # beside this file
distance = { column = "distance_m", unit = "m" }   # and/or time, speed
speed = { column = "speed_km_h", unit = "km/h" }

[[sensor]]
column = "body_vertical_acceleration_m_s2"
unit = "m/s²"
quantity = "vertical acceleration"                 # or "pitch rate"
body = "body"                                      # a body of the vehicle, by name
position = 6.9                                     # m ahead of that body's centre
noise_density = 0.01                               # optional, per root hertz, in the unit above
bandwidth = 10                                     # optional, Hz, where its own filter cuts off
valid = "accelerometer_good"                       # optional, a column of 1 and 0
"""

from __future__ import annotations

from pathlib import Path

import xarray as xr
from pydantic import Field, PositiveFloat

from trackprofile.contracts import QUANTITIES, Channel, build_recording, channels
from trackprofile.contracts.rows import steps_of
from trackprofile.errors import DataError, FileError
from trackprofile.io import table, toml_document
from trackprofile.io.atomic import whole_files
from trackprofile.units import unit_factor

NAME = "a recording as a table with a TOML of the same name beside it that explains it"
HOLDS = ("recording",)
SUFFIXES = (".toml", *table.SUFFIXES)

_DIMENSIONS = {"time": "time", "distance": "length", "speed": "speed"}
_SI = {"time": "s", "distance": "m", "speed": "m/s"}
_WORDS = ("line", "direction", "source", "vehicle")


class _Column(toml_document.Strict):
    column: str
    unit: str


class _Recording(toml_document.Strict):
    data: str
    time: _Column | None = None
    distance: _Column | None = None
    speed: _Column | None = None
    line: str = ""
    direction: str = ""
    source: str = ""
    vehicle: str = ""
    provenance: list[str] = Field(default_factory=list)


class _Sensor(toml_document.Strict):
    column: str
    unit: str
    quantity: str
    body: str
    position: float
    noise_density: PositiveFloat | None = None
    bandwidth: PositiveFloat | None = None
    valid: str | None = None


class _Document(toml_document.Strict):
    recording: _Recording
    sensor: list[_Sensor] = Field(min_length=1)


def sniff(path: Path) -> bool:
    """Whether it is a TOML, or a table that has one beside it and is no profile."""
    if path.suffix.lower() == ".toml":
        return True
    return path.with_suffix(".toml").is_file() and "elevation_m" not in table.column_names(path)


def read(path: Path) -> xr.Dataset:
    """The recording that a TOML describes, given as the TOML or as the table."""
    explained = path if path.suffix.lower() == ".toml" else path.with_suffix(".toml")
    document = toml_document.load(explained, _Document)
    data = explained.parent / document.recording.data
    if path != explained and data != path:
        raise FileError(f"{path}: {explained.name} beside it describes {data.name}; give the TOML.")
    if not data.is_file():
        raise FileError(f"{explained}: there is no data file {data}; correct the key 'data'.")
    return _recording(explained, data, document)


def write(dataset: xr.Dataset, path: Path) -> tuple[Path, ...]:
    """Write the table, and the TOML that explains it.

    Raises
    ------
    FileError : the one of the two that was not named is there already, and belongs to another.
    """
    data = path.with_suffix(".csv") if path.suffix.lower() == ".toml" else path
    explained = path.with_suffix(".toml")
    _spare_strangers(path, data, explained)
    columns = {name: dataset[name].to_numpy() for name in _SI if name in dataset}
    for channel in channels(dataset):
        columns[channel.name] = channel.values
        if channel.valid is not None and not channel.valid.all():
            columns[f"{channel.name}_valid"] = channel.valid
    with whole_files(data, explained) as (data_file, toml_file):
        table.write_columns(data_file, columns)
        toml_file.write_text(_explanation(dataset, data.name, columns), encoding="utf-8")
    return (data, explained)


def _spare_strangers(path: Path, data: Path, explained: Path) -> None:
    other = explained if path == data else data
    if other.exists() and not _explains(explained, data):
        raise FileError(
            f"{other}: it would be replaced and does not belong to {path}; choose another name."
        )


def _explains(explained: Path, data: Path) -> bool:
    try:
        return toml_document.load(explained, _Document).recording.data == data.name
    except FileError:
        return False


def _recording(explained: Path, data: Path, document: _Document) -> xr.Dataset:
    head, sensors = document.recording, document.sensor
    moves = {name: one for name in _DIMENSIONS if (one := getattr(head, name)) is not None}
    with table.located(explained):
        factors = {name: _factor(one, _DIMENSIONS[name]) for name, one in moves.items()}
        sensor_factors = [_factor(one, _dimension(one)) for one in sensors]
    values = table.read_columns(
        data,
        list(dict.fromkeys(one.column for one in (*moves.values(), *sensors))),
        list(dict.fromkeys(one.valid for one in sensors if one.valid)),
    )
    measured = [
        Channel(
            name=_name(one.column),
            values=factor * values[one.column],
            quantity=one.quantity,
            body=one.body,
            position=one.position,
            noise_density=None if one.noise_density is None else factor * one.noise_density,
            bandwidth=one.bandwidth,
            valid=None if one.valid is None else values[one.valid],
        )
        for one, factor in zip(sensors, sensor_factors, strict=True)
    ]
    columns = {_name(one.column): one.column for one in sensors}
    with table.located(data, columns | {name: one.column for name, one in moves.items()}):
        return build_recording(
            measured,
            **{name: factors[name] * values[one.column] for name, one in moves.items()},
            **{word: getattr(head, word) for word in _WORDS},
            provenance=[*head.provenance, f"read from {data.name}"],
        )


def _name(column: str) -> str:
    return column.replace("/", "_")  # a slash would be a group in NetCDF


def _dimension(sensor: _Sensor) -> str:
    if sensor.quantity not in QUANTITIES:
        raise DataError(
            f"column {sensor.column!r}: its quantity is one of {', '.join(QUANTITIES)}, "
            f"got {sensor.quantity!r}."
        )
    return QUANTITIES[sensor.quantity][1]


def _factor(described: _Column | _Sensor, dimension: str) -> float:
    with table.located(f"column {described.column!r}"):
        return unit_factor(described.unit, dimension)


def _explanation(dataset: xr.Dataset, data: str, columns: dict) -> str:
    head = {"data": data}
    head |= {n: {"column": n, "unit": u} for n, u in _SI.items() if n in columns}
    head |= {word: dataset.attrs[word] for word in _WORDS if dataset.attrs.get(word)}
    head |= {"provenance": steps_of(dataset)}
    lines = ["[recording]", *_lines(head)]
    for channel in channels(dataset):
        lines += ["", "[[sensor]]"]
        sensor = {
            "column": channel.name,
            "unit": QUANTITIES[channel.quantity][0],
            "quantity": channel.quantity,
            "body": channel.body,
            "position": channel.position,
            "noise_density": channel.noise_density,
            "bandwidth": channel.bandwidth,
            "valid": f"{channel.name}_valid" if f"{channel.name}_valid" in columns else None,
        }
        lines += _lines({key: value for key, value in sensor.items() if value is not None})
    return "\n".join(lines) + "\n"


def _lines(table: dict) -> list[str]:
    return [f"{key} = {toml_document.written(value)}" for key, value in table.items()]

"""A recording as a table (CSV or Parquet), and a small TOML beside it that says what is what.

[recording]
data = "run.csv"                                   # beside this file
distance = { column = "distance_m", unit = "m" }   # and/or time, speed
speed = { column = "speed_km_h", unit = "km/h" }

[[sensor]]
column = "body_vertical_acceleration_m_s2"
unit = "m/s²"
quantity = "vertical acceleration"                 # or "pitch rate", "roll rate"
body = "body"                                      # a body of the vehicle, by name
position = 6.9                                     # m ahead of that body's centre
lateral = 1.0                                      # optional, m to the left of that body's middle
noise_density = 0.01                               # optional, per root hertz, in the unit above
bandwidth = 10                                     # optional, Hz, where its own filter cuts off
flicker = 0.003                                    # optional, of the 1/f noise at 1 Hz, per root hertz
valid = "accelerometer_good"                       # optional, a column of 1 and 0
"""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from trackprofile.contracts import QUANTITIES, channels
from trackprofile.contracts.recording import leading_end
from trackprofile.contracts.validation import steps_of
from trackprofile.errors import FileError
from trackprofile.io import table, toml_document
from trackprofile.io.atomic import whole_files
from trackprofile.io.recording_columns import WORDS, recording_of
from trackprofile.io.recording_document import Document

NAME = "a recording as a table with a TOML of the same name beside it that explains it"
HOLDS = ("recording",)
SUFFIXES = (".toml", *(suffix for suffix in table.LOGGER_SUFFIXES if suffix != ".nc"))

_SI = {"time": "s", "distance": "m", "speed": "m/s", "distance_deviation": "m"}


def sniff(path: Path) -> bool:
    """Whether it is a TOML, or a table that has one beside it and is no profile."""
    if path.suffix.lower() == ".toml":
        return True
    if not path.with_suffix(".toml").is_file():
        return False
    return path.suffix.lower() not in table.SUFFIXES or "elevation_m" not in table.column_names(
        path
    )


def read(path: Path) -> xr.Dataset:
    """The recording that a TOML describes, given as the TOML or as the table."""
    explained = path if path.suffix.lower() == ".toml" else path.with_suffix(".toml")
    document = toml_document.load(explained, Document)
    data = explained.parent / document.recording.data
    if path != explained and data != path:
        raise FileError(f"{path}: {explained.name} beside it describes {data.name}; give the TOML.")
    if not data.is_file():
        raise FileError(f"{explained}: there is no data file {data}; correct the key 'data'.")
    return recording_of(explained, data, document)


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
    units = {name: unit for name, unit in _SI.items() if name in columns}
    units |= {one.name: QUANTITIES[one.quantity][0] for one in channels(dataset)}
    with whole_files(data, explained) as (data_file, toml_file):
        table.write_columns(data_file, columns, units)
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
        return toml_document.load(explained, Document).recording.data == data.name
    except FileError:
        return False


def _explanation(dataset: xr.Dataset, data: str, columns: dict) -> str:
    head: dict[str, object] = {"data": data}
    head |= {n: {"column": n, "unit": u} for n, u in _SI.items() if n in columns}
    head |= {word: dataset.attrs[word] for word in WORDS if dataset.attrs.get(word)}
    if "wheel_scale" in dataset.attrs:
        head["wheel_scale"] = float(dataset.attrs["wheel_scale"])
    if end := leading_end(dataset):
        head["leading_end"] = end
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
            "lateral": channel.lateral or None,
            "noise_density": channel.noise_density,
            "bandwidth": channel.bandwidth,
            "flicker": channel.flicker,
            "valid": f"{channel.name}_valid" if f"{channel.name}_valid" in columns else None,
        }
        lines += _lines({key: value for key, value in sensor.items() if value is not None})
    return "\n".join(lines) + "\n"


def _lines(table: dict) -> list[str]:
    return [f"{key} = {toml_document.written(value)}" for key, value in table.items()]

"""A recording as a table (CSV, Parquet or a logger's format) and a TOML document of the same name that describes it.

[recording]
data = "run.csv"                                   # in the same folder
distance = { column = "distance_m", unit = "m" }   # and/or time, speed
speed = { column = "speed_km_h", unit = "km/h" }

[[sensor]]
column = "body_vertical_acceleration_m_s2"
unit = "m/s²"
quantity = "vertical acceleration"                 # or "pitch rate", "roll rate"
body = "body"                                      # name of a body of the vehicle
position = 6.9                                     # m ahead of the centre of that body
lateral = 1.0                                      # optional, m to the left of the centre of that body
noise_density = 0.01                               # optional, unit above per root hertz
bandwidth = 10                                     # optional, Hz, cut-off frequency of the sensor
flicker = 0.003                                    # optional, 1/f noise at 1 Hz, unit above per root hertz
valid = "accelerometer_good"                       # optional, a column of 1 and 0
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from trackprofile.contracts import QUANTITIES, Channel, channels, recording_identity
from trackprofile.contracts.recording import leading_end
from trackprofile.contracts.validation import provenance_steps
from trackprofile.errors import FileError
from trackprofile.io import table, toml_document
from trackprofile.io.atomic import whole_files
from trackprofile.io.column_info import Column
from trackprofile.io.recording_assembly import assemble_recording
from trackprofile.io.recording_document import RecordingDocument
from trackprofile.io.recording_identity import CONTENT, RawTables, raw_identity
from trackprofile.io.unlocated_recording import UnlocatedRecording

NAME = "a recording as a table with a TOML of the same name in the same folder that describes it"
HOLDS = ("recording",)
SUFFIXES = (".toml", *(suffix for suffix in table.LOGGER_SUFFIXES if suffix != ".nc"))

_TEXTS = ("line", "direction", "source", "vehicle")
_SI = {"time": "s", "distance": "m", "speed": "m/s", "distance_deviation": "m"}


def sniff(path: Path) -> bool:
    """Whether it is a TOML, or a table with a TOML of the same name that is not a profile."""
    if path.suffix.lower() == ".toml":
        return True
    if not path.with_suffix(".toml").is_file():
        return False
    return path.suffix.lower() not in table.SUFFIXES or "elevation_m" not in table.column_names(
        path
    )


def read(path: Path) -> xr.Dataset | UnlocatedRecording:
    """The recording that a TOML describes; ``path`` is the TOML or the table."""
    description = path if path.suffix.lower() == ".toml" else path.with_suffix(".toml")
    document = toml_document.load(description, RecordingDocument)
    data = description.parent / document.recording.data
    if path not in {description, data}:
        raise FileError(
            f"{path}: {description.name} in the same folder describes {data.name}; give the TOML."
        )
    if not data.is_file():
        raise FileError(
            f"{description}: the data file {data} does not exist; correct the key 'data'."
        )
    return assemble_recording(description, data, document)


def write(dataset: xr.Dataset, path: Path) -> tuple[Path, ...]:
    """Write the table and the TOML that describes it.

    Raises
    ------
    FileError : the one of the two files that was not named exists and does not belong to the other.
    """
    data = path.with_suffix(".csv") if path.suffix.lower() == ".toml" else path
    description = path.with_suffix(".toml")
    _check_other_file(path, data, description)
    # As float64, which is what reading gives, so that the digest of what is written stays true.
    columns: dict[str, Column] = {
        name: np.asarray(dataset[name], np.float64) for name in _SI if name in dataset
    }
    for channel in channels(dataset):
        columns[channel.name] = np.asarray(channel.values, np.float64)
        if channel.valid is not None and not channel.valid.all():
            columns[f"{channel.name}_valid"] = channel.valid
    units = {name: unit for name, unit in _SI.items() if name in columns}
    units |= {one.name: QUANTITIES[one.quantity][0] for one in channels(dataset)}
    with whole_files(data, description) as (data_file, toml_file):
        table.write_columns(data_file, columns, units)
        toml_file.write_text(_description(dataset, data.name, columns), encoding="utf-8")
    return (data, description)


def _check_other_file(path: Path, data: Path, description: Path) -> None:
    """Refuse to replace a table or a TOML that does not belong to the file that was named."""
    other = description if path == data else data
    if other.exists() and not _describes(description, data):
        raise FileError(
            f"{other}: the file exists and does not belong to {path}, it would be replaced; choose another name."
        )


def _describes(description: Path, data: Path) -> bool:
    try:
        return toml_document.load(description, RecordingDocument).recording.data == data.name
    except FileError:
        return False


def _description(dataset: xr.Dataset, data: str, columns: Mapping[str, Column]) -> str:
    """The TOML document of a recording, with its identity and the digest of what is written with it."""
    head: dict[str, object] = {"data": data}
    head |= {n: {"column": n, "unit": u} for n, u in _SI.items() if n in columns}
    head |= {text: dataset.attrs[text] for text in _TEXTS if dataset.attrs.get(text)}
    if "wheel_scale" in dataset.attrs:
        head["wheel_scale"] = float(dataset.attrs["wheel_scale"])
    if end := leading_end(dataset):
        head["leading_end"] = end
    head["provenance"] = provenance_steps(dataset)
    sensors = [_sensor(channel, columns) for channel in channels(dataset)]
    document = RecordingDocument.model_validate({"recording": head, "sensor": sensors})
    head["identity"] = recording_identity(dataset)
    head[CONTENT] = raw_identity(document, RawTables(columns))
    lines = ["[recording]", *_lines(head)]
    for sensor in sensors:
        lines += ["", "[[sensor]]", *_lines(sensor)]
    return "\n".join(lines) + "\n"


def _sensor(channel: Channel, columns: Mapping[str, Column]) -> dict[str, object]:
    """The table ``[[sensor]]`` of a channel."""
    valid = f"{channel.name}_valid"
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
        "valid": valid if valid in columns else None,
    }
    return {key: value for key, value in sensor.items() if value is not None}


def _lines(keys: Mapping[str, object]) -> list[str]:
    return [f"{key} = {toml_document.toml_value(value)}" for key, value in keys.items()]

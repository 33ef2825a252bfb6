"""Inspection of a file of a logger: its columns, their probable meaning, and a TOML that describes them.

The TOML is written line by line, because its comments mark every guess that a person has to check.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts.validation import provenance_steps
from trackprofile.errors import FileError, TrackprofileError
from trackprofile.io import toml_document
from trackprofile.io.atomic import whole_files
from trackprofile.io.column_guess import MIN_MONOTONIC_SHARE, SENSOR_ROLES, ColumnGuess, Role, guess
from trackprofile.io.column_info import ColumnInfo
from trackprofile.io.recording_assembly import assemble_recording
from trackprofile.io.recording_document import RecordingDocument
from trackprofile.io.table import headings, read_columns
from trackprofile.io.timestamps import timestamp_seconds
from trackprofile.io.unlocated_recording import UnlocatedRecording
from trackprofile.preprocessing.faults import Fault, find_faults
from trackprofile.units import unit_factor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ColumnContent:
    """A column: what the file states about it, its probable meaning, and a summary of its values.

    Parameters
    ----------
    heading : information in the file
    guess : probable meaning
    rows, missing : number of values, and of missing values
    least, mean, greatest : smallest, mean and largest value, in the unit of the column; NaN for text
    rate : sampling rate [Hz]; 0: no clock
    falls : whether the values decrease too often for a running count
    """

    heading: ColumnInfo
    guess: ColumnGuess
    rows: int
    missing: int
    least: float
    mean: float
    greatest: float
    rate: float
    falls: bool = False


@dataclass(frozen=True)
class Inspection:
    """File of a logger: its columns, the TOML that describes them, and the recording that it gives.

    Parameters
    ----------
    path : inspected file
    contents : its columns
    toml : description of the columns, with comments at every guess
    recording : recording that the description gives; None: it gives none, ``notes`` has the reason
    faults : faults of that recording
    notes : provenance of that recording, or the reason why there is none
    """

    path: Path
    contents: tuple[ColumnContent, ...]
    toml: str
    recording: xr.Dataset | None
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]


def inspect(path: str | Path, locate: Callable[[UnlocatedRecording], xr.Dataset]) -> Inspection:
    """Inspect a file of a logger.

    Parameters
    ----------
    path : file to inspect
    locate : estimates the positions of a recording that has position sources

    Raises
    ------
    FileError : the file does not exist, is not readable, or is of an unknown format.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(f"{path}: the file does not exist; check the path.")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty; copy or record it again.")
    infos = headings(path)
    values = _values(path, infos)
    if not any(np.isfinite(one).any() for one in values.values()):
        raise FileError(
            f"{path}: expected at least one column of numbers, got none; export the channels as numbers."
        )
    clock = next((h.name for h in infos if guess(h, values[h.name]).role is Role.TIME), "")
    contents = tuple(_column_content(path, one, values, clock) for one in infos)
    contents = _with_checked_speed_unit(contents, values)
    text = _description(path, contents)
    recording, faults, notes = _try_reading(path, text, locate)
    return Inspection(path, contents, text, recording, faults, notes)


def write_toml(inspection: Inspection, path: str | Path) -> Path:
    """Write the TOML of an inspection; it names the inspected file relative to its own folder.

    Raises
    ------
    FileError : the file exists already: corrections by a person are not overwritten.
    """
    path = Path(path)
    if path.exists():
        raise FileError(
            f"{path}: the file exists already; choose another name, or remove it first."
        )
    with whole_files(path) as (file,):
        file.write_text(
            _description(inspection.path, inspection.contents, path.parent), encoding="utf-8"
        )
    return path


def _values(path: Path, infos: Sequence[ColumnInfo]) -> dict[str, Array]:
    """Values of all columns of numbers and of timestamps, in their own units; empty for other text."""
    names = [one.name for one in infos]
    unique = [one for one in infos if names.count(one.name) == 1]
    numbers = [one.name for one in unique if not one.form]
    stamps = {one.name: one.form for one in unique if one.form not in {"", "text"}}
    columns = read_columns(path, numbers, texts=list(stamps))
    values = {name: np.asarray(columns[name], np.float64) for name in numbers}
    values |= {
        name: timestamp_seconds(path, name, columns[name], form) for name, form in stamps.items()
    }
    return {one.name: values.get(one.name, np.empty(0)) for one in infos}


def _column_content(
    path: Path, heading: ColumnInfo, values: Mapping[str, Array], clock: str
) -> ColumnContent:
    own, clock = values[heading.name], heading.clock or clock
    known = own[np.isfinite(own)]
    least, mean, greatest = np.nan, np.nan, np.nan
    if known.size:
        least, mean, greatest = (float(f(known)) for f in (np.min, np.mean, np.max))
    has_clock = clock in values and len(values[clock]) == len(own)
    rate = _rate(values[clock]) if has_clock else 0.0
    missing = len(own) - len(known)
    falls = (
        bool(np.mean(np.diff(known) < 0) > 1.0 - MIN_MONOTONIC_SHARE) if known.size > 1 else False
    )
    return ColumnContent(
        heading, guess(heading, own), len(own), missing, least, mean, greatest, rate, falls
    )


def _rate(time: Array) -> float:
    """Sampling rate of a clock [Hz]; 0 if it does not increase."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0]
    return float(1.0 / np.median(steps)) if steps.size else 0.0


def _with_checked_speed_unit(
    contents: Sequence[ColumnContent], values: Mapping[str, Array]
) -> tuple[ColumnContent, ...]:
    """Columns in which the unit of the speed, if the file does not state it, is determined by distance over time."""
    first = {role: next((c for c in contents if c.guess.role is role), None) for role in Role}
    time, distance, speed = first[Role.TIME], first[Role.DISTANCE], first[Role.SPEED]
    if time is None or distance is None or speed is None or speed.guess.sure:
        return tuple(contents)
    t, s, v = (values[one.heading.name] for one in (time, distance, speed))
    if not len(t) == len(s) == len(v) or np.ptp(t) <= 0:
        return tuple(contents)
    scale = 1.0 if time.guess.unit not in {"ms", "µs"} else unit_factor(time.guess.unit, "time")
    mean = abs(s[-1] - s[0]) * unit_factor(distance.guess.unit, "length") / (np.ptp(t) * scale)
    ratio = float(np.nanmean(v)) / mean if mean > 0 else 0.0
    unit = "km/h" if abs(ratio - 3.6) < abs(ratio - 1.0) else "m/s"
    checked = replace(speed, guess=replace(speed.guess, unit=unit, sure=True))
    return tuple(checked if one is speed else one for one in contents)


def _description(path: Path, contents: Sequence[ColumnContent], folder: Path | None = None) -> str:
    """TOML document that describes a file, with a comment at every guess."""
    data = path.name if folder is None else os.path.relpath(path, folder)
    lines = [
        "# Written by trackprofile inspect. Check and correct every line that is marked “guessed”.",
        "[recording]",
        f"data = {toml_document.toml_value(data)}",
    ]
    clocks = {one.heading.clock for one in contents} - {""}
    gnss = _gnss_lines(contents)
    speeds = [one for one in contents if one.guess.role is Role.SPEED]
    if not gnss:
        speeds += [one for one in contents if one.guess.role is Role.GNSS_SPEED]
    has_pulses = any(one.guess.role is Role.PULSES for one in contents)
    for role, key in ((Role.TIME, "time"), (Role.DISTANCE, "distance"), (Role.SPEED, "speed")):
        candidates = speeds if role is Role.SPEED else [c for c in contents if c.guess.role is role]
        if role is Role.DISTANCE and has_pulses:
            continue  # one of both is enough for a wheel
        if role is Role.TIME and clocks:
            continue  # each channel has a clock in the file
        for number, one in enumerate(candidates):
            line = f"{key} = {_column_reference(one)}"
            lines.append(("# or: " if number else "") + line + _guess_comment(one))
    lines.append('# vehicle = "velaro"  # a preset, or the TOML of a vehicle in the same folder')
    lines += [*gnss, *_odometer_and_post_lines(contents)]
    sensors = [one for one in contents if one.guess.role in SENSOR_ROLES]
    for one in sensors:
        lines += [
            "",
            "[[sensor]]",
            f"column = {toml_document.toml_value(one.heading.name)}",
            f"unit = {toml_document.toml_value(one.guess.unit)}{_guess_comment(one)}",
            f"quantity = {toml_document.toml_value(str(one.guess.role))}",
            f"body = {toml_document.toml_value(one.guess.body)}  # guessed",
            "position = 0.0  # guessed: m ahead of the centre of that body",
        ]
        if one.guess.lateral:
            lines.append(
                f"lateral = {one.guess.lateral}  # guessed: m to the left of the centre of that body"
            )
    rest = [one.heading.name for one in contents if one.guess.role not in _USED_ROLES]
    if rest:
        lines += ["", "# Not used: " + ", ".join(map(toml_document.toml_value, rest))]
    return "\n".join(lines) + "\n"


def _gnss_lines(contents: Sequence[ColumnContent]) -> list[str]:
    """Lines of the table ``[recording.gnss]``, if both coordinates are recorded."""
    roles = (Role.LATITUDE, Role.LONGITUDE, Role.GNSS_SPEED)
    first = {role: next((c for c in contents if c.guess.role is role), None) for role in roles}
    if first[Role.LATITUDE] is None or first[Role.LONGITUDE] is None:
        return []
    lines = ["", "[recording.gnss]"]
    for role, key in zip(roles, ("latitude", "longitude", "speed"), strict=True):
        if (one := first[role]) is not None:
            lines.append(f"{key} = {_column_reference(one)}{_guess_comment(one)}")
    return [
        *lines,
        '# valid = "fix"  # a column of 1 and 0',
        "# delay = 0.2  # s, delay of a recorded position",
    ]


def _odometer_and_post_lines(contents: Sequence[ColumnContent]) -> list[str]:
    """Lines of the tables ``[recording.odometer]`` and ``[recording.posts]``."""
    lines = []
    pulses = next((one for one in contents if one.guess.role is Role.PULSES), None)
    if pulses is not None:
        lines += [
            "",
            "[recording.odometer]",
            f"column = {toml_document.toml_value(pulses.heading.name)}",
            'unit = "pulses"',
            f"incremental = {toml_document.toml_value(pulses.falls)}  # guessed: true if each row has its own count",
            "per_revolution = 80  # guessed",
            "wheel_diameter = 0.92  # guessed: m",
        ]
    post = next((one for one in contents if one.guess.role is Role.POST), None)
    if post is not None:
        lines += [
            "",
            "[recording.posts]",
            f"column = {toml_document.toml_value(post.heading.name)}",
            f"unit = {toml_document.toml_value(post.guess.unit)}{_guess_comment(post)}",
        ]
    return lines


def _column_reference(content: ColumnContent) -> str:
    return toml_document.toml_value({"column": content.heading.name, "unit": content.guess.unit})


_USED_ROLES = {
    Role.TIME,
    Role.DISTANCE,
    Role.SPEED,
    Role.LATITUDE,
    Role.LONGITUDE,
    Role.GNSS_SPEED,
    Role.PULSES,
    Role.POST,
    *SENSOR_ROLES,
}


def _guess_comment(content: ColumnContent) -> str:
    return "" if content.guess.sure else "  # guessed"


def _try_reading(
    path: Path, text: str, locate: Callable[[UnlocatedRecording], xr.Dataset]
) -> tuple[xr.Dataset | None, tuple[Fault, ...], tuple[str, ...]]:
    """Recording that the TOML gives, with its faults and notes; or the error message."""
    try:
        document = toml_document.parse(text, path, RecordingDocument)
        recording = assemble_recording(path, path, document)
        if isinstance(recording, UnlocatedRecording):
            recording = locate(recording)
    except TrackprofileError as error:
        return None, (), (str(error),)
    return recording, find_faults(recording), tuple(provenance_steps(recording)[1:])

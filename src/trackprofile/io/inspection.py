"""What is in a logger's file, what each column probably is, and a TOML that says so, for a person to correct."""

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
    """A column: what the file says of it, what it probably is, and its values in a few numbers.

    ``rate`` is its sampling rate by its clock or the file's, Hz, 0 where there is none; ``least``, ``mean`` and
    ``greatest`` in its own unit, NaN where it holds texts; ``falls`` whether it goes down as often as a count does not.
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
    """A logger's file: its columns, the TOML that would explain it, and what a recording read by that would be."""

    path: Path
    contents: tuple[ColumnContent, ...]
    toml: str
    recording: xr.Dataset | None
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]


def inspect(path: str | Path, locate: Callable[[UnlocatedRecording], xr.Dataset]) -> Inspection:
    """Look into a logger's file.

    Raises
    ------
    FileError : it is not readable, or of no format that is known.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(f"{path}: there is no such file; check the path.")
    if path.stat().st_size == 0:
        raise FileError(f"{path}: the file is empty; copy or record it again.")
    found = headings(path)
    values = _values(path, found)
    if not any(np.isfinite(one).any() for one in values.values()):
        raise FileError(f"{path}: there is no row of numbers in it; export the channels as such.")
    clock = next((h.name for h in found if guess(h, values[h.name]).role is Role.TIME), "")
    contents = tuple(_column_content(path, one, values, clock) for one in found)
    contents = _with_checked_speed_unit(contents, values)
    text = _description(path, contents)
    recording, faults, notes = _try_reading(path, text, locate)
    return Inspection(path, contents, text, recording, faults, notes)


def write_toml(inspection: Inspection, path: str | Path) -> Path:
    """Write the TOML, which names the file from where it lies.

    Raises
    ------
    FileError : there is a file already: what a person corrected is not written over.
    """
    path = Path(path)
    if path.exists():
        raise FileError(f"{path}: it is there already; choose another name, or remove it first.")
    with whole_files(path) as (file,):
        file.write_text(
            _description(inspection.path, inspection.contents, path.parent), encoding="utf-8"
        )
    return path


def _values(path: Path, found: Sequence[ColumnInfo]) -> dict[str, Array]:
    """All columns of numbers, and times that are texts, in their own units; no values of other texts."""
    names = [one.name for one in found]
    once = [one for one in found if names.count(one.name) == 1]
    numbers = [one.name for one in once if not one.form]
    stamps = {one.name: one.form for one in once if one.form not in {"", "text"}}
    read_ = read_columns(path, numbers, texts=list(stamps))
    values = {name: np.asarray(read_[name], np.float64) for name in numbers}
    values |= {
        name: timestamp_seconds(path, name, read_[name], form) for name, form in stamps.items()
    }
    return {one.name: values.get(one.name, np.empty(0)) for one in found}


def _column_content(
    path: Path, heading: ColumnInfo, values: Mapping[str, Array], clock: str
) -> ColumnContent:
    own, by = values[heading.name], heading.clock or clock
    known = own[np.isfinite(own)]
    least, mean, greatest = np.nan, np.nan, np.nan
    if known.size:
        least, mean, greatest = (float(f(known)) for f in (np.min, np.mean, np.max))
    rate = _rate(values[by]) if by in values and len(values[by]) == len(own) else 0.0
    missing = len(own) - len(known)
    falls = (
        bool(np.mean(np.diff(known) < 0) > 1.0 - MIN_MONOTONIC_SHARE) if known.size > 1 else False
    )
    return ColumnContent(
        heading, guess(heading, own), len(own), missing, least, mean, greatest, rate, falls
    )


def _rate(time: Array) -> float:
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0]
    return float(1.0 / np.median(steps)) if steps.size else 0.0


def _with_checked_speed_unit(
    contents: Sequence[ColumnContent], values: Mapping[str, Array]
) -> tuple[ColumnContent, ...]:
    """The speed's unit where the file does not say it, by distance over time."""
    first = {role: next((c for c in contents if c.guess.role is role), None) for role in Role}
    time, distance, speed = first[Role.TIME], first[Role.DISTANCE], first[Role.SPEED]
    if time is None or distance is None or speed is None or speed.guess.sure:
        return tuple(contents)
    t, s, v = (values[one.heading.name] for one in (time, distance, speed))
    if not len(t) == len(s) == len(v) or np.ptp(t) <= 0:
        return tuple(contents)
    scale = 1.0 if time.guess.unit not in {"ms", "µs"} else unit_factor(time.guess.unit, "time")
    mean = abs(s[-1] - s[0]) * unit_factor(distance.guess.unit, "length") / (np.ptp(t) * scale)
    told = float(np.nanmean(v)) / mean if mean > 0 else 0.0
    unit = "km/h" if abs(told - 3.6) < abs(told - 1.0) else "m/s"
    checked = replace(speed, guess=replace(speed.guess, unit=unit, sure=True))
    return tuple(checked if one is speed else one for one in contents)


def _description(path: Path, contents: Sequence[ColumnContent], folder: Path | None = None) -> str:
    """What explains the file, with a remark on everything that is guessed."""
    data = path.name if folder is None else os.path.relpath(path, folder)
    lines = [
        "# Written by trackprofile inspect. What is marked “guessed” is for you to correct.",
        "[recording]",
        f"data = {toml_document.toml_value(data)}",
    ]
    clocks = {one.heading.clock for one in contents} - {""}
    satellites = _gnss_lines(contents)
    speeds = [one for one in contents if one.guess.role is Role.SPEED]
    if not satellites:
        speeds += [one for one in contents if one.guess.role is Role.GNSS_SPEED]
    pulsed = any(one.guess.role is Role.PULSES for one in contents)
    for role, key in ((Role.TIME, "time"), (Role.DISTANCE, "distance"), (Role.SPEED, "speed")):
        those = speeds if role is Role.SPEED else [c for c in contents if c.guess.role is role]
        if role is Role.DISTANCE and pulsed:
            continue  # one wheel is counted once
        if role is Role.TIME and clocks:
            continue  # each channel has the file's own
        for number, one in enumerate(those):
            line = f"{key} = {_column_reference(one)}"
            lines.append(("# or: " if number else "") + line + _guess_comment(one))
    lines.append('# vehicle = "velaro"  # a preset, or the TOML of a vehicle beside this file')
    lines += [*satellites, *_odometer_and_post_lines(contents)]
    sensors = [one for one in contents if one.guess.role in SENSOR_ROLES]
    for one in sensors:
        lines += [
            "",
            "[[sensor]]",
            f"column = {toml_document.toml_value(one.heading.name)}",
            f"unit = {toml_document.toml_value(one.guess.unit)}{_guess_comment(one)}",
            f"quantity = {toml_document.toml_value(str(one.guess.role))}",
            f"body = {toml_document.toml_value(one.guess.body)}  # guessed",
            "position = 0.0  # guessed: m ahead of that body's centre",
        ]
        if one.guess.lateral:
            lines.append(f"lateral = {one.guess.lateral}  # guessed: m to the left of its middle")
    rest = [one.heading.name for one in contents if one.guess.role not in _USED_ROLES]
    if rest:
        lines += ["", "# Not used: " + ", ".join(map(toml_document.toml_value, rest))]
    return "\n".join(lines) + "\n"


def _gnss_lines(contents: Sequence[ColumnContent]) -> list[str]:
    """The table of satellite positions, where there are both coordinates."""
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
        "# delay = 0.2  # s by which a fix is recorded late",
    ]


def _odometer_and_post_lines(contents: Sequence[ColumnContent]) -> list[str]:
    """The tables of an odometer's pulses and of kilometre posts."""
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
    """The recording that the TOML makes of the file, or the sentence with which it does not."""
    try:
        document = toml_document.parse(text, path, RecordingDocument)
        recording = assemble_recording(path, path, document)
        if isinstance(recording, UnlocatedRecording):
            recording = locate(recording)
    except TrackprofileError as error:
        return None, (), (str(error),)
    return recording, find_faults(recording), tuple(provenance_steps(recording)[1:])

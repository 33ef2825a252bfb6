"""The manifest of a batch: its recordings, and the settings of each.

    line = "Testline"                       # default of all recordings
    direction = "up"
    day = 2026-05-31
    vehicle = "velaro"                      # a preset, or a TOML next to this file; default: that of the recording
    track = "zhai"                          # default: rigid
    prior = "german-low"                    # default: estimated from the data
    limits = "en-13848"
    speed = "160 km/h"                      # of the line

    [[recording]]
    file = "runs/0412.toml"                 # path relative to this file
    run = "IC 512"                          # tells the passes of one day apart
    offset = "12.5 km"                      # distance of the line where that of the recording is 0
    start = "13 km"                         # stretch by the distance of the line; default: all
    end = "18 km"
    vehicle = "car-7.toml"
    revision = 1                            # the highest revision of a recording is shown

``table = "batch.csv"`` can replace or extend the tables ``[[recording]]``: a CSV with these keys as columns and one
recording per row; an empty cell means the default. Such a CSV is a manifest by itself if its rows are complete.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, NonNegativeInt

from trackprofile.assessment.limits_toml import limit_presets, read_limits
from trackprofile.errors import FileError, TrackprofileError
from trackprofile.fleet.job import Row
from trackprofile.io import toml_document
from trackprofile.io.model_toml import RIGID, presets, read_spectrum, read_track, read_vehicle
from trackprofile.io.scenario_tables import Length, Speed

TABLE = ".csv"
SUFFIXES = (".toml", TABLE)


def _day(value: object) -> object:
    """A date, also given as text, as in a CSV."""
    try:
        return date.fromisoformat(value) if isinstance(value, str) else value
    except ValueError as error:
        raise ValueError("expected a day such as 2026-05-31") from error


def _number(value: object) -> object:
    """A whole number, also given as text."""
    return int(value) if isinstance(value, str) and value.isdecimal() else value


_Text = Annotated[str, Field(min_length=1)]


class _Said(toml_document.Strict):
    """Settings of one recording, or defaults of all."""

    line: _Text | None = None
    direction: _Text | None = None
    day: Annotated[date, BeforeValidator(_day)] | None = None
    run: str | None = None
    vehicle: _Text | None = None
    track: _Text | None = None
    prior: _Text | None = None
    limits: _Text | None = None
    speed: Speed | None = None
    offset: Length | None = None
    start: Length | None = None
    end: Length | None = None
    revision: Annotated[NonNegativeInt, BeforeValidator(_number)] | None = None


class _Recording(_Said):
    file: _Text


class _Manifest(_Said):
    table: _Text | None = None
    recording: list[_Recording] = Field(default_factory=list)


_NEEDED = ("line", "direction", "day", "speed")
_USUAL: Mapping[str, Any] = {
    "run": "", "vehicle": None, "track": RIGID, "prior": None, "limits": "en-13848", "offset": 0.0,
    "start": None, "end": None, "revision": 0,
}  # fmt: skip


def read_manifest(path: str | Path) -> tuple[Row, ...]:
    """The recordings of a manifest, each with its settings, checked but not read.

    Raises
    ------
    FileError : the manifest cannot be read, has a wrong key or no recording, or a file that it names is not there.
    TrackprofileError : a vehicle, track, prior or limits cannot be used.

    Examples
    --------
    >>> read_manifest("batch.docx")
    Traceback (most recent call last):
    trackprofile.errors.FileError: batch.docx: expected a manifest that ends in .toml, .csv.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileError(f"{path}: expected a manifest that ends in {', '.join(SUFFIXES)}.")
    if path.suffix.lower() == TABLE:
        said, recordings = {}, _of_table(path)
    else:
        manifest = toml_document.load(path, _Manifest)
        said = _stated(manifest)
        recordings = manifest.recording
        if manifest.table:
            recordings = [*recordings, *_of_table(path.parent / manifest.table)]
    if not recordings:
        raise FileError(f"{path}: it names no recording; add tables [[recording]], or a table.")
    rows = tuple(
        _row(path, number, one.file, said | _stated(one))
        for number, one in enumerate(recordings, start=1)
    )
    _check_models(path, rows)
    return rows


def _stated(said: _Said) -> dict[str, Any]:
    return {
        name: value for name in _Said.model_fields if (value := getattr(said, name)) is not None
    }


def _of_table(path: Path) -> list[_Recording]:
    """The recordings of a CSV; the separator is that of its header."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not a CSV in UTF-8: {error}.") from error
    separator = ";" if ";" in text.partition("\n")[0] else ","
    rows = list(csv.reader(io.StringIO(text), delimiter=separator))
    heads, *rows = [row for row in rows if any(map(str.strip, row))] or [[]]
    filled = []
    for number, row in enumerate(rows, start=1):
        if len(row) != len(heads):
            raise FileError(
                f"{path}: recording {number} has {len(row)} cells, the header {len(heads)}; mend it."
            )
        cells = zip(map(str.strip, heads), map(str.strip, row), strict=True)
        filled.append({head: cell for head, cell in cells if cell})
    return toml_document.checked({"recording": filled}, path, _Manifest).recording


def _row(path: Path, number: int, file: str, said: Mapping[str, Any]) -> Row:
    where, beside = f"{path}: recording {number} ({file})", path.parent.absolute()
    for key in _NEEDED:
        if key not in said:
            raise FileError(f"{where}: key {key!r} is missing; add it there, or at the top.")
    if not (beside / file).is_file():
        raise FileError(f"{where}: there is no such file; correct the key 'file'.")
    full = {**_USUAL, **said}
    for key, (names, _) in _MODELS.items():
        full[key] = _found(full[key], names(), beside)
    if not full["speed"] > 0:
        raise FileError(f"{where}: the line's speed must be above 0, got {full['speed']:g} m/s.")
    return Row(number, beside / file, **full)


def _found(name: str | None, known: Sequence[str], beside: Path) -> str | None:
    """A preset's name unchanged, otherwise the path of the file relative to the manifest."""
    if name is None or (name in known and not (beside / name).is_file()):
        return name
    return str(beside / name)


_MODELS: Mapping[str, tuple[Callable[[], Sequence[str]], Callable[[str], object]]] = {
    "vehicle": (lambda: presets("vehicle"), read_vehicle),
    "track": (lambda: presets("track"), read_track),
    "prior": (lambda: presets("spectrum"), read_spectrum),
    "limits": (limit_presets, read_limits),
}
"""By key: the presets, and what reads them and files."""


def _check_models(path: Path, rows: Sequence[Row]) -> None:
    """Check that every vehicle, track, prior and limit set can be read."""
    for key, (_, read) in _MODELS.items():
        first = {name: row for row in reversed(rows) if (name := getattr(row, key)) is not None}
        for name, row in first.items():
            try:
                read(name)
            except TrackprofileError as error:
                raise FileError(f"{path}: recording {row.number}, {key}: {error}") from error

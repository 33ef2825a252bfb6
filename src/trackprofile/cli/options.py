"""Options that several commands share, and how their files are opened."""

from __future__ import annotations

from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile.errors import DataError, FileError

if TYPE_CHECKING:
    import xarray as xr

From = Annotated[float | None, typer.Option("--from", metavar="M", help="Start of the stretch, m.")]
To = Annotated[float | None, typer.Option("--to", metavar="M", help="End of the stretch, m.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
TrackName = Annotated[
    str, typer.Option("--track", metavar="T", help="rigid, a preset such as zhai, or a TOML.")
]
OptionalVehicle = Annotated[
    str | None,
    typer.Option("--vehicle", metavar="V", help="A preset, or a TOML as calibrate writes it."),
]
RequiredVehicle = Annotated[
    str, typer.Option("--vehicle", metavar="V", help="A preset, or the TOML of a vehicle.")
]


class RailName(StrEnum):
    """Of a profile that tells both rails apart."""

    LEFT = "left"
    RIGHT = "right"
    MEAN = "mean"
    DIFFERENCE = "difference"


class JudgedRail(StrEnum):
    """Those that have a longitudinal level."""

    LEFT = "left"
    RIGHT = "right"
    MEAN = "mean"


RailOf = Annotated[
    JudgedRail | None, typer.Option("--rail", help="Of a profile per rail; without, the mean.")
]


def read_as(path: Path, kind: str) -> xr.Dataset:
    """The recording or profile in a file; FileError where it is the other."""
    from trackprofile.reader import read

    dataset = read(path)
    found = dataset.attrs["kind_of_data"]
    if found != kind:
        raise FileError(f"{path}: expected a {kind}, this is a {found}; give the right file.")
    return dataset


def day_of(text: str) -> date:
    """A day, as ISO 8601 writes it."""
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise DataError(f"{text!r}: expected a day such as 2026-05-31.") from error

"""Options that several commands share, and how their values and files are read."""

from __future__ import annotations

from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.errors import DataError, FileError, UnitError

if TYPE_CHECKING:
    import xarray as xr


def flag(name: str, help_text: str) -> Any:
    """An option without a value."""
    return typer.Option(name, metavar="", help=help_text)


def length(text: str) -> float:
    """A length in m, from a number with its unit or a number of metres."""
    from trackprofile.units import quantity

    try:
        return quantity(text, "length", default_unit="m")
    except UnitError as error:
        raise typer.BadParameter(str(error)) from error


def hours(text: str) -> float:
    """A duration in h, from a number with its unit or a number of hours."""
    from trackprofile.units import quantity

    try:
        return quantity(text, "time", default_unit="h") / 3600
    except UnitError as error:
        raise typer.BadParameter(str(error)) from error


From = Annotated[
    float | None,
    typer.Option(
        "--from",
        metavar="LENGTH",
        parser=length,
        help='Use only data from this distance along the track on, such as "1.2 km" or "75 m"; a number without unit '
        "is in m. Default: the start of the data.",
    ),
]
To = Annotated[
    float | None,
    typer.Option(
        "--to",
        metavar="LENGTH",
        parser=length,
        help='Use only data up to this distance along the track, such as "1.2 km" or "75 m"; a number without unit '
        "is in m. Default: the end of the data.",
    ),
]
Json = Annotated[
    bool,
    flag("--json", "Print the result, or the error, as one JSON object on standard output."),
]
TrackName = Annotated[
    str,
    typer.Option(
        "--track",
        metavar="TRACK",
        help="Track model under the wheels: rigid (no deflection), a preset such as zhai, or a TOML file.",
    ),
]
OptionalVehicle = Annotated[
    str | None,
    typer.Option(
        "--vehicle",
        metavar="VEHICLE",
        help="Vehicle model: a preset (listed by `trackprofile vehicles list`) or a TOML file, such as one written by "
        "`trackprofile calibrate`. Default: the vehicle that the recording names.",
    ),
]
RequiredVehicle = Annotated[
    str,
    typer.Option(
        "--vehicle",
        metavar="VEHICLE",
        help="Vehicle model: a preset (listed by `trackprofile vehicles list`) or a TOML file.",
    ),
]
StoreUrl = Annotated[
    str,
    typer.Option(
        "--store", metavar="STORE", help="The store: a folder, or a URL such as s3://bucket/passes."
    ),
]
FirstDate = Annotated[
    str | None,
    typer.Option(
        "--first-date",
        metavar="DATE",
        help="Use only passes on or after this date, such as 2026-05-31. Default: no limit.",
    ),
]
LastDate = Annotated[
    str | None,
    typer.Option(
        "--last-date",
        metavar="DATE",
        help="Use only passes on or before this date, such as 2026-05-31. Default: no limit.",
    ),
]
ForwardBackward = Annotated[
    bool,
    flag(
        "--forward-backward",
        "Apply the band filter forwards and backwards, which makes it 6 dB down at the band limits. Default: one "
        "zero-phase filter that is 3 dB down. Results of the two filters are not comparable.",
    ),
]


class RailName(StrEnum):
    """Which rail of a profile with separate rails is compared."""

    LEFT = "left"
    RIGHT = "right"
    MEAN = "mean"
    DIFFERENCE = "difference"


class AssessedRail(StrEnum):
    """Rails that have a longitudinal level."""

    LEFT = "left"
    RIGHT = "right"
    MEAN = "mean"


RailOption = Annotated[
    AssessedRail | None,
    typer.Option(
        "--rail", help="Rail to use of a profile with separate rails. Default: the mean of both."
    ),
]


def read_as(path: Path, kind: str) -> xr.Dataset:
    """The recording or profile in a file; FileError if the file holds the other."""
    from trackprofile.reader import read

    dataset = read(path)
    actual = dataset.attrs["kind_of_data"]
    if actual != kind:
        raise FileError(f"{path}: expected a {kind}, this is a {actual}; give the right file.")
    return dataset


def parse_date(text: str) -> date:
    """A date in ISO 8601."""
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise DataError(f"{text!r}: expected a date such as 2026-05-31.") from error

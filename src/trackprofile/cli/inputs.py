"""Profiles, limits and chainage that commands read, and the options that name them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli.options import AssessedRail, parse_date, read_as
from trackprofile.errors import DataError, FileError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.assess import Assessment
    from trackprofile.assessment.trend import DatedProfile, Trend
    from trackprofile.positioning.chainage import ChainageTable

Profile = Annotated[Path, typer.Argument(metavar="PROFILE", help="Profile: .nc, .csv or .parquet.")]
Speed = Annotated[
    str,
    typer.Option(
        "--speed",
        metavar="SPEED",
        help='Speed of the line with its unit, such as "160 km/h"; the limits depend on it.',
    ),
]
LimitsName = Annotated[
    str,
    typer.Option(
        "--limits",
        metavar="LIMITS",
        help="Limit set: a preset (en-13848, national-example) or a TOML file.",
    ),
]
ChainageFile = Annotated[
    Path | None,
    typer.Option(
        "--chainage",
        metavar="TABLE",
        help="Table of kilometre posts and coordinates along the track, .csv or .parquet, to locate results by. "
        "Default: kilometres from distance 0, no coordinates.",
    ),
]


def read_chainage_table(path: Path | None) -> ChainageTable:
    """The chainage table in a file; without a file, kilometres from distance 0."""
    from trackprofile.io.chainage_table import read_chainage
    from trackprofile.positioning.chainage import ChainageTable

    return ChainageTable() if path is None else read_chainage(path)


def assess_profile(
    profile: xr.Dataset,
    limits: str,
    speed: str,
    *,
    forward_backward: bool = False,
    rail: AssessedRail | None = None,
) -> Assessment:
    """The assessment of one rail of a profile, by the values of the options."""
    from trackprofile.assessment.assess import assess
    from trackprofile.assessment.limits_toml import read_limits
    from trackprofile.contracts import Rail, select_rail
    from trackprofile.io.model_toml import presets, read_roughness
    from trackprofile.units import quantity

    limit_set = read_limits(limits)
    selected = select_rail(profile, Rail(rail or AssessedRail.MEAN))
    spectra = {name: read_roughness(name) for name in presets("spectrum")}
    return assess(
        selected,
        limit_set,
        quantity(speed, "speed"),
        spectra=spectra,
        forward_backward=forward_backward,
    )


def read_dated_profile(text: str, rail: AssessedRail | None = None) -> DatedProfile:
    """The profile and date of an argument PROFILE=DATE, named after the file."""
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts import Rail, select_rail

    path, _, day = text.rpartition("=")
    try:
        when = parse_date(day)
    except DataError as error:
        raise FileError(
            f"{text}: expected a profile and its date, such as may.nc=2026-05-31, got {text!r}."
        ) from error
    profile = select_rail(read_as(Path(path), "profile"), Rail(rail or AssessedRail.MEAN))
    return DatedProfile(profile, when, Path(path).name)


def compare_dates(passes: list[DatedProfile], limits: str, speed: str | None) -> Trend:
    """The change between passes, by the values of the options."""
    from trackprofile.assessment.limits_toml import read_limits
    from trackprofile.assessment.trend import trend
    from trackprofile.units import quantity

    line_speed = None if speed is None else quantity(speed, "speed")
    return trend(passes, read_limits(limits), line_speed)


def as_text(files: Any) -> list[str]:
    """The paths of files as text."""
    return list(map(str, files))

"""`trackprofile assess`, `report` and `changes`: from profiles to what they oblige to."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.options import From, Json, JudgedRail, RailOf, To, read_as
from trackprofile.errors import DataError, FileError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.assess import Assessment
    from trackprofile.assessment.limits import Limits
    from trackprofile.assessment.trend import DatedProfile, Trend
    from trackprofile.contracts import Rail
    from trackprofile.positioning.chainage import ChainageTable

TABLES = ("defects", "sections", "not_assessed", "spectra")
CHANGE_TABLES = ("changes", "repeatability")

Profile = Annotated[Path, typer.Argument(metavar="PROFILE", help=".nc, .csv or .parquet.")]
Speed = Annotated[str, typer.Option("--speed", metavar="SPEED", help='Of the line: "160 km/h".')]
LimitsName = Annotated[
    str, typer.Option("--limits", metavar="L", help="A preset such as en-13848, or a TOML.")
]
WayFile = Annotated[
    Path | None,
    typer.Option(
        "--way", metavar="TABLE", help="Kilometre posts and coordinates, .csv or .parquet."
    ),
]
FilterPasses = Annotated[
    int,
    typer.Option("--passes", min=1, max=2, help="Of the band filter: 2 is forwards and backwards."),
]
Dated = Annotated[
    list[str], typer.Argument(metavar="PROFILE=DAY...", help="Such as may.nc=2026-05-31.")
]


def assess(
    profile: Profile,
    speed: Speed,
    limits: LimitsName = "en-13848",
    way: WayFile = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help=".csv, .parquet or .geojson. Repeatable.",
        ),
    ] = None,
    from_m: From = None,
    to_m: To = None,
    passes: FilterPasses = 1,
    rail: Annotated[
        JudgedRail | None,
        typer.Option("--rail", help="Of a profile per rail; without, left, right and mean."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Judge a profile by limits: defects with their probability, standard deviations, classes."""
    from trackprofile.assessment.tables import geojson_per_rail, tables, tables_per_rail
    from trackprofile.contracts import select_stretch
    from trackprofile.io.result_tables import (
        GEOJSON_SUFFIX,
        table_files,
        write_geojson,
        write_tables,
    )
    from trackprofile.reporting.summary import headline

    along = way_of(way)
    wanted = output or []
    for path in wanted:
        if path.suffix.lower() != GEOJSON_SUFFIX:
            table_files(path, TABLES)
        elif not along.has_coordinates:
            raise DataError(
                f"{path}: a map needs latitude and longitude; give a --way that has them."
            )
    each, apart = _each_rail(
        select_stretch(read_as(profile, "profile"), from_m, to_m), limits, speed, passes, rail
    )
    found = next(iter(each.values()))
    made = tables_per_rail(each, along) if apart else tables(found, along)
    files: list[Path] = []
    for path in wanted:
        if path.suffix.lower() == GEOJSON_SUFFIX:
            files.append(write_geojson(geojson_per_rail(each, along), path))
        else:
            files += write_tables(made, path)
    said = [headline(found, along), *_sentences(each, along, apart=apart)]
    notes = list(dict.fromkeys(note for one in each.values() for note in one.notes))
    if as_json:
        about = {"summary": said, "notes": notes, "filter": found.filter}
        show.as_one_object({"files": list(map(str, files))} | about | made)
        return
    show.note([f"{note}." for note in notes])
    for sentence in said:
        show.say(sentence)
    if files:
        show.say(f"Tables in {', '.join(map(str, files))}.")


def report(
    profile: Profile,
    speed: Speed,
    output: Annotated[
        list[Path],
        typer.Option("-o", "--output", metavar="FILE", help=".html or .pdf. Repeatable."),
    ],
    limits: LimitsName = "en-13848",
    way: WayFile = None,
    title: Annotated[str, typer.Option(help="Of the report.")] = "Track report",
    beside: Annotated[
        Path | None,
        typer.Option(metavar="PROFILE", help="Another profile of the place, drawn and compared."),
    ] = None,
    earlier: Annotated[
        list[str] | None,
        typer.Option(metavar="PROFILE=DAY", help="An earlier pass, for the change. Repeatable."),
    ] = None,
    day: Annotated[
        str | None, typer.Option(metavar="DAY", help="Of PROFILE, with --earlier.")
    ] = None,
    from_m: From = None,
    to_m: To = None,
    passes: FilterPasses = 1,
    rail: RailOf = None,
    as_json: Json = False,
) -> None:
    """Write a report that needs no network: what is wrong, where, how sure, what it obliges to."""
    from trackprofile.reporting.report import report as write_report
    from trackprofile.reporting.report import report_files
    from trackprofile.reporting.summary import headline, summary

    report_files(*output)
    along = way_of(way)
    span = (from_m, to_m, passes, rail)
    found = _assessed(profile, limits, speed, *span)
    other = None if beside is None else _assessed(beside, limits, speed, *span)
    changed = None
    if earlier or day:
        if not (earlier and day):
            raise DataError(
                "A change needs both --earlier PROFILE=DAY and the --day of the profile."
            )
        all_passes = [dated(one, rail) for one in (*earlier, f"{profile}={day}")]
        changed = _changed(all_passes, limits, speed)
    sources = {"profile file": profile.name, "limits file": limits}
    files = write_report(
        found, *output, title=title, chainage=along, sources=sources, compared=other,
        compared_name="" if beside is None else beside.name, trend=changed,
    )  # fmt: skip
    said = [headline(found, along), *summary(found, along)]
    if as_json:
        show.as_one_object(
            {"files": list(map(str, files)), "summary": said, "notes": list(found.notes)}
        )
        return
    show.note([f"{note}." for note in found.notes])
    for sentence in said:
        show.say(sentence)
    show.say(f"Report in {', '.join(map(str, files))}.")


def changes(
    profiles: Dated,
    speed: Annotated[
        str | None, typer.Option(metavar="SPEED", help="Of the line, for the dates of limits.")
    ] = None,
    limits: LimitsName = "en-13848",
    way: WayFile = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help=".csv or .parquet, a file per table."),
    ] = None,
    rail: RailOf = None,
    as_json: Json = False,
) -> None:
    """Say what changed between passes over the same place, how fast, and when a limit is reached."""
    from trackprofile.assessment.tables import change_table, repeatability_table
    from trackprofile.io.result_tables import table_files, write_tables
    from trackprofile.reporting.summary import trend_summary

    if output is not None:
        table_files(output, CHANGE_TABLES)
    along = way_of(way)
    found = _changed([dated(one, rail) for one in profiles], limits, speed)
    made = {"changes": change_table(found, along), "repeatability": repeatability_table(found)}
    files = () if output is None else write_tables(made, output)
    said = trend_summary(found, along)
    if as_json:
        about: dict[str, Any] = {"summary": said, "notes": list(found.notes)}
        show.as_one_object({"files": list(map(str, files))} | about | made)
        return
    show.note([f"{note}." for note in found.notes])
    for sentence in said:
        show.say(sentence)
    if files:
        show.say(f"Tables in {', '.join(map(str, files))}.")


def way_of(path: Path | None) -> ChainageTable:
    """Kilometre posts and coordinates from a file; without one, the distance itself."""
    from trackprofile.io.chainage_table import read_chainage
    from trackprofile.positioning.chainage import ChainageTable

    return ChainageTable() if path is None else read_chainage(path)


def _each_rail(
    profile: xr.Dataset, limits: str, speed: str, passes: int, rail: JudgedRail | None
) -> tuple[dict[Rail, Assessment], bool]:
    """The assessment of the rail that is asked for, else of all that there are; and whether they are told apart."""
    from trackprofile.contracts import Rail, available_rails

    apart = len(available_rails(profile)) > 1
    rails = list(JudgedRail) if apart and rail is None else [rail or JudgedRail.MEAN]
    return {Rail(one): judged(profile, limits, speed, passes, one) for one in rails}, apart


def _sentences(each: Mapping[Rail, Assessment], along: ChainageTable, *, apart: bool) -> list[str]:
    """The summary, rail by rail."""
    from trackprofile.reporting.summary import summary

    return [
        (f"{rail.value.capitalize()}: " if apart else "") + sentence
        for rail, found in each.items()
        for sentence in summary(found, along)
    ]


def judged(
    read: xr.Dataset, limits: str, speed: str, passes: int, rail: JudgedRail | None = None
) -> Assessment:
    """A profile assessed, as the options say."""
    from trackprofile.assessment.assess import assess as judge
    from trackprofile.assessment.limits_toml import read_limits
    from trackprofile.contracts import Rail, select_rail
    from trackprofile.io.model_toml import presets, read_roughness
    from trackprofile.units import quantity

    rules = read_limits(limits)
    profile = select_rail(read, Rail(rail or JudgedRail.MEAN))
    spectra = {name: read_roughness(name) for name in presets("spectrum")}
    return judge(profile, rules, quantity(speed, "speed"), spectra=spectra, passes=passes)


def _assessed(
    path: Path, limits: str, speed: str, from_m: float | None, to_m: float | None, passes: int,
    rail: JudgedRail | None,
) -> Assessment:  # fmt: skip
    from trackprofile.contracts import select_stretch

    return judged(
        select_stretch(read_as(path, "profile"), from_m, to_m), limits, speed, passes, rail
    )


def dated(text: str, rail: JudgedRail | None = None) -> DatedProfile:
    """A pass of PROFILE=DAY, named after the file."""
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts import Rail, select_rail

    path, _, day = text.rpartition("=")
    try:
        when = date.fromisoformat(day)
    except ValueError as error:
        raise FileError(
            f"{text}: expected a profile and its day, such as may.nc=2026-05-31, got {text!r}."
        ) from error
    profile = select_rail(read_as(Path(path), "profile"), Rail(rail or JudgedRail.MEAN))
    return DatedProfile(profile, when, Path(path).name)


def _changed(passes: list[DatedProfile], limits: str, speed: str | None) -> Trend:
    from trackprofile.assessment.limits_toml import read_limits
    from trackprofile.assessment.trend import trend as compared
    from trackprofile.units import quantity

    rules: Limits = read_limits(limits)
    return compared(passes, rules, None if speed is None else quantity(speed, "speed"))

"""`trackprofile trend`: what changed between passes over the same track."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.inputs import (
    ChainageFile,
    LimitsName,
    as_text,
    compare_dates,
    read_chainage_table,
    read_dated_profile,
)
from trackprofile.cli.options import Json, RailOption


def trend(
    profiles: Annotated[
        list[str],
        typer.Argument(
            metavar="PROFILE=DATE",
            help="Two or more profiles of the same track with their dates, such as may.nc=2026-05-31.",
        ),
    ],
    speed: Annotated[
        str | None,
        typer.Option(
            metavar="SPEED",
            help='Speed of the line with its unit, such as "160 km/h": the dates at which its limits will be reached '
            "are then predicted. Default: no prediction.",
        ),
    ] = None,
    limits: LimitsName = "en-13848",
    chainage: ChainageFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File for the tables of changed locations and of repeatability: .csv or .parquet; one file per table, "
            "its name is appended. Default: only the summary is printed.",
        ),
    ] = None,
    rail: RailOption = None,
    as_json: Json = False,
) -> None:
    """Detect where the track changed between passes, at what rate, and when limits will be reached."""
    from trackprofile.assessment.limits import condense_notes
    from trackprofile.assessment.tables import (
        TREND_TABLES,
        change_table,
        repeatability_table,
    )
    from trackprofile.io.result_tables import table_files, write_tables
    from trackprofile.reporting.summary import trend_summary

    if output is not None:
        table_files(output, TREND_TABLES)
    table = read_chainage_table(chainage)
    result = compare_dates([read_dated_profile(one, rail) for one in profiles], limits, speed)
    tables = {"changes": change_table(result, table), "repeatability": repeatability_table(result)}
    files = () if output is None else write_tables(tables, output)
    sentences = trend_summary(result, table)
    if as_json:
        about: dict[str, Any] = {"summary": sentences, "notes": list(result.notes)}
        show.as_one_object({"files": as_text(files)} | about | tables)
        return
    show.note_sentences(condense_notes(result.notes))
    for sentence in sentences:
        show.say(sentence)
    show.tables_in(files)

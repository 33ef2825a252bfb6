"""`trackprofile report`: a report of an assessment, as HTML or PDF."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.inputs import (
    ChainageFile,
    LimitsName,
    Profile,
    Speed,
    as_text,
    assess_profile,
    compare_dates,
    read_chainage_table,
    read_dated_profile,
)
from trackprofile.cli.options import ForwardBackward, From, Json, RailOption, To, read_as
from trackprofile.errors import DataError


def report(
    profile: Profile,
    speed: Speed,
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write the report to: .html (self-contained) or .pdf. Repeatable.",
        ),
    ],
    limits: LimitsName = "en-13848",
    chainage: ChainageFile = None,
    title: Annotated[str, typer.Option(help="Title of the report.")] = "Track report",
    compare_with: Annotated[
        Path | None,
        typer.Option(
            metavar="PROFILE",
            help="Another profile of the same track, such as a measured one: it is drawn in the charts, and the "
            "differences of its assessment are listed.",
        ),
    ] = None,
    previous: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PROFILE=DATE",
            help="Profile of a previous pass with its date, such as may.nc=2026-05-31: the report then lists what has "
            "changed. Repeatable. Needs --date.",
        ),
    ] = None,
    date: Annotated[
        str | None,
        typer.Option(
            metavar="DATE", help="Date of PROFILE, such as 2026-06-30; needed with --previous."
        ),
    ] = None,
    from_m: From = None,
    to_m: To = None,
    forward_backward: ForwardBackward = False,
    rail: RailOption = None,
    as_json: Json = False,
) -> None:
    """Write a report: defects with locations, probabilities and required actions, quality classes, charts."""
    from trackprofile.assessment.limits import condense_notes
    from trackprofile.contracts import select_stretch
    from trackprofile.reporting.report import report as write_report
    from trackprofile.reporting.report import report_files
    from trackprofile.reporting.summary import headline, summary

    report_files(*output)
    if bool(previous) != bool(date):
        raise DataError(
            "A change needs both --previous PROFILE=DATE and the --date of the profile."
        )
    table = read_chainage_table(chainage)
    assess = partial(
        assess_profile, limits=limits, speed=speed, forward_backward=forward_backward, rail=rail
    )
    assessment = assess(select_stretch(read_as(profile, "profile"), from_m, to_m))
    compared = trend = None
    if compare_with is not None:
        compared = assess(select_stretch(read_as(compare_with, "profile"), from_m, to_m))
    if previous:
        passes = [read_dated_profile(one, rail) for one in (*previous, f"{profile}={date}")]
        trend = compare_dates(passes, limits, speed)
    files = write_report(
        assessment, *output, title=title, chainage=table,
        sources={"profile file": profile.name, "limits file": limits}, compared=compared,
        compared_name="" if compare_with is None else compare_with.name, trend=trend,
    )  # fmt: skip
    sentences = [headline(assessment, table), *summary(assessment, table)]
    if as_json:
        show.as_one_object(
            {"files": as_text(files), "summary": sentences, "notes": list(assessment.notes)}
        )
        return
    show.note_sentences(condense_notes(assessment.notes))
    for sentence in sentences:
        show.say(sentence)
    show.say(f"Report in {', '.join(as_text(files))}.")

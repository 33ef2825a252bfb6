"""`trackprofile fuse`: several passes over one line, combined into one profile."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.inputs import as_text, read_dated_profile
from trackprofile.cli.options import FirstDate, From, Json, LastDate, To, parse_date
from trackprofile.errors import DataError

if TYPE_CHECKING:
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.fusion.fuse import FusionResult


def fuse(
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File for the profile, with its rate of change if there are several dates: .nc, .csv or .parquet.",
        ),
    ],
    profiles: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="PROFILE=DATE",
            help="Profiles of the same track with their dates, such as may.nc=2026-05-31. Alternative: --store.",
        ),
    ] = None,
    day: Annotated[
        str | None,
        typer.Option(
            "--date",
            metavar="DATE",
            help="Date for which the profile is computed, such as 2026-06-30. Default: the date of the last pass.",
        ),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option(
            metavar="STORE",
            help="Store to take the passes from, a folder or URL; needs --line and --direction.",
        ),
    ] = None,
    line: Annotated[
        str | None, typer.Option(metavar="LINE", help="Line in the store whose passes are used.")
    ] = None,
    direction: Annotated[
        str | None,
        typer.Option(
            metavar="DIRECTION", help="Direction in the store whose passes are used, such as up."
        ),
    ] = None,
    first_date: FirstDate = None,
    last_date: LastDate = None,
    from_m: From = None,
    to_m: To = None,
    as_json: Json = False,
) -> None:
    """Combine passes of different trains and dates into one profile, with its rate of change."""
    from trackprofile.fusion.fuse import fuse as combine
    from trackprofile.fusion.fusion_summary import fusion_summary
    from trackprofile.io import format_to_write, write

    if bool(profiles) == bool(store) or bool(store) != bool(line and direction):
        raise typer.BadParameter(
            "Give profiles with their dates, or --store, --line and --direction."
        )
    format_to_write("profile", output)
    if store and line and direction:
        dates = tuple(None if one is None else parse_date(one) for one in (first_date, last_date))
        passes = _stored(store, line, direction, dates, from_m, to_m)
    else:
        passes = [_between(read_dated_profile(one), from_m, to_m) for one in profiles or ()]
    result = combine(passes, None if day is None else parse_date(day))
    files = write(result.profile, output)
    sentences = fusion_summary(result)
    if as_json:
        show.as_one_object({"files": as_text(files), "summary": sentences} | _as_dict(result))
        return
    show.note_sentences(result.notes)
    for sentence in sentences:
        show.say(sentence)
    show.say(f"Profile in {', '.join(as_text(files))}.")


def _between(dated: DatedProfile, from_m: float | None, to_m: float | None) -> DatedProfile:
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts import select_stretch

    return DatedProfile(select_stretch(dated.profile, from_m, to_m), dated.day, dated.name)


def _stored(
    url: str,
    line: str,
    direction: str,
    dates: tuple[date | None, ...],
    from_m: float | None,
    to_m: float | None,
) -> list[DatedProfile]:
    """The passes of a line in a store, without profiles that were fused from others."""
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts.rates import FUSION_METHOD
    from trackprofile.store import find, open_store, read_profile

    store = open_store(url)
    entries = find(
        store, line=line, direction=direction, first=dates[0], last=dates[1], start=from_m, end=to_m
    )
    passes = [
        DatedProfile(read_profile(store, one, from_m, to_m), one.day, one.id)
        for one in entries
        if not one.origin.method.startswith(FUSION_METHOD)
    ]
    if not passes:
        raise DataError(
            f"{url}: no pass of line {line!r}, direction {direction!r} matches these dates and distances; see "
            "`trackprofile store list` for what the store holds."
        )
    return passes


def _as_dict(result: FusionResult) -> dict[str, Any]:
    return {
        "day": result.day.isoformat(),
        "passes": [asdict(one) | {"day": one.day.isoformat()} for one in result.passes],
        "contradictions": [
            asdict(one) | {"reason": one.reason.value} for one in result.contradictions
        ],
        "changing": [asdict(one) for one in result.changing],
        "notes": list(result.notes),
    }

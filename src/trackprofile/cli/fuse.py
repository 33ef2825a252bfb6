"""`trackprofile fuse`: many passes over one line, in one profile."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.assess import dated
from trackprofile.cli.options import From, Json, To, day_of
from trackprofile.errors import DataError

if TYPE_CHECKING:
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.fusion.fuse import FusionResult

Profiles = Annotated[
    list[str] | None, typer.Argument(metavar="[PROFILE=DAY]...", help="Such as may.nc=2026-05-31.")
]


def fuse(
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FILE", help=".nc, .csv, .parquet; with rates."),
    ],
    profiles: Profiles = None,
    day: Annotated[
        str | None, typer.Option(metavar="DAY", help="Of the level; else the last pass's.")
    ] = None,
    store: Annotated[
        str | None, typer.Option(metavar="S", help="Passes from a store, of --line, --direction.")
    ] = None,
    line: Annotated[str | None, typer.Option(metavar="L", help="In the store.")] = None,
    direction: Annotated[str | None, typer.Option(metavar="D", help="In the store.")] = None,
    first: Annotated[str | None, typer.Option(metavar="DAY", help="From this day on.")] = None,
    last: Annotated[str | None, typer.Option(metavar="DAY", help="Up to this day.")] = None,
    from_m: From = None,
    to_m: To = None,
    as_json: Json = False,
) -> None:
    """Combine passes by different trains and on different days into one profile with its rate of change."""
    from trackprofile.fusion.fuse import fuse as fused
    from trackprofile.fusion.fusion_summary import fusion_summary
    from trackprofile.io import format_to_write, write

    if bool(profiles) == bool(store) or bool(store) != bool(line and direction):
        raise typer.BadParameter(
            "Give profiles with their days, or --store, --line and --direction."
        )
    format_to_write("profile", output)
    if store and line and direction:
        days = tuple(None if one is None else day_of(one) for one in (first, last))
        passes = _stored(store, line, direction, days, from_m, to_m)
    else:
        passes = [_between(dated(one), from_m, to_m) for one in profiles or ()]
    found = fused(passes, None if day is None else day_of(day))
    files = write(found.profile, output)
    said = fusion_summary(found)
    if as_json:
        show.as_one_object({"files": list(map(str, files)), "summary": said} | _as_dict(found))
        return
    show.note([f"{note}." for note in found.notes])
    for sentence in said:
        show.say(sentence)
    show.say(f"Profile in {', '.join(map(str, files))}.")


def _between(one: DatedProfile, from_m: float | None, to_m: float | None) -> DatedProfile:
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts import select_stretch

    return DatedProfile(select_stretch(one.profile, from_m, to_m), one.day, one.name)


def _stored(
    url: str,
    line: str,
    direction: str,
    days: tuple[date | None, ...],
    from_m: float | None,
    to_m: float | None,
) -> list[DatedProfile]:
    """The passes of a line in a store; what was fused before is none."""
    from trackprofile.assessment.trend import DatedProfile
    from trackprofile.contracts.rates import FUSION_METHOD
    from trackprofile.store import find, open_store, read_profile

    store = open_store(url)
    entries = find(
        store, line=line, direction=direction, first=days[0], last=days[1], start=from_m, end=to_m
    )
    passes = [
        DatedProfile(read_profile(store, one, from_m, to_m), one.day, one.id)
        for one in entries
        if not one.origin.method.startswith(FUSION_METHOD)
    ]
    if not passes:
        raise DataError(
            f"{url}: there is no pass of {line!r}, {direction!r} in these days and places; see what there is with "
            "trackprofile store list."
        )
    return passes


def _as_dict(found: FusionResult) -> dict[str, Any]:
    return {
        "day": found.day.isoformat(),
        "passes": [asdict(one) | {"day": one.day.isoformat()} for one in found.passes],
        "contradictions": [
            asdict(one) | {"reason": one.reason.value} for one in found.contradictions
        ],
        "changing": [asdict(one) for one in found.changing],
        "notes": list(found.notes),
    }

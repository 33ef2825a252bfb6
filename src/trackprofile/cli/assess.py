"""`trackprofile assess`: a profile against the limits of its line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.inputs import (
    ChainageFile,
    LimitsName,
    Profile,
    Speed,
    as_text,
    assess_profile,
    read_chainage_table,
)
from trackprofile.cli.options import AssessedRail, ForwardBackward, From, Json, To, read_as
from trackprofile.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.assess import Assessment
    from trackprofile.contracts import Rail
    from trackprofile.positioning.chainage import ChainageTable


def assess(
    profile: Profile,
    speed: Speed,
    limits: LimitsName = "en-13848",
    chainage: ChainageFile = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File for the tables of defects, sections, stretches not assessed and spectra (.csv or .parquet; one "
            "file per table, its name is appended), or for a map of the defects (.geojson, needs --chainage). "
            "Repeatable. Default: only the summary is printed.",
        ),
    ] = None,
    from_m: From = None,
    to_m: To = None,
    forward_backward: ForwardBackward = False,
    rail: Annotated[
        AssessedRail | None,
        typer.Option(
            "--rail",
            help="Rail to assess of a profile with separate rails. Default: left, right and mean.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Assess a profile against limits: defects with probabilities, standard deviations per section, quality classes."""
    from trackprofile.assessment.limits import condense_notes
    from trackprofile.assessment.tables import (
        ASSESSMENT_TABLES,
        geojson_per_rail,
        tables,
        tables_per_rail,
    )
    from trackprofile.contracts import select_stretch
    from trackprofile.io.result_tables import (
        GEOJSON_SUFFIX,
        table_files,
        write_geojson,
        write_tables,
    )
    from trackprofile.reporting.summary import headline

    table = read_chainage_table(chainage)
    paths = output or []
    for path in paths:
        if path.suffix.lower() != GEOJSON_SUFFIX:
            table_files(path, ASSESSMENT_TABLES)
        elif not table.has_coordinates:
            raise DataError(
                f"{path}: a map needs latitude and longitude; give a --chainage table that has them."
            )
    per_rail, separate = _assess_rails(
        select_stretch(read_as(profile, "profile"), from_m, to_m),
        limits,
        speed,
        forward_backward,
        rail,
    )
    first = next(iter(per_rail.values()))
    results = tables_per_rail(per_rail, table) if separate else tables(first, table)
    files: list[Path] = []
    for path in paths:
        if path.suffix.lower() == GEOJSON_SUFFIX:
            files.append(write_geojson(geojson_per_rail(per_rail, table), path))
        else:
            files += write_tables(results, path)
    sentences = [headline(first, table), *_summaries(per_rail, table, separate=separate)]
    notes = list(dict.fromkeys(note for one in per_rail.values() for note in one.notes))
    if as_json:
        about = {"summary": sentences, "notes": notes, "filter": first.filter}
        show.as_one_object({"files": as_text(files)} | about | results)
        return
    show.note_sentences(condense_notes(notes))
    for sentence in sentences:
        show.say(sentence)
    show.tables_in(files)


def _assess_rails(
    profile: xr.Dataset,
    limits: str,
    speed: str,
    forward_backward: bool,
    rail: AssessedRail | None,
) -> tuple[dict[Rail, Assessment], bool]:
    """The assessment of the requested rail, or of all rails; and whether the profile has separate rails."""
    from trackprofile.contracts import Rail, available_rails

    separate = len(available_rails(profile)) > 1
    rails = list(AssessedRail) if separate and rail is None else [rail or AssessedRail.MEAN]
    return {
        Rail(one): assess_profile(
            profile, limits, speed, forward_backward=forward_backward, rail=one
        )
        for one in rails
    }, separate


def _summaries(
    per_rail: Mapping[Rail, Assessment], chainage: ChainageTable, *, separate: bool
) -> list[str]:
    """The summary of each rail."""
    from trackprofile.reporting.summary import summary

    return [
        (f"{rail.value.capitalize()}: " if separate else "") + sentence
        for rail, assessment in per_rail.items()
        for sentence in summary(assessment, chainage)
    ]

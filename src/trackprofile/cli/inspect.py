"""`trackprofile inspect`: the content of a logger's file, and the TOML that `infer` needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json

if TYPE_CHECKING:
    from trackprofile.io.inspection import ColumnContent, Inspection


def inspect(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="File of recorded signals, as the logger wrote it."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="TOML",
            help="File to write the description to that infer needs; check and correct it. Default: it is printed.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the columns of a logger's file with their probable meaning, units, rates and gaps.

    The proposed TOML states how the file is to be read. It is a guess: check it before use.
    """
    from trackprofile.io.inspection import write_toml
    from trackprofile.reader import inspect as inspect_file

    inspection = inspect_file(file)
    written = None if output is None else write_toml(inspection, output)
    if as_json:
        path = None if written is None else str(written)
        show.as_one_object(_as_dict(inspection) | {"toml": path})
        return
    heads = ("column", "probably", "unit", "values", "missing", "Hz", "minimum", "mean", "maximum")
    show.table(heads, [_row(one) for one in inspection.contents])
    show.note(_description(inspection))
    if written is None:
        show.say("Proposed TOML (write it to a file with -o):\n")
        show.say(inspection.toml.rstrip())
        return
    show.say(f"Description in {written}: correct the marked entries, then use it with infer.")


def _row(content: ColumnContent) -> tuple[str, ...]:
    numbers = (content.least, content.mean, content.greatest)
    return (
        content.heading.name,
        str(content.guess.role),
        content.guess.unit + ("" if content.guess.sure or not content.guess.unit else " ?"),
        str(content.rows),
        str(content.missing),
        f"{content.rate:.4g}" if content.rate else "",
        *("" if number != number else f"{number:.4g}" for number in numbers),
    )


def _description(inspection: Inspection) -> list[str]:
    """The recording that the guess gives, and its faults."""
    from trackprofile.inference.outliers import describe_faults
    from trackprofile.preprocessing.motion import motion
    from trackprofile.units import counted

    if inspection.recording is None:
        return [f"With this guess the file is not a valid recording: {inspection.notes[0]}"]
    recording = inspection.recording
    count = counted(recording.sizes["sample"], "sample")
    speed = recording["speed"].to_numpy() if "speed" in recording else None
    speeds = "" if speed is None else f", {3.6 * speed.min():.0f} to {3.6 * speed.max():.0f} km/h"
    return [
        f"With this guess the file is a recording of {count}{speeds}.",
        *(f"{note[0].upper()}{note[1:]}." for note in inspection.notes),
        *(
            f"{note[0].upper()}{note[1:]}."
            for note in describe_faults(inspection.faults, motion(recording).distance)
        ),
    ]


def _as_dict(inspection: Inspection) -> dict[str, Any]:
    return {
        "file": str(inspection.path),
        "columns": [
            {
                "name": one.heading.name,
                "role": str(one.guess.role),
                "unit": one.guess.unit,
                "stated_unit": one.heading.unit,
                "values": one.rows,
                "missing": one.missing,
                "rate_hz": one.rate,
                "minimum": _finite(one.least),
                "mean": _finite(one.mean),
                "maximum": _finite(one.greatest),
            }
            for one in inspection.contents
        ],
        "faults": [vars(one) | {"kind": str(one.kind)} for one in inspection.faults],
        "notes": list(inspection.notes),
        "readable": inspection.recording is not None,
    }


def _finite(number: float) -> float | None:
    return number if number == number else None

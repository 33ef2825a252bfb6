"""`trackprofile inspect`: what is in a logger's file, and the TOML that `infer` needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json

if TYPE_CHECKING:
    from trackprofile.io.inspection import ColumnContent, Inspection


def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="As the logger wrote it.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="TOML", help="Write what infer needs, to correct."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Say what is in a logger's file: channels, units, rates, gaps and what each probably is.

    The TOML says how the file is to be read. It is a guess: correct it before it is believed.
    """
    from trackprofile.io.inspection import write_toml
    from trackprofile.reader import inspect as inspected

    found = inspected(file)
    written = None if output is None else write_toml(found, output)
    if as_json:
        show.as_one_object(_as_dict(found) | {"toml": None if written is None else str(written)})
        return
    heads = ("column", "probably", "unit", "values", "missing", "Hz", "least", "mean", "greatest")
    show.table(heads, [_row(one) for one in found.contents])
    show.note(_about(found))
    if written is None:
        show.say("With -o run.toml this is written:\n")
        show.say(found.toml.rstrip())
        return
    show.say(
        f"How to read it stands in {written}: correct what is marked there, then give it to infer."
    )


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


def _about(found: Inspection) -> list[str]:
    """What a recording read in this way would be, and what is wrong with it."""
    from trackprofile.inference.outliers import describe_faults
    from trackprofile.preprocessing.motion import motion

    if found.recording is None:
        return [f"As guessed it is no recording: {found.notes[0]}"]
    recording = found.recording
    count = recording.sizes["sample"]
    speed = recording["speed"].to_numpy() if "speed" in recording else None
    fast = "" if speed is None else f", {3.6 * speed.min():.0f} to {3.6 * speed.max():.0f} km/h"
    return [
        f"As guessed it is a recording of {count} samples{fast}.",
        *(f"{note[0].upper()}{note[1:]}." for note in found.notes),
        *(
            f"{note[0].upper()}{note[1:]}."
            for note in describe_faults(found.faults, motion(recording).distance)
        ),
    ]


def _as_dict(found: Inspection) -> dict[str, Any]:
    return {
        "file": str(found.path),
        "columns": [
            {
                "name": one.heading.name,
                "role": str(one.guess.role),
                "unit": one.guess.unit,
                "stated_unit": one.heading.unit,
                "values": one.rows,
                "missing": one.missing,
                "rate_hz": one.rate,
                "least": _finite(one.least),
                "mean": _finite(one.mean),
                "greatest": _finite(one.greatest),
            }
            for one in found.contents
        ],
        "faults": [vars(one) | {"kind": str(one.kind)} for one in found.faults],
        "notes": list(found.notes),
        "readable": found.recording is not None,
    }


def _finite(number: float) -> float | None:
    return number if number == number else None

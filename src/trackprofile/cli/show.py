"""What the commands print: results to standard output, progress and messages to standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from trackprofile.errors import printable

if TYPE_CHECKING:
    from trackprofile.assessment.compare import BandComparison, Comparison

say = typer.echo
"""Print a line of a result."""


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None] | None]:
    """A function that shows the completed share of each stage; None if standard error is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        stages: dict[str, Any] = {}

        def update(stage: str, share: float) -> None:
            if stage not in stages:
                stages[stage] = bars.add_task(stage, total=1.0)
            bars.update(stages[stage], completed=share)

        yield update


def note(messages: Sequence[str]) -> None:
    """Print messages, one per line."""
    for message in messages:
        typer.echo(printable(message), err=True)


def note_sentences(notes: Sequence[str]) -> None:
    """Print notes, which have no full stop, as sentences."""
    note([f"{one}." for one in notes])


def error(message: str, *, as_json: bool) -> None:
    """Print an error message; with --json also as one object."""
    note([f"trackprofile: {message}"])
    if as_json:
        as_one_object({"error": printable(message)})


def json_requested(context: typer.Context) -> bool:
    """Whether the command line has --json, for an option that is handled before the others are read."""
    return bool((context.obj or {}).get("json"))


def as_one_object(result: Mapping[str, Any]) -> None:
    """Print a result as JSON."""
    typer.echo(json.dumps(result, ensure_ascii=False, allow_nan=False))


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table: the first column left-aligned, the others, numbers, right-aligned."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    lines = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for number, head in enumerate(heads):
        lines.add_column(head, justify="right" if number else "left")
    for row in rows:
        lines.add_row(*(Text(printable(cell)) for cell in row))
    # A pipe has no width, and output that a program reads must not be wrapped.
    # Brackets in a column's name enclose a unit, not a style.
    width = None if sys.stdout.isatty() else 200
    Console(width=width, markup=False, emoji=False).print(lines)


def tables_in(files: Sequence[Path]) -> None:
    """Print where tables were written, if any were."""
    if files:
        say(f"Tables in {', '.join(map(str, files))}.")


def comparison(result: Comparison) -> None:
    """Print the agreement of a profile with its reference, one line per band."""
    say(f"From {round(result.from_m)} m to {round(result.to_m)} m:")
    heads = ("band", "correlation", "RMS error, mm", "reference RMS, mm", "gain", "lag, m")
    rows = [(name, *_agreement(band)) for name, band in result.bands.items()]
    table((*heads, "within stated 95 %"), rows)


def _agreement(band: BandComparison | None) -> tuple[str, ...]:
    if band is None:
        return ("-",) * 6
    return (
        f"{band.correlation:.4f}",
        f"{band.rms_error_mm:.4f}",
        f"{band.reference_rms_mm:.4f}",
        f"{band.gain:.3f}",
        f"{band.lag_m:.2f}",
        "-" if band.coverage_95 is None else f"{100 * band.coverage_95:.1f} %",
    )


def estimates(parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the results of a calibration, one line per parameter."""
    table(
        ("parameter", "value", "standard error", "unit", "started from"),
        [
            (
                name,
                f"{one['value']:.5g}",
                f"{one['standard_error']:.2g}",
                one["unit"],
                f"{one['start']:.5g}",
            )
            for name, one in parameters.items()
        ],
    )


def see_figures(figures: Sequence[str]) -> None:
    """Print where figures were written, if any were."""
    if figures:
        say(f"Figures in {' and '.join(figures)}.")


def profile(files: Sequence[str], result: Mapping[str, Any]) -> None:
    """Print the result of infer."""
    note(result["notes"])
    say(f"Profile from {round(result['from_m'])} m to {round(result['to_m'])} m in {files[0]}.")
    per_rail = result.get("standard_deviation_per_rail_mm", {})
    for band, deviation in result["standard_deviation_mm"].items():
        rails = [
            f"{rail} {deviations[band]:.3f} mm"
            for rail, deviations in per_rail.items()
            if band in deviations
        ]
        more = f" (mean), {', '.join(rails)}" if rails else ""
        say(f"Standard deviation in {band}: {deviation:.3f} mm{more}")
    see_figures(files[1:])

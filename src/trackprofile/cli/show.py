"""What the commands print: results to standard output, progress and messages to standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from trackprofile.errors import printable

if TYPE_CHECKING:
    from trackprofile.assessment.compare import BandComparison, Comparison

say = typer.echo
"""Print a line of a result."""


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None] | None]:
    """What to tell of each stage the share that is done; None where nobody looks at bars."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        stages: dict[str, Any] = {}

        def tell(stage: str, share: float) -> None:
            if stage not in stages:
                stages[stage] = bars.add_task(stage, total=1.0)
            bars.update(stages[stage], completed=share)

        yield tell


def note(sentences: Sequence[str]) -> None:
    """Print messages."""
    for sentence in sentences:
        typer.echo(printable(sentence), err=True)


def as_one_object(result: Mapping[str, Any]) -> None:
    """Print a result as JSON."""
    typer.echo(json.dumps(result, ensure_ascii=False, allow_nan=False))


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table: the first column to the left, the others, numbers, to the right."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    lines = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for number, head in enumerate(heads):
        lines.add_column(head, justify="right" if number else "left")
    for row in rows:
        lines.add_row(*(Text(printable(cell)) for cell in row))
    # A pipe has no width: what a program reads must not be wrapped.
    # What stands in brackets is a unit in a column's name, not a colour.
    width = None if sys.stdout.isatty() else 200
    Console(width=width, markup=False, emoji=False).print(lines)


def comparison(result: Comparison) -> None:
    """Print how a profile agrees with its reference, a line per band."""
    say(f"From {round(result.from_m)} m to {round(result.to_m)} m:")
    heads = ("band", "correlation", "RMS error, mm", "reference RMS, mm", "gain", "lag, m")
    rows = [(name, *_agreement(band)) for name, band in result.bands.items()]
    table((*heads, "inside stated 95 %"), rows)


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
    """Print what a calibration found, a line per parameter."""
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
    """Print where the figures are, where there are any."""
    if figures:
        say(f"See it in {' or '.join(figures)}.")


def profile(files: Sequence[str], result: Mapping[str, Any]) -> None:
    """What infer found, in words."""
    note(result["notes"])
    say(f"Profile from {round(result['from_m'])} m to {round(result['to_m'])} m in {files[0]}.")
    apart = result.get("standard_deviation_per_rail_mm", {})
    for band, deviation in result["standard_deviation_mm"].items():
        rails = [f"{rail} {found[band]:.3f} mm" for rail, found in apart.items() if band in found]
        more = f" (mean), {', '.join(rails)}" if rails else ""
        say(f"Standard deviation in {band}: {deviation:.3f} mm{more}")
    see_figures(files[1:])

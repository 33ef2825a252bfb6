"""The command `trackprofile`: arguments, progress and exit codes; other packages do the computation.

Nothing that loads slowly is imported before a command runs, so that help and wrong usage are answered at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from trackprofile import __version__
from trackprofile.cli import show
from trackprofile.cli.accuracy import accuracy
from trackprofile.cli.assess import assess
from trackprofile.cli.calibrate import calibrate
from trackprofile.cli.compare import compare
from trackprofile.cli.fleet import fleet
from trackprofile.cli.fuse import fuse
from trackprofile.cli.infer import infer
from trackprofile.cli.inspect import inspect
from trackprofile.cli.options import Json
from trackprofile.cli.plan import plan
from trackprofile.cli.report import report
from trackprofile.cli.serve import serve
from trackprofile.cli.simulate import simulate
from trackprofile.cli.store import app as store
from trackprofile.cli.trend import trend
from trackprofile.cli.usage import Command, Group, UsageError, usage_message
from trackprofile.cli.vehicles import app as vehicles
from trackprofile.errors import TrackprofileError

WRONG_USAGE_EXIT = 2
UNUSABLE_DATA_EXIT = 1

app = typer.Typer(
    cls=Group,
    help="Infer the longitudinal profile of a railway track, with its uncertainty, from sensors on trains in service.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

for _command in (
    infer, inspect, calibrate, simulate, compare, assess, report, trend, accuracy, fuse, fleet, plan, serve,
):  # fmt: skip
    app.command(cls=Command)(_command)
app.add_typer(store, name="store")
app.add_typer(vehicles, name="vehicles")


@app.command(cls=Command)
def demo(
    folder: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="New folder for the files of the demonstration.",
        ),
    ] = Path("demo"),
    as_json: Json = False,
) -> None:
    """Simulate a recording on known track, infer the profile from it, and compare the two."""
    from trackprofile.demo import run
    from trackprofile.reporting.result_files import figure_notes

    with show.progress_bars() as progress:
        result = run(folder, progress=progress)
    files = [result.recording, result.truth, *result.files]
    if as_json:
        show.as_one_object(result.comparison.as_dict() | {"files": list(map(str, files))})
        return
    show.note((*result.estimate.notes, *result.comparison.notes, *figure_notes(result.files)))
    show.say(f"Simulated recording: {result.recording}")
    show.say(f"Simulated profile: {result.truth}")
    show.say(f"Inferred profile: {result.files[0]}")
    show.comparison(result.comparison)
    show.see_figures(list(map(str, result.files[1:])))


@app.command(cls=Command)
def reproduce(
    folder: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="New folder for the HTML report and the CSV tables.",
        ),
    ] = Path("reproduction"),
    as_json: Json = False,
) -> None:
    """Reproduce the tables and figures of the article of 2017 and compare them with it; takes minutes."""
    from trackprofile.reproduction import reproduce as run
    from trackprofile.units import counted

    with show.progress_bars() as progress:
        files = run(folder, progress)
    if as_json:
        show.as_one_object({"files": list(map(str, files))})
        return
    show.say(
        f"HTML report: {files[0]}; its numbers are in {counted(len(files) - 1, 'CSV table')} next to it."
    )


@app.command(cls=Command)
def bench(as_json: Json = False) -> None:
    """Measure the speed and memory use of this machine: the figures of the README."""
    from trackprofile.bench import measure

    result = measure()
    if as_json:
        show.as_one_object(result)
        return
    rows = [(one["name"], f"{one['value']:.3g}", one["unit"]) for one in result["results"]]
    show.table(("figure", "value", "unit"), rows)
    for one in result["results"]:
        if one["comparison"]:
            show.say(f"For comparison with {one['name']}: {one['comparison']}.")
    show.say(result["machine"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exit with 0 if it succeeded, 1 if the data cannot be used, 2 on wrong usage."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in given
    try:
        code = typer.main.get_command(app).main(
            args=given, prog_name="trackprofile", standalone_mode=False, obj={"json": as_json}
        )
    except UsageError as error:
        _report_usage(error, as_json=as_json)
        sys.exit(WRONG_USAGE_EXIT)
    except TrackprofileError as error:
        sentence = " ".join(str(error).split())
        show.error(sentence, as_json=as_json)
        sys.exit(UNUSABLE_DATA_EXIT)
    if code:
        sys.exit(code)


def _report_usage(error: UsageError, *, as_json: bool) -> None:
    message = usage_message(error)
    if error.ctx is not None and message:
        show.note([error.ctx.get_usage(), f"Help: {error.ctx.command_path} --help"])
    if message:
        show.error(message, as_json=as_json)


def _print_version(wanted: bool) -> None:
    if wanted:
        show.say(f"trackprofile {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            metavar="",
            callback=_print_version,
            is_eager=True,
            help="Print the version and exit.",
        ),
    ] = False,
) -> None:
    """Options of the command itself."""

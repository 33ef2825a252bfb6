"""The command `trackprofile`: arguments, progress, exit codes; what is computed stands elsewhere.

Nothing heavy is imported before a command runs, so that help and wrong usage answer at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile import __version__
from trackprofile.cli import show
from trackprofile.cli.assess import assess, changes, report
from trackprofile.cli.calibrate import calibrate
from trackprofile.cli.fleet import fleet
from trackprofile.cli.fuse import fuse
from trackprofile.cli.infer import infer
from trackprofile.cli.inspect import inspect
from trackprofile.cli.options import (
    From,
    Json,
    RailName,
    RequiredVehicle,
    To,
    TrackName,
    read_as,
)
from trackprofile.cli.plan import plan
from trackprofile.cli.serve import serve
from trackprofile.cli.simulate import simulate
from trackprofile.cli.store import app as store
from trackprofile.cli.vehicles import app as vehicles
from trackprofile.errors import DataError, TrackprofileError

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(
    help="Track profiles, with their uncertainty, from what an ordinary train's sensors record.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


app.command()(infer)
app.command()(inspect)
app.command()(calibrate)
app.command()(simulate)
app.command()(assess)
app.command()(report)
app.command()(changes)
app.command()(serve)
app.command()(fleet)
app.command()(plan)
app.command()(fuse)
app.add_typer(vehicles, name="vehicles")
app.add_typer(store, name="store")


@app.command()
def compare(
    profile: Annotated[Path, typer.Argument(metavar="PROFILE")],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE")],
    from_m: From = None,
    to_m: To = None,
    passes: Annotated[
        int, typer.Option(min=1, max=2, help="Of the band filter: 2 is forwards and backwards.")
    ] = 1,
    rail: Annotated[
        RailName | None, typer.Option(help="Of a profile per rail; without, the mean.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Say how a profile agrees with a reference, per band of wavelengths."""
    from trackprofile.assessment.compare import compare as compared

    pair, said = _of_rail(read_as(profile, "profile"), read_as(reference, "profile"), rail)
    result = compared(*pair, from_m=from_m, to_m=to_m, passes=passes)
    show.note((*said, *result.notes))
    if as_json:
        show.as_one_object(result.as_dict())
        return
    show.comparison(result)


@app.command()
def limit(
    vehicle: RequiredVehicle,
    speed: Annotated[str, typer.Option(metavar="SPEED", help='With its unit: "150 km/h".')],
    sensors: Annotated[
        str, typer.Option(metavar="S", help="A preset such as bogie-25ug, or a TOML.")
    ],
    track: TrackName = "rigid",
    prior: Annotated[
        str, typer.Option(metavar="P", help="A spectrum, preset or TOML.")
    ] = "german-low",
    as_json: Json = False,
) -> None:
    """State the least error per band that any method could reach with these sensors."""
    from trackprofile.inference.accuracy_bound import accuracy_bound_per_rail
    from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle

    metres_per_second = _speed(speed)
    car, _ = read_vehicle(vehicle)
    least = accuracy_bound_per_rail(
        car, read_track(track), read_sensors(sensors), metres_per_second, read_spectrum(prior)
    )
    bands = {
        rail.value: {name: 1e3 * error for name, error in errors.items()}
        for rail, errors in least.items()
    }
    mean = bands.pop("mean")
    if as_json:
        apart = {"limit_per_rail_mm": bands} if bands else {}
        show.as_one_object({"limit_mm": mean, **apart, "speed_m_s": metres_per_second})
        return
    whose = [f"{rail}, mm" for rail in bands]
    rows = [
        (name, f"{error:.4g}", *(f"{errors[name]:.4g}" for errors in bands.values()))
        for name, error in mean.items()
    ]
    show.table(("band", "least RMS error, mm", *whose), rows)


@app.command()
def reproduce(
    folder: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="A new folder.")
    ] = Path("reproduction"),
    as_json: Json = False,
) -> None:
    """Reproduce the paper's tables and figures, side by side with ours: a page and CSV (minutes)."""
    from trackprofile.reproduction import reproduce as reproduced

    with show.progress_bars() as progress:
        files = reproduced(folder, progress)
    if as_json:
        show.as_one_object({"files": list(map(str, files))})
        return
    show.say(f"See {files[0]}; its numbers lie beside it in {len(files) - 1} tables.")


@app.command()
def demo(
    folder: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="A new folder.")
    ] = Path("demo"),
    as_json: Json = False,
) -> None:
    """Do the main job on a built-in recording, which is simulated."""
    from trackprofile.demo import run
    from trackprofile.reporting.result_files import figure_notes

    with show.progress_bars() as progress:
        done = run(folder, progress=progress)
    files = [done.recording, done.truth, *done.files]
    if as_json:
        show.as_one_object(done.comparison.as_dict() | {"files": list(map(str, files))})
        return
    show.note((*done.found.notes, *done.comparison.notes, *figure_notes(done.files)))
    show.say(f"Simulated a recording ({done.recording}) on track that is known ({done.truth}),")
    show.say("inferred the profile from it, and compared the two:")
    show.comparison(done.comparison)
    if done.files[1:]:
        show.say("Open these:")
    for path in done.files[1:]:
        show.say(f"  {path}")


@app.command()
def bench(as_json: Json = False) -> None:
    """Measure the figures of speed and memory that the README quotes."""
    from trackprofile.bench import measure

    result = measure()
    if as_json:
        show.as_one_object(result)
        return
    rows = [(one["name"], f"{one['value']:.3g}", one["unit"]) for one in result["results"]]
    show.table(("figure", "value", "unit"), rows)
    for one in result["results"]:
        if one["beside"]:
            show.say(f"Beside {one['name']}: {one['beside']}.")
    show.say(result["machine"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exit with 0 when done, 1 when the data cannot be used, 2 on wrong usage."""
    try:
        app(args=arguments, prog_name="trackprofile")
    except TrackprofileError as error:
        sentence = " ".join(str(error).split())
        show.note([f"trackprofile: {sentence}"])
        sys.exit(1)


def _print_version(wanted: bool) -> None:
    if wanted:
        show.say(f"trackprofile {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    """Options of the command itself."""


def _of_rail(
    profile: xr.Dataset, reference: xr.Dataset, rail: RailName | None
) -> tuple[tuple[xr.Dataset, xr.Dataset], tuple[str, ...]]:
    """Both of one rail, and a sentence where the reference does not tell which it is of."""
    from trackprofile.contracts import Rail, available_rails, select_rail

    wanted = Rail(rail or RailName.MEAN)
    one = select_rail(profile, wanted)
    if wanted in available_rails(reference):
        return (one, select_rail(reference, wanted)), ()
    return (one, reference), (
        f"The reference does not tell rails apart: its elevation is taken for that of the {wanted}",
    )


def _speed(text: str) -> float:
    """A speed that a train can run at, m/s."""
    from trackprofile.units import quantity

    metres_per_second = quantity(text, "speed")
    if metres_per_second <= 0:
        raise DataError(f"{text!r}: expected a speed above zero.")
    return metres_per_second

"""The command `trackprofile`: arguments, progress, exit codes; what is computed stands elsewhere.

Nothing heavy is imported before a command runs, so that help and wrong usage answer at once.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile import __version__
from trackprofile.cli import show
from trackprofile.cli.assess import assess, changes, report
from trackprofile.cli.calibrate import calibrate
from trackprofile.cli.inspect import inspect
from trackprofile.cli.options import (
    From,
    Json,
    OptionalVehicle,
    RequiredVehicle,
    To,
    TrackName,
    read_as,
)
from trackprofile.cli.simulate import simulate
from trackprofile.cli.vehicles import app as vehicles
from trackprofile.errors import DataError, FileError, TrackprofileError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.resume import Kept
    from trackprofile.sensor import Installation
    from trackprofile.vehicle import Vehicle

app = typer.Typer(
    help="Track profiles, with their uncertainty, from what an ordinary train's sensors record.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


INTERRUPTED_EXIT = 130
"""As a shell has it of what ends by Ctrl-C."""


class Method(StrEnum):
    """How `infer` finds the profile."""

    SMOOTHER = "smoother"
    CROSS_ENTROPY = "cross-entropy"


class Evaluation(StrEnum):
    """How cross-entropy computes what a trial profile does."""

    MAP = "map"
    SIMULATION = "simulation"


@app.command()
def infer(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="TOML or NetCDF.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PROFILE", help=".nc, .csv or .parquet.")
    ],
    vehicle: OptionalVehicle = None,
    track: TrackName = "rigid",
    method: Annotated[Method, typer.Option(help="How to find it.")] = Method.SMOOTHER,
    prior: Annotated[
        str | None,
        typer.Option(metavar="S", help="A spectrum, preset or TOML; without, found from the data."),
    ] = None,
    from_m: From = None,
    to_m: To = None,
    draws: Annotated[
        int | None,
        typer.Option(min=2, help="Behind the bands' uncertainty: 64, for a long ride 24."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the draws, or of the search.")] = 0,
    correct: Annotated[
        bool, typer.Option("--correct", help="For a layered track: correct by its full model.")
    ] = False,
    load: Annotated[
        bool, typer.Option("--load", help="Find what the body weighs on the day.")
    ] = False,
    search: Annotated[
        str | None,
        typer.Option(metavar="S", help="Of cross-entropy: table-5, table-6 or a TOML."),
    ] = None,
    evaluation: Annotated[
        Evaluation, typer.Option(help="Of cross-entropy's trial profiles.")
    ] = Evaluation.MAP,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a long run that was interrupted.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Infer a track profile, with its uncertainty, from a recording.

    Beside PROFILE a page (.html) and a picture (.png) of the same name show it. Cross-entropy, the published
    method that the smoother replaces, gives no uncertainty. A long run keeps what it has solved in a hidden folder
    beside PROFILE until it ends.
    """
    from trackprofile import search as searches
    from trackprofile.contracts import between
    from trackprofile.inference.cross_entropy import INTERRUPTED, cross_entropy
    from trackprofile.inference.estimate import estimate
    from trackprofile.io.model_toml import read_spectrum, read_track
    from trackprofile.io.search_toml import read_search
    from trackprofile.outputs import estimate_files, summary, write_estimate
    from trackprofile.resume import kept_beside, key_of

    _only_of(method, prior=prior, correct=correct, load=load, resume=resume, search=search)
    estimate_files(output)
    measured = read_as(recording, "recording")
    car, installation = _vehicle_of(measured, recording, vehicle)
    support, spectrum = read_track(track), None if prior is None else read_spectrum(prior)
    settings = None if search is None else read_search(search)
    measured = between(measured, from_m, to_m)
    stopped = ""
    kept, said = None, ()
    if method is Method.SMOOTHER:
        settled = {
            "vehicle": car,
            "installation": installation,
            "track": support,
            "prior": spectrum,
        }
        key = key_of(measured, **settled, draws=draws, seed=seed, correct=correct, load=load)
        kept, said = kept_beside(output, key, resume=resume)
        show.note(said)
    with show.progress_bars() as progress, _interruptible(kept):
        if method is Method.CROSS_ENTROPY:
            found = cross_entropy(
                measured,
                car,
                installation=installation,
                track=support,
                search=settings,
                evaluation=searches.Evaluation(evaluation.value),
                seed=seed,
                progress=progress,
            )
            stopped = found.stopped
        else:
            found = estimate(
                measured,
                car,
                installation=installation,
                track=support,
                prior=spectrum,
                draws=draws,
                seed=seed,
                correct=correct,
                load=load,
                progress=progress,
                kept=kept,
            )
    files = list(map(str, write_estimate(found, measured, output)))
    if kept is not None:
        kept.discard()
    result = summary(found)
    if as_json:
        show.as_one_object({"files": files, "method": method.value} | result)
    else:
        show.profile(files, found.notes, result)
    if stopped:
        raise typer.Exit(INTERRUPTED_EXIT if stopped == INTERRUPTED else 1)


@contextmanager
def _interruptible(kept: Kept | None) -> Iterator[None]:
    """Ctrl-C ends the command with what to do to go on."""
    try:
        yield
    except KeyboardInterrupt:
        done = 0 if kept is None else len(kept)
        there = (
            f"; {done} blocks are kept: go on with --resume" if done else "; nothing was written"
        )
        show.note([f"Interrupted{there}."])
        raise typer.Exit(INTERRUPTED_EXIT) from None


def _only_of(method: Method, **given: object) -> None:
    """Refuse an option of the other method, which would otherwise be passed over in silence."""
    others = {"search"} if method is Method.SMOOTHER else {"prior", "correct", "load", "resume"}
    for name in sorted(others & given.keys()):
        if given[name]:
            raise DataError(
                f"--{name} is not of the method {method.value}; leave it out, or choose the other --method"
            )


app.command()(inspect)
app.command()(calibrate)
app.command()(simulate)
app.command()(assess)
app.command()(report)
app.command()(changes)
app.add_typer(vehicles, name="vehicles")


@app.command()
def compare(
    profile: Annotated[Path, typer.Argument(metavar="PROFILE")],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE")],
    from_m: From = None,
    to_m: To = None,
    passes: Annotated[
        int, typer.Option(min=1, max=2, help="Of the band filter: 2 is forwards and backwards.")
    ] = 1,
    as_json: Json = False,
) -> None:
    """Say how a profile agrees with a reference, per band of wavelengths."""
    from trackprofile.comparison import compare as compared

    result = compared(
        read_as(profile, "profile"),
        read_as(reference, "profile"),
        from_m=from_m,
        to_m=to_m,
        passes=passes,
    )
    show.note(result.notes)
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
    from trackprofile.inference.bound import limit as least_error
    from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle

    metres_per_second = _speed(speed)
    car, _ = read_vehicle(vehicle)
    least = least_error(
        car, read_track(track), read_sensors(sensors), metres_per_second, read_spectrum(prior)
    )
    bands = {name: 1e3 * error for name, error in least.items()}
    if as_json:
        show.as_one_object({"limit_mm": bands, "speed_m_s": metres_per_second})
        return
    rows = [(name, f"{error:.4g}") for name, error in bands.items()]
    show.table(("band", "least RMS error, mm"), rows)


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

    with show.progress_bars() as progress:
        done = run(folder, progress=progress)
    files = [done.recording, done.truth, *done.files]
    if as_json:
        show.as_one_object(done.comparison.as_dict() | {"files": list(map(str, files))})
        return
    show.note((*done.found.notes, *done.comparison.notes))
    show.say(f"Simulated a recording ({done.recording}) on track that is known ({done.truth}),")
    show.say("inferred the profile from it, and compared the two:")
    show.comparison(done.comparison)
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


def _speed(text: str) -> float:
    """A speed that a train can run at, m/s."""
    from trackprofile.units import quantity

    metres_per_second = quantity(text, "speed")
    if metres_per_second <= 0:
        raise DataError(f"{text!r}: expected a speed above zero.")
    return metres_per_second


def _vehicle_of(
    recording: xr.Dataset, path: Path, given: str | None
) -> tuple[Vehicle, Installation]:
    """The vehicle that was given, else the one that the recording names, beside it or a preset."""
    from trackprofile.io.model_toml import presets, read_vehicle

    if given is not None:
        return read_vehicle(given)
    named = recording.attrs.get("vehicle", "")
    if not named:
        raise FileError(
            f"{path}: it names no vehicle; add --vehicle with the TOML of one, "
            f"or with one of the presets {', '.join(presets('vehicle'))}."
        )
    beside = path.parent / named
    return read_vehicle(beside if beside.is_file() else named)

"""`trackprofile infer`: from a recording to a profile."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import From, Json, OptionalVehicle, To, TrackName, read_as
from trackprofile.errors import DataError

if TYPE_CHECKING:
    from trackprofile.checkpoint import CheckpointStore

INTERRUPTED_EXIT = 130
"""As a shell has it of what ends by Ctrl-C."""


class Method(StrEnum):
    """How `infer` finds the profile."""

    SMOOTHER = "smoother"
    CROSS_ENTROPY = "cross-entropy"


class Evaluation(StrEnum):
    """How cross-entropy computes what a trial profile does."""

    AFFINE = "affine"
    SIMULATION = "simulation"


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
        typer.Option(min=2, help="Behind the bands' uncertainty: 128, for a long ride down to 24."),
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
    ] = Evaluation.AFFINE,
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
    from trackprofile.checkpoint import checkpoint_key, checkpoint_store
    from trackprofile.contracts import select_stretch
    from trackprofile.inference.infer import estimate
    from trackprofile.inference.settings import InferenceSettings
    from trackprofile.io.model_toml import read_spectrum, read_track
    from trackprofile.io.vehicle_of_recording import vehicle_of_recording
    from trackprofile.methods.cross_entropy import search_settings as searches
    from trackprofile.methods.cross_entropy.search_toml import read_search
    from trackprofile.reporting.result_files import (
        estimate_files,
        figure_notes,
        summary,
        write_estimate,
    )

    _only_of(method, prior=prior, correct=correct, load=load, resume=resume, search=search)
    estimate_files(output)
    measured = read_as(recording, "recording")
    car, installation = vehicle_of_recording(measured, recording, vehicle)
    support, spectrum = read_track(track), None if prior is None else read_spectrum(prior)
    settings = None if search is None else read_search(search)
    measured = select_stretch(measured, from_m, to_m)
    kept, stopped = None, ""
    if method is Method.CROSS_ENTROPY:
        from trackprofile.methods.cross_entropy.estimator import cross_entropy

        chosen = searches.CrossEntropySettings(
            installation, support, settings, searches.Evaluation(evaluation.value), seed
        )
        with show.progress_bars() as progress, _interruptible(kept):
            found = cross_entropy(measured, car, chosen, progress=progress)
        stopped = found.stopped
    else:
        options = InferenceSettings(installation, support, spectrum, draws, seed, correct, load)
        kept, said = checkpoint_store(
            output, checkpoint_key(measured, vehicle=car, settings=options), resume=resume
        )
        show.note(said)
        with show.progress_bars() as progress, _interruptible(kept):
            found = estimate(measured, car, options, progress=progress, checkpoint=kept)
    files = list(map(str, write_estimate(found, measured, output)))
    if kept is not None:
        kept.discard()
    result = summary(found)
    result["notes"] += figure_notes(files)
    if as_json:
        show.as_one_object({"files": files, "method": method.value} | result)
    else:
        show.profile(files, result)
    if stopped:
        from trackprofile.methods.cross_entropy.estimator import INTERRUPTED

        raise typer.Exit(INTERRUPTED_EXIT if stopped == INTERRUPTED else 1)


@contextmanager
def _interruptible(kept: CheckpointStore | None) -> Iterator[None]:
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

"""`trackprofile infer`: from a recording to a profile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.options import From, Json, OptionalVehicle, To, TrackName, flag, read_as
from trackprofile.errors import DataError
from trackprofile.methods.registry import INTERRUPTED, METHODS

if TYPE_CHECKING:
    from trackprofile.checkpoint import CheckpointStore

INTERRUPTED_EXIT = 130
"""Exit code of a command that Ctrl-C ended, as shells define it."""


if TYPE_CHECKING:
    MethodName = str
else:
    # The choices of --method are those of the registry, so that a new method needs no change here.
    MethodName = StrEnum("MethodName", {name: name for name in METHODS})

DEFAULT_METHOD = MethodName("smoother")


class Evaluation(StrEnum):
    """How cross-entropy computes the signals of trial profiles."""

    AFFINE = "affine"
    SIMULATION = "simulation"


def infer(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="Recording of one run: a TOML file that describes a logger's file, or NetCDF.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="PROFILE",
            help="File to write the profile to: .nc, .csv or .parquet.",
        ),
    ],
    vehicle: OptionalVehicle = None,
    track: TrackName = "rigid",
    method: Annotated[
        MethodName,
        typer.Option(
            help="smoother: a Kalman smoother, with standard deviations. cross-entropy: the search published in 2017, "
            "which gives no standard deviations.",
        ),
    ] = DEFAULT_METHOD,
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="SPECTRUM",
            help="Roughness spectrum of the track that the smoother assumes before it uses the data: a preset such as "
            "german-low, or a TOML file. Default: a smooth spectrum whose level is estimated from the recording.",
        ),
    ] = None,
    from_m: From = None,
    to_m: To = None,
    samples: Annotated[
        int | None,
        typer.Option(
            min=2,
            metavar="N",
            help="Number of posterior samples from which the smoother computes the standard deviations of the bands; "
            "more samples are more precise and take longer. Default: 128, for long runs down to 24.",
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Seed of the random numbers of the posterior samples or of the search; the same seed gives the same "
            "result.",
        ),
    ] = 0,
    full_track_correction: Annotated[
        bool,
        flag(
            "--full-track-correction",
            "Correct the profile once for what the full model of a layered track adds to the reduced model that the "
            "smoother uses. Needs a layered --track.",
        ),
    ] = False,
    estimate_load: Annotated[
        bool,
        flag(
            "--estimate-load",
            "Also estimate the mass of the vehicle's body on the day of the run. Default: the mass of the vehicle "
            "model.",
        ),
    ] = False,
    search: Annotated[
        str | None,
        typer.Option(
            metavar="SETTINGS",
            help="Settings of the cross-entropy search: table-5 or table-6 of the article, or a TOML file. Default: "
            "table-5 for one sensor, table-6 for several.",
        ),
    ] = None,
    evaluation: Annotated[
        Evaluation,
        typer.Option(
            help="How cross-entropy computes the signals of a trial profile: affine, by the model's matrices (fast), "
            "or simulation, by time integration. The results are equal to rounding."
        ),
    ] = Evaluation.AFFINE,
    resume: Annotated[
        bool,
        flag(
            "--resume",
            "Continue a run of the smoother that was interrupted, from the part that is already solved.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Infer a track profile with its standard deviation from a recording.

    An HTML figure and a PNG figure of the same name are written next to PROFILE.
    During a long run, the solved part is kept in a hidden folder next to PROFILE.
    """
    from trackprofile.checkpoint import checkpoint_key, checkpoint_store
    from trackprofile.contracts import select_stretch
    from trackprofile.io.model_toml import read_track
    from trackprofile.io.vehicle_of_recording import vehicle_of_recording
    from trackprofile.methods.method import load_method, method_settings
    from trackprofile.reporting.result_files import (
        estimate_files,
        figure_notes,
        summary,
        write_estimate,
    )

    options = {
        "prior": prior,
        "samples": samples,
        "full_track_correction": full_track_correction,
        "estimate_load": estimate_load,
        "search": search,
        "evaluation": None if evaluation is Evaluation.AFFINE else evaluation,
    }
    _check_method_options(method, options, resume=resume)
    estimate_files(output)
    data = read_as(recording, "recording")
    model, installation = vehicle_of_recording(data, recording, vehicle)
    common = {"installation": installation, "track": read_track(track), "seed": seed}
    settings = method_settings(method, common | _settings_from_options(options))
    data = select_stretch(data, from_m, to_m)
    checkpoint, arguments = None, dict[str, Any]()
    if METHODS[method].resumable:
        checkpoint, notes = checkpoint_store(
            output, checkpoint_key(data, vehicle=model, settings=settings), resume=resume
        )
        show.note(notes)
        arguments["checkpoint"] = checkpoint
    function: Any = load_method(method)
    with show.progress_bars() as progress, _interruptible(checkpoint, as_json=as_json):
        estimated = function(data, model, settings, progress=progress, **arguments)
    files = list(map(str, write_estimate(estimated, data, output)))
    if checkpoint is not None:
        checkpoint.discard()
    result = summary(estimated)
    result["notes"] += figure_notes(files)
    if as_json:
        show.as_one_object({"files": files, "method": str(method)} | result)
    else:
        show.profile(files, result)
    if stopped := getattr(estimated, "stopped", ""):
        raise typer.Exit(INTERRUPTED_EXIT if stopped == INTERRUPTED else 1)


def _settings_from_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """The given options as settings of a method: files are read, names become members of enumerations."""
    given = {name: value for name, value in options.items() if value not in (None, False)}
    if "prior" in given:
        from trackprofile.io.model_toml import read_spectrum

        given["prior"] = read_spectrum(given["prior"])
    if "search" in given:
        from trackprofile.methods.cross_entropy.search_toml import read_search

        given["search"] = read_search(given["search"])
    if "evaluation" in given:
        from trackprofile.methods.cross_entropy import search_settings

        given["evaluation"] = search_settings.Evaluation(given["evaluation"].value)
    return given


@contextmanager
def _interruptible(checkpoint: CheckpointStore | None, *, as_json: bool) -> Iterator[None]:
    """End the command on Ctrl-C with a message that states how to continue."""
    try:
        yield
    except KeyboardInterrupt:
        from trackprofile.units import counted

        solved = 0 if checkpoint is None else len(checkpoint)
        state = (
            f"{counted(solved, 'solved block')} kept: continue with --resume"
            if solved
            else "nothing was written"
        )
        show.error(f"Interrupted; {state}.", as_json=as_json)
        raise typer.Exit(INTERRUPTED_EXIT) from None


def _check_method_options(method: str, options: Mapping[str, object], *, resume: bool) -> None:
    """Refuse options that the method does not have, because they would have no effect."""
    from trackprofile.methods.method import setting_names

    known = {*setting_names(method), *(["resume"] if METHODS[method].resumable else [])}
    for name, value in {**options, "resume": resume}.items():
        if value and name not in known:
            raise DataError(
                f"--{name.replace('_', '-')} has no effect with --method {method}; leave it out, or choose another "
                "method."
            )

"""`trackprofile calibrate`: recordings go in, with or without a reference; a vehicle as it is comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import From, Json, RequiredVehicle, To, TrackName, read_as


def calibrate(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING...")],
    vehicle: RequiredVehicle,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="TOML", help="The vehicle.")],
    reference: Annotated[
        Path | None,
        typer.Option(metavar="PROFILE", help="The profile there, where it is known."),
    ] = None,
    track: TrackName = "rigid",
    prior: Annotated[
        str | None,
        typer.Option(metavar="SPECTRUM", help="Shape of the unknown profile: a preset, or a TOML."),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="To fit; may be repeated. Without: all that can be."),
    ] = None,
    anyway: Annotated[
        bool, typer.Option(help="Write also what the data tell less than the prior.")
    ] = False,
    from_m: From = None,
    to_m: To = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A .png: how sure each parameter is, what is left."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit a vehicle to recordings, with or without a reference for the profile under them."""
    from trackprofile.calibration.calibrate import calibrate as fit
    from trackprofile.contracts import select_stretch
    from trackprofile.io.atomic import check_writable, whole_files
    from trackprofile.io.model_toml import (
        check_vehicle_path,
        read_spectrum,
        read_track,
        read_vehicle,
        write_vehicle,
    )
    from trackprofile.reporting.figures import (
        calibration_figure,
        check_png_library,
        write_png,
    )

    check_vehicle_path(output)
    if picture is not None:
        check_png_library()
        check_writable(picture)
    measured = [select_stretch(read_as(path, "recording"), from_m, to_m) for path in recordings]
    known = (
        None if reference is None else select_stretch(read_as(reference, "profile"), from_m, to_m)
    )
    car, installation = read_vehicle(vehicle)
    support = read_track(track)
    spectrum = None if prior is None else read_spectrum(prior)
    with show.progress_bars() as progress:
        found = fit(
            measured, car, known, installation=installation, track=support, prior=spectrum,
            parameters=parameter, keep_undetermined=anyway, progress=progress,
        )  # fmt: skip
    result = found.as_dict()
    origin = {
        "recordings": [path.name for path in recordings],
        "reference": None if reference is None else reference.name,
        "track": track,
        "from_m": from_m,
        "to_m": to_m,
    }
    write_vehicle(found.vehicle, found.installation, output, origin | result)
    if picture is not None:
        with whole_files(picture) as (file,):
            write_png(calibration_figure(found), file)
    if as_json:
        show.as_one_object({"file": str(output)} | origin | result)
        return
    show.note(found.notes)
    show.estimates(result["parameters"])
    drawn = "" if picture is None else f" How sure it is: {picture}."
    show.say(f"Vehicle in {output}: give it to infer with --vehicle.{drawn}")

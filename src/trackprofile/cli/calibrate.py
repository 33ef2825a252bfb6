"""`trackprofile calibrate`: fit a vehicle model to recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import From, Json, RequiredVehicle, To, TrackName, flag, read_as


def calibrate(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING",
            help="One or more recordings of runs with this vehicle: TOML or NetCDF.",
        ),
    ],
    vehicle: RequiredVehicle,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="TOML", help="File to write the fitted vehicle model to."
        ),
    ],
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="PROFILE",
            help="Known profile of the track that the recordings were made on: .nc, .csv or .parquet. Default: the "
            "profile is unknown and the vehicle is fitted from the agreement of sensors and speeds.",
        ),
    ] = None,
    track: TrackName = "rigid",
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="SPECTRUM",
            help="Shape of the roughness spectrum of the unknown profile: a preset such as german-low, or a TOML file.",
        ),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help='Parameter to fit, such as "primary stiffness". Repeatable. Default: all that the data determine.',
        ),
    ] = None,
    keep_undetermined: Annotated[
        bool,
        flag(
            "--keep-undetermined",
            "Fit and write also parameters that the data determine less than the prior does. Default: they keep their "
            "starting values.",
        ),
    ] = False,
    from_m: From = None,
    to_m: To = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="PNG file for a figure of each parameter's likelihood and of the signals' residuals.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit the parameters of a vehicle model to recordings, with or without a known reference profile."""
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
    if figure is not None:
        check_png_library()
        check_writable(figure)
    data = [select_stretch(read_as(path, "recording"), from_m, to_m) for path in recordings]
    profile = (
        None if reference is None else select_stretch(read_as(reference, "profile"), from_m, to_m)
    )
    model, installation = read_vehicle(vehicle)
    support = read_track(track)
    spectrum = None if prior is None else read_spectrum(prior)
    with show.progress_bars() as progress:
        calibration = fit(
            data, model, profile, installation=installation, track=support, prior=spectrum,
            parameters=parameter, keep_undetermined=keep_undetermined, progress=progress,
        )  # fmt: skip
    result = calibration.as_dict()
    origin = {
        "recordings": [path.name for path in recordings],
        "reference": None if reference is None else reference.name,
        "track": track,
        "from_m": from_m,
        "to_m": to_m,
    }
    write_vehicle(calibration.vehicle, calibration.installation, output, origin | result)
    if figure is not None:
        with whole_files(figure) as (file,):
            write_png(calibration_figure(calibration), file)
    if as_json:
        show.as_one_object({"file": str(output)} | origin | result)
        return
    show.note(calibration.notes)
    show.estimates(result["parameters"])
    show.say(f"Vehicle in {output}: use it with infer --vehicle {output}.")
    if figure is not None:
        show.say(f"Likelihoods and residuals in {figure}.")

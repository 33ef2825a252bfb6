"""`trackprofile accuracy`: the accuracy bound of a set of sensors."""

from __future__ import annotations

from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json, RequiredVehicle, TrackName
from trackprofile.errors import DataError


def accuracy(
    vehicle: RequiredVehicle,
    speed: Annotated[
        str, typer.Option(metavar="SPEED", help='Speed of the train with its unit: "150 km/h".')
    ],
    sensors: Annotated[
        str,
        typer.Option(
            metavar="SENSORS",
            help="Sensors with their noise: a preset such as bogie-25ug, or a TOML file.",
        ),
    ],
    track: TrackName = "rigid",
    prior: Annotated[
        str,
        typer.Option(
            metavar="SPECTRUM",
            help="Roughness spectrum of the track: a preset such as fra-6, or a TOML file.",
        ),
    ] = "german-low",
    as_json: Json = False,
) -> None:
    """Compute the smallest RMS error per wavelength band that any method can reach with given sensors."""
    from trackprofile.inference.accuracy_bound import accuracy_bound_per_rail
    from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle

    metres_per_second = _train_speed(speed)
    model, _ = read_vehicle(vehicle)
    bounds = accuracy_bound_per_rail(
        model, read_track(track), read_sensors(sensors), metres_per_second, read_spectrum(prior)
    )
    per_rail = {
        rail.value: {band: 1e3 * error for band, error in errors.items()}
        for rail, errors in bounds.items()
    }
    mean = per_rail.pop("mean")
    if as_json:
        rails = {"accuracy_bound_per_rail_mm": per_rail} if per_rail else {}
        show.as_one_object({"accuracy_bound_mm": mean, **rails, "speed_m_s": metres_per_second})
        return
    heads = ("band", "smallest RMS error, mm", *(f"{rail}, mm" for rail in per_rail))
    rows = [
        (band, *(f"{errors[band]:.4g}" for errors in (mean, *per_rail.values()))) for band in mean
    ]
    show.table(heads, rows)


def _train_speed(text: str) -> float:
    """A speed above zero, m/s."""
    from trackprofile.units import quantity

    metres_per_second = quantity(text, "speed")
    if metres_per_second <= 0:
        raise DataError(f"{text!r}: expected a speed above zero.")
    return metres_per_second

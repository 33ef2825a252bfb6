"""`trackprofile vehicles list | show`: the built-in vehicles, and how they swing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json

app = typer.Typer(
    help="The built-in vehicles: their parameters, with sources, and how they swing.",
    no_args_is_help=True,
)


@app.command("list")
def list_vehicles(as_json: Json = False) -> None:
    """List the built-in vehicles."""
    from trackprofile.io.model_toml import presets, read_vehicle

    cars = {name: read_vehicle(name)[0] for name in presets("vehicle")}
    if as_json:
        show.as_one_object({name: car.source for name, car in cars.items()})
        return
    width = max(map(len, cars))
    for name, car in cars.items():
        show.say(f"{name:<{width}}  {car.name}: {car.source}")


@app.command("show")
def show_vehicle(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A preset, or a TOML.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="TOML", help="Write it there, to change it."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a vehicle's parameters with their priors and sources, and its modes on a rigid track."""
    from trackprofile.io.model_toml import check_vehicle_path, read_vehicle, write_vehicle
    from trackprofile.models.modal import modes, roll_modes
    from trackprofile.models.vehicle import parameter_values

    car, installation = read_vehicle(vehicle)
    if output is not None:
        check_vehicle_path(output)
        write_vehicle(car, installation, output)
    values, swings = parameter_values(car), [*modes(car), *roll_modes(car)]
    if as_json:
        show.as_one_object(
            {
                "name": car.name,
                "source": car.source,
                "parameters": {
                    one.name: {
                        "value": values[one.name],
                        "unit": one.unit,
                        "log_std": one.log_std,
                        "source": one.source,
                    }
                    for one in car.parameters
                },
                "modes": [
                    {"frequency_hz": one.frequency, "damping_ratio": one.damping_ratio, "motions": one.description}
                    for one in swings
                ],
            }
        )  # fmt: skip
        return
    show.say(f"{car.name}: {car.source}\n")
    show.table(
        ("parameter", "value", "unit", "std of its logarithm"),
        [
            (one.name, f"{values[one.name]:.6g}", one.unit, f"{one.log_std:g}")
            for one in car.parameters
        ],
    )
    show.say("\nSources:")
    for one in car.parameters:
        show.say(f"  {one.name}: {one.source}")
    show.say("\nOn a rigid track, with the wheels held:")
    show.table(
        ("swings", "Hz", "damping ratio"),
        [(one.description, f"{one.frequency:.2f}", f"{one.damping_ratio:.2f}") for one in swings],
    )

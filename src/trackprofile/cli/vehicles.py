"""`trackprofile vehicles list | show`: the built-in vehicles and their modes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json
from trackprofile.cli.usage import Command, Group

app = typer.Typer(
    cls=Group,
    help="List the built-in vehicle models; show a model's parameters, their sources and its modes.",
    no_args_is_help=True,
)


@app.command("list", cls=Command)
def list_vehicles(as_json: Json = False) -> None:
    """List the built-in vehicle models with their sources."""
    from trackprofile.io.model_toml import presets, read_vehicle

    models = {name: read_vehicle(name)[0] for name in presets("vehicle")}
    if as_json:
        show.as_one_object({name: model.source for name, model in models.items()})
        return
    width = max(map(len, models))
    for name, model in models.items():
        show.say(f"{name:<{width}}  {model.name}: {model.source}")


@app.command("show", cls=Command)
def show_vehicle(
    vehicle: Annotated[
        str, typer.Argument(metavar="VEHICLE", help="Vehicle model: a preset or a TOML file.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="TOML",
            help="Also write the vehicle model to this TOML file, as a start for an own model.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a vehicle's parameters with their priors and sources, and its modes on a rigid track."""
    from trackprofile.io.model_toml import check_vehicle_path, read_vehicle, write_vehicle
    from trackprofile.models.modal import modes, roll_modes
    from trackprofile.models.vehicle import parameter_values

    model, installation = read_vehicle(vehicle)
    if output is not None:
        check_vehicle_path(output)
        write_vehicle(model, installation, output)
    values, all_modes = parameter_values(model), [*modes(model), *roll_modes(model)]
    if as_json:
        show.as_one_object(
            {
                "name": model.name,
                "source": model.source,
                "parameters": {
                    one.name: {
                        "value": values[one.name],
                        "unit": one.unit,
                        "log_std": one.log_std,
                        "source": one.source,
                    }
                    for one in model.parameters
                },
                "modes": [
                    {"frequency_hz": one.frequency, "damping_ratio": one.damping_ratio, "motions": one.description}
                    for one in all_modes
                ],
            }
        )  # fmt: skip
        return
    show.say(f"{model.name}: {model.source}\n")
    show.table(
        ("parameter", "value", "unit", "std of its logarithm"),
        [
            (one.name, f"{values[one.name]:.6g}", one.unit, f"{one.log_std:g}")
            for one in model.parameters
        ],
    )
    show.say("\nSources:")
    for one in model.parameters:
        show.say(f"  {one.name}: {one.source}")
    show.say("\nModes on a rigid track:")
    show.table(
        ("motion", "frequency, Hz", "damping ratio"),
        [
            (one.description, f"{one.frequency:.2f}", f"{one.damping_ratio:.2f}")
            for one in all_modes
        ],
    )

"""`trackprofile simulate`: from a scenario to a recording and the profile that it was simulated on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json, flag


def _print_names(context: typer.Context, wanted: bool) -> None:
    if wanted:
        from trackprofile.scenario import scenarios

        names = list(scenarios())
        if show.json_requested(context):
            show.as_one_object({"scenarios": names})
        else:
            for name in names:
                show.say(name)
        raise typer.Exit


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO", help="Scenario: a TOML file, or the name of a built-in scenario."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="RECORDING",
            help="File to write the recording to: .nc, or .toml with a CSV table next to it.",
        ),
    ],
    truth: Annotated[
        Path,
        typer.Option(
            metavar="PROFILE",
            help="File to write the simulated unloaded profile to: .nc, .csv or .parquet.",
        ),
    ],
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Seed of the sensors' noise; the same seed gives the same noise. Default: the scenario's seed.",
        ),
    ] = None,
    check_step: Annotated[
        bool,
        flag(
            "--check-step",
            "Repeat the simulation with half the time step and report by how much the signals differ.",
        ),
    ] = False,
    names: Annotated[
        bool,
        typer.Option(
            "--list",
            metavar="",
            callback=_print_names,
            is_eager=True,
            help="Print the names of the built-in scenarios and exit.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Simulate the signals that sensors on a train record, and write them with the profile of the track.

    An HTML figure and a PNG figure of the same name are written next to RECORDING.
    """
    from trackprofile.reporting.result_files import (
        figure_notes,
        simulation_files,
        simulation_summary,
        write_simulation,
    )
    from trackprofile.scenario import read_scenario, run_scenario, step_errors
    from trackprofile.units import counted

    simulation_files(output, truth)
    ready = read_scenario(scenario, seed)
    with show.progress_bars() as progress:
        run = run_scenario(ready, progress or (lambda stage, share: None))
    changes = step_errors(ready, run) if check_step else {}
    title = f"Simulation {ready.name}: {ready.vehicle.name}"
    files = list(map(str, write_simulation(run, output, truth, title)))
    result = {"files": files} | simulation_summary(run, changes)
    result["notes"] += figure_notes(files)
    if as_json:
        show.as_one_object(result)
        return
    show.note(result["notes"])
    ends = f"{result['from_m']:.0f} m to {result['to_m']:.0f} m"
    samples: Any = result["samples"]
    show.say(
        f"Recording of {counted(samples, 'sample')} from {ends} in {files[0]}, profile in {files[1]}."
    )
    forces = 1e-3 * run.simulation.contact_force
    show.say(f"Contact forces {forces.min():.1f} to {forces.max():.1f} kN.")
    for name, change in changes.items():
        show.say(f"With half the time step {name} changes by {100 * change:.2g} %.")
    show.see_figures(files[2:])

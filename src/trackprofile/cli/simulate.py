"""`trackprofile simulate`: a scenario goes in, a recording and the truth come out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show


def _print_names(wanted: bool) -> None:
    if wanted:
        from trackprofile.scenario import scenarios

        for name in scenarios():
            show.say(name)
        raise typer.Exit


def simulate(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A TOML, or the name of a built-in scenario.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RECORDING", help="NetCDF, or TOML with CSV.")
    ],
    truth: Annotated[
        Path, typer.Option(metavar="PROFILE", help="The unloaded profile: .nc, .csv or .parquet.")
    ],
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the sensors' noise, in place of the scenario's.")
    ] = None,
    check_step: Annotated[
        bool,
        typer.Option("--check-step", help="Simulate with half the step too, and say what changes."),
    ] = False,
    names: Annotated[
        bool,
        typer.Option(
            "--list", callback=_print_names, is_eager=True, help="Name the built-in scenarios."
        ),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object and nothing else.")
    ] = False,
) -> None:
    """Simulate what sensors on a train record, and write down the track that it ran on.

    Beside RECORDING a page (.html) and a picture (.png) of the same name show what happened.
    """
    from trackprofile.reporting.result_files import (
        figure_notes,
        simulation_files,
        simulation_summary,
        write_simulation,
    )
    from trackprofile.scenario import read_scenario, run_scenario, step_errors

    simulation_files(output, truth)
    ready = read_scenario(scenario, seed)
    with show.progress_bars() as progress:
        made = run_scenario(ready, progress or (lambda stage, share: None))
    changes = step_errors(ready, made) if check_step else {}
    title = f"Simulation {ready.name}: {ready.vehicle.name}"
    files = list(map(str, write_simulation(made, output, truth, title)))
    result = {"files": files} | simulation_summary(made, changes)
    result["notes"] += figure_notes(files)
    if as_json:
        show.as_one_object(result)
        return
    show.note(result["notes"])
    ends = f"{result['from_m']:.0f} m to {result['to_m']:.0f} m"
    show.say(
        f"Recording of {result['samples']} samples from {ends} in {files[0]}, truth in {files[1]}."
    )
    forces = 1e-3 * made.simulation.contact_force
    show.say(f"Contact forces {forces.min():.1f} to {forces.max():.1f} kN.")
    for name, change in changes.items():
        show.say(f"At half the step {name} changes by {100 * change:.2g} %.")
    show.see_figures(files[2:])

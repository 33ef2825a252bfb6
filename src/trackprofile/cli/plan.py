"""`trackprofile plan`: the computing capacity that a railway network needs."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json, TrackName, hours, length
from trackprofile.errors import FileError

SUFFIXES = (".html", ".md")


def plan(
    line_length: Annotated[
        float,
        typer.Option(
            "--length",
            metavar="LENGTH",
            parser=length,
            help='Total length of the lines, such as "10000 km"; a number without unit is in m.',
        ),
    ] = "10000 km",  # type: ignore[assignment]
    passes_per_day: Annotated[
        float, typer.Option(metavar="N", help="Recorded passes per day over each location.")
    ] = 50.0,
    recording_length: Annotated[
        float,
        typer.Option(
            metavar="LENGTH",
            parser=length,
            help='Length of track in one recording, such as "10 km"; a number without unit is in m.',
        ),
    ] = "10 km",  # type: ignore[assignment]
    speed: Annotated[
        str, typer.Option(metavar="SPEED", help="Speed of the trains with its unit.")
    ] = "120 km/h",
    sampling_rate: Annotated[
        str, typer.Option(metavar="RATE", help="Sampling rate of the sensors with its unit.")
    ] = "500 Hz",
    sensors: Annotated[
        str, typer.Option(metavar="SENSORS", help="Sensors: a preset or a TOML file.")
    ] = "bogie-25ug",
    vehicle: Annotated[
        str, typer.Option(metavar="VEHICLE", help="Vehicle model: a preset or a TOML file.")
    ] = "velaro",
    track: TrackName = "zhai",
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="SPECTRUM",
            help="Roughness spectrum as prior of the inference: a preset or a TOML file. Default: estimated from each "
            "recording, which takes longer.",
        ),
    ] = None,
    working_hours: Annotated[
        float,
        typer.Option(
            metavar="HOURS",
            parser=hours,
            help="Hours per day in which recordings are transferred and computed, up to 24.",
        ),
    ] = "24 h",  # type: ignore[assignment]
    utilisation: Annotated[
        float,
        typer.Option(metavar="SHARE", help="Share of the cores' time used for computing, 0 to 1."),
    ] = 0.6,
    copies: Annotated[
        float, typer.Option(metavar="N", help="Number of copies of all stored data.")
    ] = 2.0,
    retention_days: Annotated[
        float, typer.Option(metavar="DAYS", help="Days for which recordings are kept.")
    ] = 30.0,
    store: Annotated[
        str | None,
        typer.Option(
            "--store",
            metavar="STORE",
            help="Store whose passes determine the stored bytes per metre. Default: the recording that is simulated "
            "for the measurement.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write the plan to: .html or .md. Default: it is printed only.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Estimate the cores, memory, storage and data transfer that a railway network needs.

    The cost per metre is measured on this machine with a simulated recording, which takes about a minute.
    """
    from trackprofile.fleet.capacity import Network, need
    from trackprofile.fleet.capacity_html import Plan, html, markdown, tables, title
    from trackprofile.fleet.cost_measurement import Sample, cost, stored_per_metre
    from trackprofile.io.atomic import check_writable, whole_files
    from trackprofile.machine import machine
    from trackprofile.store import open_store
    from trackprofile.units import quantity

    if output is not None:
        if output.suffix.lower() not in SUFFIXES:
            raise FileError(
                f"{output}: expected a file name that ends in {' or '.join(SUFFIXES)} for a plan."
            )
        check_writable(output)
    train = quantity(speed, "speed")
    network = Network(
        line_length, passes_per_day, recording_length, train, working_hours, utilisation, copies,
        retention_days,
    )  # fmt: skip
    rate = quantity(sampling_rate, "frequency")
    sample = Sample(recording_length, train, rate, vehicle, track, sensors, prior)
    stored = None if store is None else stored_per_metre(open_store(store))
    measured = cost(sample)
    if stored is not None:
        measured = replace(measured, stored=stored)
    result = Plan(
        network, sample, measured, need(network, measured), store or "", machine(), _command()
    )
    files = []
    if output is not None:
        with whole_files(output) as (part,):
            text = html(result) if output.suffix.lower() == ".html" else markdown(result)
            part.write_text(text, encoding="utf-8")
        files.append(str(output))
    if as_json:
        about = {"machine": result.machine, "command": result.command, "files": files}
        parts = {"assumed": asdict(network) | asdict(sample), "measured": asdict(measured)}
        show.as_one_object(parts | {"needed": asdict(result.need)} | about)
        return
    show.say(f"{title(result)}:")
    for table in tables(result).values():
        rows = list(zip(*table.values(), strict=True))
        show.table(tuple(table), rows)
    if files:
        show.say(f"Plan in {files[0]}.")


def _command() -> str:
    """This command as it is typed in a shell."""
    return shlex.join(["trackprofile", *sys.argv[1:]])

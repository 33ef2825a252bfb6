"""`trackprofile plan`: what a country's lines need, from what one recording costs here."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json, TrackName
from trackprofile.errors import FileError

SUFFIXES = (".html", ".md")


def plan(
    km: Annotated[float, typer.Option(metavar="KM", help="Of line.")] = 10_000.0,
    passes_per_day: Annotated[
        float, typer.Option(metavar="N", help="Over each kilometre of line.")
    ] = 50.0,
    recording_km: Annotated[float, typer.Option(metavar="KM", help="Of one recording.")] = 10.0,
    speed: Annotated[str, typer.Option(metavar="SPEED", help="Of the trains.")] = "120 km/h",
    sampling: Annotated[str, typer.Option(metavar="RATE", help="Of the sensors.")] = "500 Hz",
    sensors: Annotated[str, typer.Option(metavar="S", help="A preset, or a TOML.")] = "bogie-25ug",
    vehicle: Annotated[str, typer.Option(metavar="V", help="A preset, or a TOML.")] = "velaro",
    track: TrackName = "zhai",
    prior: Annotated[
        str | None,
        typer.Option(metavar="P", help="A spectrum; without, found from each recording."),
    ] = None,
    hours: Annotated[float, typer.Option(metavar="H", help="Of a day with work.")] = 24.0,
    utilisation: Annotated[
        float, typer.Option(metavar="SHARE", help="Of the cores' time that is work.")
    ] = 0.6,
    copies: Annotated[float, typer.Option(metavar="N", help="Of what is kept.")] = 2.0,
    raw_days: Annotated[float, typer.Option(metavar="DAYS", help="Recordings are kept.")] = 30.0,
    store: Annotated[
        str | None, typer.Option("--store", metavar="S", help="Whose passes say what one takes.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help=".html or .md.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Say what a country's lines need in cores, memory, storage and transfer; the cost is measured here (a minute)."""
    from trackprofile.fleet.capacity import Network, need
    from trackprofile.fleet.capacity_html import Plan, html, markdown, tables, title
    from trackprofile.fleet.cost_measurement import Sample, cost, stored_per_metre
    from trackprofile.io.atomic import check_writable, whole_files
    from trackprofile.machine import machine
    from trackprofile.store import open_store
    from trackprofile.units import quantity

    if output is not None:
        if output.suffix.lower() not in SUFFIXES:
            raise FileError(f"{output}: a plan goes to a file that ends in {', '.join(SUFFIXES)}.")
        check_writable(output)
    train = quantity(speed, "speed")
    network = Network(
        1e3 * km, passes_per_day, 1e3 * recording_km, train, hours, utilisation, copies, raw_days
    )
    sample = Sample(
        1e3 * recording_km, train, quantity(sampling, "frequency"), vehicle, track, sensors, prior
    )
    of_store = None if store is None else stored_per_metre(open_store(store))
    measured = cost(sample)
    if of_store is not None:
        measured = replace(measured, stored=of_store)
    found = Plan(
        network, sample, measured, need(network, measured), store or "", machine(), _command()
    )
    files = []
    if output is not None:
        with whole_files(output) as (part,):
            text = html(found) if output.suffix.lower() == ".html" else markdown(found)
            part.write_text(text, encoding="utf-8")
        files.append(str(output))
    if as_json:
        about = {"machine": found.machine, "command": found.command, "files": files}
        parts = {"assumed": asdict(network) | asdict(sample), "measured": asdict(measured)}
        show.as_one_object(parts | {"needed": asdict(found.need)} | about)
        return
    show.say(f"{title(found)}:")
    for table in tables(found).values():
        rows = list(zip(*table.values(), strict=True))
        show.table(tuple(table), rows)
    if files:
        show.say(f"See {files[0]}.")


def _command() -> str:
    """This command, as a shell takes it."""
    return shlex.join(["trackprofile", *sys.argv[1:]])

"""A capacity plan in tables, as HTML or Markdown: assumptions, measurements and requirements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

from trackprofile import __version__
from trackprofile.assessment.limits import KM_H
from trackprofile.assessment.tables import Table
from trackprofile.fleet.capacity import Cost, Need, Network
from trackprofile.fleet.cost_measurement import Sample
from trackprofile.reporting.html import html_document, html_table

_DATA = (("PB", 1e15), ("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3), ("B", 1.0))


@dataclass(frozen=True)
class Plan:
    """A capacity plan and the sources of its numbers.

    Parameters
    ----------
    network, sample : what is assumed
    cost, need : what was measured, what follows
    stored_in : the store that the stored bytes are of; empty is the measured recording's
    machine : that it was measured on
    command : that makes it anew
    """

    network: Network
    sample: Sample
    cost: Cost
    need: Need
    stored_in: str
    machine: str
    command: str


def tables(plan: Plan) -> dict[str, Table]:
    """Assumptions, measurements and requirements: each quantity with its value and source."""
    network, sample, cost, need = plan.network, plan.sample, plan.cost, plan.need
    hours = f"in {network.hours:g} h a day"
    stored = f"passes of {plan.stored_in}" if plan.stored_in else "that recording's"
    assumed = [
        ("lines", f"{network.length / 1e3:,g} km", "--length"),
        ("passes over each kilometre", f"{network.passes:g} a day", "--passes-per-day"),
        ("a recording", f"{network.recording_length / 1e3:g} km", "--recording-length"),
        ("trains run at", f"{network.train_speed / KM_H:.4g} km/h", "--speed"),
        ("sensors", f"{sample.sensors}, {sample.sampling:g} Hz", "--sensors, --sampling-rate"),
        ("vehicle, track", f"{sample.vehicle}, {sample.track}", "--vehicle, --track"),
        ("prior", sample.prior or "found from the data of each recording", "--prior"),
        ("hours of a day with work", f"{network.hours:g} h", "--working-hours"),
        ("share of the cores' time that is work", f"{100 * network.utilisation:g} %", "--utilisation"),
        ("copies of what is kept", f"{network.copies:g}", "--copies"),
        ("recordings are kept for", f"{network.raw_days:g} days", "--retention-days"),
    ]  # fmt: skip
    measured = [
        ("computing", f"{number(1e3 * cost.cpu)} ms per metre", "to read, infer, assess and store one recording"),
        ("memory of a worker", data(cost.memory), "its peak"),
        ("recording in Parquet", f"{number(cost.recorded)} B per metre", "64-bit numbers; 16-bit ones are a quarter"),
        ("recording in CSV", f"{number(cost.recorded_as_csv)} B per metre", "for comparison"),
        ("in the store", f"{number(cost.stored)} B per metre", stored),
        ("files in the store", f"{cost.files:g} a recording", "that recording's"),
    ]  # fmt: skip
    needed = [
        ("recorded", f"{need.metres / 1e3:,.0f} km a day", f"{need.recordings:,.0f} recordings"),
        ("cores", f"{need.cores:,}", f"{number(need.core_seconds / 3600)} core hours a day, {hours}"),
        ("memory", data(need.memory), "of all workers, one a core"),
        ("received", f"{data(need.received)} a day", f"{number(need.received_rate / 1e6)} Mbit/s {hours}"),
        ("written to the store", f"{data(need.stored)} a day", f"{number(need.written_rate / 1e6)} Mbit/s {hours}"),
        ("store", f"{data(need.stored_year)} a year", f"{network.copies:g} copies"),
        ("files in the store", f"{number(need.files_year / 1e6)} million a year", f"{cost.files:g} a recording"),
        ("recordings kept", data(need.raw_kept), f"{network.raw_days:g} days, {network.copies:g} copies"),
    ]  # fmt: skip
    columns = {
        "assumed": ("assumed", "value", "option", assumed),
        "measured": ("measured", "value", "how", measured),
        "needed": ("needed", "value", "that is", needed),
    }
    return {
        name: dict(zip((what, value, whence), map(list, zip(*rows, strict=True)), strict=True))
        for name, (what, value, whence, rows) in columns.items()
    }


def title(plan: Plan) -> str:
    """Title of the plan."""
    network = plan.network
    return f"{network.length / 1e3:,g} km of line, {network.passes:g} passes a day"


def html(plan: Plan) -> str:
    """The plan as one HTML file."""
    made = tables(plan)
    parts = [f"<h1>{escape(title(plan))}</h1>", f'<p class="where">{escape(_whence(plan))}</p>']
    parts += [
        f"<h2>{escape(name.capitalize())}</h2>{html_table(made[name], name)}"
        for name in ("needed", "measured", "assumed")
    ]
    parts.append(f"<p>Repeat with <code>{escape(plan.command)}</code>.</p>")
    return html_document(title(plan), "\n".join(parts))


def markdown(plan: Plan) -> str:
    """The plan as Markdown."""
    made = tables(plan)
    parts = [f"# {title(plan)}", _whence(plan)]
    parts += [_markdown(made[name]) for name in ("needed", "measured", "assumed")]
    return "\n\n".join([*parts, f"Repeat with `{plan.command}`."]) + "\n"


def data(size: float) -> str:
    """An amount of data with its unit, in powers of ten.

    Examples
    --------
    >>> data(2.5e13), data(999.0), data(0.0)
    ('25 TB', '999 B', '0 B')
    """
    name, unit = next((one for one in _DATA if size >= one[1]), _DATA[-1])
    return f"{number(size / unit)} {name}"


def number(value: float) -> str:
    """A number with three digits, without powers of ten.

    Examples
    --------
    >>> number(1062.4), number(0.02134)
    ('1,060', '0.0213')
    """
    return f"{float(f'{value:.3g}'):,g}"


def _whence(plan: Plan) -> str:
    return f"Measured on one of {plan.machine}, by trackprofile {__version__}."


def _markdown(table: Mapping[str, list[str]]) -> str:
    lines = [tuple(table), ("---",) * len(table), *zip(*table.values(), strict=True)]
    return "\n".join(f"| {' | '.join(one.replace('|', '/') for one in line)} |" for line in lines)

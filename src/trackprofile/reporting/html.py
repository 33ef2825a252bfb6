"""The report as one HTML file that needs no network: words, charts, tables, method."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import Table, change_table, duty, tables, words
from trackprofile.reporting.band_figures import chart_data
from trackprofile.reporting.contents import Report, differences, method
from trackprofile.reporting.spectrum_figure import drawing
from trackprofile.reporting.summary import changes_summary, gravity, headline, percent, summary

MOST_ROWS = 2000
"""Defects in the page's table, the gravest; all are in the tables that `assess` writes."""

ASSESSED = "the tables of trackprofile assess"

_DIGITS = {"_mm": 3, "_m": 1, "kilometre": 3}  # after the point, by how a column's name ends
_GRAVE = ("calls for immediate", "call for immediate", "This obliges to")


def html(report: Report) -> str:
    """The whole page as text."""
    found, way = report.assessment, report.way
    title = escape(report.title)
    said = summary(found, way)
    drawn = json.dumps(chart_data(found, way, report.beside), separators=(",", ":"), allow_nan=False)  # fmt: skip
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="where">{escape(headline(found, way))}</p>',
        _sentences(said),
        _warnings(found),
        _charts(found, report),
        _defects(report),
        _sections(report),
        _spectrum(report),
        _changes(report),
        _beside(report),
        _quality(report),
        _method(report),
    ]
    body = "\n".join(part for part in parts if part)
    # "<" in a string would end the element.
    drawn = drawn.replace("<", "\\u003c")
    script = f'<script type="application/json" id="data">{drawn}</script>\n<script>{_own("strips.js")}</script>\n'
    return document(report.title, f"{body}\n{script}")


def document(title: str, body: str) -> str:
    """A page that needs no network, around what stands in it."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(title)}</title><style>{_own("report.css")}</style></head>\n'
        f"<body>{body}</body></html>\n"
    )


def _own(name: str) -> str:
    return (files("trackprofile.reporting") / name).read_text(encoding="utf-8")


def _sentences(said: Sequence[str]) -> str:
    items = "".join(
        f'<li class="{"grave" if any(one in text for one in _GRAVE) else ""}">{escape(text)}</li>'
        for text in said
    )
    return f'<ul class="first">{items}</ul>'


def _warnings(found: Assessment) -> str:
    if not found.notes:
        return ""
    items = "".join(f"<li>{escape(note)}.</li>" for note in dict.fromkeys(found.notes))
    return f'<details class="warning" open><summary>To be said with every number</summary><ul>{items}</ul></details>'


def _charts(found: Assessment, report: Report) -> str:
    tools = "".join(
        f'<button type="button" data-do="{do}" aria-label="{label}">{sign}</button>'
        for do, label, sign in (
            ("left", "to the left", "←"), ("right", "to the right", "→"), ("in", "closer", "+"),
            ("out", "wider", "−"), ("all", "all of it", "all"),
        )
    )  # fmt: skip
    keys = [
        ("#0072B2", "level"), ("rgba(86,180,233,0.6)", "95 % interval"), ("rgba(120,120,120,0.4)", "not judged"),
        ("#E69F00", "alert"), ("#D55E00", "intervention"), ("#B00020", "immediate action"),
    ]  # fmt: skip
    if report.beside:
        keys.append(("#8C8C8C", report.beside_name))
    legend = "".join(
        f'<span class="key" style="background:{colour}"></span>{escape(name)}'
        for colour, name in keys
    )
    strips = "".join(
        f'<p class="strip-name">{escape(name)} <span>{level.band.shortest:g} to {level.band.longest:g} m, mm</span></p>'
        f'<canvas class="strip" id="chart-{escape(name)}" role="img" aria-label="level in {escape(name)}"></canvas>'
        for name, level in found.levels.items()
    )
    of_sections = ""
    if found.sections:
        of_sections = (
            '<p class="strip-name">Standard deviation <span>per section, with its 95 % interval; coloured by class, '
            'green is best</span></p><canvas class="low" id="chart-sections" role="img" '
            'aria-label="standard deviation per section"></canvas>'
        )
    return (
        f'<h2>Along the line</h2><section id="charts" tabindex="0" aria-label="strip charts">'
        f'<canvas id="overview" role="img" aria-label="overview"></canvas>'
        f'<div class="tools">{tools}<output id="range"></output><output id="reading"></output></div>'
        f"<div>{legend}</div>{strips}{of_sections}</section>"
        "<p>Wheel or + and − zoom, dragging or the arrow keys move; a link from a table goes to its place.</p>"
    )


def _defects(report: Report) -> str:
    found = report.assessment
    if not found.defects:
        return "<h2>Isolated defects</h2><p>None.</p>"
    ordered = sorted(found.defects, key=gravity, reverse=True)
    rows = "".join(_defect(one, report) for one in ordered[:MOST_ROWS])
    choices = {
        0: "all", 1: "alert and graver", 2: "intervention and graver", 3: "immediate action"
    }  # fmt: skip
    options = "".join(f'<option value="{value}">{text}</option>' for value, text in choices.items())
    heads = ["place", "band", "height, mm", "± 95 %, mm", "length, m"]
    heads += [f"P {action.words}" for action in Action]
    return (
        f'<h2>Isolated defects</h2><p><label>Show <select id="choice">{options}</select></label> '
        "P is the probability that the true level exceeds the limit.</p>"
        f"{_table([*heads, 'calls for'], rows, 'defects')}{_more(len(ordered), ASSESSED)}"
    )


def _defect(one: Defect, report: Report) -> str:
    place = report.way.name(one.peak)
    link = f'<a href="#at={one.peak:.1f}&amp;span=200">{escape(place)}</a>'
    numbers = [f"{1e3 * one.height:.2f}", f"{1.96e3 * one.deviation:.2f}", f"{one.length:.1f}"]
    numbers += [
        percent(one.probabilities[action]) if action in one.probabilities else "–"
        for action in Action
    ]
    grade = int(one.likely) if one.likely else 0
    return (
        f'<tr class="grade-{grade}" data-grade="{grade}"><td>{link}</td><td>{escape(one.band)}</td>'
        + "".join(f'<td class="number">{value}</td>' for value in numbers)
        + f'<td title="{escape(duty(one, report.assessment))}">{words(one.likely)}</td></tr>'
    )


def _sections(report: Report) -> str:
    made = tables(report.assessment, report.way)
    if not made["sections"]["start_m"]:
        return ""
    kept = {
        name: made["sections"][name]
        for name in (
            "start_kilometre", "band", "length_m", "standard_deviation_mm", "low_mm", "high_mm", "of_estimate_mm",
            "quality_class", "assessed_share",
        )
    }  # fmt: skip
    return f"<h2>Sections</h2>{plain(kept, 'sections')}"


def _spectrum(report: Report) -> str:
    found = report.assessment
    if found.spectrum is None:
        return ""
    table = tables(found, report.way)["spectra"]
    near = (
        "<p>The nearest of the known spectra, per kilometre; the difference is the root mean square over third "
        f"octaves.</p>{plain(table, 'spectra')}"
        if table["start_m"]
        else ""
    )
    return f"<h2>Spectrum</h2>{drawing(found.spectrum, found.known)}{near}"


def _changes(report: Report) -> str:
    if report.changes is None:
        return ""
    said = "".join(f"<li>{escape(one)}</li>" for one in changes_summary(report.changes, report.way))
    notes = "".join(f"<li>{escape(one)}.</li>" for one in report.changes.notes)
    table = change_table(report.changes, report.way)
    shown = plain(table, "changes") if table["peak_m"] else ""
    return f'<h2>Change since earlier passes</h2><ul class="first">{said}{notes}</ul>{shown}'


def _beside(report: Report) -> str:
    if report.beside is None:
        return ""
    said = "".join(f"<li>{escape(one)}</li>" for one in differences(report))
    return f"<h2>Beside {escape(report.beside_name)}</h2><ul>{said}</ul>"


def _quality(report: Report) -> str:
    made = tables(report.assessment, report.way)["not_assessed"]
    if not made["band"]:
        return "<h2>Not judged</h2><p>Nothing: all of the profile is.</p>"
    return f"<h2>Not judged, and why</h2>{plain(made, 'not-assessed')}"


def _method(report: Report) -> str:
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td class="long">{escape(text)}</td></tr>'
        for name, text in method(report).items()
    )
    return f'<h2>Method, limits, versions</h2><div class="wide"><table><tbody>{rows}</tbody></table></div>'


def plain(table: Table, key: str, elsewhere: str = ASSESSED) -> str:
    """A table as it is; ``elsewhere`` holds the rows beyond `MOST_ROWS`."""
    heads = [name.replace("_", " ") for name in table]
    columns = list(table.values())
    rows = "".join(
        "<tr>" + "".join(_cell(name, column[i]) for name, column in table.items()) + "</tr>"
        for i in range(min(len(columns[0]), MOST_ROWS))
    )
    return _table(heads, rows, key) + _more(len(columns[0]), elsewhere)


def _more(rows: int, elsewhere: str) -> str:
    rest = rows - MOST_ROWS
    if rest <= 0:
        return ""
    return f"<p>{rest} more rows are in {escape(elsewhere)}.</p>"


def _table(heads: Sequence[str], rows: str, key: str) -> str:
    head = "".join(f'<th scope="col">{escape(one)}</th>' for one in heads)
    table = f'<table id="{key}"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return f'<div class="wide" tabindex="0">{table}</div>'


def _cell(name: str, value: Any) -> str:
    if value is None:
        return '<td class="number">–</td>'
    if isinstance(value, float):
        digits = next((n for end, n in _DIGITS.items() if name.endswith(end)), 2)
        return f'<td class="number">{value:.{digits}f}</td>'
    return f"<td>{escape(str(value))}</td>"

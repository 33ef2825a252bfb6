"""The report as one HTML file that needs no network: summary, charts, tables, caveats, method."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Any

from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import (
    Table,
    action_text,
    change_table,
    required_action_text,
    tables,
)
from trackprofile.reporting.band_figures import chart_data
from trackprofile.reporting.contents import Report, differences, method
from trackprofile.reporting.spectrum_figure import spectrum_svg
from trackprofile.reporting.summary import (
    caveat_line,
    headline,
    percent,
    severity,
    summary,
    trend_summary,
)
from trackprofile.reporting.web_files import report_script, report_style

MAX_ROWS = 2000
"""Maximum number of rows of a table in the report; `trackprofile assess` writes all of them."""

ASSESS_TABLES = "the tables of trackprofile assess"

_DECIMALS = {"_mm": 3, "_m": 1, "kilometre": 3}  # by the end of a column's name
_MAIN_RESULTS = ("requires immediate", "require immediate", "Required action")
_MILLI = 1e3

_BUTTONS = (
    ("ArrowLeft", "move left", "←"),
    ("ArrowRight", "move right", "→"),
    ("+", "zoom in", "+"),
    ("-", "zoom out", "−"),
    ("Home", "whole line", "all"),
)
"""Key, accessible name and text, as the web viewer has them (`web/view.js`)."""

_FILTERS = {
    0: "all",
    1: "alert or more severe",
    2: "intervention or more severe",
    3: "immediate action",
}


def html(report: Report) -> str:
    """The whole report as text."""
    assessment, chainage = report.assessment, report.chainage
    data = chart_data(assessment, chainage, report.compared)
    encoded = json.dumps(data, separators=(",", ":"), allow_nan=False)
    parts = [
        f"<h1>{escape(report.title)}</h1>",
        f'<p class="where">{escape(headline(assessment, chainage))}</p>',
        _caveat_link(assessment),
        _sentences(summary(assessment, chainage)),
        _charts(report),
        _defects(report),
        _sections(report),
        _spectrum(report),
        _trend(report),
        _comparison(report),
        _not_assessed(report),
        _caveats(assessment),
        _method(report),
    ]
    # A "<" within a string could end the script element.
    encoded = encoded.replace("<", "\\u003c")
    script = f'<script type="application/json" id="data">{encoded}</script>\n{report_script()}'
    return html_document(report.title, "\n".join([*filter(None, parts), script]))


def html_document(title: str, body: str) -> str:
    """A self-contained HTML document with the report's style sheet."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(title)}</title><style>{report_style()}</style></head>\n'
        f"<body>{body}</body></html>\n"
    )


def _sentences(sentences: Sequence[str]) -> str:
    items = "".join(
        f'<li class="{"main" if any(one in text for one in _MAIN_RESULTS) else ""}">{escape(text)}</li>'
        for text in sentences
    )
    return f'<ul class="first">{items}</ul>'


def _caveat_link(assessment: Assessment) -> str:
    line = caveat_line(assessment)
    return f'<p class="where"><a href="#caveats">{line}</a>.</p>' if line else ""


def _caveats(assessment: Assessment) -> str:
    if not assessment.notes:
        return ""
    items = "".join(f"<li>{escape(note)}.</li>" for note in dict.fromkeys(assessment.notes))
    return f'<h2 id="caveats">Caveats</h2><ul>{items}</ul>'


def _charts(report: Report) -> str:
    buttons = "".join(
        f'<button type="button" data-key="{key}" aria-label="{name}" title="{name}">{text}</button>'
        for key, name, text in _BUTTONS
    )
    keys = ["level", "interval", "not-assessed", "alert", "intervention", "immediate-action"]
    names = ["level", "95 % interval", "not assessed", *(action.text for action in Action)]
    if report.compared:
        keys.append("compared")
        names.append(report.compared_name)
    legend = "".join(
        f'<span class="key-name"><span class="key key-{key}"></span>{escape(name)}</span>'
        for key, name in zip(keys, names, strict=True)
    )
    strips = "".join(
        f'<p class="strip-name">{escape(name)} <span>{level.band.shortest:g} to {level.band.longest:g} m, '
        f'level in mm</span></p><div class="strip" id="chart-{escape(name)}" role="img" '
        f'aria-label="level in {escape(name)}"></div>'
        for name, level in report.assessment.levels.items()
    )
    sections = ""
    if report.assessment.sections:
        sections = (
            '<p class="strip-name">Standard deviation <span>per section in mm, with its 95 % interval; the colour '
            'is the quality class, green is the best</span></p><div class="low" id="chart-sections" role="img" '
            'aria-label="standard deviation per section"></div>'
        )
    return (
        '<h2>Along the line</h2><section id="charts" tabindex="0" aria-label="charts along the line">'
        '<canvas class="schematic" id="overview" role="img" aria-label="defects along the line"></canvas>'
        f'<div class="tools">{buttons}<output id="range"></output><output id="reading"></output></div>'
        f'<div class="legend">{legend}</div>{strips}{sections}</section>'
        '<p class="hint">Zoom with the wheel, + and −, or two fingers; move by dragging or with the arrow keys; a link '
        "in a table shows its location.</p>"
    )


def _defects(report: Report) -> str:
    assessment = report.assessment
    if not assessment.defects:
        return "<h2>Isolated defects</h2><p>None.</p>"
    ordered = sorted(assessment.defects, key=severity, reverse=True)
    rows = "".join(_defect(one, report) for one in ordered[:MAX_ROWS])
    options = "".join(
        f'<option value="{value}">{text}</option>' for value, text in _FILTERS.items()
    )
    heads = ["location", "band", "height, mm", "± 95 %, mm", "length, m"]
    heads += [f"P {action.text}" for action in Action]
    return (
        f'<h2>Isolated defects</h2><p><label>Show <select id="choice">{options}</select></label> '
        "P is the probability that the true level exceeds the limit.</p>"
        f"{_table([*heads, 'required action'], rows, 'defects')}{_omitted(len(ordered), ASSESS_TABLES)}"
    )


def _defect(one: Defect, report: Report) -> str:
    link = f'<a href="#at={one.peak:.1f}&amp;span=200">{escape(report.chainage.name(one.peak))}</a>'
    numbers = [
        f"{_MILLI * one.height:.2f}",
        f"{NORMAL_95 * _MILLI * one.deviation:.2f}",
        f"{one.length:.1f}",
    ]
    numbers += [
        percent(one.probabilities[action]) if action in one.probabilities else "–"
        for action in Action
    ]
    grade = int(one.required_action) if one.required_action else 0
    return (
        f'<tr class="grade-{grade}" data-grade="{grade}"><td>{link}</td><td>{escape(one.band)}</td>'
        + "".join(f'<td class="number">{value}</td>' for value in numbers)
        + f'<td title="{escape(required_action_text(one, report.assessment))}">'
        + f"{action_text(one.required_action)}</td></tr>"
    )


def _sections(report: Report) -> str:
    table = tables(report.assessment, report.chainage)["sections"]
    if not table["start_m"]:
        return ""
    columns = {
        name: table[name]
        for name in (
            "start_kilometre", "band", "length_m", "standard_deviation_mm", "low_mm", "high_mm",
            "estimate_standard_deviation_mm", "quality_class", "assessed_share",
        )
    }  # fmt: skip
    return f"<h2>Sections</h2>{html_table(columns, 'sections')}"


def _spectrum(report: Report) -> str:
    assessment = report.assessment
    if assessment.spectrum is None:
        return ""
    table = tables(assessment, report.chainage)["spectra"]
    nearest = (
        "<p>The nearest reference spectrum of each kilometre; the difference is the root mean square over third-octave "
        f"bands.</p>{html_table(table, 'spectra')}"
        if table["start_m"]
        else ""
    )
    return f"<h2>Spectrum</h2>{spectrum_svg(assessment.spectrum, assessment.known)}{nearest}"


def _trend(report: Report) -> str:
    if report.trend is None:
        return ""
    sentences = [*trend_summary(report.trend, report.chainage)]
    sentences += [f"{note}." for note in report.trend.notes]
    items = "".join(f"<li>{escape(one)}</li>" for one in sentences)
    table = change_table(report.trend, report.chainage)
    rows = html_table(table, "changes") if table["peak_m"] else ""
    return f'<h2>Change since earlier passes</h2><ul class="first">{items}</ul>{rows}'


def _comparison(report: Report) -> str:
    if report.compared is None:
        return ""
    items = "".join(f"<li>{escape(one)}</li>" for one in differences(report))
    return f"<h2>Comparison with {escape(report.compared_name)}</h2><ul>{items}</ul>"


def _not_assessed(report: Report) -> str:
    table = tables(report.assessment, report.chainage)["not_assessed"]
    if not table["band"]:
        return "<h2>Stretches not assessed</h2><p>None.</p>"
    return f"<h2>Stretches not assessed</h2>{html_table(table, 'not-assessed')}"


def _method(report: Report) -> str:
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td class="long">{escape(text)}</td></tr>'
        for name, text in method(report).items()
    )
    return f'<h2>Method, limits, versions</h2><div class="wide"><table><tbody>{rows}</tbody></table></div>'


def html_table(table: Table, key: str, all_rows: str = ASSESS_TABLES) -> str:
    """A table with its first `MAX_ROWS` rows; ``all_rows`` says where the others are."""
    heads = [name.replace("_", " ") for name in table]
    columns = list(table.values())
    rows = "".join(
        "<tr>" + "".join(_cell(name, column[i]) for name, column in table.items()) + "</tr>"
        for i in range(min(len(columns[0]), MAX_ROWS))
    )
    return _table(heads, rows, key) + _omitted(len(columns[0]), all_rows)


def _omitted(rows: int, all_rows: str) -> str:
    rest = rows - MAX_ROWS
    if rest <= 0:
        return ""
    return f"<p>{rest} more {'row is' if rest == 1 else 'rows are'} in {escape(all_rows)}.</p>"


def _table(heads: Sequence[str], rows: str, key: str) -> str:
    head = "".join(f'<th scope="col">{escape(one)}</th>' for one in heads)
    table = f'<table id="{key}"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return f'<div class="wide" tabindex="0">{table}</div>'


def _cell(name: str, value: Any) -> str:
    if value is None:
        return '<td class="number">–</td>'
    if isinstance(value, float):
        decimals = next((n for end, n in _DECIMALS.items() if name.endswith(end)), 2)
        return f'<td class="number">{value:.{decimals}f}</td>'
    return f"<td>{escape(str(value))}</td>"

"""The report for print: pages of text, strip charts and tables in one PDF, by matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.levels import BandLevel, not_assessed
from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import action_text
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.reporting import palette
from trackprofile.reporting.contents import Report, differences, method
from trackprofile.reporting.summary import headline, percent, severity, summary, trend_summary

PAGE_SIZE = (11.69, 8.27)  # inches, A4 landscape
STRIP_LENGTH = 1000.0
"""Length of track in one strip [m]."""

STRIPS_PER_PAGE = 3
BANDS_PER_STRIP = 2
"""Bands in each strip: those of the shortest wavelengths."""

ROWS_PER_PAGE = 44
LINE_WIDTH = 150  # characters
LINES_PER_PAGE = 46

_MILLI = 1e3


def write_pdf(report: Report, path: Path) -> None:
    """Write a report as PDF; its tables list the defects that require an action and the classified sections."""
    with PdfPages(path, metadata={"Title": report.title}) as pdf:
        for number, page in enumerate(_pages(report), start=1):
            page.text(0.97, 0.02, f"{report.title}, page {number}", ha="right", fontsize=7)
            pdf.savefig(page)


def _pages(report: Report) -> Iterator[Figure]:
    yield from _text_pages(report)
    yield from _strip_pages(report.assessment, report.chainage)
    yield from _table_pages(report)


def _text_pages(report: Report) -> Iterator[Figure]:
    assessment, chainage = report.assessment, report.chainage
    texts = [headline(assessment, chainage), "", *summary(assessment, chainage)]
    if report.trend is not None:
        texts += ["", *trend_summary(report.trend, chainage)]
    if report.compared is not None:
        texts += ["", f"Comparison with {report.compared_name}:", *differences(report)]
    if assessment.notes:
        texts += ["", "Caveats:", *(f"{note}." for note in dict.fromkeys(assessment.notes))]
    texts += ["", *(f"{name}: {text}" for name, text in method(report).items())]
    lines = [line for text in texts for line in textwrap.wrap(text, LINE_WIDTH) or [""]]
    for start in range(0, len(lines), LINES_PER_PAGE):
        page = Figure(figsize=PAGE_SIZE)
        if start == 0:
            page.text(0.05, 0.94, report.title, fontsize=16, weight="bold")
        text = "\n".join(lines[start : start + LINES_PER_PAGE])
        page.text(0.05, 0.91, text, va="top", fontsize=8.5)
        yield page


def _strip_pages(assessment: Assessment, chainage: ChainageTable) -> Iterator[Figure]:
    levels = list(assessment.levels.values())[:BANDS_PER_STRIP]
    first_start = np.floor(assessment.start / STRIP_LENGTH) * STRIP_LENGTH
    starts = np.arange(first_start, assessment.end, STRIP_LENGTH)
    for first in range(0, len(starts), STRIPS_PER_PAGE):
        page_starts = starts[first : first + STRIPS_PER_PAGE]
        page = Figure(figsize=PAGE_SIZE)
        page.subplots_adjust(0.05, 0.06, 0.98, 0.97, hspace=0.35)
        grid = page.subplots(STRIPS_PER_PAGE * len(levels), 1, squeeze=False)[:, 0]
        for row, axes in enumerate(grid):
            strip, level = divmod(row, len(levels))
            if strip < len(page_starts):
                _draw_strip(axes, levels[level], assessment, chainage, float(page_starts[strip]))
            else:
                axes.set_axis_off()
        yield page


def _draw_strip(
    axes: Axes, level: BandLevel, assessment: Assessment, chainage: ChainageTable, start: float
) -> None:
    end = start + STRIP_LENGTH
    inside = slice(*np.searchsorted(level.distance, [start, end]))
    x, y = level.distance[inside], _MILLI * level.level[inside]
    half = NORMAL_95 * _MILLI * level.deviation[inside]
    axes.fill_between(x, y - half, y + half, color=palette.INTERVAL, alpha=0.5, linewidth=0)
    axes.plot(x, y, color=palette.LEVEL, linewidth=0.6)
    limits = assessment.limits.defects_at(level.band.name, assessment.speed)
    for action, height in (limits.heights if limits else {}).items():
        for sign in (-1, 1):
            colour = palette.ACTIONS[action]
            axes.axhline(sign * _MILLI * height, color=colour, linewidth=0.6, dashes=(5, 4))
    for one in not_assessed(level):
        if one.end > start and one.start < end:
            axes.axvspan(max(one.start, start), min(one.end, end), color=palette.MISSING, lw=0)
    for one in assessment.defects:
        if one.band == level.band.name and one.required_action and start <= one.peak < end:
            colour = palette.ACTIONS[one.required_action]
            axes.axvspan(one.start, one.end, color=colour, alpha=0.4, linewidth=0)
    ticks = np.arange(start, end + 1, 100.0)
    axes.set_xlim(start, end)
    axes.set_xticks(ticks, [f"{one:.3f}" for one in chainage.kilometres(ticks)])
    axes.tick_params(labelsize=6)
    axes.set_ylabel(f"{level.band.name}, mm", fontsize=7)


def _table_pages(report: Report) -> Iterator[Figure]:
    assessment = report.assessment
    defects = [one for one in assessment.defects if one.required_action]
    defects.sort(key=lambda one: (-severity(one)[0], one.peak))
    probabilities = [f"P {one.text}" for one in Action]
    heads = ["location", "band", "height, mm", "± 95 %", "length, m", *probabilities]
    rows = [_defect_row(one, report.chainage) for one in defects]
    yield from _tables("Isolated defects that require an action", [*heads, "action"], rows)
    sections = [
        [
            report.chainage.name(one.start),
            one.band,
            f"{one.length:g}",
            f"{_MILLI * one.standard_deviation:.2f}",
            f"{_MILLI * one.low:.2f} to {_MILLI * one.high:.2f}",
            one.quality_class,
        ]
        for one in assessment.sections
        if one.quality_class
    ]
    heads = ["from", "band", "length, m", "standard deviation, mm", "95 %, mm", "class"]
    yield from _tables("Sections", heads, sections)


def _defect_row(one: Defect, chainage: ChainageTable) -> list[str]:
    probabilities = [
        percent(one.probabilities[action]) if action in one.probabilities else "–"
        for action in Action
    ]
    half = NORMAL_95 * _MILLI * one.deviation
    size = [f"{_MILLI * one.height:.1f}", f"{half:.1f}", f"{one.length:.1f}"]
    return [
        chainage.name(one.peak),
        one.band,
        *size,
        *probabilities,
        action_text(one.required_action),
    ]


def _tables(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[Figure]:
    for start in range(0, len(rows), ROWS_PER_PAGE):
        page = Figure(figsize=PAGE_SIZE)
        axes = page.add_axes((0.04, 0.05, 0.92, 0.88))
        axes.set_axis_off()
        page.text(0.05, 0.95, title, fontsize=12, weight="bold")
        part = [list(row) for row in rows[start : start + ROWS_PER_PAGE]]
        table = axes.table(part, colLabels=list(heads), loc="upper left", cellLoc="left")
        table.auto_set_font_size(False)
        table.set_fontsize(7)
        for cell in table.get_celld().values():
            cell.set_linewidth(0.2)
            cell.set_height(0.0208)
        yield page

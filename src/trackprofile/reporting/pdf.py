"""The report for print: pages of words, strips and tables in one PDF, by matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.levels import BandLevel, not_assessed
from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import words
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.reporting import palette
from trackprofile.reporting.contents import Report, differences, method
from trackprofile.reporting.summary import changes_summary, headline, percent, summary

SIZE = (11.69, 8.27)  # inches, A4 on its side
STRIP = 1000.0  # m of track in one strip
STRIPS = 3  # per page
BANDS = 2  # in each strip, the shortest ones
ROWS = 44  # of a table on a page
WIDTH = 150  # characters of a line
LINES = 46  # on a page of words


def write_pdf(report: Report, path: Path) -> None:
    """Write the pages; the tables on paper hold what calls for something."""
    with PdfPages(path, metadata={"Title": report.title}) as book:
        for number, page in enumerate(_pages(report), start=1):
            page.text(0.97, 0.02, f"{report.title}, page {number}", ha="right", fontsize=7)
            book.savefig(page)


def _pages(report: Report) -> Iterator[Figure]:
    yield from _words(report)
    yield from _strips(report.assessment, report.way)
    yield from _tables(report)


def _words(report: Report) -> Iterator[Figure]:
    found, way = report.assessment, report.way
    said = [headline(found, way), "", *summary(found, way), ""]
    said += [f"{note}." for note in dict.fromkeys(found.notes)]
    if report.changes is not None:
        said += ["", *changes_summary(report.changes, way)]
    if report.beside is not None:
        said += ["", f"Beside {report.beside_name}:", *differences(report)]
    said += ["", *(f"{name}: {text}" for name, text in method(report).items())]
    lines = [line for text in said for line in textwrap.wrap(text, WIDTH) or [""]]
    for start in range(0, len(lines), LINES):
        page = Figure(figsize=SIZE)
        if start == 0:
            page.text(0.05, 0.94, report.title, fontsize=16, weight="bold")
        page.text(0.05, 0.91, "\n".join(lines[start : start + LINES]), va="top", fontsize=8.5)
        yield page


def _strips(found: Assessment, way: ChainageTable) -> Iterator[Figure]:
    levels = list(found.levels.values())[:BANDS]
    starts = np.arange(np.floor(found.start / STRIP) * STRIP, found.end, STRIP)
    for first in range(0, len(starts), STRIPS):
        here = starts[first : first + STRIPS]
        page = Figure(figsize=SIZE)
        page.subplots_adjust(0.05, 0.06, 0.98, 0.97, hspace=0.35)
        grid = page.subplots(STRIPS * len(levels), 1, squeeze=False)[:, 0]
        for row, axes in enumerate(grid):
            strip, level = divmod(row, len(levels))
            if strip < len(here):
                _strip(axes, levels[level], found, way, float(here[strip]))
            else:
                axes.set_axis_off()
        yield page


def _strip(
    axes: Axes, level: BandLevel, found: Assessment, way: ChainageTable, start: float
) -> None:
    inside = slice(*np.searchsorted(level.distance, [start, start + STRIP]))
    x, y, s = level.distance[inside], 1e3 * level.level[inside], 1e3 * level.deviation[inside]
    axes.fill_between(x, y - 1.96 * s, y + 1.96 * s, color=palette.INTERVAL, alpha=0.5, linewidth=0)
    axes.plot(x, y, color=palette.LEVEL, linewidth=0.6)
    limits = found.limits.defects_at(level.band.name, found.speed)
    for action, height in (limits.heights if limits else {}).items():
        for sign in (-1, 1):
            axes.axhline(
                sign * 1e3 * height, color=palette.ACTIONS[action], linewidth=0.6, dashes=(5, 4)
            )
    for one in not_assessed(level):
        if one.end > start and one.start < start + STRIP:
            axes.axvspan(
                max(one.start, start), min(one.end, start + STRIP), color=palette.MISSING, lw=0
            )
    for one in found.defects:
        if one.band == level.band.name and one.likely and start <= one.peak < start + STRIP:
            axes.axvspan(
                one.start, one.end, color=palette.ACTIONS[one.likely], alpha=0.4, linewidth=0
            )
    ticks = np.arange(start, start + STRIP + 1, 100.0)
    axes.set_xlim(start, start + STRIP)
    axes.set_xticks(ticks, [f"{one:.3f}" for one in way.kilometres(ticks)])
    axes.tick_params(labelsize=6)
    axes.set_ylabel(f"{level.band.name}, mm", fontsize=7)


def _tables(report: Report) -> Iterator[Figure]:
    found = report.assessment
    calling = [one for one in found.defects if one.likely]
    calling.sort(key=lambda one: (-int(one.likely or 0), one.peak))
    chances = [f"P {one.words}" for one in Action]
    heads = ["place", "band", "height, mm", "± 95 %", "length, m", *chances, "calls for"]
    rows = [_row(one, report.way) for one in calling]
    yield from _table("Isolated defects that call for something", heads, rows)
    sections = [
        [
            report.way.name(one.start), one.band, f"{one.length:g}", f"{1e3 * one.standard_deviation:.2f}",
            f"{1e3 * one.low:.2f} to {1e3 * one.high:.2f}", one.quality_class,
        ]
        for one in found.sections
        if one.quality_class
    ]  # fmt: skip
    heads = ["from", "band", "length, m", "standard deviation, mm", "95 %, mm", "class"]
    yield from _table("Sections", heads, sections)


def _row(one: Defect, way: ChainageTable) -> list[str]:
    chances = [
        percent(one.probabilities[action]) if action in one.probabilities else "–"
        for action in Action
    ]
    size = [f"{1e3 * one.height:.1f}", f"{1.96e3 * one.deviation:.1f}", f"{one.length:.1f}"]
    return [way.name(one.peak), one.band, *size, *chances, words(one.likely)]


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[Figure]:
    for start in range(0, len(rows), ROWS):
        page = Figure(figsize=SIZE)
        axes = page.add_axes((0.04, 0.05, 0.92, 0.88))
        axes.set_axis_off()
        page.text(0.05, 0.95, title, fontsize=12, weight="bold")
        piece = [list(row) for row in rows[start : start + ROWS]]
        drawn = axes.table(piece, colLabels=list(heads), loc="upper left", cellLoc="left")
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(7)
        for cell in drawn.get_celld().values():
            cell.set_linewidth(0.2)
            cell.set_height(0.0208)
        yield page

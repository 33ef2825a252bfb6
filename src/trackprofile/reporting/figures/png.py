"""Static figures by matplotlib, without pyplot and without global state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from trackprofile.reporting import palette
from trackprofile.reporting.figures.chart import (
    COLOURS,
    GAP,
    GAP_OPACITY,
    INTERVAL,
    INTERVAL_OPACITY,
    Chart,
    ChartPanel,
)

_PANEL_HEIGHT, _HEAD_HEIGHT = 1.6, 1.3  # inches
DPI = 150
"""Dots per inch of a PNG."""


def draw(chart: Chart) -> Figure:
    """All panels one below the other, on one distance axis."""
    heights = [panel.height for panel in chart.panels]
    height = _PANEL_HEIGHT * sum(heights) + _HEAD_HEIGHT
    figure = Figure(figsize=(11, height), dpi=DPI, layout="constrained")
    strips = figure.subplots(
        len(heights), sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    legend = {}
    for axes, panel in zip(strips, chart.panels, strict=True):
        _draw_panel(axes, panel, chart.gaps)
        handles, names = axes.get_legend_handles_labels()
        legend |= dict(zip(names, handles, strict=True))
    strips[-1].set(xlim=chart.ends, xlabel="distance in m")
    # The empty lines reserve space for the legend, which the layout engine does not place below a title.
    figure.suptitle(f"{chart.title}\n\n", x=0.008, ha="left", fontsize=13, weight="bold")
    figure.legend(
        legend.values(),
        legend.keys(),
        loc="upper left",
        bbox_to_anchor=(0, 1 - 0.32 / height),
        ncols=len(legend),
        frameon=False,
        fontsize=9,
    )
    figure.supxlabel(chart.note, x=0.008, ha="left", fontsize=8, color=palette.DARK_GREY)
    _lay_out(figure)
    return figure


def _lay_out(figure: Figure) -> None:
    """Compute the layout once and keep it; labels are aligned afterwards, because each alignment measures all axes."""
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")
    figure.align_ylabels()


def write(figure: Figure, path: Path | str) -> None:
    """Write a figure as PNG. It is drawn once: ``savefig`` would draw it twice because of its layout engine."""
    screen_dpi = figure.get_dpi()
    figure.set_dpi(DPI)
    try:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        imsave(path, canvas.buffer_rgba(), format="png", dpi=DPI)
    finally:
        figure.set_dpi(screen_dpi)


def _draw_panel(axes: Axes, panel: ChartPanel, gaps: Sequence[tuple[float, float]]) -> None:
    if panel.interval:
        area = panel.interval
        style = {"color": COLOURS[INTERVAL], "alpha": INTERVAL_OPACITY, "linewidth": 0}
        axes.fill_between(area.x, area.low, area.high, label=INTERVAL, **style)
    for line in panel.lines:
        style = {"color": line.colour, "linewidth": 0.8 * line.width}
        axes.plot(line.x, line.y, label=line.name, **style)
    for start, stop in gaps:
        axes.axvspan(start, stop, color=COLOURS[GAP], alpha=GAP_OPACITY, linewidth=0, label=GAP)
    axes.set_title(panel.name, loc="left", fontsize=9.5, weight="bold")
    axes.set_title(panel.description, loc="right", fontsize=9, color=palette.DARK_GREY)
    axes.set_ylabel(panel.unit, fontsize=9)
    axes.grid(color=palette.GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8.5, color="#999999")

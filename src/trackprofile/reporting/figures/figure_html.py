"""Interactive figures by plotly, as self-contained HTML."""

from __future__ import annotations

import re
from html import escape

import plotly.graph_objects as go
from plotly.subplots import make_subplots

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

_PANEL_HEIGHT, _SPACING, _HEAD, _FOOT = 160, 36, 140, 50  # px


def draw(chart: Chart) -> go.Figure:
    """All panels one below the other, on one distance axis."""
    heights = [panel.height for panel in chart.panels]
    height = _PANEL_HEIGHT * sum(heights) + _HEAD + _FOOT
    figure = make_subplots(
        rows=len(heights),
        shared_xaxes=True,
        vertical_spacing=_SPACING / (height - _HEAD - _FOOT),
        row_heights=heights,
        subplot_titles=[f"<b>{panel.name}</b>   {panel.description}" for panel in chart.panels],
    )
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    for row, panel in enumerate(chart.panels, start=1):
        _draw_panel(figure, panel, row)
    for start, stop in chart.gaps:
        style = {"fillcolor": COLOURS[GAP], "opacity": GAP_OPACITY, "line_width": 0}
        figure.add_vrect(start, stop, layer="below", row="all", col="all", **style)
    figure.update_xaxes(gridcolor=palette.GRID, zeroline=False, showspikes=True, spikemode="across")
    figure.update_xaxes(spikethickness=1, spikecolor="#999999", spikedash="solid")
    figure.update_yaxes(gridcolor=palette.GRID, zerolinecolor="#AAAAAA", zerolinewidth=1)
    figure.update_xaxes(title_text="distance in m", row=len(heights))
    figure.update_layout(
        title={"text": f"<b>{chart.title}</b>", "subtitle": {"text": chart.note}},
        title_x=0,
        title_xref="paper",
        title_y=1 - 30 / height,
        legend={"orientation": "h", "yref": "container", "y": 1 - 76 / height, "yanchor": "top"},
        height=height,
        margin={"l": 80, "r": 24, "t": _HEAD, "b": _FOOT},
        template="plotly_white",
        font={"family": "system-ui, Helvetica, Arial, sans-serif", "color": palette.INK},
        hovermode="x",
    )
    return figure


def html(figure: go.Figure) -> str:
    """The figure as one HTML text that contains the plotting library."""
    title = re.sub("<.*?>", "", str(figure["layout"]["title"]["text"] or "Track profile"))
    document = figure.to_html(
        include_plotlyjs=True, config={"displaylogo": False, "responsive": True}
    )
    return document.replace("<head>", f"<head><title>{escape(title)}</title>", 1)


def _draw_panel(figure: go.Figure, panel: ChartPanel, row: int) -> None:
    traces = []
    if panel.interval:
        x, y = panel.interval.outline()
        style = {"line_width": 0, "fill": "toself", "fillcolor": COLOURS[INTERVAL]}
        style |= {"opacity": INTERVAL_OPACITY, "hoverinfo": "skip"}
        traces.append(go.Scatter(x=x, y=y, name=INTERVAL, **style))
    for line in panel.lines:
        style = {"line_color": line.colour, "line_width": line.width}
        style |= {"hovertemplate": f"%{{y:.4g}} {panel.unit}"}
        traces.append(go.Scatter(x=line.x, y=line.y, name=line.name, **style))
    in_legend = {trace.name for trace in figure.data}
    for trace in traces:
        trace.update(mode="lines", legendgroup=trace.name, showlegend=trace.name not in in_legend)
    figure.add_traces(traces, rows=row, cols=1)
    figure.update_yaxes(title_text=panel.unit, row=row)

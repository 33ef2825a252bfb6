"""The sections as one self-contained HTML report, and as CSV files."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape

from trackprofile.errors import importing_extra
from trackprofile.reproduction.parts import Cell, FigurePanel, PageSection, Table

with importing_extra("plot", "The report of the reproduction"):
    import plotly.graph_objects as go
    from plotly.io import to_html
    from plotly.offline import get_plotlyjs

STYLE = """
body { font: 16px/1.5 system-ui, Helvetica, Arial, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.5rem; border-top: 1px solid #ccc; padding-top: 1rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: 0.9rem; margin: 1rem 0; }
th, td { padding: 0.2rem 0.7rem; border-bottom: 1px solid #ddd; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; } nav a { margin-right: 0.8rem; }
"""
PANEL = 340  # px


def html(title: str, introduction: Sequence[str], sections: Sequence[PageSection]) -> str:
    """The HTML report as text, with the plotting library embedded."""
    links = "".join(f'<a href="#{one.key}">{escape(_named(one.key))}</a> ' for one in sections)
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE}</style><script>{get_plotlyjs()}</script></head><body><h1>{escape(title)}</h1>"
        f"{_paragraphs(introduction)}<nav>{links}</nav>{''.join(map(_section, sections))}</body></html>"
    )


def files(section: PageSection) -> dict[str, str]:
    """The CSV files of a section: text by file name."""
    texts = {}
    if section.table:
        texts[f"{section.key}.csv"] = _csv(section.table.heads, section.table.rows)
    for number, panel in enumerate(section.panels, start=1):
        letter = f"-{chr(96 + number)}" if len(section.panels) > 1 else ""
        name = f"{section.key}-lines{letter}.csv"
        rows = [
            (line, float(x), float(y))
            for line, (xs, ys) in panel.lines.items()
            for x, y in zip(xs, ys, strict=True)
        ]
        texts[name] = _csv(("line", panel.x, panel.y), rows)
    return texts


def _named(key: str) -> str:
    return key.replace("-", " ").capitalize()


def _section(section: PageSection) -> str:
    head = f'<h2 id="{section.key}">{escape(section.title)}</h2>'
    table = _table(section.table) if section.table else ""
    return head + _paragraphs(section.text) + table + "".join(map(_figure, section.panels))


def _paragraphs(text: Sequence[str]) -> str:
    return "".join(f"<p>{escape(one)}</p>" for one in text)


def _table(table: Table) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.heads)
    rows = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in table.rows)
    return f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>'


def _cell(cell: Cell) -> str:
    if cell is None:
        return '<td class="number">–</td>'
    if isinstance(cell, str):
        return f"<td>{escape(cell)}</td>"
    return f'<td class="number">{cell:.4g}</td>'


def _figure(panel: FigurePanel) -> str:
    figure = go.Figure(
        [go.Scatter(x=x, y=y, name=name, mode="lines") for name, (x, y) in panel.lines.items()]
    )
    kinds = {axis: "log" if axis in panel.logarithmic else "linear" for axis in "xy"}
    figure.update_xaxes(title_text=panel.x, type=kinds["x"])
    figure.update_yaxes(title_text=panel.y, type=kinds["y"], exponentformat="power")
    figure.update_layout(
        height=PANEL,
        template="plotly_white",
        margin={"l": 80, "r": 20, "t": 10, "b": 50},
        showlegend=True,
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
    )
    return to_html(
        figure,
        full_html=False,
        include_plotlyjs=False,
        config={"displayModeBar": False, "responsive": True},
    )


def _csv(heads: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()

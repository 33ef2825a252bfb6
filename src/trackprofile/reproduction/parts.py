"""Parts of the reproduction report: sections with text, a table, and figure panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """A table; units are in the heads or in a column of their own."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class FigurePanel:
    """Lines over common axes.

    Parameters
    ----------
    x, y : titles of the axes, with units
    lines : x and y of each line, by name
    logarithmic : logarithmic axes, any of "x" and "y"
    """

    x: str
    y: str
    lines: Mapping[str, tuple[Array, Array]]
    logarithmic: str = ""


@dataclass(frozen=True)
class PageSection:
    """A section on one table or figure of the paper, with our values for comparison.

    Parameters
    ----------
    key : file name of its data, such as figure-10
    text : paragraphs, without markup
    """

    key: str
    title: str
    text: tuple[str, ...]
    table: Table | None = None
    panels: tuple[FigurePanel, ...] = ()


def ratio(ours: float, paper: float) -> float:
    """Our value over the paper's value."""
    return ours / paper


def comparison_table(rows: Sequence[tuple[str, str, float, float]]) -> Table:
    """A table of rows (quantity, unit, paper, ours) with their ratio."""
    return Table(
        ("what", "unit", "paper", "ours", "ratio"),
        tuple((what, unit, paper, ours, ratio(ours, paper)) for what, unit, paper, ours in rows),
    )

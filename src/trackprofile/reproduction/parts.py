"""What the reproduction consists of: sections with text, a table, and panels of lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """Rows under heads; units stand in the heads, or in a column of their own."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class FigurePanel:
    """Lines over a common axis.

    Parameters
    ----------
    x, y : what the axes show, with units
    lines : x and y of each, by name
    logarithmic : axes, any of "x" and "y"
    """

    x: str
    y: str
    lines: Mapping[str, tuple[Array, Array]]
    logarithmic: str = ""


@dataclass(frozen=True)
class PageSection:
    """A table or figure of the paper, and ours beside it.

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
    """Ours to the paper's."""
    return ours / paper


def comparison_table(rows: Sequence[tuple[str, str, float, float]]) -> Table:
    """Rows of (what, unit, the paper's, ours) with their ratio."""
    return Table(
        ("what", "unit", "paper", "ours", "ratio"),
        tuple((what, unit, paper, ours, ratio(ours, paper)) for what, unit, paper, ours in rows),
    )

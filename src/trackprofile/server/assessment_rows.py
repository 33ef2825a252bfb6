"""Rows of the assessment tables as the server needs them: counted, ordered, grouped along the line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from trackprofile.assessment.limits import Action
from trackprofile.assessment.limits_toml import limit_presets, read_limits
from trackprofile.server.responses import (
    ActionRequirement,
    DefectInfo,
    Schematic,
    SchematicBin,
    SectionInfo,
    Sections,
)
from trackprofile.store import Entry, Store, read_table_rows

Array = NDArray[np.float64]

POSSIBLE = "possible"
"""Name of defects whose limits are exceeded with a probability below 50 %."""

ACTIONS = {action.text: action for action in Action}
_MILLI = 1e3
_GRADES = {"": 0, **{name: int(action) for name, action in ACTIONS.items()}}

_COLUMNS = (
    "entry",
    "band",
    "start_m",
    "peak_m",
    "end_m",
    "height_mm",
    "standard_deviation_mm",
    "required_action",
    "required_action_text",
)
_ACTION_COLUMNS = tuple(
    f"{quantity}_{action.name.lower()}{unit}"
    for action in Action
    for quantity, unit in (("limit", "_mm"), ("probability", ""))
)  # fmt: skip
_LIMIT_COLUMNS = _ACTION_COLUMNS[::2]


def defect_rows(
    store: Store,
    entries: Sequence[Entry],
    start: float | None = None,
    end: float | None = None,
    columns: Sequence[str] = (*_COLUMNS, *_ACTION_COLUMNS),
) -> pa.Table:
    """Isolated defects of some passes that touch a stretch [m]."""
    parts = [read_table_rows(store, one, "defects", start, end, columns) for one in entries]
    return pa.concat_tables(parts, promote_options="default")


def grades(rows: pa.Table) -> NDArray[np.int64]:
    """Grade of the action that each defect requires: 0 is possible only, 3 is the most severe."""
    return np.array(
        [_GRADES.get(one or "", 0) for one in _texts(rows, "required_action")], np.int64
    )


def lowest_limits(rows: pa.Table) -> Array:
    """Lowest limit of each defect, (n,) [mm]."""
    heights = [_floats(rows, f"limit_{action.name.lower()}_mm") for action in Action]
    return np.fmin.reduce(heights)


def select_defects(
    rows: pa.Table, band: str | None, minimum_action: str | None, order: str
) -> tuple[pa.Table, NDArray[np.int64]]:
    """Rows that pass the filters, in order of ``severity`` or ``distance``, and their grades."""
    grade = grades(rows)
    selected = grade >= _GRADES[minimum_action or ""]
    if band is not None:
        selected &= _texts(rows, "band") == band
    if order == "distance":
        keys: tuple[Array, ...] = (_floats(rows, "peak_m"),)
    else:
        excess = np.abs(_floats(rows, "height_mm")) / lowest_limits(rows)
        keys = (_floats(rows, "peak_m"), -np.nan_to_num(excess), -grade.astype(np.float64))
    ordered = np.lexsort(keys)
    kept = ordered[selected[ordered]]
    return rows.take(pa.array(kept)), grade[kept]


def counts(grade: NDArray[np.int64]) -> dict[str, int]:
    """Number of defects by required action."""
    names = (POSSIBLE, *ACTIONS)
    numbers = np.bincount(grade, minlength=len(names))
    return {name: int(count) for name, count in zip(names, numbers, strict=True) if count}


def defect_list(rows: pa.Table) -> list[DefectInfo]:
    """Rows as an answer holds them."""
    return [
        DefectInfo(
            **{name: one[name] for name in _COLUMNS[:7]},
            required_action=one["required_action"] or "",
            probabilities=_by_action(one, "probability_{}"),
            limits_mm=_by_action(one, "limit_{}_mm"),
        )
        for one in rows.to_pylist()
    ]


def requirements(rows: pa.Table) -> list[ActionRequirement]:
    """What the actions in some rows require, the most severe first."""
    texts: dict[str, str] = {}
    for action, text in zip(
        _texts(rows, "required_action"), _texts(rows, "required_action_text"), strict=True
    ):
        if action and text:
            texts.setdefault(action, text)
    ordered = sorted(texts, key=lambda action: -_GRADES.get(action, 0))
    return [ActionRequirement(action=one, requirement=texts[one]) for one in ordered]


def schematic_response(
    store: Store, entries: Sequence[Entry], whole: tuple[float, float], bins: int
) -> Schematic:
    """All defects of some passes, grouped by bin of the line and required action."""
    rows = defect_rows(
        store, entries, columns=("peak_m", "height_mm", "required_action", *_LIMIT_COLUMNS)
    )
    size = (whole[1] - whole[0]) / bins
    peak, grade = _floats(rows, "peak_m"), grades(rows)
    number = np.clip(((peak - whole[0]) / size).astype(np.int64), 0, bins - 1)
    excess = np.nan_to_num(np.abs(_floats(rows, "height_mm")) / lowest_limits(rows))
    names = ("", *ACTIONS)
    key = number * len(names) + grade
    ordered = np.lexsort((-excess, key))
    groups, first, count = np.unique(key[ordered], return_index=True, return_counts=True)
    return Schematic(
        start_m=whole[0],
        end_m=whole[1],
        bin_m=size,
        bins=[
            SchematicBin(
                start_m=whole[0] + size * int(group // len(names)),
                end_m=whole[0] + size * (int(group // len(names)) + 1),
                required_action=names[int(group % len(names))],
                defects=int(defects),
                peak_m=float(peak[ordered[worst]]),
            )
            for group, worst, defects in zip(groups, first, count, strict=True)
        ],
    )


def section_columns(
    store: Store, entries: Sequence[Entry], band: str, start: float | None, end: float | None
) -> tuple[float, dict[str, Any]]:
    """Length of the longest sections of a band [m], and the columns of these sections, ordered by their start."""
    names = ("band", "length_m", "standard_deviation_mm", "low_mm", "high_mm", "quality_class")
    rows = pa.concat_tables(
        [read_table_rows(store, one, "sections", start, end, names) for one in entries]
    )
    rows = rows.filter(pa.array(_texts(rows, "band") == band, pa.bool_()))
    length = max((round(one) for one in _floats(rows, "length_m")), default=0)
    kept = np.abs(_floats(rows, "length_m") - length) < 1.0
    order = np.argsort(_floats(rows, "start_m")[kept], kind="stable")
    rows = rows.filter(pa.array(kept)).take(pa.array(order))
    columns: dict[str, Any] = {
        name: _floats(rows, name)
        for name in ("start_m", "end_m", "standard_deviation_mm", "low_mm", "high_mm")
    }
    columns["quality_class"] = [one or "" for one in _texts(rows, "quality_class")]
    return float(length), columns


def sections_response(
    band: str, length: float, columns: Mapping[str, Any], max_sections: int
) -> Sections:
    """Sections as an answer holds them: the worst of each group where there are more than ``max_sections``."""
    start, deviation = columns["start_m"], columns["standard_deviation_mm"]
    number = np.floor(start / length + 0.5).astype(np.int64) if length else np.zeros(0, np.int64)
    span = int(number[-1] - number[0]) + 1 if number.size else 0
    group_size = max(1, -(-span // max_sections))
    group = number // group_size
    order = np.lexsort((-deviation, group))
    _, first = np.unique(group[order], return_index=True)
    worst = order[first]
    begins = np.searchsorted(group, group[worst])
    starts = start[begins]
    ends = np.maximum.reduceat(columns["end_m"], begins) if begins.size else starts
    return Sections(
        band=band,
        length_m=length,
        group_size=group_size,
        sections=[
            SectionInfo(
                start_m=float(begin),
                end_m=float(stop),
                standard_deviation_mm=round(float(deviation[row]), 4),
                low_mm=round(float(columns["low_mm"][row]), 4),
                high_mm=round(float(columns["high_mm"][row]), 4),
                quality_class=columns["quality_class"][row],
            )
            for row, begin, stop in zip(worst, starts, ends, strict=True)
        ],
    )


def limit_heights(store: Store, entry: Entry, band: str) -> dict[Action, float]:
    """Limits by which a pass was assessed in a band [m]: those of its defects, else those of the preset it names."""
    rows = defect_rows(store, [entry], columns=("band", *_LIMIT_COLUMNS))
    rows = rows.filter(pa.array(_texts(rows, "band") == band, pa.bool_()))
    if rows.num_rows:
        heights = {one: _floats(rows, f"limit_{one.name.lower()}_mm")[0] / _MILLI for one in Action}
        return {action: float(height) for action, height in heights.items() if np.isfinite(height)}
    for preset in map(read_limits, limit_presets()):
        if entry.origin.limits == preset.name and entry.origin.speed > 0:
            limits = preset.defects_at(band, entry.origin.speed)
            return dict(limits.heights) if limits else {}
    return {}


def _texts(rows: pa.Table, name: str) -> NDArray[np.object_]:
    return rows[name].to_numpy(zero_copy_only=False)


def _floats(rows: pa.Table, name: str) -> Array:
    if name not in rows.column_names:
        return np.full(rows.num_rows, np.nan)
    return rows[name].to_numpy().astype(np.float64)


def _by_action(row: Mapping[str, Any], pattern: str) -> dict[str, float]:
    values = {name: row.get(pattern.format(one.name.lower())) for name, one in ACTIONS.items()}
    return {name: float(value) for name, value in values.items() if value is not None}

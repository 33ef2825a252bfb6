"""Rows of the assessment's tables, as the server needs them: counted, ordered, gathered along the line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from trackprofile.assessment.limits import Action
from trackprofile.assessment.limits_toml import limit_presets, read_limits
from trackprofile.server import responses as models
from trackprofile.store import Entry, Store, rows_of

Array = NDArray[np.float64]

POSSIBLE = "possible"
"""What a place is called whose limits are exceeded with less than 50 %."""

ACTIONS = {action.words: action for action in Action}
_MILLI = 1e3
_GRADES = {"": 0, **{words: int(action) for words, action in ACTIONS.items()}}

_COLUMNS = (
    "entry",
    "band",
    "start_m",
    "peak_m",
    "end_m",
    "height_mm",
    "standard_deviation_mm",
    "likely",
    "obliges_to",
)
_OF_ACTION = tuple(
    f"{what}_{action.name.lower()}{unit}"
    for action in Action
    for what, unit in (("limit", "_mm"), ("probability", ""))
)  # fmt: skip


def defect_rows(
    store: Store,
    entries: Sequence[Entry],
    start: float | None = None,
    end: float | None = None,
    columns: Sequence[str] = (*_COLUMNS, *_OF_ACTION),
) -> pa.Table:
    """Isolated defects of some passes that touch a stretch."""
    parts = [rows_of(store, one, "defects", start, end, columns) for one in entries]
    return pa.concat_tables(parts, promote_options="default")


def grades(rows: pa.Table) -> NDArray[np.int64]:
    """What each defect calls for: 0 is possible, 3 is the gravest."""
    return np.array([_GRADES.get(one or "", 0) for one in _words(rows, "likely")], np.int64)


def lowest_limit(rows: pa.Table) -> Array:
    """Of each defect [mm]."""
    heights = [_floats(rows, f"limit_{action.name.lower()}_mm") for action in Action]
    return np.fmin.reduce(heights)


def chosen(
    rows: pa.Table, band: str | None, least: str | None, order: str
) -> tuple[pa.Table, NDArray[np.int64]]:
    """The rows that filters let through, in order, and their grades."""
    found = grades(rows)
    through = found >= _GRADES[least or ""]
    if band is not None:
        through &= _words(rows, "band") == band
    if order == "along":
        keys: tuple[Array, ...] = (_floats(rows, "peak_m"),)
    else:
        beyond = np.abs(_floats(rows, "height_mm")) / lowest_limit(rows)
        keys = (_floats(rows, "peak_m"), -np.nan_to_num(beyond), -found.astype(np.float64))
    ordered = np.lexsort(keys)
    kept = ordered[through[ordered]]
    return rows.take(pa.array(kept)), found[kept]


def counts(found: NDArray[np.int64]) -> dict[str, int]:
    """Of each grade, by its words."""
    names = (POSSIBLE, *ACTIONS)
    counted = np.bincount(found, minlength=len(names))
    return {name: int(count) for name, count in zip(names, counted, strict=True) if count}


def defect_models(rows: pa.Table) -> list[models.DefectInfo]:
    """Rows as they are answered."""
    return [
        models.DefectInfo(
            **{name: one[name] for name in _COLUMNS[:7]},
            calls_for=one["likely"] or "",
            probabilities=_of_action(one, "probability_{}"),
            limits_mm=_of_action(one, "limit_{}_mm"),
        )
        for one in rows.to_pylist()
    ]


def duties(rows: pa.Table) -> list[models.Duty]:
    """What the actions oblige to, as far as rows say it, the gravest first."""
    said: dict[str, str] = {}
    for action, words in zip(_words(rows, "likely"), _words(rows, "obliges_to"), strict=True):
        if action and words:
            said.setdefault(action, words)
    ordered = sorted(said, key=lambda one: -_GRADES.get(one, 0))
    return [models.Duty(action=one, obliges_to=said[one]) for one in ordered]


def schematic(
    store: Store, entries: Sequence[Entry], whole: tuple[float, float], bins: int
) -> models.Schematic:
    """All defects of some passes, gathered into bins of the whole line by what they call for."""
    rows = defect_rows(store, entries, columns=("peak_m", "height_mm", "likely", *_OF_ACTION[::2]))
    size = (whole[1] - whole[0]) / bins
    peak, grade = _floats(rows, "peak_m"), grades(rows)
    number = np.clip(((peak - whole[0]) / size).astype(np.int64), 0, bins - 1)
    beyond = np.nan_to_num(np.abs(_floats(rows, "height_mm")) / lowest_limit(rows))
    key = number * 4 + grade
    ordered = np.lexsort((-beyond, key))
    groups, first, count = np.unique(key[ordered], return_index=True, return_counts=True)
    names = ("", *ACTIONS)
    return models.Schematic(
        start_m=whole[0],
        end_m=whole[1],
        bin_m=size,
        bins=[
            models.SchematicMark(
                start_m=whole[0] + size * int(group // 4),
                end_m=whole[0] + size * (int(group // 4) + 1),
                calls_for=names[int(group % 4)],
                places=int(many),
                peak_m=float(peak[ordered[place]]),
            )
            for group, place, many in zip(groups, first, count, strict=True)
        ],
    )


def section_columns(
    store: Store, entries: Sequence[Entry], band: str, start: float | None, end: float | None
) -> tuple[float, dict[str, Any]]:
    """Length of the longest sections of a band [m], and these sections by where they start."""
    names = ("band", "length_m", "standard_deviation_mm", "low_mm", "high_mm", "quality_class")
    rows = pa.concat_tables([rows_of(store, one, "sections", start, end, names) for one in entries])
    rows = rows.filter(pa.array(_words(rows, "band") == band, pa.bool_()))
    length = max((round(one) for one in _floats(rows, "length_m")), default=0)
    kept = np.abs(_floats(rows, "length_m") - length) < 1.0
    order = np.argsort(_floats(rows, "start_m")[kept], kind="stable")
    rows = rows.filter(pa.array(kept)).take(pa.array(order))
    columns: dict[str, Any] = {
        name: _floats(rows, name)
        for name in ("start_m", "end_m", "standard_deviation_mm", "low_mm", "high_mm")
    }
    columns["quality_class"] = [one or "" for one in _words(rows, "quality_class")]
    return float(length), columns


def sections(band: str, length: float, columns: Mapping[str, Any], most: int) -> models.Sections:
    """Sections as they are answered: of each group of some the worst, where there would be more than `most`."""
    start, deviation = columns["start_m"], columns["standard_deviation_mm"]
    number = np.floor(start / length + 0.5).astype(np.int64) if length else np.zeros(0, np.int64)
    span = int(number[-1] - number[0]) + 1 if number.size else 0
    grouped = max(1, -(-span // most))
    group = number // grouped
    order = np.lexsort((-deviation, group))
    _, first = np.unique(group[order], return_index=True)
    worst = order[first]
    begins = np.searchsorted(group, group[worst])
    starts = start[begins]
    ends = np.maximum.reduceat(columns["end_m"], begins) if begins.size else starts
    return models.Sections(
        band=band,
        length_m=length,
        grouped=grouped,
        sections=[
            models.SectionInfo(
                start_m=float(begin),
                end_m=float(stop),
                standard_deviation_mm=round(float(deviation[place]), 4),
                low_mm=round(float(columns["low_mm"][place]), 4),
                high_mm=round(float(columns["high_mm"][place]), 4),
                quality_class=columns["quality_class"][place],
            )
            for place, begin, stop in zip(worst, starts, ends, strict=True)
        ],
    )


def heights(store: Store, entry: Entry, band: str) -> dict[Action, float]:
    """The limits that a pass was judged by in a band [m]: as its defects state them, or those built in by that name."""
    rows = defect_rows(store, [entry], columns=("band", *_OF_ACTION[::2]))
    rows = rows.filter(pa.array(_words(rows, "band") == band, pa.bool_()))
    if rows.num_rows:
        found = {one: _floats(rows, f"limit_{one.name.lower()}_mm")[0] / _MILLI for one in Action}
        return {action: float(height) for action, height in found.items() if np.isfinite(height)}
    for built_in in map(read_limits, limit_presets()):
        if entry.origin.limits == built_in.name and entry.origin.speed > 0:
            limits = built_in.defects_at(band, entry.origin.speed)
            return dict(limits.heights) if limits else {}
    return {}


def _words(rows: pa.Table, name: str) -> NDArray[np.object_]:
    return rows[name].to_numpy(zero_copy_only=False)


def _floats(rows: pa.Table, name: str) -> Array:
    if name not in rows.column_names:
        return np.full(rows.num_rows, np.nan)
    return rows[name].to_numpy().astype(np.float64)


def _of_action(row: Mapping[str, Any], pattern: str) -> dict[str, float]:
    found = {words: row.get(pattern.format(one.name.lower())) for words, one in ACTIONS.items()}
    return {words: float(value) for words, value in found.items() if value is not None}

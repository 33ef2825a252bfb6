"""Results as tables of plain columns, with the unit in the name of each column, for files and reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.limits import Action
from trackprofile.assessment.sections import Section
from trackprofile.assessment.trend import Trend
from trackprofile.contracts import Rail
from trackprofile.positioning.chainage import ChainageTable

Table = dict[str, list[Any]]
"""Columns of equal length, by name."""

ASSESSMENT_TABLES = ("defects", "sections", "not_assessed", "spectra")
"""Names of the tables of an assessment."""

TREND_TABLES = ("changes", "repeatability")
"""Names of the tables of a trend."""

_MILLI = 1e3


def tables(assessment: Assessment, chainage: ChainageTable) -> dict[str, Table]:
    """All tables of an assessment, by name, see `ASSESSMENT_TABLES`.

    Examples
    --------
    >>> from trackprofile.assessment.assess import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits import DefectLimits, Limits
    >>> distance = np.arange(0.0, 400.0, 0.25)
    >>> dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    >>> rule = DefectLimits("D1", 0.0, 50.0, "ours", True, {Action.ALERT: 0.01})
    >>> result = assess(build_profile(distance, dip, kind="truth"), Limits("ours", (rule,)), 40.0)
    >>> defects = tables(result, ChainageTable())["defects"]
    >>> defects["peak_kilometre"], defects["exceeded"]
    ([0.2], ['alert'])
    """
    return {
        "defects": defect_table(assessment.defects, assessment, chainage),
        "sections": section_table(assessment.sections, chainage),
        "not_assessed": _columns(
            [
                {
                    "band": one.band,
                    "start_m": one.start,
                    "end_m": one.end,
                    "start_kilometre": _kilometre(chainage, one.start),
                    "end_kilometre": _kilometre(chainage, one.end),
                    "reasons": one.reasons.text,
                }
                for one in assessment.not_assessed
            ],
            ("band", "start_m", "end_m", "start_kilometre", "end_kilometre", "reasons"),
        ),
        "spectra": _columns(
            [
                {
                    "start_m": one.start,
                    "end_m": one.end,
                    "nearest_spectrum": one.spectrum,
                    "difference_dB": one.difference_db,
                    "level_dB": one.level_db,
                }
                for one in assessment.spectra
            ],
            ("start_m", "end_m", "nearest_spectrum", "difference_dB", "level_dB"),
        ),
    }


def defect_table(
    defects: Sequence[Defect], assessment: Assessment, chainage: ChainageTable
) -> Table:
    """Table of isolated defects, in the given order."""
    rows = []
    for one in defects:
        north, east = chainage.coordinates(one.peak)
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "peak_m": one.peak,
            "end_m": one.end,
            "length_m": one.length,
            "peak_kilometre": _kilometre(chainage, one.peak),
            "latitude_deg": _number(north),
            "longitude_deg": _number(east),
            "location_deviation_m": one.location_deviation,
            "height_mm": _MILLI * one.height,
            "standard_deviation_mm": _MILLI * one.deviation,
            "exceeded": action_text(one.exceeded),
            "required_action": action_text(one.required_action),
        }
        for action in Action:
            name = action.name.lower()
            height = one.limits.heights.get(action)
            row[f"limit_{name}_mm"] = None if height is None else _MILLI * height
            row[f"probability_{name}"] = one.probabilities.get(action)
        rows.append(
            row
            | {
                "required_action_text": required_action_text(one, assessment),
                "limits_verified": one.limits.verified,
            }
        )
    names = ["band", "start_m", "peak_m", "end_m", "length_m", "peak_kilometre", "latitude_deg"]
    names += ["longitude_deg", "location_deviation_m", "height_mm", "standard_deviation_mm"]
    names += ["exceeded", "required_action"]
    for action in Action:
        names += [f"limit_{action.name.lower()}_mm", f"probability_{action.name.lower()}"]
    return _columns(rows, [*names, "required_action_text", "limits_verified"])


def section_table(sections: Sequence[Section], chainage: ChainageTable) -> Table:
    """Table of standard deviations and quality classes per section, in the given order."""
    classes = list(dict.fromkeys(name for one in sections for name in one.probabilities))
    rows = []
    for one in sections:
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "end_m": one.end,
            "length_m": one.length,
            "start_kilometre": _kilometre(chainage, one.start),
            "end_kilometre": _kilometre(chainage, one.end),
            "assessed_share": one.assessed_share,
            "standard_deviation_mm": _MILLI * one.standard_deviation,
            "low_mm": _MILLI * one.low,
            "high_mm": _MILLI * one.high,
            "estimate_standard_deviation_mm": _MILLI * one.estimate_standard_deviation,
            "quality_class": one.quality_class,
        }
        row |= {f"probability_{name}": one.probabilities.get(name) for name in classes}
        rows.append(
            row | {"classes_verified": None if one.classes is None else one.classes.verified}
        )
    names = ["band", "start_m", "end_m", "length_m", "start_kilometre", "end_kilometre"]
    names += [
        "assessed_share",
        "standard_deviation_mm",
        "low_mm",
        "high_mm",
        "estimate_standard_deviation_mm",
    ]
    names += ["quality_class", *(f"probability_{name}" for name in classes), "classes_verified"]
    return _columns(rows, names)


def required_action_text(defect: Defect, assessment: Assessment) -> str:
    """What a defect requires, in the words of the limit set; empty if it requires nothing."""
    action, texts = defect.required_action, assessment.limits.action_texts
    if action is None or texts is None:
        return ""
    return texts.texts.get(action, "")


def action_text(action: Action | None) -> str:
    """Name of an action; empty for none."""
    return "" if action is None else action.text


def tables_per_rail(
    assessments: Mapping[Rail, Assessment], chainage: ChainageTable
) -> dict[str, Table]:
    """The tables of several rails, concatenated, with ``rail`` as the first column."""
    per_rail = {rail: tables(one, chainage) for rail, one in assessments.items()}
    joined: dict[str, Table] = {}
    for name in next(iter(per_rail.values())):
        heads = dict.fromkeys(head for one in per_rail.values() for head in one[name])
        columns: Table = {"rail": [], **{head: [] for head in heads}}
        for rail, one in per_rail.items():
            count = len(next(iter(one[name].values())))
            columns["rail"] += count * [rail.value]
            for head in heads:
                columns[head] += one[name].get(head, count * [None])
        joined[name] = columns
    return joined


def geojson_per_rail(
    assessments: Mapping[Rail, Assessment], chainage: ChainageTable
) -> dict[str, Any]:
    """The defects of several rails as points of a map, with the rail as a property."""
    features = []
    for rail, one in assessments.items():
        for feature in geojson(one, chainage)["features"]:
            properties = {"rail": rail.value, **feature["properties"]}
            features.append(feature | {"properties": properties})
    return {"type": "FeatureCollection", "features": features}


def geojson(assessment: Assessment, chainage: ChainageTable) -> dict[str, Any]:
    """The defects with known coordinates as points of a map (RFC 7946).

    Examples
    --------
    See `docs/assessment.md`.
    """
    table = defect_table(assessment.defects, assessment, chainage)
    features = []
    for i, (north, east) in enumerate(
        zip(table["latitude_deg"], table["longitude_deg"], strict=True)
    ):
        if north is None or east is None:
            continue
        properties = {name: column[i] for name, column in table.items()}
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": [round(east, 7), round(north, 7)]},
                "properties": properties,
            }
        )
    return {"type": "FeatureCollection", "features": features}


def _columns(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Table:
    return {name: [row[name] for row in rows] for name in names}


def _kilometre(chainage: ChainageTable, distance: float) -> float:
    return round(float(chainage.kilometres(distance)), 4)


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def change_table(trend: Trend, chainage: ChainageTable) -> Table:
    """Table of locations that changed between passes."""
    rows = []
    for one in trend.changed_locations:
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "peak_m": one.peak,
            "end_m": one.end,
            "peak_kilometre": _kilometre(chainage, one.peak),
            "change_mm": _MILLI * one.change,
            "standard_deviation_mm": _MILLI * one.deviation,
            "level_mm": _MILLI * one.level,
            "per_day_mm": None if one.per_day is None else _MILLI * one.per_day,
            "per_day_standard_deviation_mm": None
            if one.per_day_deviation is None
            else _MILLI * one.per_day_deviation,
        }
        dates = {each.action: each for each in one.limit_crossings}
        for action in Action:
            each = dates.get(action)
            for name in ("earliest", "median", "latest"):
                day = getattr(each, name) if each else None
                row[f"{action.name.lower()}_{name}"] = None if day is None else day.isoformat()
        rows.append(row)
    names = ["band", "start_m", "peak_m", "end_m", "peak_kilometre", "change_mm"]
    names += ["standard_deviation_mm", "level_mm", "per_day_mm", "per_day_standard_deviation_mm"]
    names += [
        f"{action.name.lower()}_{name}"
        for action in Action
        for name in ("earliest", "median", "latest")
    ]
    return _columns(rows, names)


def repeatability_table(trend: Trend) -> Table:
    """Table of repeatability and reproducibility per band."""
    rows = [
        {
            "band": one.band,
            "kind": "repeatability" if one.same_vehicle else "reproducibility",
            "difference_95_mm": _MILLI * one.difference,
            "maximum_mm": None if one.limit is None else _MILLI * one.limit,
            "pairs": one.pairs,
            "limit_verified": None if one.required is None else one.required.verified,
        }
        for one in trend.repeatabilities
    ]
    names = ["band", "kind", "difference_95_mm", "maximum_mm", "pairs", "limit_verified"]
    return _columns(rows, names)

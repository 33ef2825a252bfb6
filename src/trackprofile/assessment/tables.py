"""Results as tables of plain columns, each with its unit in its name, for files and pages."""

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


def tables(found: Assessment, way: ChainageTable) -> dict[str, Table]:
    """All tables of an assessment, by name: ``defects``, ``sections``, ``not_assessed``, ``spectra``.

    Examples
    --------
    >>> from trackprofile.assessment.assess import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits import DefectLimits, Limits
    >>> distance = np.arange(0.0, 400.0, 0.25)
    >>> dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    >>> rule = DefectLimits("D1", 0.0, 50.0, "ours", True, {Action.ALERT: 0.01})
    >>> found = assess(build_profile(distance, dip, kind="truth"), Limits("ours", (rule,)), 40.0)
    >>> made = tables(found, Way())
    >>> made["defects"]["peak_kilometre"], made["defects"]["exceeded"]
    ([0.2], ['alert'])
    """
    return {
        "defects": defect_table(found.defects, found, way),
        "sections": section_table(found.sections, found, way),
        "not_assessed": _columns(
            [
                {
                    "band": one.band,
                    "start_m": one.start,
                    "end_m": one.end,
                    "start_kilometre": _kilometre(way, one.start),
                    "end_kilometre": _kilometre(way, one.end),
                    "reasons": one.reasons.words,
                }
                for one in found.not_assessed
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
                for one in found.spectra
            ],
            ("start_m", "end_m", "nearest_spectrum", "difference_dB", "level_dB"),
        ),
    }


def defect_table(defects: Sequence[Defect], found: Assessment, way: ChainageTable) -> Table:
    """Of isolated defects, in the order given."""
    rows = []
    for one in defects:
        north, east = way.coordinates(one.peak)
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "peak_m": one.peak,
            "end_m": one.end,
            "length_m": one.length,
            "peak_kilometre": _kilometre(way, one.peak),
            "latitude_deg": _number(north),
            "longitude_deg": _number(east),
            "location_deviation_m": one.location_deviation,
            "height_mm": _MILLI * one.height,
            "standard_deviation_mm": _MILLI * one.deviation,
            "exceeded": words(one.exceeded),
            "likely": words(one.likely),
        }
        for action in Action:
            name = action.name.lower()
            height = one.limits.heights.get(action)
            row[f"limit_{name}_mm"] = None if height is None else _MILLI * height
            row[f"probability_{name}"] = one.probabilities.get(action)
        rows.append(row | {"obliges_to": duty(one, found), "limits_verified": one.limits.verified})
    names = ["band", "start_m", "peak_m", "end_m", "length_m", "peak_kilometre", "latitude_deg"]
    names += ["longitude_deg", "location_deviation_m", "height_mm", "standard_deviation_mm"]
    names += ["exceeded", "likely"]
    for action in Action:
        names += [f"limit_{action.name.lower()}_mm", f"probability_{action.name.lower()}"]
    return _columns(rows, [*names, "obliges_to", "limits_verified"])


def section_table(sections: Sequence[Section], found: Assessment, way: ChainageTable) -> Table:
    """Of standard deviations per section, in the order given."""
    classes = list(dict.fromkeys(name for one in sections for name in one.probabilities))
    rows = []
    for one in sections:
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "end_m": one.end,
            "length_m": one.length,
            "start_kilometre": _kilometre(way, one.start),
            "end_kilometre": _kilometre(way, one.end),
            "assessed_share": one.assessed_share,
            "standard_deviation_mm": _MILLI * one.standard_deviation,
            "low_mm": _MILLI * one.low,
            "high_mm": _MILLI * one.high,
            "of_estimate_mm": _MILLI * one.of_estimate,
            "quality_class": one.quality_class,
        }
        row |= {f"probability_{name}": one.probabilities.get(name) for name in classes}
        rows.append(
            row | {"classes_verified": None if one.classes is None else one.classes.verified}
        )
    names = ["band", "start_m", "end_m", "length_m", "start_kilometre", "end_kilometre"]
    names += ["assessed_share", "standard_deviation_mm", "low_mm", "high_mm", "of_estimate_mm"]
    names += ["quality_class", *(f"probability_{name}" for name in classes), "classes_verified"]
    return _columns(rows, names)


def duty(defect: Defect, found: Assessment) -> str:
    """What a defect obliges to, in the words of the limits; empty if to nothing."""
    action = defect.likely
    if action is None or found.limits.duties is None:
        return ""
    return found.limits.duties.words.get(action, "")


def words(action: Action | None) -> str:
    """Of an action; empty for none."""
    return "" if action is None else action.words


def tables_per_rail(found: Mapping[Rail, Assessment], way: ChainageTable) -> dict[str, Table]:
    """The same of several rails, one below the other, with a column ``rail`` in front."""
    made = {rail: tables(one, way) for rail, one in found.items()}
    joined: dict[str, Table] = {}
    for name in next(iter(made.values())):
        heads = dict.fromkeys(head for one in made.values() for head in one[name])
        columns: Table = {"rail": [], **{head: [] for head in heads}}
        for rail, one in made.items():
            count = len(next(iter(one[name].values())))
            columns["rail"] += count * [rail.value]
            for head in heads:
                columns[head] += one[name].get(head, count * [None])
        joined[name] = columns
    return joined


def geojson_per_rail(found: Mapping[Rail, Assessment], way: ChainageTable) -> dict[str, Any]:
    """The defects of several rails as points of a map, the rail among their properties."""
    features = []
    for rail, one in found.items():
        for feature in geojson(one, way)["features"]:
            properties = {"rail": rail.value, **feature["properties"]}
            features.append(feature | {"properties": properties})
    return {"type": "FeatureCollection", "features": features}


def geojson(found: Assessment, way: ChainageTable) -> dict[str, Any]:
    """The defects as points of a map (RFC 7946), those whose place is known.

    Examples
    --------
    See `docs/assessment.md`.
    """
    table = defect_table(found.defects, found, way)
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


def _kilometre(way: ChainageTable, distance: float) -> float:
    return round(float(way.kilometres(distance)), 4)


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def change_table(found: Trend, way: ChainageTable) -> Table:
    """Of places that changed between passes."""
    rows = []
    for one in found.places:
        row: dict[str, Any] = {
            "band": one.band,
            "start_m": one.start,
            "peak_m": one.peak,
            "end_m": one.end,
            "peak_kilometre": _kilometre(way, one.peak),
            "change_mm": _MILLI * one.change,
            "standard_deviation_mm": _MILLI * one.deviation,
            "level_mm": _MILLI * one.level,
            "per_day_mm": None if one.per_day is None else _MILLI * one.per_day,
            "per_day_standard_deviation_mm": None
            if one.per_day_deviation is None
            else _MILLI * one.per_day_deviation,
        }
        dates = {each.action: each for each in one.reached}
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


def repeatability_table(found: Trend) -> Table:
    """Of how passes repeat each other, per band."""
    rows = [
        {
            "band": one.band,
            "kind": "repeatability" if one.same_vehicle else "reproducibility",
            "difference_95_mm": _MILLI * one.difference,
            "to_stay_below_mm": None if one.limit is None else _MILLI * one.limit,
            "pairs": one.pairs,
            "limit_verified": None if one.required is None else one.required.verified,
        }
        for one in found.repeatabilities
    ]
    names = ["band", "kind", "difference_95_mm", "to_stay_below_mm", "pairs", "limit_verified"]
    return _columns(rows, names)

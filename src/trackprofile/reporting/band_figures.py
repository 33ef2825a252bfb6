"""Data of the report's charts, as compact arrays that its script unpacks."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.levels import BandLevel, not_assessed
from trackprofile.assessment.tables import action_text
from trackprofile.bands import resample
from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]

UNIT = 1e-5
"""One count of a packed level [m]; 16 bits reach from -0.33 m to 0.33 m."""

UNKNOWN = -32768
"""Count of an unknown level."""

DEVIATION_STRIDE = 4
"""Points of the level for each point of its standard deviation, which changes slowly."""

CHAINAGE_STEP = 10.0
"""Distance between the points of the chainage table [m]."""

_MILLI = 1e3


def chart_data(
    assessment: Assessment, chainage: ChainageTable, compared: Assessment | None
) -> dict[str, Any]:
    """Data of all charts, ready for JSON.

    Parameters
    ----------
    assessment : of the profile
    chainage : kilometres of its distances
    compared : assessment of another profile of the same track, drawn behind the first
    """
    at = np.arange(assessment.start, assessment.end + CHAINAGE_STEP, CHAINAGE_STEP)
    return {
        "start_m": assessment.start,
        "end_m": assessment.end,
        "unit_mm": _MILLI * UNIT,
        "deviation_stride": DEVIATION_STRIDE,
        "chainage_step_m": CHAINAGE_STEP,
        "chainage_km": np.round(chainage.kilometres(at), 4).tolist(),
        "bands": [
            _band(assessment, level, compared.levels.get(name) if compared else None)
            for name, level in assessment.levels.items()
        ],
        "sections": _sections(assessment),
    }


def _band(assessment: Assessment, level: BandLevel, compared: BandLevel | None) -> dict[str, Any]:
    name = level.band.name
    limits = assessment.limits.defects_at(name, assessment.speed)
    heights: Mapping[Any, float] = limits.heights if limits else {}
    other = resample(compared.distance, compared.level, level.distance) if compared else None
    return {
        "name": name,
        "first_m": float(level.distance[0]),
        "spacing_m": level.spacing,
        "level": packed(level.level),
        "standard_deviation": packed(level.deviation[::DEVIATION_STRIDE]) if level.stated else "",
        "compared": "" if other is None else packed(other),
        "limits": [
            {"action": action_text(action), "height_mm": _MILLI * height}
            for action, height in sorted(heights.items())
        ],
        "not_assessed": [
            {"start_m": one.start, "end_m": one.end, "reasons": one.reasons.text}
            for one in not_assessed(level)
        ],
        "defects": [_defect(one) for one in assessment.defects if one.band == name],
    }


def _defect(one: Defect) -> dict[str, Any]:
    return {
        "start_m": round(one.start, 2),
        "peak_m": round(one.peak, 2),
        "end_m": round(one.end, 2),
        "height_mm": round(_MILLI * one.height, 2),
        "required_action": one.required_action.text if one.required_action else "",
    }


def _sections(assessment: Assessment) -> list[dict[str, Any]]:
    """The longest sections of the first band, which quality classes are defined for."""
    sections = [one for one in assessment.sections if one.band == next(iter(assessment.levels))]
    length = max((one.length for one in sections), default=0.0)
    return [
        {
            "start_m": one.start,
            "end_m": one.end,
            "standard_deviation_mm": round(_MILLI * one.standard_deviation, 3),
            "low_mm": round(_MILLI * one.low, 3),
            "high_mm": round(_MILLI * one.high, 3),
            "quality_class": one.quality_class,
            "class_number": one.classes.names.index(one.quality_class) if one.classes else -1,
        }
        for one in sections
        if one.length == length
    ]


def packed(values: Array) -> str:
    """Values as 16-bit counts of `UNIT`, the lower byte first, in base 64; NaN as `UNKNOWN`.

    Examples
    --------
    >>> np.frombuffer(base64.b64decode(packed(np.array([1e-3, np.nan]))), "<i2").tolist()
    [100, -32768]
    """
    counts = np.clip(np.round(np.nan_to_num(values) / UNIT), UNKNOWN + 1, -UNKNOWN - 1)
    counts[np.isnan(values)] = UNKNOWN
    return base64.b64encode(counts.astype("<i2").tobytes()).decode("ascii")

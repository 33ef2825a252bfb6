"""What the page's charts draw, as compact arrays that its script unpacks."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.levels import BandLevel, not_assessed
from trackprofile.assessment.tables import words
from trackprofile.bands import resample
from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]

STEP = 1e-5
"""m of one count: a hundredth of a millimetre, up to a third of a metre."""

UNKNOWN = -32768
"""Count of a place that nobody knows."""

EVERY = 4
"""Points of the level for one of its deviation, which changes slowly."""

POST_EVERY = 10.0
"""m between the places whose kilometrage the page knows."""


def chart_data(found: Assessment, way: ChainageTable, beside: Assessment | None) -> dict[str, Any]:
    """All of the charts, ready for JSON.

    Parameters
    ----------
    found : what is shown
    way : where its places are
    beside : another assessment of the same place, drawn below it
    """
    posts = np.arange(found.start, found.end + POST_EVERY, POST_EVERY)
    return {
        "start": found.start,
        "end": found.end,
        "step": 1e3 * STEP,
        "every": EVERY,
        "post_every": POST_EVERY,
        "kilometres": np.round(way.kilometres(posts), 4).tolist(),
        "bands": [
            _band(found, level, beside.levels.get(name) if beside else None)
            for name, level in found.levels.items()
        ],
        "sections": _sections(found),
    }


def _band(found: Assessment, level: BandLevel, beside: BandLevel | None) -> dict[str, Any]:
    name = level.band.name
    limits = found.limits.defects_at(name, found.speed)
    heights: Mapping[Any, float] = limits.heights if limits else {}
    first = float(level.distance[0])
    return {
        "name": name,
        "about": f"{level.band.shortest:g} to {level.band.longest:g} m",
        "first": first,
        "spacing": level.spacing,
        "level": packed(level.level),
        "deviation": packed(level.deviation[::EVERY]) if level.stated else "",
        "beside": packed(resample(beside.distance, beside.level, level.distance)) if beside else "",
        "limits": [[words(action), 1e3 * height] for action, height in sorted(heights.items())],
        "untold": [
            [one.start, one.end, one.reasons.words] for one in not_assessed(level)
        ],
        "defects": [_defect(one) for one in found.defects if one.band == name],
    }  # fmt: skip


def _defect(one: Defect) -> list[Any]:
    grade = int(one.likely) if one.likely else 0
    return [
        round(one.start, 2),
        round(one.peak, 2),
        round(one.end, 2),
        round(1e3 * one.height, 2),
        grade,
    ]


def _sections(found: Assessment) -> dict[str, Any]:
    """Of the shortest band and the longest sections, which classes are made for."""
    ones = [one for one in found.sections if one.band == next(iter(found.levels))]
    length = max((one.length for one in ones), default=0.0)
    ones = [one for one in ones if one.length == length]
    classes = ones[0].classes.names if ones and ones[0].classes else ()
    return {
        "band": ones[0].band if ones else "",
        "length": length,
        "classes": list(classes),
        "rows": [
            [
                one.start,
                one.end,
                *(
                    round(1e3 * value, 3)
                    for value in (one.standard_deviation, one.low, one.high)
                ),
                classes.index(one.quality_class) if classes else -1,
            ]
            for one in ones
        ],
    }  # fmt: skip


def packed(values: Array) -> str:
    """Counts of `STEP` as 16-bit integers, the lower byte first, in base 64.

    Examples
    --------
    >>> np.frombuffer(base64.b64decode(packed(np.array([1e-3, np.nan]))), "<i2").tolist()
    [100, -32768]
    """
    counts = np.clip(np.round(np.nan_to_num(values) / STEP), UNKNOWN + 1, -UNKNOWN - 1)
    counts[np.isnan(values)] = UNKNOWN
    return base64.b64encode(counts.astype("<i2").tobytes()).decode("ascii")

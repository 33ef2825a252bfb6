"""What a report is made of, and the parts of it that are the same on screen and on paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.limits import KM_H
from trackprofile.assessment.sections import Section
from trackprofile.assessment.trend import Trend
from trackprofile.bands import edge_distance
from trackprofile.positioning.chainage import ChainageTable

_MILLI = 1e3


@dataclass(frozen=True)
class Report:
    """What is reported.

    Parameters
    ----------
    title : of the report
    assessment : of the profile
    way : where its places are
    sources : of what was used, by what it is: the profile's file, the limits' ...
    version : of this program
    beside, beside_name : an assessment of another profile of the same place, and what it is called
    changes : since earlier passes
    """

    title: str
    assessment: Assessment
    way: ChainageTable
    sources: Mapping[str, str]
    version: str
    beside: Assessment | None = None
    beside_name: str = ""
    changes: Trend | None = None


def method(report: Report) -> dict[str, str]:
    """How the numbers came about, by name; what nobody stated is left out."""
    found, about = report.assessment, report.assessment.about
    limits = found.limits
    parts = {
        **report.sources,
        "profile": ", ".join(
            f"{name} {about[name]}"
            for name in ("kind", "method", "loading", "vehicle")
            if about.get(name)
        ),
        "provenance": "; ".join(_steps(about.get("provenance", ""))),
        "bands": "; ".join(
            f"{name} {level.band.shortest:g} to {level.band.longest:g} m"
            for name, level in found.levels.items()
        ),
        "filter": found.filter,
        "edges": "a band is judged from "
        + ", ".join(
            f"{edge_distance(level.band):.0f} m ({name})" for name, level in found.levels.items()
        )
        + " inside an end or gap",
        "line speed": f"{found.speed / KM_H:.4g} km/h",
        "limits": f"{limits.name}; {limits.source}",
        "probability": "that the true level exceeds a limit somewhere in the defect, from the profile's stated "
        f"uncertainty; listed from {100 * found.least_probability:g} %",
        "standard deviation": "of the true level over a section, with its 95 % interval; of_estimate is that of the "
        "estimate itself, which is too smooth by what it does not know",
        "version": f"trackprofile {report.version}",
    }
    return {name: text for name, text in parts.items() if text}


def _steps(provenance: str) -> list[str]:
    return [one for one in provenance.strip("[]").replace('"', "").split(", ") if one]


def differences(report: Report) -> list[str]:
    """How the sections and defects of the other profile differ, where both are, in sentences."""
    other = report.beside
    if other is None:
        return []
    found, said = report.assessment, []
    for band in found.levels:
        pairs = _same_sections(found, other, band)
        if not pairs:
            continue
        judged = [(one, two) for one, two in pairs if one.classes and two.classes]
        same = [one.quality_class == two.quality_class for one, two in judged]
        ratio = np.array([[one.standard_deviation, two.standard_deviation] for one, two in pairs])
        inside = [one.low <= two.standard_deviation <= one.high for one, two in pairs]
        text = (
            f"{band}: standard deviation over {len(pairs)} sections {_MILLI * ratio[:, 0].mean():.2f} mm here, "
            f"{_MILLI * ratio[:, 1].mean():.2f} mm there, root mean square of the difference "
            f"{_MILLI * float(np.sqrt(np.mean(np.square(ratio[:, 0] - ratio[:, 1])))):.3f} mm; "
            f"{sum(inside)} of {len(pairs)} lie in the stated 95 % interval"
        )
        if judged:
            text += f"; {sum(same)} of {len(judged)} of the same class"
            apart = [
                f"{report.way.name(one.start)} ({one.quality_class} here, {two.quality_class} there)"
                for one, two in judged
                if one.quality_class != two.quality_class
            ]
            text += f", not {'; '.join(apart)}" if apart else ""
        said.append(text + ".")
    return [*said, *_defects_both(found, other, report.way)]


def _same_sections(
    found: Assessment, other: Assessment, band: str
) -> list[tuple[Section, Section]]:
    there = {(one.band, one.start, one.end): one for one in other.sections}
    return [
        (one, there[key])
        for one in found.sections
        if one.band == band and (key := (one.band, one.start, one.end)) in there
    ]


def _defects_both(found: Assessment, other: Assessment, way: ChainageTable) -> list[str]:
    def calling(one: Assessment) -> list[tuple[str, float, float, str]]:
        return [(d.band, d.start, d.end, way.name(d.peak)) for d in one.defects if d.likely]

    here, there = calling(found), calling(other)

    def meets(
        one: tuple[str, float, float, str], others: list[tuple[str, float, float, str]]
    ) -> bool:
        return any(one[0] == two[0] and one[1] < two[2] and two[1] < one[2] for two in others)

    start, end = max(found.start, other.start), min(found.end, other.end)
    here, there = (
        [one for one in ones if one[1] >= start and one[2] <= end] for ones in (here, there)
    )
    both = [one for one in here if meets(one, there)]
    only_here = [one[3] for one in here if not meets(one, there)]
    only_there = [one[3] for one in there if not meets(one, here)]
    return [
        f"Defects that call for something: {len(both)} in both, {len(only_here)} only here"
        f"{_listed(only_here)}, {len(only_there)} only there{_listed(only_there)}."
    ]


def _listed(places: list[str]) -> str:
    return f" ({', '.join(places[:10])}{' ...' if len(places) > 10 else ''})" if places else ""

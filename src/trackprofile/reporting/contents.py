"""Contents of a report, and the parts of it that the HTML and the PDF share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.limits import KM_H
from trackprofile.assessment.sections import Section
from trackprofile.assessment.trend import Trend
from trackprofile.bands import edge_distance
from trackprofile.positioning.chainage import ChainageTable

_MILLI = 1e3
_MAX_NAMED = 10


@dataclass(frozen=True)
class Report:
    """Contents of a report.

    Parameters
    ----------
    title : title of the report
    assessment : of the profile
    chainage : kilometres of its distances
    sources : files and settings that were used, by name: the profile's file, the limit set ...
    version : version of this program
    compared, compared_name : assessment of another profile of the same track, and its name
    trend : change since earlier passes
    """

    title: str
    assessment: Assessment
    chainage: ChainageTable
    sources: Mapping[str, str]
    version: str
    compared: Assessment | None = None
    compared_name: str = ""
    trend: Trend | None = None


def method(report: Report) -> dict[str, str]:
    """How the numbers were obtained, by name; entries without a value are omitted."""
    assessment, about = report.assessment, report.assessment.about
    limits = assessment.limits
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
            for name, level in assessment.levels.items()
        ),
        "filter": assessment.filter,
        "edges": "the assessment of a band begins "
        + ", ".join(
            f"{edge_distance(level.band):.0f} m ({name})"
            for name, level in assessment.levels.items()
        )
        + " from an end or a gap",
        "line speed": f"{assessment.speed / KM_H:.4g} km/h",
        "limits": f"{limits.name}; {limits.source}",
        "probability": "probability that the true level exceeds the limit somewhere in the defect, from the "
        f"uncertainty that the profile states; defects are listed from {100 * assessment.least_probability:g} %",
        "standard deviation": "standard deviation of the true level over a section, with its 95 % interval; "
        "estimate_standard_deviation is that of the estimated level, which is smoother than the true one",
        "version": f"trackprofile {report.version}",
    }
    return {name: text for name, text in parts.items() if text}


def _steps(provenance: str) -> list[str]:
    return [one for one in provenance.strip("[]").replace('"', "").split(", ") if one]


def differences(report: Report) -> list[str]:
    """Differences of sections and defects from the compared profile, in sentences."""
    if report.compared is None:
        return []
    pairs = {
        band: _same_sections(report.assessment, report.compared, band)
        for band in report.assessment.levels
    }
    sentences = [
        _section_differences(band, ones, report.chainage) for band, ones in pairs.items() if ones
    ]
    return [*sentences, _defect_differences(report.assessment, report.compared, report.chainage)]


def _section_differences(
    band: str, pairs: Sequence[tuple[Section, Section]], chainage: ChainageTable
) -> str:
    values = np.array([[one.standard_deviation, two.standard_deviation] for one, two in pairs])
    inside = [one.low <= two.standard_deviation <= one.high for one, two in pairs]
    rms = float(np.sqrt(np.mean(np.square(values[:, 0] - values[:, 1]))))
    text = (
        f"{band}: mean standard deviation of {len(pairs)} sections {_MILLI * values[:, 0].mean():.2f} mm, "
        f"{_MILLI * values[:, 1].mean():.2f} mm in the compared profile, RMS difference {_MILLI * rms:.3f} mm; "
        f"{sum(inside)} of {len(pairs)} compared values are in the stated 95 % interval"
    )
    classified = [(one, two) for one, two in pairs if one.classes and two.classes]
    if not classified:
        return f"{text}."
    other_class = [(one, two) for one, two in classified if one.quality_class != two.quality_class]
    text += f"; {len(classified) - len(other_class)} of {len(classified)} are of the same class"
    names = [
        f"{chainage.name(one.start)} ({one.quality_class}; compared: {two.quality_class})"
        for one, two in other_class
    ]
    return f"{text}, except {'; '.join(names)}." if names else f"{text}."


def _same_sections(
    assessment: Assessment, compared: Assessment, band: str
) -> list[tuple[Section, Section]]:
    """Sections of a band that both assessments have."""
    others = {(one.band, one.start, one.end): one for one in compared.sections}
    return [
        (one, others[key])
        for one in assessment.sections
        if one.band == band and (key := (one.band, one.start, one.end)) in others
    ]


@dataclass(frozen=True)
class _DefectStretch:
    """Extent [m] and name of a defect that requires an action."""

    band: str
    start: float
    end: float
    name: str

    def overlaps(self, others: Sequence[_DefectStretch]) -> bool:
        return any(
            self.band == one.band and self.start < one.end and one.start < self.end
            for one in others
        )


def _defect_differences(
    assessment: Assessment, compared: Assessment, chainage: ChainageTable
) -> str:
    """Defects in one of two assessments or in both, over the stretch that both have."""
    start, end = max(assessment.start, compared.start), min(assessment.end, compared.end)
    own, other = (
        [
            _DefectStretch(one.band, one.start, one.end, chainage.name(one.peak))
            for one in each.defects
            if one.required_action and one.start >= start and one.end <= end
        ]
        for each in (assessment, compared)
    )
    both = [one for one in own if one.overlaps(other)]
    only_own = [one.name for one in own if not one.overlaps(other)]
    only_other = [one.name for one in other if not one.overlaps(own)]
    return (
        f"Defects that require an action: {len(both)} in both profiles, {len(only_own)} only in this profile"
        f"{_listed(only_own)}, {len(only_other)} only in the compared profile{_listed(only_other)}."
    )


def _listed(names: Sequence[str]) -> str:
    if not names:
        return ""
    return f" ({', '.join(names[:_MAX_NAMED])}{' ...' if len(names) > _MAX_NAMED else ''})"

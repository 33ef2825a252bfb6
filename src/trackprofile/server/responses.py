"""What the server answers, as its OpenAPI description states it: every number with its unit in its name."""

from __future__ import annotations

from datetime import date

from pydantic import BaseModel, ConfigDict, Field

Millimetres = list[float | None]
"""Null where it is not known."""


class ResponseModel(BaseModel):
    """An answer, or a part of one."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ErrorResponse(ResponseModel):
    """Why a question has no answer."""

    error: str = Field(description="one sentence")


class BandName(ResponseModel):
    """A band of wavelengths."""

    name: str
    shortest_m: float
    longest_m: float


class LineInfo(ResponseModel):
    """A line in one direction, as far as it was passed."""

    line: str
    direction: str
    start_m: float
    end_m: float
    passes: int
    first_day: date
    last_day: date


class Lines(ResponseModel):
    """All lines of the store."""

    lines: list[LineInfo]
    bands: list[BandName]
    locked: bool = Field(description="whether this server asks for a token")


class Days(ResponseModel):
    """Days on which a line was passed, in their order."""

    days: list[date]


class PassInfo(ResponseModel):
    """One pass: where, when, from what, how well, and what it obliges to."""

    entry: str
    line: str
    direction: str
    day: date
    run: str
    start_m: float
    end_m: float
    known_share: float = Field(description="of its points, not in a gap")
    deviation_mm: dict[str, float] = Field(
        description="median standard deviation by band; bands without are not stated"
    )
    counts: dict[str, int] = Field(description="places by the action that they call for")
    kind: str
    vehicle: str
    method: str
    track: str
    prior: str
    limits: str
    speed_km_h: float = Field(description="of the line, that limits were taken for")
    source: str
    recording: str = Field(description="SHA-256 of the recording's content")
    software: str
    notes: list[str] = Field(description="to be said with every number")


class Passes(ResponseModel):
    """Passes over one line and direction, by day."""

    passes: list[PassInfo]
    omitted: int = Field(description="earlier ones that are not listed")


class Limit(ResponseModel):
    """A height from which a defect calls for an action."""

    action: str
    height_mm: float


class NotJudged(ResponseModel):
    """A stretch in which the band is not judged, with the reasons."""

    start_m: float
    end_m: float
    reasons: str


class EnvelopeResponse(ResponseModel):
    """The level in a band, bin by bin: bin i runs from from_m + i bin_m to from_m + (i + 1) bin_m."""

    entries: list[str]
    band: str
    from_m: float
    to_m: float
    bin_m: float
    low_mm: Millimetres = Field(description="least value in the bin")
    high_mm: Millimetres = Field(description="greatest value in the bin")
    deviation_mm: Millimetres = Field(
        description="greatest standard deviation; the 95 % band is ±1.96 of it about low and high"
    )
    limits: list[Limit]
    not_judged: list[NotJudged]
    notes: list[str]


class DefectInfo(ResponseModel):
    """An isolated defect: a half wave beyond a limit, or that may be."""

    entry: str
    band: str
    start_m: float
    peak_m: float
    end_m: float
    height_mm: float = Field(description="of the peak over the mean, up is positive")
    standard_deviation_mm: float
    calls_for: str = Field(
        description="gravest action whose limit is exceeded with 50 % or more; empty: possible only"
    )
    probabilities: dict[str, float] = Field(description="by action, that its limit is exceeded")
    limits_mm: dict[str, float]


class Duty(ResponseModel):
    """What an action obliges to, in the words of the limits."""

    action: str
    obliges_to: str


class Defects(ResponseModel):
    """Isolated defects, a part of them."""

    defects: list[DefectInfo]
    total: int = Field(description="that the filters let through")
    counts: dict[str, int] = Field(description="of those, by action; possible is under 50 %")
    duties: list[Duty]
    notes: list[str]


class SchematicMark(ResponseModel):
    """All places of one action within a bin of the line."""

    start_m: float
    end_m: float
    calls_for: str
    places: int
    peak_m: float = Field(description="of the gravest of them")


class Schematic(ResponseModel):
    """A line's places at a glance."""

    start_m: float
    end_m: float
    bin_m: float
    bins: list[SchematicMark]


class SectionInfo(ResponseModel):
    """A section, or the worst of some that follow each other."""

    start_m: float
    end_m: float
    standard_deviation_mm: float
    low_mm: float = Field(description="95 % interval from")
    high_mm: float = Field(description="95 % interval to")
    quality_class: str


class Sections(ResponseModel):
    """Standard deviations per section."""

    band: str
    length_m: float = Field(description="of a section; 0 where there is none")
    grouped: int = Field(description="sections of which the worst is given")
    sections: list[SectionInfo]


class Told(ResponseModel):
    """A pass that tells a place."""

    entry: str
    day: date
    run: str
    vehicle: str


class LeftOut(ResponseModel):
    """A pass that does not, and why."""

    entry: str
    day: date
    run: str
    reason: str


class Trend(ResponseModel):
    """A line in time through the passes."""

    per_day_mm: float
    per_day_deviation_mm: float
    straight: bool = Field(description="whether the passes lie on it, as far as they state")


class Ahead(ResponseModel):
    """The trend on a day."""

    day: date
    level_mm: float
    deviation_mm: float


class ReachedInfo(ResponseModel):
    """When a limit is reached if the change goes on; null is not within ten years."""

    action: str
    height_mm: float
    earliest: date | None = Field(description="reached by then with 2.5 %")
    median: date | None
    latest: date | None = Field(description="reached by then with 97.5 %")


class Around(ResponseModel):
    """The level around a place, pass by pass in their order."""

    distance_m: list[float]
    levels_mm: list[Millimetres]


class DevelopmentResponse(ResponseModel):
    """How a place developed."""

    band: str
    at_m: float
    passes: list[Told]
    level_mm: list[float]
    deviation_mm: list[float]
    trend: Trend | None
    forecast: list[Ahead] = Field(
        description="the trend from the first pass on, and beyond the last"
    )
    reached: list[ReachedInfo]
    beyond: list[Limit] = Field(description="limits that the trend is beyond at the last pass")
    limits: list[Limit]
    around: Around
    left_out: list[LeftOut]
    omitted: int = Field(description="passes that were not looked at, to answer in time")
    notes: list[str]


class ChangedPlaceInfo(ResponseModel):
    """A place that changed between two passes."""

    start_m: float
    peak_m: float
    end_m: float
    change_mm: float
    deviation_mm: float
    level_mm: float = Field(description="at the later pass")
    per_day_mm: float | None
    per_day_deviation_mm: float | None
    reached: list[ReachedInfo]


class ComparisonResponse(ResponseModel):
    """Two days against each other: second less first, which is the earlier."""

    band: str
    first_day: date
    second_day: date
    first: EnvelopeResponse
    second: EnvelopeResponse
    difference: EnvelopeResponse = Field(
        description="of the aligned levels; where by_section is above 0, of the sections' standard deviations"
    )
    by_section: float = Field(description="length of the sections that are compared [m], or 0")
    closest_m: float = Field(description="stretch up to which levels are compared themselves")
    places: list[ChangedPlaceInfo]
    notes: list[str]


class Flag(ResponseModel):
    """A flag of doubtful places."""

    name: str
    share: float = Field(description="of the pieces of the pass that hold a place with it")


class PassQuality(ResponseModel):
    """How much of the line a pass tells, and how well."""

    entry: str
    day: date
    run: str
    vehicle: str
    start_m: float
    end_m: float
    known_share: float
    deviation_mm: dict[str, float]
    counts: dict[str, int]
    flags: list[Flag]
    deviation_along_mm: Millimetres = Field(description="median per bin of the line")


class QualityResponse(ResponseModel):
    """Data quality of a line's passes, the earliest first."""

    band: str
    start_m: float
    bin_m: float
    least_mm: float = Field(description="standard deviation that the best bins have")
    passes: list[PassQuality]
    omitted: int

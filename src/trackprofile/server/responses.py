"""Answers of the server, as its OpenAPI description states them; the name of every number ends in its unit."""

from __future__ import annotations

from datetime import date

from pydantic import BaseModel, ConfigDict, Field

Millimetres = list[float | None]
"""Null where the value is not known."""


class ResponseModel(BaseModel):
    """An answer, or a part of one."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ErrorResponse(ResponseModel):
    """The reason why a request has no answer."""

    error: str = Field(description="one sentence")


class BandName(ResponseModel):
    """A wavelength band."""

    name: str
    shortest_m: float
    longest_m: float


class LineInfo(ResponseModel):
    """A line in one direction, over the stretch that passes cover."""

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
    token_required: bool = Field(description="whether this server requires a token")


class Days(ResponseModel):
    """Days with passes, in order."""

    days: list[date]


class PassInfo(ResponseModel):
    """One pass: its stretch, date, origin, uncertainty and number of defects."""

    entry: str
    line: str
    direction: str
    day: date
    run: str
    start_m: float
    end_m: float
    known_share: float = Field(description="share of points that are not in a gap")
    standard_deviation_mm: dict[str, float] = Field(
        description="median standard deviation by band; without the bands that the profile does not state"
    )
    defect_counts: dict[str, int] = Field(description="number of defects by required action")
    kind: str
    vehicle: str
    method: str
    track: str
    prior: str
    limit_set: str
    line_speed_km_h: float = Field(description="line speed for which limits were chosen")
    source: str
    recording: str = Field(description="identity of the recording (SHA-256)")
    software: str
    notes: list[str] = Field(description="caveats on limits and assessment")


class Passes(ResponseModel):
    """Passes over one line in one direction, by day."""

    passes: list[PassInfo]
    omitted_passes: int = Field(description="number of earlier passes that are not listed")


class Limit(ResponseModel):
    """The height from which a defect requires an action."""

    action: str
    height_mm: float


class NotAssessedStretch(ResponseModel):
    """A stretch in which the band is not assessed, with the reasons."""

    start_m: float
    end_m: float
    reasons: str


class EnvelopeResponse(ResponseModel):
    """The level in a band, bin by bin: bin i extends from from_m + i bin_m to from_m + (i + 1) bin_m."""

    entries: list[str]
    band: str
    from_m: float
    to_m: float
    bin_m: float
    low_mm: Millimetres = Field(description="minimum in the bin")
    high_mm: Millimetres = Field(description="maximum in the bin")
    standard_deviation_mm: Millimetres = Field(
        description="largest standard deviation in the bin; the 95 % interval extends from low - 1.96 of it to "
        "high + 1.96 of it"
    )
    limits: list[Limit]
    not_assessed: list[NotAssessedStretch]
    notes: list[str]


class DefectInfo(ResponseModel):
    """An isolated defect: a half wave that exceeds a limit, or may exceed it."""

    entry: str
    band: str
    start_m: float
    peak_m: float
    end_m: float
    height_mm: float = Field(description="height of the peak above the mean; up is positive")
    standard_deviation_mm: float
    required_action: str = Field(
        description="most severe action whose limit is exceeded with a probability of 50 % or more; empty: none"
    )
    probabilities: dict[str, float] = Field(
        description="by action, the probability that its limit is exceeded"
    )
    limits_mm: dict[str, float]


class ActionRequirement(ResponseModel):
    """What an action requires, as the limit set states it."""

    action: str
    requirement: str


class Defects(ResponseModel):
    """Isolated defects, or a part of them."""

    defects: list[DefectInfo]
    total: int = Field(description="number of defects that pass the filters")
    counts: dict[str, int] = Field(
        description="number of these by required action; `possible` is below 50 %"
    )
    requirements: list[ActionRequirement]
    notes: list[str]


class SchematicBin(ResponseModel):
    """All defects of one required action within a bin of the line."""

    start_m: float
    end_m: float
    required_action: str
    defects: int
    peak_m: float = Field(description="distance of the most severe of them")


class Schematic(ResponseModel):
    """Overview of the defects of a line."""

    start_m: float
    end_m: float
    bin_m: float
    bins: list[SchematicBin]


class SectionInfo(ResponseModel):
    """A section, or the worst of several consecutive ones."""

    start_m: float
    end_m: float
    standard_deviation_mm: float
    low_mm: float = Field(description="lower end of the 95 % interval")
    high_mm: float = Field(description="upper end of the 95 % interval")
    quality_class: str


class Sections(ResponseModel):
    """Standard deviations per section."""

    band: str
    length_m: float = Field(description="length of a section; 0 without sections")
    group_size: int = Field(
        description="number of consecutive sections of which the worst is given"
    )
    sections: list[SectionInfo]


class DevelopmentPass(ResponseModel):
    """A pass from which the development of a location is determined."""

    entry: str
    day: date
    run: str
    vehicle: str


class ExcludedPass(ResponseModel):
    """A pass that is not used, and why."""

    entry: str
    day: date
    run: str
    reason: str


class TrendInfo(ResponseModel):
    """Linear trend through the passes."""

    rate_mm_per_day: float
    rate_standard_deviation_mm_per_day: float
    is_linear: bool = Field(
        description="whether the passes agree with the trend within their uncertainty"
    )


class ForecastPoint(ResponseModel):
    """The trend on a day."""

    day: date
    level_mm: float
    standard_deviation_mm: float


class LimitCrossingInfo(ResponseModel):
    """Day on which a limit is reached if the trend continues; null: not within ten years."""

    action: str
    height_mm: float
    earliest: date | None = Field(description="reached by then with a probability of 2.5 %")
    median: date | None
    latest: date | None = Field(description="reached by then with a probability of 97.5 %")


class Surroundings(ResponseModel):
    """The level around a location, one list per pass in their order."""

    distance_m: list[float]
    levels_mm: list[Millimetres]


class DevelopmentResponse(ResponseModel):
    """Development of a location over time."""

    band: str
    at_m: float
    passes: list[DevelopmentPass]
    level_mm: list[float]
    standard_deviation_mm: list[float]
    trend: TrendInfo | None
    forecast: list[ForecastPoint] = Field(
        description="the trend from the first pass to some time after the last"
    )
    limit_crossings: list[LimitCrossingInfo]
    exceeded_limits: list[Limit] = Field(
        description="limits that the trend exceeds at the last pass"
    )
    limits: list[Limit]
    surroundings: Surroundings
    excluded: list[ExcludedPass]
    omitted_passes: int = Field(
        description="number of passes that were not read, to limit the response time"
    )
    notes: list[str]


class ChangedLocationInfo(ResponseModel):
    """A location that changed between two passes."""

    start_m: float
    peak_m: float
    end_m: float
    change_mm: float
    standard_deviation_mm: float
    level_mm: float = Field(description="level at the later pass")
    rate_mm_per_day: float | None
    rate_standard_deviation_mm_per_day: float | None
    limit_crossings: list[LimitCrossingInfo]


class ComparisonResponse(ResponseModel):
    """Two days compared: the second, which is the later, minus the first."""

    band: str
    first_day: date
    second_day: date
    first: EnvelopeResponse
    second: EnvelopeResponse
    difference: EnvelopeResponse = Field(
        description="difference of the aligned levels; where section_length_m is above 0, of the standard deviations "
        "of the sections"
    )
    section_length_m: float = Field(
        description="length of the compared sections; 0 where levels are compared"
    )
    max_pointwise_length_m: float = Field(
        description="length of a stretch up to which levels are compared point by point"
    )
    locations: list[ChangedLocationInfo]
    notes: list[str]


class Flag(ResponseModel):
    """A quality flag."""

    name: str
    share: float = Field(description="share of the pass in which the flag is set")


class PassQuality(ResponseModel):
    """Coverage and uncertainty of a pass."""

    entry: str
    day: date
    run: str
    vehicle: str
    start_m: float
    end_m: float
    known_share: float
    standard_deviation_mm: dict[str, float]
    defect_counts: dict[str, int]
    flags: list[Flag]
    standard_deviation_along_mm: Millimetres = Field(description="largest per bin of the line")


class QualityResponse(ResponseModel):
    """Data quality of the passes over a line, the earliest first."""

    band: str
    start_m: float
    bin_m: float
    lowest_standard_deviation_mm: float = Field(
        description="lowest 5 % quantile of the standard deviation among the passes"
    )
    passes: list[PassQuality]
    omitted_passes: int

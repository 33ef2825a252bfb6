"""Parameters of the server's requests and their bounds; any other parameter is refused."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

MAX_DISTANCE = 1e8
"""Largest distance along a line [m]."""

MAX_BINS = 8000


def _printable(value: str) -> str:
    if not value.isprintable():
        raise ValueError("expected printable text")
    return value


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
Metres = Annotated[float, Field(ge=-MAX_DISTANCE, le=MAX_DISTANCE, allow_inf_nan=False)]
EntryId = Annotated[str, Field(pattern="^[0-9a-f]{16}-[0-9a-f]{16}$")]
BandName = Literal["D1", "D2", "D3"]
ActionName = Literal["alert", "intervention", "immediate action"]


class RequestParameters(BaseModel):
    """Parameters of a request; unknown ones are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class LineParameters(RequestParameters):
    """A line in one direction."""

    line: Name
    direction: Name


class PassesParameters(LineParameters):
    """Passes between two days."""

    first: date | None = None
    last: date | None = None


class DayParameters(LineParameters):
    """All passes of a day, or one of them."""

    day: date
    entry: EntryId | None = None


class StretchParameters(RequestParameters):
    """A part of the line."""

    start: Metres | None = Field(None, alias="from")
    end: Metres | None = Field(None, alias="to")

    @model_validator(mode="after")
    def _ordered(self) -> StretchParameters:
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise ValueError("expected from below to")
        return self


class LevelParameters(DayParameters, StretchParameters):
    """The level in a band."""

    band: BandName
    max_bins: int = Field(1000, ge=2, le=MAX_BINS, description="maximum number of bins")


class DefectsParameters(DayParameters, StretchParameters):
    """Isolated defects."""

    band: BandName | None = None
    minimum_action: ActionName | None = Field(
        None, description="only defects that require this action or a more severe one"
    )
    order: Literal["severity", "distance"] = "severity"
    offset: int = Field(0, ge=0, le=1_000_000)
    count: int = Field(100, ge=1, le=1000)


class SchematicParameters(DayParameters):
    """Overview of the defects of a line."""

    bins: int = Field(400, ge=10, le=2000)


class SectionsParameters(DayParameters, StretchParameters):
    """Standard deviations per section."""

    band: BandName
    count: int = Field(
        500,
        ge=1,
        le=2000,
        description="maximum number; of more sections, the worst of each group is given",
    )


class DevelopmentParameters(LineParameters):
    """Development of a location over time."""

    band: BandName
    at: Metres
    since: date | None = None
    until: date | None = None


class CompareParameters(DayParameters, StretchParameters):
    """Two days."""

    band: BandName
    compared_day: date
    compared_entry: EntryId | None = None
    max_bins: int = Field(1000, ge=2, le=MAX_BINS, description="maximum number of bins")


class QualityParameters(LineParameters):
    """Data quality of the passes over a line."""

    band: BandName
    first: date | None = None
    last: date | None = None
    bins: int = Field(300, ge=10, le=2000)

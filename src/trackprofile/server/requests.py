"""What may be asked, and within which bounds; anything else in a question is refused."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

FARTHEST = 1e8
"""m along a line: farther than any."""

MOST_BINS = 8000


def _text(value: str) -> str:
    if not value.isprintable():
        raise ValueError("expected printable text")
    return value


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_text)]
Metres = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
EntryId = Annotated[str, Field(pattern="^[0-9a-f]{16}-[0-9a-f]{16}$")]
Band = Literal["D1", "D2", "D3"]
Act = Literal["alert", "intervention", "immediate action"]


class Question(BaseModel):
    """Of a client; what it does not know of is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class LineQuestion(Question):
    """About a line in one direction."""

    line: Name
    direction: Name


class PassesQuestion(LineQuestion):
    """Which passes there are."""

    first: date | None = None
    last: date | None = None


class DayQuestion(LineQuestion):
    """About all passes of a day, or one of them."""

    day: date
    entry: EntryId | None = None


class Stretch(Question):
    """A part of the line."""

    start: Metres | None = Field(None, alias="from")
    end: Metres | None = Field(None, alias="to")

    @model_validator(mode="after")
    def _ordered(self) -> Stretch:
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise ValueError("expected from below to")
        return self


class StripQuestion(DayQuestion, Stretch):
    """What to draw of a band."""

    band: Band
    width: int = Field(1000, ge=2, le=MOST_BINS, description="bins at most")


class DefectsQuestion(DayQuestion, Stretch):
    """Isolated defects."""

    band: Band | None = None
    least: Act | None = Field(None, description="action that they call for at least")
    order: Literal["gravest", "along"] = "gravest"
    offset: int = Field(0, ge=0, le=1_000_000)
    count: int = Field(100, ge=1, le=1000)


class SchematicQuestion(DayQuestion):
    """A line's places at a glance."""

    bins: int = Field(400, ge=10, le=2000)


class SectionsQuestion(DayQuestion, Stretch):
    """Standard deviations per section."""

    band: Band
    count: int = Field(
        500, ge=1, le=2000, description="of sections at most; then the worst of some"
    )


class PlaceQuestion(LineQuestion):
    """Development of a place."""

    band: Band
    at: Metres
    since: date | None = None
    until: date | None = None


class CompareQuestion(DayQuestion, Stretch):
    """Two days."""

    band: Band
    other: date
    other_entry: EntryId | None = None
    width: int = Field(1000, ge=2, le=MOST_BINS, description="bins at most")


class QualityQuestion(LineQuestion):
    """Data quality of a line's passes."""

    band: Band
    first: date | None = None
    last: date | None = None
    bins: int = Field(300, ge=10, le=2000)

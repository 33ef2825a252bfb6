"""The TOML that explains a recording: its keys."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from trackprofile.io import toml_document
from trackprofile.positioning.sources import NOMINAL


class ColumnReference(toml_document.Strict):
    """A column and its unit."""

    column: str
    unit: str


class Gnss(toml_document.Strict):
    """The table ``[recording.gnss]``: satellite positions; lengths in m, times in s."""

    latitude: ColumnReference
    longitude: ColumnReference
    speed: ColumnReference | None = None
    valid: str | None = None
    deviation: PositiveFloat | None = None
    wander: NonNegativeFloat | None = None
    delay: float = 0.0
    behind: float = 0.0
    time: ColumnReference | None = None


class Odometer(toml_document.Strict):
    """The table ``[recording.odometer]``: pulses of a wheel, or metres that it counts."""

    column: str
    unit: str
    each_row: bool = False
    per_revolution: PositiveFloat | None = None
    wheel_diameter: PositiveFloat | None = None
    scale_deviation: PositiveFloat = NOMINAL
    time: ColumnReference | None = None


class PostColumns(toml_document.Strict):
    """The table ``[recording.posts]``: kilometre posts passed; lengths in m, times in s."""

    column: str
    unit: str
    data: str | None = None
    time: ColumnReference | None = None
    deviation: PositiveFloat = 5.0
    timing: NonNegativeFloat = 0.5
    behind: float = 0.0


class Head(toml_document.Strict):
    """The table ``[recording]``."""

    data: str
    time: ColumnReference | None = None
    distance: ColumnReference | None = None
    speed: ColumnReference | None = None
    distance_deviation: ColumnReference | None = None
    wheel_scale: PositiveFloat | None = None
    gnss: Gnss | None = None
    odometer: Odometer | None = None
    posts: PostColumns | None = None
    way: str | None = None
    leading_end: Literal["first", "last"] | None = None
    line: str = ""
    direction: str = ""
    source: str = ""
    vehicle: str = ""
    provenance: list[str] = Field(default_factory=list)


class SensorColumn(toml_document.Strict):
    """One table ``[[sensor]]``."""

    column: str
    unit: str
    quantity: str
    body: str
    position: float
    lateral: float = 0.0
    noise_density: PositiveFloat | None = None
    bandwidth: PositiveFloat | None = None
    flicker: PositiveFloat | None = None
    valid: str | None = None
    time: ColumnReference | None = None


class Document(toml_document.Strict):
    """The whole."""

    recording: Head
    sensor: list[SensorColumn] = Field(min_length=1)

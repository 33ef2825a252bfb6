"""The keys of the TOML document that describes the columns of a recording's table."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from trackprofile.io import toml_document
from trackprofile.positioning.sources import WHEEL_SCALE_STD

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class ColumnReference(toml_document.Strict):
    """Name and unit of a column."""

    column: str
    unit: str


class Gnss(toml_document.Strict):
    """Table ``[recording.gnss]``: columns and errors of GNSS positions.

    ``std`` [m] is the standard deviation of the independent error along the line, ``bias_std`` [m] that of the slowly
    varying error; both are estimated where they are not given. ``delay`` [s] is the delay of a recorded position,
    ``antenna_offset`` [m] the distance from the leading wheel back to the antenna.
    """

    renamed: ClassVar = {"deviation": "std", "wander": "bias_std", "behind": "antenna_offset"}

    latitude: ColumnReference
    longitude: ColumnReference
    speed: ColumnReference | None = None
    valid: str | None = None
    std: PositiveFloat | None = None
    bias_std: NonNegativeFloat | None = None
    delay: float = 0.0
    antenna_offset: float = 0.0
    time: ColumnReference | None = None


class Odometer(toml_document.Strict):
    """Table ``[recording.odometer]``: column of wheel pulses, or of the distance that a wheel counts.

    ``incremental`` is true where a row holds the count since the row before, false where it holds the running total.
    ``wheel_diameter`` [m] is the nominal diameter, ``scale_std`` the standard deviation of the logarithm of the true
    diameter over it.
    """

    renamed: ClassVar = {"each_row": "incremental", "scale_deviation": "scale_std"}

    column: str
    unit: str
    incremental: bool = False
    per_revolution: PositiveFloat | None = None
    wheel_diameter: PositiveFloat | None = None
    scale_std: PositiveFloat = WHEEL_SCALE_STD
    time: ColumnReference | None = None


class PostColumns(toml_document.Strict):
    """Table ``[recording.posts]``: column of passed kilometre posts, in the recording's table or in one of its own.

    ``std`` [m] is the standard deviation of a post's location, ``time_std`` [s] that of its recorded time,
    ``detector_offset`` [m] the distance from the leading wheel back to what detects a post.
    """

    renamed: ClassVar = {"deviation": "std", "timing": "time_std", "behind": "detector_offset"}

    column: str
    unit: str
    data: str | None = None
    time: ColumnReference | None = None
    std: PositiveFloat = 5.0
    time_std: NonNegativeFloat = 0.5
    detector_offset: float = 0.0


class RecordingTable(toml_document.Strict):
    """Table ``[recording]``: data file, motion, position sources and texts."""

    renamed: ClassVar = {"way": "chainage"}

    data: str
    time: ColumnReference | None = None
    distance: ColumnReference | None = None
    speed: ColumnReference | None = None
    distance_deviation: ColumnReference | None = None
    wheel_scale: PositiveFloat | None = None
    gnss: Gnss | None = None
    odometer: Odometer | None = None
    posts: PostColumns | None = None
    chainage: str | None = None
    leading_end: Literal["first", "last"] | None = None
    line: str = ""
    direction: str = ""
    source: str = ""
    vehicle: str = ""
    provenance: list[str] = Field(default_factory=list)
    identity: Digest | None = None
    identity_content: Digest | None = None


class SensorColumn(toml_document.Strict):
    """One table ``[[sensor]]``: a column with a sensor's signal."""

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


class RecordingDocument(toml_document.Strict):
    """The whole document."""

    recording: RecordingTable
    sensor: list[SensorColumn] = Field(min_length=1)

"""The TOML that explains a recording: its keys."""

from __future__ import annotations

from pydantic import Field, PositiveFloat

from trackprofile.io import toml_document


class Quantity(toml_document.Strict):
    """A column and its unit."""

    column: str
    unit: str


class Head(toml_document.Strict):
    """The table ``[recording]``."""

    data: str
    time: Quantity | None = None
    distance: Quantity | None = None
    speed: Quantity | None = None
    line: str = ""
    direction: str = ""
    source: str = ""
    vehicle: str = ""
    provenance: list[str] = Field(default_factory=list)


class Sensor(toml_document.Strict):
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
    time: Quantity | None = None


class Document(toml_document.Strict):
    """The whole."""

    recording: Head
    sensor: list[Sensor] = Field(min_length=1)

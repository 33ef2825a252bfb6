"""The tables of a vehicle's, track's, spectrum's or sensors' TOML, and what may stand in them."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PlainValidator, PositiveFloat
from pydantic_core import PydanticCustomError

from trackprofile.io.toml_document import Strict
from trackprofile.units import unit_factor


def _number_or_name(value: object) -> float | str:
    if isinstance(value, str):
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise PydanticCustomError("number", "expected a number, or the name of a parameter")


Number = Annotated[float | str, PlainValidator(_number_or_name)]


class Sourced(Strict):
    source: str = ""
    verified: bool = True

    @property
    def said(self) -> str:
        """The source, with what is to be said of it."""
        return self.source if self.verified else f"{self.source} (not verified)".strip()


class Quantity(Strict):
    value: float
    unit: str

    def si(self, dimension: str) -> float:
        return self.value * unit_factor(self.unit, dimension)


class Parameter(Quantity, Sourced):
    standard_error: NonNegativeFloat | None = None


class Body(Strict):
    name: str
    mass: Number
    pitch_inertia: Number | None = None
    position: Number = 0.0


class Wheel(Strict):
    name: str
    mass: Number
    position: Number


class Link(Strict):
    name: str
    upper: str
    lower: str
    position: Number
    stiffness: Number
    damping: Number


class Sensor(Strict):
    name: str
    quantity: Literal["vertical acceleration", "pitch rate"]
    body: str
    position: float = 0.0
    unit: str
    noise_density: PositiveFloat | None = None
    bandwidth: PositiveFloat | None = None
    offset: NonNegativeFloat | None = None
    drift: NonNegativeFloat | None = None


class Installation(Strict):
    origin: float = 0.0
    unmodelled: NonNegativeFloat | None = None
    sensor: list[Sensor] = Field(default_factory=list)


class Vehicle(Sourced):
    name: str
    parameter: dict[str, Parameter] = Field(default_factory=dict)
    body: list[Body]
    wheel: list[Wheel]
    link: list[Link]
    installation: Installation = Field(default_factory=Installation)
    calibration: dict[str, Any] = Field(default_factory=dict)


class Track(Sourced):
    name: str
    stiffness: Quantity
    damping: Quantity


class Spectrum(Sourced):
    name: str
    amplitude: Quantity
    lower: Quantity
    upper: Quantity


class Sensors(Sourced):
    name: str = ""
    sensor: list[Sensor] = Field(min_length=1)

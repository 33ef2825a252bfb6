"""The tables of a vehicle's, track's, spectrum's or sensors' TOML, and what may stand in them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BaseModel,
    Field,
    NonNegativeFloat,
    PlainValidator,
    PositiveFloat,
    model_validator,
)
from pydantic_core import PydanticCustomError

from trackprofile.contracts import QUANTITIES
from trackprofile.io.table import error_location
from trackprofile.io.toml_document import Strict
from trackprofile.models import sensor, track
from trackprofile.models import sensor_errors as instrument
from trackprofile.units import unit_factor


def _number_or_parameter(value: object) -> float | str:
    if isinstance(value, str):
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise PydanticCustomError("number", "expected a number, or the name of a parameter")


Number = Annotated[float | str, PlainValidator(_number_or_parameter)]


class SourcedTable(Strict):
    source: str = ""
    verified: bool = True

    @property
    def said(self) -> str:
        """The source, with what is to be said of it."""
        return self.source if self.verified else f"{self.source} (not verified)".strip()


class QuantityTable(Strict):
    value: float
    unit: str

    def si(self, dimension: str) -> float:
        return self.value * unit_factor(self.unit, dimension)


class ParameterTable(QuantityTable, SourcedTable):
    log_std: PositiveFloat = 0.5
    standard_error: NonNegativeFloat | None = None


class BodyTable(Strict):
    name: str
    mass: Number
    pitch_inertia: Number | None = None
    position: Number = 0.0
    roll_inertia: Number | None = None


class WheelTable(Strict):
    name: str
    mass: Number
    position: Number
    roll_inertia: Number | None = None


class LinkTable(Strict):
    name: str
    upper: str
    lower: str
    position: Number
    stiffness: Number
    damping: Number
    semi_spacing: Number | None = None
    roll_stiffness: Number = 0.0


class SensorTable(Strict):
    name: str
    quantity: Literal["vertical acceleration", "pitch rate", "roll rate"]
    body: str
    position: float = 0.0
    lateral: float = 0.0
    unit: str
    noise_density: PositiveFloat | None = None
    bandwidth: PositiveFloat | None = None
    offset: NonNegativeFloat | None = None
    drift: NonNegativeFloat | None = None
    flicker: NonNegativeFloat | None = None

    @property
    def factor(self) -> float:
        """SI value of one of its unit."""
        with error_location(f"sensor {self.name!r}"):
            return unit_factor(self.unit, QUANTITIES[self.quantity][1])

    def si(self) -> sensor.Sensor:
        factor = self.factor
        fields = self.model_dump(include=SensorTable.model_fields.keys() - {"unit"})
        for field in ("noise_density", "offset", "drift", "flicker"):
            if fields[field] is not None:
                fields[field] *= factor
        return sensor.Sensor(**fields)


class InstrumentTable(SensorTable):
    resolution: NonNegativeFloat = 0.0
    range: PositiveFloat | None = None
    misalignment_deg: float = 0.0
    gain: float = 1.0

    def complete(self, source: str) -> instrument.Instrument:
        return instrument.Instrument(
            self.si(),
            resolution=self.resolution * self.factor,
            range=None if self.range is None else self.range * self.factor,
            misalignment=math.radians(self.misalignment_deg),
            gain=self.gain,
            source=source,
        )


class ResidualTable(Strict):
    share: NonNegativeFloat
    frequency: PositiveFloat
    damping: PositiveFloat = 0.5


class InstalledSensorTable(SensorTable):
    gain: float = 1.0
    tilt_rad: float = 0.0
    residual: ResidualTable | None = None

    def installed(self) -> sensor.Sensor:
        """As a calibration found it on the vehicle."""
        left = None if self.residual is None else sensor.Residual(**self.residual.model_dump())
        return replace(self.si(), gain=self.gain, tilt=self.tilt_rad, residual=left)


class UncertaintyTable(Strict):
    names: list[str]
    covariance: list[list[float]]

    @model_validator(mode="after")
    def square(self) -> UncertaintyTable:
        size = len(self.names)
        if len(self.covariance) != size or any(len(row) != size for row in self.covariance):
            raise PydanticCustomError("square", "expected a row and a column for each of the names")
        return self

    def si(self) -> sensor.Uncertainty:
        return sensor.Uncertainty(tuple(self.names), tuple(map(tuple, self.covariance)))


class InstallationTable(Strict):
    origin: float = 0.0
    unmodelled: NonNegativeFloat | None = None
    distance_scale: PositiveFloat = 1.0
    sensor: list[InstalledSensorTable] = Field(default_factory=list)
    uncertainty: UncertaintyTable | None = None

    def si(self) -> sensor.Installation:
        return sensor.Installation(
            self.origin,
            tuple(one.installed() for one in self.sensor),
            self.unmodelled,
            self.distance_scale,
            None if self.uncertainty is None else self.uncertainty.si(),
        )


class VehicleTable(SourcedTable):
    name: str
    contact_spacing: PositiveFloat = 1.5
    parameter: dict[str, ParameterTable] = Field(default_factory=dict)
    body: list[BodyTable]
    wheel: list[WheelTable]
    link: list[LinkTable]
    installation: InstallationTable = Field(default_factory=InstallationTable)
    calibration: dict[str, Any] = Field(default_factory=dict)


class TrackTable(SourcedTable):
    name: str
    stiffness: QuantityTable
    damping: QuantityTable
    mass: QuantityTable | None = None

    def si(self) -> track.ElasticTrack:
        """As the simulation and the smoother take it."""
        mass = 0.0 if self.mass is None else self.mass.si("mass")
        return track.ElasticTrack(
            self.stiffness.si("stiffness"), self.damping.si("damping"), self.said, mass
        )


class TrackKind(BaseModel):
    """Tells whether a track is layered; whatever else stands there is not looked at."""

    rail: object | None = None


class RailTable(Strict):
    bending_stiffness: QuantityTable
    mass: QuantityTable


class SupportTable(Strict):
    pad_stiffness: QuantityTable
    pad_damping: QuantityTable
    sleeper_mass: QuantityTable
    ballast_stiffness: QuantityTable
    ballast_damping: QuantityTable
    ballast_mass: QuantityTable
    subballast_stiffness: QuantityTable
    subballast_damping: QuantityTable

    def si(self) -> track.Support:
        """As the simulation takes it."""
        return track.Support(
            **{name: getattr(self, name).si(name.split("_")[1]) for name in track.SUPPORT_FIELDS}
        )


class TrackChangeTable(Strict):
    field: str
    factor: float
    start: QuantityTable
    end: QuantityTable

    def si(self) -> track.SupportChange:
        """As the simulation takes it."""
        return track.SupportChange(
            self.field, self.factor, self.start.si("length"), self.end.si("length")
        )


class LayeredTrackTable(SourcedTable):
    name: str
    spacing: QuantityTable
    rail: RailTable
    support: SupportTable
    change: list[TrackChangeTable] = Field(default_factory=list)

    def si(self) -> track.LayeredTrack:
        """As the simulation takes it."""
        return track.LayeredTrack(
            self.name,
            self.rail.bending_stiffness.si("bending stiffness"),
            self.rail.mass.si("mass per length"),
            self.spacing.si("length"),
            self.support.si(),
            tuple(one.si() for one in self.change),
            self.said,
        )


class SpectrumTable(SourcedTable):
    renamed: ClassVar = {"lower": "corner_low", "upper": "corner_high", "piece": "segment"}

    name: str
    amplitude: QuantityTable
    corner_low: QuantityTable
    corner_high: QuantityTable


class SpatialFrequencyTable(Strict):
    value: PositiveFloat
    unit: Literal["rad/m", "1/m"]

    @property
    def si(self) -> float:
        """rad/m"""
        return self.value * (1.0 if self.unit == "rad/m" else 2 * math.pi)


class DensityTable(Strict):
    value: PositiveFloat
    unit: Literal["m²/(rad/m)", "cm²/(rad/m)", "m²/(1/m)", "mm²/(1/m)"]

    @property
    def si(self) -> float:
        """m²/(rad/m); per rad/m there is 1/2π of what there is per 1/m"""
        square, per = self.unit.split("/", maxsplit=1)
        factor = {"m²": 1.0, "cm²": 1e-4, "mm²": 1e-6}[square]
        return self.value * factor / (1.0 if per == "(rad/m)" else 2 * math.pi)


class CornerTable(Strict):
    renamed: ClassVar = {"at": "frequency", "fall": "added_slope"}

    frequency: SpatialFrequencyTable
    added_slope: PositiveFloat
    sharpness: PositiveFloat


class SpectrumSegmentTable(Strict):
    renamed: ClassVar = {"at": "reference", "upper": "end", "knee": "corner"}

    density: DensityTable
    reference: SpatialFrequencyTable
    slope: float
    end: SpatialFrequencyTable | None = None
    corner: CornerTable | None = None


class PowerLawTable(SourcedTable):
    name: str
    shortest: QuantityTable
    longest: QuantityTable
    segment: list[SpectrumSegmentTable] = Field(min_length=1)


class SpectrumKind(BaseModel):
    """Tells whether a spectrum is one of pieces; whatever else stands there is not looked at."""

    segment: list[object] | None = None


class SensorListTable(SourcedTable):
    name: str = ""
    sensor: list[InstrumentTable] = Field(min_length=1)

"""Keys and value types of the TOML documents of vehicles, tracks, spectra and sensors."""

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
    raise PydanticCustomError("number", "expected a number or the name of a parameter")


Number = Annotated[float | str, PlainValidator(_number_or_parameter)]


class SourcedTable(Strict):
    source: str = ""
    verified: bool = True

    @property
    def described_source(self) -> str:
        """Source, marked where it is not verified."""
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
        """SI value of one unit of the sensor."""
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

    def to_instrument(self, source: str) -> instrument.Instrument:
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

    def to_sensor(self) -> sensor.Sensor:
        """Sensor with the gain, tilt and residual of a calibration."""
        residual = None if self.residual is None else sensor.Residual(**self.residual.model_dump())
        return replace(self.si(), gain=self.gain, tilt=self.tilt_rad, residual=residual)


class UncertaintyTable(Strict):
    names: list[str]
    covariance: list[list[float]]

    @model_validator(mode="after")
    def square(self) -> UncertaintyTable:
        size = len(self.names)
        if len(self.covariance) != size or any(len(row) != size for row in self.covariance):
            raise PydanticCustomError("square", "expected one row and one column per name")
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
            tuple(one.to_sensor() for one in self.sensor),
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
        """Track in SI units."""
        mass = 0.0 if self.mass is None else self.mass.si("mass")
        return track.ElasticTrack(
            self.stiffness.si("stiffness"), self.damping.si("damping"), self.described_source, mass
        )


class TrackKind(BaseModel):
    """Key that distinguishes a layered track; other keys are ignored."""

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
        """The same in SI units."""
        return track.Support(
            **{name: getattr(self, name).si(name.split("_")[1]) for name in track.SUPPORT_FIELDS}
        )


class TrackChangeTable(Strict):
    field: str
    factor: float
    start: QuantityTable
    end: QuantityTable

    def si(self) -> track.SupportChange:
        """The same in SI units."""
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
        """The same in SI units."""
        return track.LayeredTrack(
            self.name,
            self.rail.bending_stiffness.si("bending stiffness"),
            self.rail.mass.si("mass per length"),
            self.spacing.si("length"),
            self.support.si(),
            tuple(one.si() for one in self.change),
            self.described_source,
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
        """Spatial angular frequency [rad/m]."""
        return self.value * (1.0 if self.unit == "rad/m" else 2 * math.pi)


class DensityTable(Strict):
    value: PositiveFloat
    unit: Literal["m²/(rad/m)", "cm²/(rad/m)", "m²/(1/m)", "mm²/(1/m)"]

    @property
    def si(self) -> float:
        """Density [m²/(rad/m)]; a density per rad/m is 1/2π of that per 1/m."""
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
    """Key that distinguishes a spectrum of power-law segments; other keys are ignored."""

    segment: list[object] | None = None


class SensorListTable(SourcedTable):
    name: str = ""
    sensor: list[InstrumentTable] = Field(min_length=1)

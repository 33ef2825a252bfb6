"""Vehicles, tracks, spectra and sensors in TOML; presets by name.

A vehicle is a list of parts. A value is a number in SI units, or the name of a parameter that has a unit:

    name = "half a car"
    [parameter."body mass"]
    value = 20
    unit = "t"
    source = "weighed"
    [[body]]
    name = "body"
    mass = "body mass"
    pitch_inertia = 4e5                     # optional: without it the body has no pitch
    position = 1.25                         # m behind the leading wheel
    roll_inertia = 3e4                      # optional: needed for a profile per rail
    [[wheel]]
    name = "wheel 1"
    mass = 900
    position = 0
    [[link]]
    name = "suspension 1"
    upper = "body"
    lower = "wheel 1"
    position = 0
    stiffness = 1e6
    damping = 2e4
    semi_spacing = 1                        # optional: m from the centre line to the springs of one side

Further results of a calibration are in the tables ``installation`` and ``calibration``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from trackprofile.contracts import QUANTITIES
from trackprofile.errors import FileError, ModelError
from trackprofile.io import model_tables as tables
from trackprofile.io.atomic import check_writable, whole_files
from trackprofile.io.table import error_location
from trackprofile.io.toml_document import load, toml_text
from trackprofile.models.sensor import Installation, Sensor
from trackprofile.models.sensor_errors import Instrument
from trackprofile.models.spectrum import (
    PowerLaw,
    Roughness,
    Spectrum,
    SpectrumSegment,
    require_rational,
)
from trackprofile.models.track import RigidTrack, Track
from trackprofile.models.vehicle import (
    Body,
    Link,
    Vehicle,
    VehicleParameter,
    Wheel,
    parameter_values,
)
from trackprofile.units import si_unit

_Part = tables.BodyTable | tables.LinkTable | tables.WheelTable

Kind = Literal["vehicle", "track", "spectrum", "sensors"]

RIGID = "rigid"
"""Name of the rigid track, which has no parameters."""

_PRESETS = Path(__file__).parents[1] / "presets"

_DIMENSIONS = {
    "mass": "mass",
    "pitch_inertia": "inertia",
    "position": "length",
    "stiffness": "stiffness",
    "damping": "damping",
    "roll_inertia": "inertia",
    "semi_spacing": "length",
    "roll_stiffness": "rotational stiffness",
}
"""Fields of a part that may name a parameter, with their dimension."""


def presets(kind: Kind) -> tuple[str, ...]:
    """Names of the presets of a kind, which are accepted instead of a path.

    Examples
    --------
    >>> presets("vehicle")
    ('high-speed', 'intercity-coach', 'light-rail', 'locomotive', 'manchester-benchmark', 'multiple-unit', ...)
    """
    named = sorted(path.stem for path in (_PRESETS / kind).glob("*.toml"))
    return (RIGID, *named) if kind == "track" else tuple(named)


def read_vehicle(name_or_path: str | Path) -> tuple[Vehicle, Installation]:
    """Read a vehicle, and the installation of its sensors as calibrated.

    Raises
    ------
    FileError : neither a preset nor a file has that name, or the document has a wrong key.
    UnitError : a unit is unknown or of another dimension.
    ModelError : parameters contradict each other.

    Examples
    --------
    >>> vehicle, _ = read_vehicle("quarter-car")
    >>> vehicle.body("bogie").mass
    512.5
    """
    path = _find(name_or_path, "vehicle")
    document = load(path, tables.VehicleTable)
    with _error_location(path):
        return _vehicle(document), document.installation.si()


def write_vehicle(
    vehicle: Vehicle,
    installation: Installation,
    path: str | Path,
    calibration: Mapping[str, object] | None = None,
) -> None:
    """Write a vehicle in SI units; `read_vehicle` reads it back exactly.

    Parameters
    ----------
    path : file that ends in .toml
    calibration : origin of the parameters, written unchanged and not read back; the source of its ``parameters``
        becomes "calibrated", with their ``standard_error`` [SI]

    Raises
    ------
    FileError : the path does not end in .toml, or cannot be written.
    """
    check_vehicle_path(path)
    text = toml_text(_vehicle_table(vehicle, installation, calibration or {}))
    with whole_files(path) as (file,):
        file.write_text(text, encoding="utf-8")


def check_vehicle_path(path: str | Path) -> None:
    """Check that a vehicle can be written to a path, before a calibration.

    Raises
    ------
    FileError : it cannot be written, or would replace a file that is not a vehicle.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        raise FileError(
            f"{path}: a vehicle is written to a file that ends in .toml; change the suffix."
        )
    check_writable(path)
    if path.exists():
        try:
            load(path, tables.VehicleTable)
        except FileError as error:
            message = f"{path}: the file exists and is not a vehicle; choose another name."
            raise FileError(message) from error


def read_track(name_or_path: str | Path) -> Track:
    """Read a track; the name "rigid" is a track without deflection.

    A file with the table ``rail`` is a layered track, any other a spring and a damper under each wheel.

    Raises
    ------
    FileError, UnitError, ModelError : see `read_vehicle`.

    Examples
    --------
    >>> read_track("zhai").stiffness
    87800000.0
    """
    if str(name_or_path) == RIGID:
        return RigidTrack()
    path = _find(name_or_path, "track")
    layered = load(path, tables.TrackKind).rail is not None
    document = load(path, tables.LayeredTrackTable if layered else tables.TrackTable)
    with _error_location(path):
        return document.si()


def read_spectrum(name_or_path: str | Path) -> Spectrum:
    """Read a spectrum of track irregularity that can be the prior of an estimate.

    Raises
    ------
    FileError, UnitError, ModelError : see `read_vehicle`.
    ModelError : the spectrum is not rational; see `read_roughness`.

    Examples
    --------
    >>> read_spectrum("fra-6").corner_high
    0.825
    """
    roughness = read_roughness(name_or_path)
    with _error_location(_find(name_or_path, "spectrum")):
        return require_rational(roughness)


def read_roughness(name_or_path: str | Path) -> Roughness:
    """Read a spectrum of track irregularity of any form, for simulation or comparison.

    Its TOML has ``amplitude``, ``corner_low`` and ``corner_high``, or a list of ``segment``.

    Raises
    ------
    FileError, UnitError, ModelError : see `read_vehicle`.

    Examples
    --------
    >>> read_roughness("china-ballastless").longest
    200.0
    """
    path = _find(name_or_path, "spectrum")
    if load(path, tables.SpectrumKind).segment is not None:
        return _power_law(path)
    document = load(path, tables.SpectrumTable)
    with _error_location(path):
        return Spectrum(
            document.name,
            amplitude=document.amplitude.si("roughness"),
            corner_low=document.corner_low.si("spatial frequency"),
            corner_high=document.corner_high.si("spatial frequency"),
            source=document.described_source,
        )


def read_sensors(name_or_path: str | Path) -> tuple[Sensor, ...]:
    """Read the sensors on a vehicle.

    Raises
    ------
    FileError, UnitError, ModelError : see `read_vehicle`.

    Examples
    --------
    >>> [sensor.quantity for sensor in read_sensors("bogie-25ug")]
    ['vertical acceleration', 'pitch rate']
    """
    path = _find(name_or_path, "sensors")
    document = load(path, tables.SensorListTable)
    with _error_location(path):
        return tuple(one.si() for one in document.sensor)


def read_instruments(name_or_path: str | Path) -> tuple[Instrument, ...]:
    """Read the sensors on a vehicle with all data of their data sheets, for a simulation.

    Raises
    ------
    FileError, UnitError, ModelError : see `read_vehicle`.

    Examples
    --------
    >>> [round(one.range) for one in read_instruments("bogie-mti1")]
    [157, 35]
    """
    path = _find(name_or_path, "sensors")
    document = load(path, tables.SensorListTable)
    with _error_location(path):
        return tuple(one.to_instrument(document.described_source) for one in document.sensor)


def _find(name_or_path: str | Path, kind: Kind) -> Path:
    named = presets(kind)
    if str(name_or_path) in named:
        return _PRESETS / kind / f"{name_or_path}.toml"
    if not Path(name_or_path).is_file():
        raise FileError(
            f"{name_or_path}: the file does not exist; give the path of a {kind} TOML, "
            f"or one of the presets {', '.join(named)}."
        )
    return Path(name_or_path)


@contextmanager
def _error_location(path: Path) -> Iterator[None]:
    """Add the path of the file to errors that are raised inside."""
    try:
        with error_location(path):
            yield
    except ModelError as error:
        raise ModelError(f"{path}: {error}.") from error


def _power_law(path: Path) -> PowerLaw:
    document = load(path, tables.PowerLawTable)
    with _error_location(path):
        return PowerLaw(
            document.name,
            segments=tuple(map(_segment, document.segment)),
            shortest=document.shortest.si("length"),
            longest=document.longest.si("length"),
            source=document.described_source,
        )


def _segment(document: tables.SpectrumSegmentTable) -> SpectrumSegment:
    optional: dict[str, float] = {}
    if document.end is not None:
        optional["end"] = document.end.si
    if document.corner is not None:
        optional["corner_frequency"] = document.corner.frequency.si
        optional["added_slope"] = document.corner.added_slope
        optional["sharpness"] = document.corner.sharpness
    return SpectrumSegment(document.density.si, document.reference.si, document.slope, **optional)


def _vehicle(document: tables.VehicleTable) -> Vehicle:
    parts = (*document.body, *document.link, *document.wheel)
    return Vehicle(
        document.name,
        bodies=tuple(Body(**_fields(part, document.parameter)) for part in document.body),
        links=tuple(Link(**_fields(part, document.parameter)) for part in document.link),
        wheels=tuple(Wheel(**_fields(part, document.parameter)) for part in document.wheel),
        source=document.described_source,
        parameters=tuple(
            _shared(name, parameter, parts) for name, parameter in document.parameter.items()
        ),
        contact_spacing=document.contact_spacing,
    )


def _fields(part: _Part, parameters: Mapping[str, tables.ParameterTable]) -> dict[str, Any]:
    """Fields of a part in SI units, with the values of its parameters."""
    fields = part.model_dump()
    for field, name in _named(part):
        if name not in parameters:
            known = ", ".join(parameters) or "none"
            raise ModelError(
                f"{field} of {fields['name']!r} names the parameter {name!r}, which is not defined; "
                f"the parameters are: {known}"
            )
        with error_location(f"parameter {name!r}, {field} of {fields['name']!r}"):
            fields[field] = parameters[name].si(_DIMENSIONS[field])
    return fields


def _named(part: _Part) -> list[tuple[str, str]]:
    """Fields of a part that name a parameter, each with that name."""
    fields = ((field, getattr(part, field, None)) for field in _DIMENSIONS)
    return [(field, name) for field, name in fields if isinstance(name, str)]


def _shared(
    name: str, parameter: tables.ParameterTable, parts: Sequence[_Part]
) -> VehicleParameter:
    used_by = [(part.name, field) for part in parts for field, used in _named(part) if used == name]
    if not used_by:
        raise ModelError(f"parameter {name!r} is not used; name it in a part, or remove it")
    unit = si_unit(_DIMENSIONS[used_by[0][1]])
    return VehicleParameter(
        name, unit, tuple(used_by), parameter.described_source, parameter.log_std
    )


def _vehicle_table(
    vehicle: Vehicle, installation: Installation, calibration: Mapping[str, Any]
) -> dict[str, object]:
    calibrated = calibration.get("parameters", {})
    values = parameter_values(vehicle)
    parameters = {
        one.name: {
            "value": values[one.name],
            "unit": si_unit(_DIMENSIONS[one.used_by[0][1]]),
            "source": "calibrated" if one.name in calibrated else one.source or None,
            "log_std": one.log_std,
            "standard_error": calibrated.get(one.name, {}).get("standard_error"),
        }
        for one in vehicle.parameters
    }
    names = {place: one.name for one in vehicle.parameters for place in one.used_by}
    parts = {"body": vehicle.bodies, "wheel": vehicle.wheels, "link": vehicle.links}
    table: dict[str, object] = {"name": vehicle.name, "source": vehicle.source or None}
    table["contact_spacing"] = vehicle.contact_spacing
    table["parameter"] = parameters
    for kind, ones in parts.items():
        table[kind] = [
            {field: names.get((one.name, field), value) for field, value in asdict(one).items()}
            for one in ones
        ]
    if installation != Installation():
        table["installation"] = _installation_table(installation)
    return table | ({"calibration": calibration} if calibration else {})


def _installation_table(installation: Installation) -> dict[str, object]:
    fields = asdict(installation)
    fields["sensor"] = [
        {"unit": si_unit(QUANTITIES[one["quantity"]][1]), "tilt_rad": one.pop("tilt")} | one
        for one in fields.pop("sensors")
    ]
    return fields

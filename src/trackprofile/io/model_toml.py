"""Vehicles, tracks, spectra and sensors as a person writes them in TOML; presets by name.

A vehicle is a list of parts; a number is in SI, or the name of a parameter that has its unit:

    name = "half a car"

    [parameter."body mass"]
    value = 20
    unit = "t"
    source = "weighed"

    [[body]]
    name = "body"
    mass = "body mass"
    pitch_inertia = 4e5                     # optional: without it the body only heaves
    position = 1.25                         # m behind the leading wheel, as everywhere
    roll_inertia = 3e4                      # optional: for a profile per rail

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
    semi_spacing = 1                        # optional: m from the middle to the springs of either side

What a calibration found beside it stands in the tables ``installation`` and ``calibration``.
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
"""The name of the track that has no numbers."""

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
"""Which fields of a part a parameter may stand for."""


def presets(kind: Kind) -> tuple[str, ...]:
    """The names that a reader of that kind takes instead of a path.

    Examples
    --------
    >>> presets("vehicle")
    ('high-speed', 'intercity-coach', 'light-rail', 'locomotive', 'manchester-benchmark', 'multiple-unit', ...)
    """
    named = sorted(path.stem for path in (_PRESETS / kind).glob("*.toml"))
    return (RIGID, *named) if kind == "track" else tuple(named)


def read_vehicle(name_or_path: str | Path) -> tuple[Vehicle, Installation]:
    """A vehicle, and how the sensors sit on it as far as a calibration found that.

    Raises
    ------
    FileError : there is no such preset or file, or it has a wrong key.
    UnitError : a unit does not fit.
    ModelError : the vehicle contradicts itself.

    Examples
    --------
    >>> vehicle, _ = read_vehicle("quarter-car")
    >>> vehicle.body("bogie").mass
    512.5
    """
    path = _find(name_or_path, "vehicle")
    read = load(path, tables.VehicleTable)
    with _error_location(path):
        return _vehicle(read), read.installation.si()


def write_vehicle(
    vehicle: Vehicle,
    installation: Installation,
    path: str | Path,
    calibration: Mapping[str, object] | None = None,
) -> None:
    """Write what `read_vehicle` reads back exactly, in SI.

    Parameters
    ----------
    path : ends in .toml
    calibration : where the numbers come from, kept as it is (nothing in it is read); those of
        its ``parameters`` get "calibrated" for a source, and their ``standard_error`` [SI]

    Raises
    ------
    FileError : the path does not end in .toml, or cannot be written.
    """
    check_vehicle_path(path)
    text = toml_text(_vehicle_table(vehicle, installation, calibration or {}))
    with whole_files(path) as (file,):
        file.write_text(text, encoding="utf-8")


def check_vehicle_path(path: str | Path) -> None:
    """See that a vehicle can be written there: worth asking before a calibration.

    Raises
    ------
    FileError : it cannot, or it would replace what is not a vehicle.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        raise FileError(f"{path}: a vehicle is written to a file that ends in .toml.")
    check_writable(path)
    if path.exists():
        try:
            load(path, tables.VehicleTable)
        except FileError as error:
            message = f"{path}: it is there already and is no vehicle; choose another name."
            raise FileError(message) from error


def read_track(name_or_path: str | Path) -> Track:
    """A track; the name "rigid" stands for a path that gives way to nothing.

    A file with a table ``rail`` is a layered track, any other a spring and a damper under each wheel.

    Raises
    ------
    FileError, UnitError, ModelError : as of `read_vehicle`.

    Examples
    --------
    >>> read_track("zhai").stiffness
    87800000.0
    """
    if str(name_or_path) == RIGID:
        return RigidTrack()
    path = _find(name_or_path, "track")
    layered = load(path, tables.TrackKind).rail is not None
    read = load(path, tables.LayeredTrackTable if layered else tables.TrackTable)
    with _error_location(path):
        return read.si()


def read_spectrum(name_or_path: str | Path) -> Spectrum:
    """A spectrum of track irregularity that can be the prior of an estimate.

    Raises
    ------
    FileError, UnitError, ModelError : as of `read_vehicle`.
    ModelError : it is not of the rational form; `read_roughness` reads those too.

    Examples
    --------
    >>> read_spectrum("fra-6").corner_high
    0.825
    """
    read = read_roughness(name_or_path)
    with _error_location(_find(name_or_path, "spectrum")):
        return require_rational(read)


def read_roughness(name_or_path: str | Path) -> Roughness:
    """A spectrum of track irregularity, of whatever form, to draw profiles from or compare with.

    Its TOML has ``amplitude``, ``corner_low`` and ``corner_high``, or a list of ``segment``.

    Raises
    ------
    FileError, UnitError, ModelError : as of `read_vehicle`.

    Examples
    --------
    >>> read_roughness("china-ballastless").longest
    200.0
    """
    path = _find(name_or_path, "spectrum")
    if load(path, tables.SpectrumKind).segment is not None:
        return _power_law(path)
    read = load(path, tables.SpectrumTable)
    with _error_location(path):
        return Spectrum(
            read.name,
            amplitude=read.amplitude.si("roughness"),
            corner_low=read.corner_low.si("spatial frequency"),
            corner_high=read.corner_high.si("spatial frequency"),
            source=read.said,
        )


def read_sensors(name_or_path: str | Path) -> tuple[Sensor, ...]:
    """The sensors on a vehicle.

    Raises
    ------
    FileError, UnitError, ModelError : as of `read_vehicle`.

    Examples
    --------
    >>> [sensor.quantity for sensor in read_sensors("bogie-25ug")]
    ['vertical acceleration', 'pitch rate']
    """
    path = _find(name_or_path, "sensors")
    read = load(path, tables.SensorListTable)
    with _error_location(path):
        return tuple(one.si() for one in read.sensor)


def read_instruments(name_or_path: str | Path) -> tuple[Instrument, ...]:
    """The sensors on a vehicle, with what else their data sheets say, for a simulation.

    Raises
    ------
    FileError, UnitError, ModelError : as of `read_vehicle`.

    Examples
    --------
    >>> [round(one.range) for one in read_instruments("bogie-mti1")]
    [157, 35]
    """
    path = _find(name_or_path, "sensors")
    read = load(path, tables.SensorListTable)
    with _error_location(path):
        return tuple(one.complete(read.said) for one in read.sensor)


def _find(name_or_path: str | Path, kind: Kind) -> Path:
    named = presets(kind)
    if str(name_or_path) in named:
        return _PRESETS / kind / f"{name_or_path}.toml"
    if not Path(name_or_path).is_file():
        raise FileError(
            f"{name_or_path}: there is no such file; give the path of a {kind} TOML, "
            f"or one of the presets {', '.join(named)}."
        )
    return Path(name_or_path)


@contextmanager
def _error_location(path: Path) -> Iterator[None]:
    """Errors raised inside gain the file's path."""
    try:
        with error_location(path):
            yield
    except ModelError as error:
        raise ModelError(f"{path}: {error}.") from error


def _power_law(path: Path) -> PowerLaw:
    read = load(path, tables.PowerLawTable)
    with _error_location(path):
        return PowerLaw(
            read.name,
            segments=tuple(map(_segment, read.segment)),
            shortest=read.shortest.si("length"),
            longest=read.longest.si("length"),
            source=read.said,
        )


def _segment(read: tables.SpectrumSegmentTable) -> SpectrumSegment:
    optional: dict[str, float] = {}
    if read.end is not None:
        optional["end"] = read.end.si
    if read.corner is not None:
        optional["corner_frequency"] = read.corner.frequency.si
        optional["added_slope"] = read.corner.added_slope
        optional["sharpness"] = read.corner.sharpness
    return SpectrumSegment(read.density.si, read.reference.si, read.slope, **optional)


def _vehicle(read: tables.VehicleTable) -> Vehicle:
    parts = (*read.body, *read.link, *read.wheel)
    return Vehicle(
        read.name,
        bodies=tuple(Body(**_fields(part, read.parameter)) for part in read.body),
        links=tuple(Link(**_fields(part, read.parameter)) for part in read.link),
        wheels=tuple(Wheel(**_fields(part, read.parameter)) for part in read.wheel),
        source=read.said,
        parameters=tuple(
            _shared(name, parameter, parts) for name, parameter in read.parameter.items()
        ),
        contact_spacing=read.contact_spacing,
    )


def _fields(part: _Part, parameters: Mapping[str, tables.ParameterTable]) -> dict[str, Any]:
    """The fields of a part, in SI, the parameters put in."""
    fields = part.model_dump()
    for field, name in _named(part):
        if name not in parameters:
            known = ", ".join(parameters) or "none"
            raise ModelError(
                f"{field} of {fields['name']!r} names the parameter {name!r}, which is not there; "
                f"there is {known}"
            )
        with error_location(f"parameter {name!r}, {field} of {fields['name']!r}"):
            fields[field] = parameters[name].si(_DIMENSIONS[field])
    return fields


def _named(part: _Part) -> list[tuple[str, str]]:
    """Which fields of a part name a parameter, and which."""
    fields = ((field, getattr(part, field, None)) for field in _DIMENSIONS)
    return [(field, name) for field, name in fields if isinstance(name, str)]


def _shared(
    name: str, parameter: tables.ParameterTable, parts: Sequence[_Part]
) -> VehicleParameter:
    used_by = [(part.name, field) for part in parts for field, used in _named(part) if used == name]
    if not used_by:
        raise ModelError(f"nothing uses the parameter {name!r}; name it in a part, or remove it")
    unit = si_unit(_DIMENSIONS[used_by[0][1]])
    return VehicleParameter(name, unit, tuple(used_by), parameter.said, parameter.log_std)


def _vehicle_table(
    vehicle: Vehicle, installation: Installation, calibration: Mapping[str, Any]
) -> dict[str, object]:
    fitted = calibration.get("parameters", {})
    values = parameter_values(vehicle)
    parameters = {
        one.name: {
            "value": values[one.name],
            "unit": si_unit(_DIMENSIONS[one.used_by[0][1]]),
            "source": "calibrated" if one.name in fitted else one.source or None,
            "log_std": one.log_std,
            "standard_error": fitted.get(one.name, {}).get("standard_error"),
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

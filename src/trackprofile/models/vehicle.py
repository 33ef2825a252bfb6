"""Vehicles: planar multibody models of bodies, links and wheels, assembled into M, C and K.

Positions are distances behind the leading wheel in m: a body with the centre at ``position`` is at s - position when
the leading wheel is at s. Up is positive; pitch is positive nose-up. Stiffness and damping are those of both sides
together. Parameters that only roll needs are optional: see :mod:`trackprofile.models.roll`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

Array = NDArray[np.float64]

HEAVE = "heave"
PITCH = "pitch"

ROLL_FIELDS = frozenset({"roll_inertia", "semi_spacing", "roll_stiffness"})
"""Fields of parts that affect roll only."""


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Parameters
    ----------
    name : name of the body
    mass : kg
    pitch_inertia : kg m²; None: the body heaves only
    position : distance of its centre behind the leading wheel, m
    roll_inertia : kg m²; None where unknown
    """

    name: str
    mass: float
    pitch_inertia: float | None = None
    position: float = 0.0
    roll_inertia: float | None = None


@dataclass(frozen=True)
class Wheel:
    """A wheelset.

    Parameters
    ----------
    name : name of the wheelset
    mass : kg; 0 where it is included in the mass of the body above
    position : distance behind the leading wheel, m
    roll_inertia : kg m²; None where unknown
    """

    name: str
    mass: float
    position: float
    roll_inertia: float | None = None


@dataclass(frozen=True)
class Link:
    """A vertical spring and damper in parallel between two parts.

    Parameters
    ----------
    name : name of the link
    upper, lower : names of the parts above and below
    position : distance behind the leading wheel, m
    stiffness : both sides together, N/m
    damping : both sides together, N s/m
    semi_spacing : lateral distance of each side's spring and damper from the centre line, m; None where unknown
    roll_stiffness : stiffness of an anti-roll bar, N m/rad
    """

    name: str
    upper: str
    lower: str
    position: float
    stiffness: float
    damping: float
    semi_spacing: float | None = None
    roll_stiffness: float = 0.0


Part = TypeVar("Part", Body, Wheel, Link)


@dataclass(frozen=True)
class VehicleParameter:
    """A named parameter of a vehicle, with its unit, its source and the fields that share its value.

    Parameters
    ----------
    name : such as "primary stiffness"
    unit : unit in which files and tables state the value
    used_by : pairs (part, field) that have this value, so that one suspension stiffness serves all its springs
    source : source of the value
    log_std : prior standard deviation of the value's logarithm
    """

    name: str
    unit: str
    used_by: tuple[tuple[str, str], ...]
    source: str = ""
    log_std: float = 0.5

    def __post_init__(self) -> None:
        if not self.log_std > 0:
            raise ModelError(
                f"parameter {self.name!r} needs a log_std above 0, got {self.log_std:g}"
            )


@dataclass(frozen=True)
class Vehicle:
    """A vehicle of bodies, links and wheels; see :func:`assemble` for its equations of motion.

    Parameters
    ----------
    name : name of the vehicle
    bodies, links, wheels : its parts; names are unique
    source : source of the numbers
    parameters : named parameters, which a calibration can change
    contact_spacing : lateral distance between the contact points of a wheelset's wheels, m

    Raises
    ------
    ModelError
        Where parts contradict each other: equal names, a link to a missing part, a mass that is not above 0.

    Examples
    --------
    >>> body, bogie = Body("body", 7900.0), Body("bogie", 512.5)
    >>> Vehicle("quarter car", bodies=(body, bogie), wheels=(Wheel("wheel", 0.0, 0.0),), links=(
    ...     Link("secondary", "body", "bogie", 0.0, 7.3e5, 15e3),
    ...     Link("primary", "bogie", "wheel", 0.0, 5e5, 5e3))).length
    0.0
    """

    name: str
    bodies: tuple[Body, ...]
    links: tuple[Link, ...]
    wheels: tuple[Wheel, ...]
    source: str = ""
    parameters: tuple[VehicleParameter, ...] = field(default=())
    contact_spacing: float = 1.5

    def __post_init__(self) -> None:
        _check(self)

    @property
    def length(self) -> float:
        """Distance from the first to the last wheel, m."""
        return max(wheel.position for wheel in self.wheels)

    def body(self, name: str) -> Body:
        """The body with a given name; raises ModelError with the known names where there is none."""
        for body in self.bodies:
            if body.name == name:
                return body
        known = ", ".join(repr(body.name) for body in self.bodies)
        raise ModelError(f"vehicle {self.name!r} has no body {name!r}; it has {known}")


@dataclass(frozen=True)
class Assembly:
    """Mass, damping and stiffness matrices of M q̈ + C q̇ + K q = f, with q in m and rad.

    Parameters
    ----------
    degrees_of_freedom : (part, motion) of each row
    mass, damping, stiffness : M, C and K, (n, n)
    """

    degrees_of_freedom: tuple[tuple[str, str], ...]
    mass: Array
    damping: Array
    stiffness: Array

    def index(self, part: str, motion: str) -> int:
        """Index of a part's heave or pitch."""
        return self.degrees_of_freedom.index((part, motion))


def assemble(vehicle: Vehicle) -> Assembly:
    """Assemble M, C and K of a vehicle with free wheels; degrees of freedom in the order bodies, wheels.

    A link's elongation is b·q; it adds k b bᵀ to K and c b bᵀ to C (theory, section 2). Gravity is not
    included: q is measured from the static equilibrium.
    """
    freedoms = _degrees_of_freedom(vehicle)
    n = len(freedoms)
    mass, damping, stiffness = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    for i, (part, motion) in enumerate(freedoms):
        mass[i, i] = _inertia(vehicle, part, motion)
    for link in vehicle.links:
        stretch = displacement_row(vehicle, freedoms, link.upper, link.position)
        stretch = stretch - displacement_row(vehicle, freedoms, link.lower, link.position)
        stiffness += link.stiffness * np.outer(stretch, stretch)
        damping += link.damping * np.outer(stretch, stretch)
    return Assembly(freedoms, mass, damping, stiffness)


def displacement_row(
    vehicle: Vehicle, freedoms: tuple[tuple[str, str], ...], part: str, position: float
) -> Array:
    """The row b (n,) with b·q = upward displacement of ``part`` at ``position`` m behind the leading wheel."""
    row = np.zeros(len(freedoms))
    row[freedoms.index((part, HEAVE))] = 1.0
    if (part, PITCH) in freedoms:
        row[freedoms.index((part, PITCH))] = vehicle.body(part).position - position
    return row


def parameter_values(vehicle: Vehicle) -> dict[str, float]:
    """The vehicle's named parameters and their values, in SI units.

    Raises
    ------
    ModelError
        Where fields that share a parameter have different values.
    """
    values: dict[str, float] = {}
    for parameter in vehicle.parameters:
        distinct = {getattr(_part(vehicle, part), name) for part, name in parameter.used_by}
        if len(distinct) != 1:
            raise ModelError(
                f"parameter {parameter.name!r} is used by fields of different values {distinct}"
            )
        values[parameter.name] = float(distinct.pop())
    return values


def with_parameters(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """The same vehicle with some of its named parameters changed.

    Parameters
    ----------
    values : new values by parameter name, SI units

    Raises
    ------
    ModelError
        Where the vehicle has no parameter of that name.
    """
    fields: dict[str, dict[str, float]] = {}
    named = {parameter.name: parameter for parameter in vehicle.parameters}
    for name, value in values.items():
        if name not in named:
            known = ", ".join(named) or "none"
            raise ModelError(f"vehicle {vehicle.name!r} has no parameter {name!r}; it has {known}")
        for part, attribute in named[name].used_by:
            fields.setdefault(part, {})[attribute] = value
    return replace(
        vehicle,
        bodies=tuple(replace(body, **fields.get(body.name, {})) for body in vehicle.bodies),
        links=tuple(replace(link, **fields.get(link.name, {})) for link in vehicle.links),
        wheels=tuple(replace(wheel, **fields.get(wheel.name, {})) for wheel in vehicle.wheels),
    )


def reversed_vehicle(vehicle: Vehicle) -> Vehicle:
    """The same vehicle running in the opposite direction: its last wheel leads.

    Examples
    --------
    >>> wheels = Wheel("front", 1e3, 0.0), Wheel("rear", 1e3, 9.0)
    >>> car = Vehicle("car", (Body("body", 1e4, position=2.0),), (), wheels)
    >>> [(one.name, one.position) for one in reversed_vehicle(car).wheels], reversed_vehicle(car).bodies[0].position
    ([('rear', 0.0), ('front', 9.0)], 7.0)
    """

    def reverse(part: Part) -> Part:
        return replace(part, position=vehicle.length - part.position)

    return replace(
        vehicle,
        bodies=tuple(reverse(one) for one in vehicle.bodies),
        links=tuple(reverse(one) for one in vehicle.links),
        wheels=tuple(sorted(map(reverse, vehicle.wheels), key=lambda one: one.position)),
    )


def _degrees_of_freedom(vehicle: Vehicle) -> tuple[tuple[str, str], ...]:
    freedoms: list[tuple[str, str]] = []
    for body in vehicle.bodies:
        freedoms.append((body.name, HEAVE))
        if body.pitch_inertia is not None:
            freedoms.append((body.name, PITCH))
    return (*freedoms, *((wheel.name, HEAVE) for wheel in vehicle.wheels))


def _inertia(vehicle: Vehicle, part: str, motion: str) -> float:
    one = _part(vehicle, part)
    if motion == PITCH and isinstance(one, Body) and one.pitch_inertia is not None:
        return one.pitch_inertia
    return one.mass if isinstance(one, Body | Wheel) else 0.0


def _part(vehicle: Vehicle, name: str) -> Body | Link | Wheel:
    for part in (*vehicle.bodies, *vehicle.links, *vehicle.wheels):
        if part.name == name:
            return part
    raise ModelError(f"vehicle {vehicle.name!r} has no part {name!r}")


def _check(vehicle: Vehicle) -> None:
    where = f"vehicle {vehicle.name!r}"
    names = [part.name for part in (*vehicle.bodies, *vehicle.links, *vehicle.wheels)]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"{where} has {names.count(name)} parts named {name!r}; rename them")
    if not vehicle.bodies or not vehicle.wheels:
        raise ModelError(f"{where} needs at least one body and one wheel")
    first = min(wheel.position for wheel in vehicle.wheels)
    if first != 0.0:
        raise ModelError(
            f"{where}: positions count from the leading wheel, which must be at 0 m, got {first:g} m"
        )
    for body in vehicle.bodies:
        if not body.mass > 0 or (body.pitch_inertia is not None and not body.pitch_inertia > 0):
            raise ModelError(f"{where}: mass and pitch inertia of {body.name!r} must be above 0")
    if not vehicle.contact_spacing > 0:
        raise ModelError(
            f"{where}: contact_spacing must be above 0 m, got {vehicle.contact_spacing:g} m"
        )
    for part in (*vehicle.bodies, *vehicle.wheels):
        if part.roll_inertia is not None and not part.roll_inertia > 0:
            raise ModelError(
                f"{where}: roll inertia of {part.name!r} must be above 0; omit it if unknown"
            )
    _check_links(vehicle, where)


def _check_links(vehicle: Vehicle, where: str) -> None:
    ends = [part.name for part in (*vehicle.bodies, *vehicle.wheels)]
    for link in vehicle.links:
        for end in (link.upper, link.lower):
            if end not in ends:
                raise ModelError(
                    f"{where}: link {link.name!r} connects to {end!r}, which is neither a body nor a wheel"
                )
        if link.stiffness < 0 or link.damping < 0:
            raise ModelError(
                f"{where}: link {link.name!r} needs stiffness and damping of at least 0"
            )
        if link.roll_stiffness < 0 or (link.semi_spacing is not None and not link.semi_spacing > 0):
            raise ModelError(
                f"{where}: link {link.name!r} needs a semi-spacing above 0 m, or none if unknown, and a roll stiffness "
                "of at least 0"
            )

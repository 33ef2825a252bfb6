"""Vehicles: any planar multibody, described by bodies, links and wheels, assembled into M, C and K.

Positions are distances behind the leading wheel, in m, so that a body centred at ``position`` stands
at s - position when the leading wheel stands at s. Up is positive; pitch is positive nose-up. Stiffness and damping
are those of both sides together. What only roll needs is optional: see :mod:`trackprofile.models.roll`.
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
"""Fields of parts that heave and pitch do not feel."""


@dataclass(frozen=True)
class Body:
    """A rigid body: mass in kg, pitch inertia in kg m² (None: it only heaves), position in m.

    ``roll_inertia`` in kg m²; None where nobody knows it.
    """

    name: str
    mass: float
    pitch_inertia: float | None = None
    position: float = 0.0
    roll_inertia: float | None = None


@dataclass(frozen=True)
class Wheel:
    """A wheelset: mass in kg (0 where it belongs to the body above), position in m.

    ``roll_inertia`` in kg m²; None where nobody knows it.
    """

    name: str
    mass: float
    position: float
    roll_inertia: float | None = None


@dataclass(frozen=True)
class Link:
    """A vertical spring (N/m) and damper (N s/m) side by side, between two named parts.

    One half of each stands ``semi_spacing`` m to the left of the middle, the other to the right; None where nobody
    knows. ``roll_stiffness`` in N m/rad is what an anti-roll bar adds.
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
    """A named number of a vehicle, with its unit and source, and the fields that take it.

    ``used_by`` holds pairs (part, field), so that one suspension stiffness serves all its springs. ``spread`` is
    how well the value is known: the standard deviation of its logarithm.
    """

    name: str
    unit: str
    used_by: tuple[tuple[str, str], ...]
    source: str = ""
    spread: float = 0.5

    def __post_init__(self) -> None:
        if not self.spread > 0:
            raise ModelError(f"parameter {self.name!r} needs a spread above 0, got {self.spread:g}")


@dataclass(frozen=True)
class Vehicle:
    """Bodies, links and wheels; see :func:`assemble` for the equations that they stand for.

    ``contact_spacing`` in m is from where the left wheels touch their rail to where the right ones do.

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
        """The body of that name; ModelError lists the names there are."""
        for body in self.bodies:
            if body.name == name:
                return body
        known = ", ".join(repr(body.name) for body in self.bodies)
        raise ModelError(f"vehicle {self.name!r} has no body {name!r}; it has {known}")


@dataclass(frozen=True)
class Assembly:
    """Mass, damping and stiffness matrices over named degrees of freedom.

    M q̈ + C q̇ + K q = f, with q in m and rad; ``degrees_of_freedom`` names each row.
    """

    degrees_of_freedom: tuple[tuple[str, str], ...]
    mass: Array
    damping: Array
    stiffness: Array

    def index(self, part: str, motion: str) -> int:
        """The row of one part's heave or pitch."""
        return self.degrees_of_freedom.index((part, motion))


def assemble(vehicle: Vehicle) -> Assembly:
    """Assemble M, C and K of a vehicle whose wheels are free, in the order bodies, wheels.

    Each link stretches by b·q and adds k b bᵀ to K and c b bᵀ to C (theory, section 2). Gravity is
    left out: q is measured from the static equilibrium.
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
    """The row b with b·q = upward displacement of ``part`` at ``position`` m behind the leading wheel."""
    row = np.zeros(len(freedoms))
    row[freedoms.index((part, HEAVE))] = 1.0
    if (part, PITCH) in freedoms:
        row[freedoms.index((part, PITCH))] = vehicle.body(part).position - position
    return row


def parameter_values(vehicle: Vehicle) -> dict[str, float]:
    """The vehicle's named parameters and their values, in SI.

    Raises
    ------
    ModelError
        Where two fields that share a parameter differ.
    """
    values: dict[str, float] = {}
    for parameter in vehicle.parameters:
        found = {getattr(_part(vehicle, part), name) for part, name in parameter.used_by}
        if len(found) != 1:
            raise ModelError(f"parameter {parameter.name!r} stands for different values {found}")
        values[parameter.name] = float(found.pop())
    return values


def with_parameters(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """The same vehicle with some of its named parameters changed.

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
    """The same vehicle with its last wheel leading: positions count from there.

    Examples
    --------
    >>> wheels = Wheel("front", 1e3, 0.0), Wheel("rear", 1e3, 9.0)
    >>> car = Vehicle("car", (Body("body", 1e4, position=2.0),), (), wheels)
    >>> [(one.name, one.position) for one in reversed_vehicle(car).wheels], reversed_vehicle(car).bodies[0].position
    ([('rear', 0.0), ('front', 9.0)], 7.0)
    """

    def turned(part: Part) -> Part:
        return replace(part, position=vehicle.length - part.position)

    return replace(
        vehicle,
        bodies=tuple(turned(one) for one in vehicle.bodies),
        links=tuple(turned(one) for one in vehicle.links),
        wheels=tuple(sorted(map(turned, vehicle.wheels), key=lambda one: one.position)),
    )


def _degrees_of_freedom(vehicle: Vehicle) -> tuple[tuple[str, str], ...]:
    freedoms: list[tuple[str, str]] = []
    for body in vehicle.bodies:
        freedoms.append((body.name, HEAVE))
        if body.pitch_inertia is not None:
            freedoms.append((body.name, PITCH))
    return (*freedoms, *((wheel.name, HEAVE) for wheel in vehicle.wheels))


def _inertia(vehicle: Vehicle, part: str, motion: str) -> float:
    found = _part(vehicle, part)
    if motion == PITCH and isinstance(found, Body) and found.pitch_inertia is not None:
        return found.pitch_inertia
    return found.mass if isinstance(found, Body | Wheel) else 0.0


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
    if min(wheel.position for wheel in vehicle.wheels) != 0.0:
        raise ModelError(
            f"{where}: positions count from the leading wheel, so one wheel stands at 0"
        )
    for body in vehicle.bodies:
        if not body.mass > 0 or (body.pitch_inertia is not None and not body.pitch_inertia > 0):
            raise ModelError(f"{where}: mass and pitch inertia of {body.name!r} must be positive")
    if not vehicle.contact_spacing > 0:
        raise ModelError(f"{where}: its wheels' contacts must stand more than 0 m apart")
    for part in (*vehicle.bodies, *vehicle.wheels):
        if part.roll_inertia is not None and not part.roll_inertia > 0:
            raise ModelError(
                f"{where}: roll inertia of {part.name!r} must be positive, or left out"
            )
    ends = [part.name for part in (*vehicle.bodies, *vehicle.wheels)]
    for link in vehicle.links:
        for end in (link.upper, link.lower):
            if end not in ends:
                raise ModelError(f"{where}: link {link.name!r} ends at {end!r}, which is no part")
        if link.stiffness < 0 or link.damping < 0:
            raise ModelError(
                f"{where}: link {link.name!r} needs stiffness and damping of at least 0"
            )
        if link.roll_stiffness < 0 or (link.semi_spacing is not None and not link.semi_spacing > 0):
            raise ModelError(
                f"{where}: link {link.name!r} needs a semi-spacing above 0 m, or none, and a roll stiffness of at "
                "least 0"
            )

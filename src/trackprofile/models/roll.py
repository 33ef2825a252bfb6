"""The roll of a car, which is the heave of another: what the cross level does to it, and what sensors feel of that.

A car that is alike on both sides has two motions that know nothing of each other. Heave and pitch stand on the mean of
both rails, roll on their difference, the cross level c = r_L - r_R. With w between the contacts of a wheelset's wheels
and u = w φ, a wheelset's u is the cross level under it, and

    I/w² ü + Σ (c b²/w²) (u̇ - u̇_below) + Σ ((k b² + k_φ)/w²) (u - u_below) = 0

is the heave of a car whose masses are I/w² and whose springs are (k b² + k_φ)/w², with b the semi-spacing of springs
and dampers and k_φ of an anti-roll bar (theory, section 13). So all that is known of heave holds of roll. Left out:
the sideways motion that goes with roll where a centre of gravity stands above its springs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.models.sensor import ROLL_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.track import Coupling, PointTrack, RigidTrack
from trackprofile.models.vehicle import (
    Body,
    Link,
    Vehicle,
    VehicleParameter,
    Wheel,
    parameter_values,
)

Array = NDArray[np.float64]

SAME_PLACE = 0.05
"""m along the car, by which the two of a pair may stand apart."""

SAME_BANDWIDTH = 0.01
"""Share by which the bandwidths of the two of a pair may differ."""

BAR = " anti-roll bar"
"""What a link's name gains for the bar beside it."""


@dataclass(frozen=True)
class RollingVehicle(Vehicle):
    """A car whose heave is the roll of another: u = w φ in m, with w its ``contact_spacing``."""

    def __post_init__(self) -> None:
        """It is made of a vehicle that was checked."""


def roll_unknowns(vehicle: Vehicle, track: PointTrack) -> tuple[str, ...]:
    """What a vehicle would have to state for its roll to be known, such as ``roll_inertia of 'body'``.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> roll_unknowns(read_vehicle("quarter-car")[0], RigidTrack())[:2]
    ("roll_inertia of 'body'", "roll_inertia of 'bogie'")
    """
    inert = [*vehicle.bodies, *([] if isinstance(track, RigidTrack) else vehicle.wheels)]
    return (
        *(f"roll_inertia of {one.name!r}" for one in inert if one.roll_inertia is None),
        *(f"semi_spacing of {one.name!r}" for one in vehicle.links if one.semi_spacing is None),
    )


def rolling(vehicle: Vehicle) -> RollingVehicle:
    """The car whose heave is the roll of this one, its parameters those of this one that roll feels.

    Raises
    ------
    ModelError
        Where a roll inertia or a semi-spacing is not stated, or one parameter serves links of different semi-spacings.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> manchester, _ = read_vehicle("manchester-benchmark")
    >>> rolling(manchester).body("body").mass * 1.5**2  # its roll inertia, kg m²
    56800.0
    """
    unknown = roll_unknowns(vehicle, RigidTrack())
    if unknown:
        raise ModelError(f"vehicle {vehicle.name!r} does not state {', '.join(unknown)}; add them")
    square = vehicle.contact_spacing**2
    links: list[Link] = []
    for link in vehicle.links:
        share = (link.semi_spacing or 0.0) ** 2 / square
        ends = (link.upper, link.lower, link.position)
        links.append(Link(link.name, *ends, share * link.stiffness, share * link.damping))
        if link.roll_stiffness > 0.0:
            # A link of its own, so that a parameter's logarithm acts here as it does there.
            links.append(Link(link.name + BAR, *ends, link.roll_stiffness / square, 0.0))
    found = RollingVehicle(
        vehicle.name,
        bodies=tuple(
            Body(one.name, (one.roll_inertia or 0.0) / square, None, one.position)
            for one in vehicle.bodies
        ),
        links=tuple(links),
        wheels=tuple(
            Wheel(one.name, (one.roll_inertia or 0.0) / square, one.position)
            for one in vehicle.wheels
        ),
        source=vehicle.source,
        parameters=tuple(
            felt
            for one in vehicle.parameters
            if (felt := _felt_in_roll(one, [link.name for link in links]))
        ),
        contact_spacing=vehicle.contact_spacing,
    )
    try:
        parameter_values(found)
    except ModelError as error:
        raise ModelError(
            f"vehicle {vehicle.name!r}: links of different semi-spacings share a parameter, {error}; give each its own"
        ) from error
    return found


def rolling_wheels(vehicle: Vehicle) -> RollingVehicle:
    """The wheelsets alone, which on a rigid track roll as the rails make them."""
    return RollingVehicle(
        vehicle.name,
        bodies=(),
        links=(),
        wheels=tuple(Wheel(one.name, 0.0, one.position) for one in vehicle.wheels),
        source=vehicle.source,
        contact_spacing=vehicle.contact_spacing,
    )


def rolling_for(vehicle: Vehicle, track: PointTrack, sensors: Sequence[Sensor]) -> RollingVehicle:
    """The rolling car for such sensors: its wheelsets alone where these are all that is needed and known.

    Raises
    ------
    ModelError
        As of :func:`rolling`.
    """
    wheels = {wheel.name for wheel in vehicle.wheels}
    alone = isinstance(track, RigidTrack) and all(one.body in wheels for one in sensors)
    return rolling_wheels(vehicle) if alone and roll_unknowns(vehicle, track) else rolling(vehicle)


def rolling_track(track: PointTrack) -> PointTrack:
    """What the rolling car stands on: half of k_t under each rail makes k_t w²/4 in roll, and k_t/4 over w².

    Examples
    --------
    >>> from trackprofile.models.track import ElasticTrack
    >>> rolling_track(ElasticTrack(88e6, 36e3)).stiffness
    22000000.0
    """
    if isinstance(track, RigidTrack):
        return track
    coupling = track.coupling
    if coupling is not None:
        quarters = (
            tuple(0.25 * one for one in row)
            for row in (coupling.stiffness, coupling.damping, coupling.mass)
        )
        coupling = Coupling(coupling.distance, *quarters)
    return replace(
        track, stiffness=0.25 * track.stiffness, damping=0.25 * track.damping, mass=0.25 * track.mass, coupling=coupling
    )  # fmt: skip


@dataclass(frozen=True)
class SensorPair:
    """Two accelerometers, by their numbers, of one cross-section: a_L = h + y_L φ̈, a_R = h + y_R φ̈.

    Parameters
    ----------
    left, right : numbers of the sensors
    reach : y_L, y_R, m, above 0 and below 0
    """

    left: int
    right: int
    reach: tuple[float, float]

    @property
    def of_mean(self) -> Array:
        """Weights of the two in h: -y_R/(y_L - y_R) and y_L/(y_L - y_R)."""
        left, right = self.reach
        return np.array([-right, left]) / (left - right)

    @property
    def of_difference(self) -> Array:
        """Shares of a_L - a_R in what the two read beyond h: y_L/(y_L - y_R) and y_R/(y_L - y_R)."""
        left, right = self.reach
        return np.array([left, right]) / (left - right)


def sensor_pairs(sensors: Sequence[Sensor]) -> tuple[SensorPair, ...]:
    """Accelerometers left and right of the same body, at the same place along it and with the same bandwidth.

    Examples
    --------
    >>> left = Sensor("a", VERTICAL_ACCELERATION, "wheel 1", lateral=1.0)
    >>> right = Sensor("b", VERTICAL_ACCELERATION, "wheel 1", lateral=-1.0)
    >>> pairs_of([right, left])
    (Pair(left=1, right=0, reach=(1.0, -1.0)),)
    """
    pairs: list[SensorPair] = []
    taken: set[int] = set()
    for i, one in enumerate(sensors):
        for j, other in enumerate(sensors):
            if not {i, j} & taken and _opposite(one, other):
                pairs.append(SensorPair(i, j, (one.lateral, other.lateral)))
                taken |= {i, j}
    return tuple(pairs)


def mean_of(left: Sensor, right: Sensor, pair: SensorPair) -> Sensor:
    """What reads the heave that the two of a pair feel."""
    return replace(
        _together(left, right, pair.of_mean), name=f"mean of {left.name} and {right.name}"
    )


def difference_of(left: Sensor, right: Sensor, pair: SensorPair, contact_spacing: float) -> Sensor:
    """What reads the roll that the two of a pair feel, on the rolling car: a_L - a_R = (y_L - y_R)/w ü."""
    gain = left.gain_along * (pair.reach[0] - pair.reach[1]) / contact_spacing
    both = _together(left, right, np.array([1.0, -1.0]))
    return replace(both, name=f"{left.name} - {right.name}", gain=gain, tilt=0.0, residual=None)


def roll_rate_of(sensor: Sensor, contact_spacing: float) -> Sensor:
    """A roll rate sensor as the rolling car has it: φ̇ = u̇/w."""
    return replace(sensor, lateral=0.0, gain=sensor.gain / contact_spacing)


def shared_noise(left: Sensor, right: Sensor, pair: SensorPair) -> float:
    """Correlation of the noise of a pair's mean and difference: 0 where both sides are alike.

    Sides of which only one states its noise, or none, are taken to be alike.
    """
    if left.noise_density is None or right.noise_density is None:
        powers = np.ones(2)
    else:
        powers = np.square([left.noise_density, right.noise_density])
    mean, difference = pair.of_mean, np.array([1.0, -1.0])
    cross = np.sum(mean * difference * powers)
    return float(cross / np.sqrt(np.sum(mean**2 * powers) * np.sum(difference**2 * powers)))


@dataclass(frozen=True)
class RailMode:
    """Sensors that read one of the two motions, and how each comes about from those on board.

    Parameters
    ----------
    sensors : as the car, or the rolling car, has them
    weights : (on board, sensors), of the readings
    shares : (sensors, on board), of its readings in those of the sensors on board
    """

    sensors: tuple[Sensor, ...]
    weights: Array
    shares: Array

    def only(self, wanted: Sequence[bool]) -> RailMode:
        """Some of the sensors."""
        kept = np.flatnonzero(wanted)
        return RailMode(
            tuple(self.sensors[i] for i in kept), self.weights[:, kept], self.shares[kept]
        )


def rail_modes(
    sensors: Sequence[Sensor], pairs: Sequence[SensorPair], contact_spacing: float
) -> tuple[RailMode, RailMode]:
    """What reads the mean of both rails, and what reads their difference.

    Examples
    --------
    >>> sides = [Sensor(name, VERTICAL_ACCELERATION, "wheel 1", lateral=y, noise_density=1.0)
    ...     for name, y in (("a", 0.9), ("b", -0.9))]
    >>> mean, difference = halves_of(sides, pairs_of(sides), 1.5)
    >>> mean.weights.T, round(mean.sensors[0].noise_density, 3)
    (array([[0.5, 0.5]]), 0.707)
    >>> difference.weights.T, round(difference.sensors[0].noise_density, 3), difference.sensors[0].gain
    (array([[ 1., -1.]]), 1.414, 1.2)
    """
    of = {pair.left: pair for pair in pairs}
    rights = {pair.right for pair in pairs}
    alone = np.eye(len(sensors))
    mean, difference = list[_Reading](), list[_Reading]()
    for i, one in enumerate(sensors):
        if one.quantity == ROLL_RATE:
            difference.append((roll_rate_of(one, contact_spacing), alone[i], alone[i]))
        elif i in of:
            pair, other = of[i], sensors[of[i].right]
            sides = alone[[i, pair.right]]
            mean.append((mean_of(one, other, pair), pair.of_mean @ sides, np.sum(sides, axis=0)))
            apart = difference_of(one, other, pair, contact_spacing)
            difference.append((apart, sides[0] - sides[1], pair.of_difference @ sides))
        elif i not in rights:
            mean.append((one, alone[i], alone[i]))
    return _half(mean, len(sensors)), _half(difference, len(sensors))


_Reading = tuple[Sensor, Array, Array]


def _half(parts: Sequence[_Reading], count: int) -> RailMode:
    """Of sensors, each with its weights and shares, (on board,)."""
    weights, shares = (np.array([one[k] for one in parts]).reshape(-1, count) for k in (1, 2))
    return RailMode(tuple(one[0] for one in parts), weights.T, shares)


def _opposite(left: Sensor, right: Sensor) -> bool:
    alike = (left.quantity, left.body) == (right.quantity, right.body)
    beside = abs(left.position - right.position) <= SAME_PLACE
    sides = left.lateral > 0.0 > right.lateral
    same = _same_bandwidth(left.bandwidth, right.bandwidth)
    return left.quantity == VERTICAL_ACCELERATION and alike and beside and sides and same


def _same_bandwidth(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= SAME_BANDWIDTH * other


def _together(left: Sensor, right: Sensor, weights: Array) -> Sensor:
    """A sensor that reads a weighted sum of two, whose noises, flickers, offsets and drifts are independent."""

    def root(one: float, other: float) -> float:
        return float(np.hypot(weights[0] * one, weights[1] * other))

    noise = None
    if left.noise_density is not None and right.noise_density is not None:
        noise = root(left.noise_density, right.noise_density)
    return replace(
        left,
        position=0.5 * (left.position + right.position),
        lateral=0.0,
        noise_density=noise,
        offset=root(left.offset_standard_deviation, right.offset_standard_deviation),
        drift=root(left.drift_rate, right.drift_rate),
        flicker=root(left.flicker or 0.0, right.flicker or 0.0) or None,
    )


def _felt_in_roll(parameter: VehicleParameter, links: Sequence[str]) -> VehicleParameter | None:
    """The parameter with the fields of the rolling car that it stands for; None where roll does not feel it."""
    used_by = list[tuple[str, str]]()
    for part, field in parameter.used_by:
        if field == "roll_inertia":
            used_by.append((part, "mass"))
        elif field == "roll_stiffness" and part + BAR in links:
            used_by.append((part + BAR, "stiffness"))
        elif field in {"stiffness", "damping", "position"}:
            used_by.append((part, field))
    return replace(parameter, used_by=tuple(used_by)) if used_by else None

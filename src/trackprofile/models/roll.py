"""Roll of a car on the cross level, described by an equivalent vehicle that heaves, and its sensors.

A car that is symmetric about its vertical longitudinal plane has two uncoupled motions: heave and pitch are excited by
the mean of both rails, roll by their difference, the cross level c = r_L - r_R. With w the distance between the contact
points of a wheelset and u = w φ, the u of a wheelset is the cross level under it, and the equation of roll

    I/w² ü + Σ (c b²/w²) (u̇ - u̇_below) + Σ ((k b² + k_φ)/w²) (u - u_below) = 0

is the equation of heave of a vehicle with the masses I/w² and the springs (k b² + k_φ)/w², where b is the semi-spacing
of springs and dampers and k_φ the stiffness of an anti-roll bar (theory, section 13). All functions for heave therefore
apply to roll. Neglected: the lateral motion coupled to roll where a centre of gravity lies above its springs.
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

POSITION_TOLERANCE = 0.05
"""Maximum longitudinal distance between the two sensors of a pair, m."""

BANDWIDTH_TOLERANCE = 0.01
"""Maximum relative difference between the bandwidths of the two sensors of a pair."""

ANTI_ROLL_BAR_SUFFIX = " anti-roll bar"
"""Suffix of the name of the link that represents a link's anti-roll bar."""


@dataclass(frozen=True)
class RollVehicle(Vehicle):
    """A vehicle whose heave is the roll of another: u = w φ in m, with w its ``contact_spacing``."""

    def __post_init__(self) -> None:
        """Skip the checks of `Vehicle`: the vehicle that it is built from has passed them."""


def missing_roll_parameters(vehicle: Vehicle, track: PointTrack) -> tuple[str, ...]:
    """The parameters that a vehicle lacks for its roll to be modelled, such as ``roll_inertia of 'body'``.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> missing_roll_parameters(read_vehicle("quarter-car")[0], RigidTrack())[:2]
    ("roll_inertia of 'body'", "roll_inertia of 'bogie'")
    """
    moving = [*vehicle.bodies, *([] if isinstance(track, RigidTrack) else vehicle.wheels)]
    return (
        *(f"roll_inertia of {one.name!r}" for one in moving if one.roll_inertia is None),
        *(f"semi_spacing of {one.name!r}" for one in vehicle.links if one.semi_spacing is None),
    )


def roll_vehicle(vehicle: Vehicle) -> RollVehicle:
    """The vehicle whose heave is the roll of the given one, with those of its parameters that affect roll.

    Raises
    ------
    ModelError
        Where a roll inertia or a semi-spacing is missing, or links of different semi-spacings share a parameter.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> manchester, _ = read_vehicle("manchester-benchmark")
    >>> roll_vehicle(manchester).body("body").mass * 1.5**2  # its roll inertia, kg m²
    56800.0
    """
    unknown = missing_roll_parameters(vehicle, RigidTrack())
    if unknown:
        raise ModelError(f"vehicle {vehicle.name!r} does not state {', '.join(unknown)}; add them")
    square = vehicle.contact_spacing**2
    links: list[Link] = []
    for link in vehicle.links:
        share = (link.semi_spacing or 0.0) ** 2 / square
        ends = (link.upper, link.lower, link.position)
        links.append(Link(link.name, *ends, share * link.stiffness, share * link.damping))
        if link.roll_stiffness > 0.0:
            # A separate link, so that a factor on the bar's parameter scales the bar's stiffness only.
            links.append(
                Link(link.name + ANTI_ROLL_BAR_SUFFIX, *ends, link.roll_stiffness / square, 0.0)
            )
    result = RollVehicle(
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
            parameter
            for one in vehicle.parameters
            if (parameter := _roll_parameter(one, [link.name for link in links]))
        ),
        contact_spacing=vehicle.contact_spacing,
    )
    try:
        parameter_values(result)
    except ModelError as error:
        raise ModelError(
            f"vehicle {vehicle.name!r}: links of different semi-spacings share a parameter, {error}; give each its own"
        ) from error
    return result


def roll_wheelsets(vehicle: Vehicle) -> RollVehicle:
    """The roll vehicle reduced to its wheelsets, whose roll on a rigid track is that of the rails."""
    return RollVehicle(
        vehicle.name,
        bodies=(),
        links=(),
        wheels=tuple(Wheel(one.name, 0.0, one.position) for one in vehicle.wheels),
        source=vehicle.source,
        contact_spacing=vehicle.contact_spacing,
    )


def roll_vehicle_for_sensors(
    vehicle: Vehicle, track: PointTrack, sensors: Sequence[Sensor]
) -> RollVehicle:
    """The roll vehicle for given sensors; only its wheelsets where nothing else is needed or known.

    Raises
    ------
    ModelError
        As for :func:`roll_vehicle`.
    """
    wheels = {wheel.name for wheel in vehicle.wheels}
    wheelsets_suffice = isinstance(track, RigidTrack) and all(one.body in wheels for one in sensors)
    if wheelsets_suffice and missing_roll_parameters(vehicle, track):
        return roll_wheelsets(vehicle)
    return roll_vehicle(vehicle)


def roll_track(track: PointTrack) -> PointTrack:
    """The track under the roll vehicle: k_t/2 under each rail makes k_t w²/4 in roll, which is k_t/4 for u = w φ.

    Examples
    --------
    >>> from trackprofile.models.track import ElasticTrack
    >>> roll_track(ElasticTrack(88e6, 36e3)).stiffness
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
    """Two accelerometers in one cross-section: a_L = h + y_L φ̈ and a_R = h + y_R φ̈, with heave h and roll φ.

    Parameters
    ----------
    left, right : indices of the sensors
    lateral : y_L above 0 and y_R below 0, m
    """

    left: int
    right: int
    lateral: tuple[float, float]

    @property
    def mean_weights(self) -> Array:
        """Weights of the two readings in the heave h, (2,): -y_R/(y_L - y_R) and y_L/(y_L - y_R)."""
        left, right = self.lateral
        return np.array([-right, left]) / (left - right)

    @property
    def difference_shares(self) -> Array:
        """Shares of a_L - a_R in the two readings minus h, (2,): y_L/(y_L - y_R) and y_R/(y_L - y_R)."""
        left, right = self.lateral
        return np.array([left, right]) / (left - right)


def sensor_pairs(sensors: Sequence[Sensor]) -> tuple[SensorPair, ...]:
    """Pairs of accelerometers left and right on one body, at the same longitudinal position, with equal bandwidth.

    Examples
    --------
    >>> left = Sensor("a", VERTICAL_ACCELERATION, "wheel 1", lateral=1.0)
    >>> right = Sensor("b", VERTICAL_ACCELERATION, "wheel 1", lateral=-1.0)
    >>> sensor_pairs([right, left])
    (SensorPair(left=1, right=0, lateral=(1.0, -1.0)),)
    """
    pairs: list[SensorPair] = []
    paired: set[int] = set()
    for i, one in enumerate(sensors):
        for j, other in enumerate(sensors):
            if not {i, j} & paired and _opposite(one, other):
                pairs.append(SensorPair(i, j, (one.lateral, other.lateral)))
                paired |= {i, j}
    return tuple(pairs)


def mean_sensor(left: Sensor, right: Sensor, pair: SensorPair) -> Sensor:
    """The virtual sensor of a pair that measures heave."""
    return replace(
        _combined(left, right, pair.mean_weights), name=f"mean of {left.name} and {right.name}"
    )


def difference_sensor(
    left: Sensor, right: Sensor, pair: SensorPair, contact_spacing: float
) -> Sensor:
    """The virtual sensor of a pair that measures roll, on the roll vehicle: a_L - a_R = (y_L - y_R)/w ü."""
    gain = left.effective_gain * (pair.lateral[0] - pair.lateral[1]) / contact_spacing
    both = _combined(left, right, np.array([1.0, -1.0]))
    return replace(both, name=f"{left.name} - {right.name}", gain=gain, tilt=0.0, residual=None)


def roll_rate_sensor(sensor: Sensor, contact_spacing: float) -> Sensor:
    """A roll rate sensor expressed on the roll vehicle: φ̇ = u̇/w."""
    return replace(sensor, lateral=0.0, gain=sensor.gain / contact_spacing)


def noise_correlation(left: Sensor, right: Sensor, pair: SensorPair) -> float:
    """Correlation of the noise of a pair's mean and difference; 0 where both sensors have equal noise.

    Equal noise is assumed where one or both sensors state none.
    """
    if left.noise_density is None or right.noise_density is None:
        powers = np.ones(2)
    else:
        powers = np.square([left.noise_density, right.noise_density])
    mean, difference = pair.mean_weights, np.array([1.0, -1.0])
    cross = np.sum(mean * difference * powers)
    return float(cross / np.sqrt(np.sum(mean**2 * powers) * np.sum(difference**2 * powers)))


@dataclass(frozen=True)
class RailMode:
    """Virtual sensors of one of the two rail modes (mean or difference), and their relation to those on board.

    Parameters
    ----------
    sensors : virtual sensors, on the vehicle (mean) or on the roll vehicle (difference)
    weights : (on board, sensors), weights of the readings on board in the virtual readings
    shares : (sensors, on board), shares of the virtual readings in the readings on board
    """

    sensors: tuple[Sensor, ...]
    weights: Array
    shares: Array

    def select(self, selected: Sequence[bool]) -> RailMode:
        """The same mode with some of its sensors.

        Parameters
        ----------
        selected : one flag per sensor
        """
        kept = np.flatnonzero(selected)
        return RailMode(
            tuple(self.sensors[i] for i in kept), self.weights[:, kept], self.shares[kept]
        )


def rail_modes(
    sensors: Sequence[Sensor], pairs: Sequence[SensorPair], contact_spacing: float
) -> tuple[RailMode, RailMode]:
    """The virtual sensors of the mean of both rails, and those of their difference.

    Examples
    --------
    >>> sides = [Sensor(name, VERTICAL_ACCELERATION, "wheel 1", lateral=y, noise_density=1.0)
    ...     for name, y in (("a", 0.9), ("b", -0.9))]
    >>> mean, difference = rail_modes(sides, sensor_pairs(sides), 1.5)
    >>> mean.weights.T, round(mean.sensors[0].noise_density, 3)
    (array([[0.5, 0.5]]), 0.707)
    >>> difference.weights.T, round(difference.sensors[0].noise_density, 3), difference.sensors[0].gain
    (array([[ 1., -1.]]), 1.414, 1.2)
    """
    pair_of_left = {pair.left: pair for pair in pairs}
    rights = {pair.right for pair in pairs}
    unit = np.eye(len(sensors))
    mean, difference = list[_Reading](), list[_Reading]()
    for i, one in enumerate(sensors):
        if one.quantity == ROLL_RATE:
            difference.append((roll_rate_sensor(one, contact_spacing), unit[i], unit[i]))
        elif i in pair_of_left:
            pair, other = pair_of_left[i], sensors[pair_of_left[i].right]
            sides = unit[[i, pair.right]]
            mean.append(
                (mean_sensor(one, other, pair), pair.mean_weights @ sides, np.sum(sides, axis=0))
            )
            virtual = difference_sensor(one, other, pair, contact_spacing)
            difference.append((virtual, sides[0] - sides[1], pair.difference_shares @ sides))
        elif i not in rights:
            mean.append((one, unit[i], unit[i]))
    return _rail_mode(mean, len(sensors)), _rail_mode(difference, len(sensors))


_Reading = tuple[Sensor, Array, Array]
"""A virtual sensor, its weights (on board,) and its shares (on board,)."""


def _rail_mode(parts: Sequence[_Reading], count: int) -> RailMode:
    weights, shares = (np.array([one[k] for one in parts]).reshape(-1, count) for k in (1, 2))
    return RailMode(tuple(one[0] for one in parts), weights.T, shares)


def _opposite(left: Sensor, right: Sensor) -> bool:
    same_body = (left.quantity, left.body) == (right.quantity, right.body)
    same_position = abs(left.position - right.position) <= POSITION_TOLERANCE
    both_sides = left.lateral > 0.0 > right.lateral
    same_bandwidth = _same_bandwidth(left.bandwidth, right.bandwidth)
    accelerometers = left.quantity == VERTICAL_ACCELERATION
    return accelerometers and same_body and same_position and both_sides and same_bandwidth


def _same_bandwidth(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= BANDWIDTH_TOLERANCE * other


def _combined(left: Sensor, right: Sensor, weights: Array) -> Sensor:
    """A sensor that reads a weighted sum of two sensors with independent noise, flicker, offset and drift."""

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


def _roll_parameter(parameter: VehicleParameter, links: Sequence[str]) -> VehicleParameter | None:
    """The parameter with the corresponding fields of the roll vehicle; None where it does not affect roll."""
    used_by = list[tuple[str, str]]()
    for part, field in parameter.used_by:
        if field == "roll_inertia":
            used_by.append((part, "mass"))
        elif field == "roll_stiffness" and part + ANTI_ROLL_BAR_SUFFIX in links:
            used_by.append((part + ANTI_ROLL_BAR_SUFFIX, "stiffness"))
        elif field in {"stiffness", "damping", "position"}:
            used_by.append((part, field))
    return replace(parameter, used_by=tuple(used_by)) if used_by else None

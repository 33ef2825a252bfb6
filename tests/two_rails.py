"""A car on two rails, for tests: heave, pitch and roll, every spring by itself, in the frequency domain.

Nothing of the package's assembly, state space or roll is used. Left and right are never added or subtracted here: each
spring stands at its own place in space and pulls at two bodies, each wheel stands on its own rail, and each sensor
reads what its own place does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from narrowing import floats
from trackprofile.contracts import Channel
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import ElasticTrack, RigidTrack
from trackprofile.models.vehicle import Body, Link, Vehicle, Wheel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
HEAVE, PITCH, ROLL = range(3)

WAGON = Vehicle(
    "two-axle wagon",
    bodies=(Body("body", 20e3, 1.8e5, 3.0, roll_inertia=3e4),),
    wheels=(
        Wheel("wheel 1", 1300.0, 0.0, roll_inertia=800.0),
        Wheel("wheel 2", 1300.0, 6.0, roll_inertia=800.0),
    ),
    links=tuple(
        Link(f"suspension {i}", "body", f"wheel {i}", at, 1e6, 4e4, semi_spacing=1.0, roll_stiffness=2e5)
        for i, at in ((1, 0.0), (2, 6.0))
    ),
)  # fmt: skip


def row(vehicle: Vehicle, part: str, behind: float, left: float) -> Array:
    """What moves a point of a part up: its heave, pitch (nose up) and roll (left side up)."""
    parts = [*vehicle.bodies, *vehicle.wheels]
    number = next(i for i, one in enumerate(parts) if one.name == part)
    found = np.zeros((len(parts), 3))
    found[number] = 1.0, parts[number].position - behind, left
    return found.ravel()


def response(
    vehicle: Vehicle, track: RigidTrack | ElasticTrack, sensors: Sequence[Sensor], omega: Array, speed: float
) -> ComplexArray:  # fmt: skip
    """Of each sensor to a unit wave under the leading left and the leading right wheel, (waves, sensors, 2)."""
    s = np.asarray(1j * omega * speed, np.complex128)
    M, C, K = _matrices(vehicle)
    dynamic = s[:, None, None] ** 2 * M + s[:, None, None] * C + K
    load = np.zeros((len(omega), len(M), 2), complex)
    touches = []
    for wheel in vehicle.wheels:
        under = np.exp(-1j * omega * wheel.position)
        for side, left in enumerate((0.5, -0.5)):
            touch = row(vehicle, wheel.name, wheel.position, left * vehicle.contact_spacing)
            touches.append((touch, side, under))
    if isinstance(track, ElasticTrack):
        contact = 0.5 * (track.stiffness + s * track.damping + s**2 * track.mass)
        for touch, side, under in touches:
            dynamic += contact[:, None, None] * np.outer(touch, touch)
            load[:, :, side] += (contact * under)[:, None] * touch
        q = np.asarray(np.linalg.solve(dynamic, load), np.complex128)
    else:
        q = _held(vehicle, dynamic, touches)
    return np.stack([_read(vehicle, one, s, q) for one in sensors], axis=1)


def _matrices(vehicle: Vehicle) -> tuple[Array, Array, Array]:
    parts = [*vehicle.bodies, *vehicle.wheels]
    size = 3 * len(parts)
    M, C, K = np.zeros((3, size, size))
    for i, part in enumerate(parts):
        # A wheelset does not pitch: some inertia, which nothing moves.
        inertias = (part.mass, getattr(part, "pitch_inertia", 1.0), part.roll_inertia)
        M[range(3 * i, 3 * i + 3), range(3 * i, 3 * i + 3)] = inertias
    for link in vehicle.links:
        assert link.semi_spacing is not None
        for left in (link.semi_spacing, -link.semi_spacing):
            upper, lower = (row(vehicle, x, link.position, left) for x in (link.upper, link.lower))
            K += 0.5 * link.stiffness * np.outer(upper - lower, upper - lower)
            C += 0.5 * link.damping * np.outer(upper - lower, upper - lower)
        twist = np.zeros(size)
        twist[3 * [one.name for one in parts].index(link.upper) + ROLL] = 1.0
        twist[3 * [one.name for one in parts].index(link.lower) + ROLL] = -1.0
        K += link.roll_stiffness * np.outer(twist, twist)
    for i in range(len(vehicle.bodies), len(parts)):
        # ... so that the spring's lever on it is taken off.
        for matrix in (C, K):
            matrix[3 * i + PITCH] = matrix[:, 3 * i + PITCH] = 0.0
    return M, C, K


def _held(
    vehicle: Vehicle, dynamic: ComplexArray, touches: Sequence[tuple[Array, int, ComplexArray]]
) -> ComplexArray:
    """The wheels held on their rails: their motion is what puts each contact where its rail is."""
    size = dynamic.shape[1]
    free = np.arange(3 * len(vehicle.bodies))
    held = np.setdiff1d(np.arange(size), free)
    moving = held[held % 3 != PITCH]
    contacts = np.array([touch for touch, _, _ in touches])
    onto = np.linalg.inv(contacts[:, moving])
    q = np.zeros((len(dynamic), size, 2), complex)
    for number, (_, side, under) in enumerate(touches):
        q[:, moving, side] += under[:, None] * onto[:, number]
    push = -dynamic[:, free[:, None], moving] @ q[:, moving]
    q[:, free] = np.linalg.solve(dynamic[:, free[:, None], free], push)
    return q


def _read(vehicle: Vehicle, sensor: Sensor, s: ComplexArray, q: ComplexArray) -> ComplexArray:
    parts = [*vehicle.bodies, *vehicle.wheels]
    number = next(i for i, one in enumerate(parts) if one.name == sensor.body)
    if sensor.quantity == "vertical acceleration":
        at = parts[number].position - sensor.position
        where = row(vehicle, sensor.body, at, sensor.lateral)
        return s[:, None] ** 2 * np.einsum("i,wir->wr", where, q)
    turn = PITCH if sensor.quantity == "pitch rate" else ROLL
    return s[:, None] * q[:, 3 * number + turn]


@dataclass(frozen=True)
class Ridden:
    """Both rails (samples, 2) under the leading wheels, and what is read there, (samples, sensors)."""

    distance: Array
    rails: Array
    signals: Array


def ride(
    vehicle: Vehicle, track: RigidTrack | ElasticTrack, sensors: Sequence[Sensor], speed: float,
    sampling: float, waves: ComplexArray, samples: int,
) -> Ridden:  # fmt: skip
    """The first ``samples`` of a ride over rails whose waves, (waves, 2) as of numpy.fft.rfft, are given."""
    between, whole = speed / sampling, 2 * (len(waves) - 1)
    omega = 2 * np.pi * np.fft.rfftfreq(whole, between)
    there = np.flatnonzero(np.any(waves != 0.0, axis=1))
    spectra = np.zeros((len(omega), len(sensors)), complex)
    for some in np.array_split(there, max(1, len(there) // 2000)):
        H = response(vehicle, track, sensors, floats(omega[some]), speed)
        spectra[some] = np.einsum("wsr,wr->ws", H, waves[some])
    return Ridden(
        floats(between * np.arange(samples)),
        np.fft.irfft(waves, whole, axis=0)[:samples],
        np.fft.irfft(spectra, whole, axis=0)[:samples],
    )


def random_rails(
    mean: Spectrum, cross_level: Spectrum, length: float, between: float,
    generator: np.random.Generator, shortest: float,
) -> ComplexArray:  # fmt: skip
    """Waves of two rails, over four times a length, whose mean and difference have those spectra and random phases."""
    whole = 4 * round(length / between / 2) * 2
    omega = 2 * np.pi * np.fft.rfftfreq(whole, between)
    there = (omega > 0) & (omega <= 2 * np.pi / shortest)
    parts = np.zeros((2, len(omega)), complex)
    for part, spectrum in zip(parts, (mean, cross_level), strict=True):
        turns = np.exp(2j * np.pi * generator.random(int(there.sum())))
        part[there] = (
            0.5 * whole * np.sqrt(2 * spectrum.density(floats(omega[there])) * omega[1]) * turns
        )
    return np.stack([parts[0] + 0.5 * parts[1], parts[0] - 0.5 * parts[1]], axis=1)


def recorded(
    sensors: Sequence[Sensor], signals: Array, sampling: float, generator: np.random.Generator
) -> list[Channel]:
    """Channels with the sensors' white noise and an offset each."""
    channels = []
    for i, one in enumerate(sensors):
        assert one.noise_density is not None
        noise = one.noise_density * np.sqrt(sampling / 2) * generator.standard_normal(len(signals))
        offset = 0.3 * one.offset_standard_deviation * generator.standard_normal()
        channels.append(
            Channel(
                one.name, signals[:, i] + noise + offset, one.quantity, one.body, one.position, one.noise_density,
                lateral=one.lateral,
            )
        )  # fmt: skip
    return channels

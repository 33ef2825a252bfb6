"""State-space model of a vehicle and its sensors on the paths of its wheels, discretised exactly for any time step.

    ẋ = A x + B [z; ż; z̈],    y = C x + D [z; ż; z̈],    z_i(t) = r(s(t) - d_i)

x = [q; q̇; w; e; l; p; offsets]: the free degrees of freedom q, the filter states w of the first body's unmodelled
accelerations, and of the sensors the coloured residuals e, the low-pass states l of those with a bandwidth, the flicker
processes p and the offsets; z_i is the path of wheel i.

The smoother and the calibration use this model. The full coupled model (`trackprofile.simulation`) is written
separately, so that each verifies the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.models.flicker_noise import flicker_processes
from trackprofile.models.roll import RollVehicle
from trackprofile.models.sensor import PITCH_RATE, ROLL_RATE, Sensor
from trackprofile.models.track import ElasticTrack, PointTrack, RigidTrack, wheel_matrices
from trackprofile.models.vehicle import HEAVE, PITCH, Assembly, Vehicle, assemble, displacement_row

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

UNMODELLED_DAMPING = 0.2
"""Damping ratio of the filter that shapes unmodelled accelerations around the body's natural frequencies."""

FILTER_STATES = 2
"""Number of states of one second-order filter (unmodelled acceleration, residual or low-pass)."""


@dataclass(frozen=True)
class StateSpace:
    """State-space model of a vehicle on a track with its sensors.

    Parameters
    ----------
    freedoms : the f free degrees of freedom, (part, motion)
    A : (n, n), n = 2 f + u + e + l + p + sensors; states are q (m, rad), q̇ (m/s, rad/s), those of the unmodelled
        accelerations (m/s², rad/s²), of the residuals, the low-passes, the flicker and the offsets (sensor's unit)
    B : (n, 3, wheels), for z in m, ż in m/s and z̈ in m/s²
    C : (sensors, n)
    D : (sensors, 3, wheels), for z, ż and z̈
    disturbance : (n, inputs), input matrix of independent white noises of unit intensity; no columns where the model
        is assumed exact
    wheel_positions : (wheels,), distance behind the leading wheel, m
    flicker : (p,), stationary variances of the flicker states, sensor's unit squared
    """

    freedoms: tuple[tuple[str, str], ...]
    A: Array
    B: Array
    C: Array
    D: Array
    disturbance: Array
    wheel_positions: Array
    flicker: Array


def state_space(
    vehicle: Vehicle,
    track: PointTrack,
    sensors: Sequence[Sensor],
    unmodelled: float = 0.0,
    signal_rms: Sequence[float] = (),
) -> StateSpace:
    """The state-space model of a vehicle on a rigid or elastic track.

    On a :class:`RigidTrack` the wheels follow their paths; on an :class:`ElasticTrack` each wheel is a degree of
    freedom w with the force k_t (z - w) + c_t (ż - ẇ) + m_t (z̈ - ẅ) (theory, section 7).

    Parameters
    ----------
    vehicle, track, sensors : the models; one row of C and D per sensor
    unmodelled : standard deviation of the acceleration that a rigid, linear car does not model, m/s²: random
        accelerations of the first body's heave, and of its pitch so that they are equal at the radius of gyration
        √(I/m). Friction, play and progressive springs act with the stroke of the suspension, so each acceleration is
        strongest around the natural frequency of the mode of its motion.
    signal_rms : (sensors,), root mean square of each signal, to which the residuals are proportional; empty: no
        residuals

    Raises
    ------
    ModelError
        Where a sensor names a part that the vehicle does not have, or a wheel on an elastic track has no mass.
    """
    model = _supported(vehicle, track)
    freedoms = tuple(model.assembly.degrees_of_freedom[i] for i in model.free)
    excited = _excited_freedoms(vehicle, freedoms) if unmodelled > 0.0 else []
    f, wheels = len(freedoms), len(vehicle.wheels)
    n = 2 * f + FILTER_STATES * len(excited)
    A, B = np.zeros((n, n)), np.zeros((n, 3, wheels))
    A[:f, f : 2 * f] = np.eye(f)
    A[f : 2 * f, : 2 * f] = -np.linalg.solve(model.M, np.hstack([model.K, model.C]))
    load = model.load
    B[f : 2 * f] = np.linalg.solve(model.M, load.reshape(f, 3 * wheels)).reshape(load.shape)
    disturbance = _add_unmodelled(A, excited, f, unmodelled)
    C, D = _sensor_matrices(vehicle, track, sensors, model, A, B)
    positions = np.array([wheel.position for wheel in vehicle.wheels])
    exact = StateSpace(freedoms, A, B, C, D, disturbance, positions, np.zeros(0))
    filtered = _with_low_passes(_with_residuals(exact, sensors, signal_rms), sensors)
    return _with_offsets(_with_flicker(filtered, sensors))


def _sensor_matrices(
    vehicle: Vehicle, track: PointTrack, sensors: Sequence[Sensor], model: _SupportedVehicle, A: Array, B: Array
) -> tuple[Array, Array]:  # fmt: skip
    """C and D of the sensors, without their noise and filters."""
    full, free, wheels = model.assembly, model.free, model.wheels
    f, n = len(free), len(A)
    C, D = np.zeros((len(sensors), n)), np.zeros((len(sensors), 3, len(wheels)))
    for row, sensor in enumerate(sensors):
        weights = _sensor_row(vehicle, full, sensor)
        if sensor.quantity in {PITCH_RATE, ROLL_RATE}:
            C[row, f : 2 * f] = weights[free]
            if isinstance(track, RigidTrack):
                D[row, 1] = weights[wheels]
        else:
            C[row], D[row] = (
                weights[free] @ A[f : 2 * f],
                np.einsum("i,ijk", weights[free], B[f : 2 * f]),
            )
            if isinstance(track, RigidTrack):
                D[row, 2] = weights[wheels]
    gain = np.array([one.effective_gain for one in sensors])
    return gain[:, None] * C, gain[:, None, None] * D


def transfer_function(system: StateSpace, spatial_frequency: Array, speed: float) -> ComplexArray:
    """Transfer functions from the profile under the leading wheel to each sensor's reading.

    H(Ω) = C (iω - A)⁻¹ B [1; iω; -ω²] e^{-iΩd} + D [1; iω; -ω²] e^{-iΩd},  ω = Ω v.

    Parameters
    ----------
    spatial_frequency : (m,), rad/m, above 0
    speed : m/s

    Returns
    -------
    (m, sensors), complex, sensor's unit per m
    """
    omega = spatial_frequency * speed
    states, paths = state_response(system, spatial_frequency, speed)
    derivatives = np.stack([np.ones_like(omega) + 0j, 1j * omega, -(omega**2) + 0j], axis=1)
    direct = np.einsum("sdw,md,mw->ms", system.D, derivatives, paths)
    return states @ system.C.T + direct


def state_response(
    system: StateSpace, spatial_frequency: Array, speed: float
) -> tuple[ComplexArray, ComplexArray]:
    """Transfer functions from the profile to the states, and the phase factors of the wheels' paths.

    Parameters
    ----------
    spatial_frequency : (m,), rad/m, above 0
    speed : m/s

    Returns
    -------
    states per metre of profile (m, n), and e^{-iΩd} of each wheel (m, wheels)
    """
    omega = spatial_frequency * speed
    paths = np.exp(-1j * np.outer(spatial_frequency, system.wheel_positions))
    derivatives = np.stack([np.ones_like(omega) + 0j, 1j * omega, -(omega**2) + 0j], axis=1)
    load = np.einsum("ndw,md,mw->mn", system.B, derivatives, paths)
    resolvent = 1j * omega[:, None, None] * np.eye(len(system.A)) - system.A
    return np.asarray(np.linalg.solve(resolvent, load[..., None])[..., 0], np.complex128), paths


@dataclass(frozen=True)
class _SupportedVehicle:
    """A vehicle on its track.

    ``free`` and ``wheels`` are indices into the assembly's degrees of freedom. M, K and C are those of the free ones
    (f, f); ``load`` (f, 3, wheels) is the load per z, ż and z̈ of each wheel's path.
    """

    assembly: Assembly
    free: list[int]
    wheels: list[int]
    M: Array
    K: Array
    C: Array
    load: Array


def _supported(vehicle: Vehicle, track: PointTrack) -> _SupportedVehicle:
    full = assemble(vehicle)
    wheels = [full.index(wheel.name, HEAVE) for wheel in vehicle.wheels]
    M = full.mass
    indices = list(range(len(full.degrees_of_freedom)))
    match track:
        case RigidTrack():
            free = [i for i in indices if i not in wheels]
            K, C = full.stiffness, full.damping
            inertia = np.zeros((len(free), len(wheels)))
            load = -np.stack([K[np.ix_(free, wheels)], C[np.ix_(free, wheels)], inertia], axis=1)
        case ElasticTrack():
            for wheel in vehicle.wheels:
                if not wheel.mass > 0:
                    raise ModelError(
                        f"vehicle {vehicle.name!r}: wheel {wheel.name!r} has no mass, which an elastic track needs; "
                        "give it a mass or use the rigid track"
                    )
            free = indices
            selection = np.zeros((len(free), len(wheels)))
            selection[wheels, range(len(wheels))] = 1.0
            positions = np.array([wheel.position for wheel in vehicle.wheels])
            load = np.einsum("fw,kwv->fkv", selection, wheel_matrices(track, positions))
            K = full.stiffness + load[:, 0] @ selection.T
            C = full.damping + load[:, 1] @ selection.T
            M = M + load[:, 2] @ selection.T
    square = np.ix_(free, free)
    return _SupportedVehicle(full, free, wheels, M[square], K[square], C[square], load)


def _sensor_row(vehicle: Vehicle, full: Assembly, sensor: Sensor) -> Array:
    """The row (n,) from all degrees of freedom to the sensor's displacement or pitch."""
    parts = [*(body.name for body in vehicle.bodies), *(wheel.name for wheel in vehicle.wheels)]
    if sensor.body not in parts:
        raise ModelError(
            f"sensor {sensor.name!r} is mounted on {sensor.body!r}, which vehicle {vehicle.name!r} does not have; "
            f"it has {', '.join(parts)}"
        )
    freedoms = full.degrees_of_freedom
    if sensor.quantity == ROLL_RATE and not isinstance(vehicle, RollVehicle):
        raise ModelError(
            f"sensor {sensor.name!r} measures roll, which a model of heave and pitch does not contain; omit the sensor"
        )
    if sensor.quantity == PITCH_RATE:
        if (sensor.body, PITCH) not in freedoms:
            raise ModelError(
                f"sensor {sensor.name!r} measures pitch, but {sensor.body!r} has no pitch degree of freedom"
            )
        row = np.zeros(len(freedoms))
        row[freedoms.index((sensor.body, PITCH))] = 1.0
        return row
    on_wheel = [wheel.position for wheel in vehicle.wheels if wheel.name == sensor.body]
    centre = on_wheel[0] if on_wheel else vehicle.body(sensor.body).position
    return displacement_row(vehicle, freedoms, sensor.body, centre - sensor.position)


def _with_low_passes(system: StateSpace, sensors: Sequence[Sensor]) -> StateSpace:
    """Add the Butterworth low-pass of each sensor with a bandwidth: l̇_1 = ω (y - l_2) - √2 ω l_1, l̇_2 = ω l_1."""
    rates = [(i, 2 * np.pi * one.bandwidth) for i, one in enumerate(sensors) if one.bandwidth]
    n, added = len(system.A), FILTER_STATES * len(rates)
    A, B, C, D = (
        np.pad(system.A, ((0, added), (0, added))),
        np.pad(system.B, ((0, added), (0, 0), (0, 0))),
        np.pad(system.C, ((0, 0), (0, added))),
        system.D.copy(),
    )
    for number, (sensor, rate) in enumerate(rates):
        first = n + FILTER_STATES * number
        A[first, :n], B[first] = rate * system.C[sensor], rate * system.D[sensor]
        A[first, first], A[first, first + 1] = -np.sqrt(2) * rate, -rate
        A[first + 1, first] = rate
        C[sensor], D[sensor] = 0.0, 0.0
        C[sensor, first + 1] = 1.0
    disturbance = np.pad(system.disturbance, ((0, added), (0, 0)))
    return replace(system, A=A, B=B, C=C, D=D, disturbance=disturbance)


def _with_residuals(
    system: StateSpace, sensors: Sequence[Sensor], signal_rms: Sequence[float]
) -> StateSpace:
    """Add each sensor's residual to its reading: ė_1 = -2ζω e_1 - ω e_2 + noise, ė_2 = ω e_1, y += e_1."""
    residuals = [
        (i, one.residual) for i, one in enumerate(sensors) if one.residual and len(signal_rms)
    ]
    n, inputs, added = len(system.A), system.disturbance.shape[1], FILTER_STATES * len(residuals)
    A, C = np.pad(system.A, ((0, added), (0, added))), np.pad(system.C, ((0, 0), (0, added)))
    disturbance = np.pad(system.disturbance, ((0, added), (0, len(residuals))))
    for number, (sensor, residual) in enumerate(residuals):
        first, rate = n + FILTER_STATES * number, 2 * np.pi * residual.frequency
        A[first, first] = -2 * residual.damping * rate
        A[first, first + 1], A[first + 1, first] = -rate, rate
        C[sensor, first] = 1.0
        deviation = residual.share * signal_rms[sensor]
        disturbance[first, inputs + number] = deviation * np.sqrt(4 * residual.damping * rate)
    B = np.pad(system.B, ((0, added), (0, 0), (0, 0)))
    return replace(system, A=A, B=B, C=C, disturbance=disturbance)


def _with_flicker(system: StateSpace, sensors: Sequence[Sensor]) -> StateSpace:
    """Add each sensor's 1/f noise to its reading: ṗ = -ω p + noise, y += p, one p per decade of frequency."""
    parts = [flicker_processes(sensor) for sensor in sensors]
    sensor_of_state = np.repeat(np.arange(len(sensors)), [len(one.rate) for one in parts])
    n, added = len(system.A), len(sensor_of_state)
    A, C = np.pad(system.A, ((0, added), (0, added))), np.pad(system.C, ((0, 0), (0, added)))
    states = n + np.arange(added)
    A[states, states] = -np.concatenate([one.rate for one in parts])
    C[sensor_of_state, states] = 1.0
    return replace(
        system, A=A, B=np.pad(system.B, ((0, added), (0, 0), (0, 0))), C=C,
        disturbance=np.pad(system.disturbance, ((0, added), (0, 0))),
        flicker=np.concatenate([one.variance for one in parts]),
    )  # fmt: skip


def _with_offsets(system: StateSpace) -> StateSpace:
    """Add one constant offset to each sensor's reading."""
    added = len(system.C)
    return replace(
        system,
        A=np.pad(system.A, ((0, added), (0, added))),
        B=np.pad(system.B, ((0, added), (0, 0), (0, 0))),
        C=np.hstack([system.C, np.eye(added)]),
        disturbance=np.pad(system.disturbance, ((0, added), (0, 0))),
    )


def _excited_freedoms(
    vehicle: Vehicle, freedoms: tuple[tuple[str, str], ...]
) -> list[tuple[int, float]]:
    """Freedoms of the first body with unmodelled accelerations, and their relative standard deviations."""
    body = vehicle.bodies[0]
    excited = [(freedoms.index((body.name, HEAVE)), 1.0)]
    if body.pitch_inertia is not None:
        radius = np.sqrt(body.pitch_inertia / body.mass)
        excited.append((freedoms.index((body.name, PITCH)), float(1.0 / radius)))
    return excited


def _add_unmodelled(A: Array, excited: list[tuple[int, float]], f: int, deviation: float) -> Array:
    """Add the unmodelled accelerations to A in place, and return their input matrix.

    ẇ_1 = -2ζω w_1 - ω w_2 + noise, ẇ_2 = ω w_1, q̈ += w_2.
    """
    frequencies = [_natural_frequency(A[: 2 * f, : 2 * f], freedom) for freedom, _ in excited]
    disturbance = np.zeros((len(A), len(excited)))
    for number, ((freedom, relative), rate) in enumerate(zip(excited, frequencies, strict=True)):
        first = 2 * f + FILTER_STATES * number
        A[first, first] = -2 * UNMODELLED_DAMPING * rate
        A[first, first + 1], A[first + 1, first] = -rate, rate
        A[f + freedom, first + 1] = 1.0
        # White noise of intensity 4ζω σ² gives both states the standard deviation σ.
        disturbance[first, number] = relative * deviation * np.sqrt(4 * UNMODELLED_DAMPING * rate)
    return disturbance


def _natural_frequency(A: Array, freedom: int) -> float:
    """|λ|, rad/s, of the mode in which a freedom has the largest share."""
    eigenvalues, modes = np.linalg.eig(A)
    displacements = modes[: len(A) // 2]
    shares = np.abs(displacements[freedom]) / np.linalg.norm(displacements, axis=0)
    return float(np.abs(eigenvalues[np.argmax(shares)]))

"""The vehicle on its wheels' paths as a linear system, discretised exactly for any step.

    ẋ = A x + B [z; ż; z̈],    y = C x + D [z; ż; z̈],    z_i(t) = r(s(t) - d_i)

x = [q; q̇; w; e; l; p; offsets]: the free degrees of freedom, the unmodelled accelerations of the first body, the
sensors' coloured residuals, the low-passes of those with a bandwidth, their flicker and their offsets; z_i is the path
of wheel i.
The smoother and the calibration run on it; the full coupled model is written apart, so that each checks the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from trackprofile.errors import ModelError
from trackprofile.models.flicker_noise import flicker_processes
from trackprofile.models.roll import RollVehicle
from trackprofile.models.sensor import PITCH_RATE, ROLL_RATE, Sensor
from trackprofile.models.track import ElasticTrack, PointTrack, RigidTrack, wheel_matrices
from trackprofile.models.vehicle import HEAVE, PITCH, Assembly, Vehicle, assemble, displacement_row

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

UNMODELLED_DAMPING = 0.2
"""Damping ratio of the filter that shapes unmodelled accelerations about the body's own frequencies."""

FILTER_STATES = 2
"""States of a second-order filter: of each freedom's unmodelled acceleration, and of each sensor's own."""


@dataclass(frozen=True)
class StateSpace:
    """A vehicle on a track, seen by its sensors.

    Parameters
    ----------
    freedoms : the f free degrees of freedom, (part, motion)
    A : (n, n), n = 2 f + u + e + l + p + sensors; states are q (m, rad), q̇ (m/s, rad/s), those of the unmodelled
        accelerations (m/s², rad/s²), of the residuals, the low-passes, the flicker and the offsets (sensor's unit)
    B : (n, 3, wheels), for z in m, ż in m/s and z̈ in m/s²
    C : (sensors, n); D : (sensors, 3, wheels), for z, ż and z̈
    disturbance : (n, kinds), multiplies independent white noises of unit intensity; no columns where the model
        is taken to be exact
    wheel_positions : (wheels,), m behind the leading wheel
    flicker : (p,), variances that the flicker's states keep, sensor's unit squared
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
    """The linear system of a vehicle on a rigid path or on per-wheel springs.

    On a :class:`RigidTrack` the wheels are their paths; on an :class:`ElasticTrack` each wheel is a degree of
    freedom pushed by k_t (z - w) + c_t (ż - ẇ) + m_t (z̈ - ẅ) (theory, section 7). ``unmodelled`` is the standard
    deviation, m/s², of what a rigid, linear car leaves out: random accelerations of the first body's heave, and of
    its pitch as much as makes the same at the radius of gyration √(I/m). Friction, play and progressive springs act
    with the stroke of the suspension, so each is strongest about the frequency of the mode in which it moves.
    ``signal_rms`` is each signal's root mean square, of which a residual is a share; empty: no residuals.

    Raises
    ------
    ModelError
        Where a sensor names no part of the vehicle, or a wheel without mass stands on a spring.
    """
    full = assemble(vehicle)
    wheels = [full.index(wheel.name, HEAVE) for wheel in vehicle.wheels]
    free, M, K, Cd, push = _supported(vehicle, track, full, wheels)
    freedoms = tuple(full.degrees_of_freedom[i] for i in free)
    shaken = _shaken(vehicle, freedoms) if unmodelled > 0.0 else []
    f, n = len(free), 2 * len(free) + FILTER_STATES * len(shaken)
    A, B = np.zeros((n, n)), np.zeros((n, 3, len(wheels)))
    A[:f, f : 2 * f] = np.eye(f)
    A[f : 2 * f, : 2 * f] = -np.linalg.solve(M, np.hstack([K, Cd]))
    B[f : 2 * f] = np.linalg.solve(M, push.reshape(f, 3 * len(wheels))).reshape(push.shape)
    disturbance = _shake(A, shaken, f, unmodelled)
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
    seen = np.array([one.effective_gain for one in sensors])
    C, D = seen[:, None] * C, seen[:, None, None] * D
    positions = np.array([wheel.position for wheel in vehicle.wheels])
    exact = StateSpace(freedoms, A, B, C, D, disturbance, positions, np.zeros(0))
    behind = _low_passed(_with_residuals(exact, sensors, signal_rms), sensors)
    return _with_offsets(_with_flicker(behind, sensors))


def transfer_function(system: StateSpace, spatial_frequency: Array, speed: float) -> ComplexArray:
    """Response of each sensor to a unit cosine of the profile under the leading wheel.

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
    """States (m, n) per metre of a unit harmonic profile, and the paths' phases (m, wheels)."""
    omega = spatial_frequency * speed
    paths = np.exp(-1j * np.outer(spatial_frequency, system.wheel_positions))
    derivatives = np.stack([np.ones_like(omega) + 0j, 1j * omega, -(omega**2) + 0j], axis=1)
    push = np.einsum("ndw,md,mw->mn", system.B, derivatives, paths)
    left = 1j * omega[:, None, None] * np.eye(len(system.A)) - system.A
    return np.asarray(np.linalg.solve(left, push[..., None])[..., 0], np.complex128), paths


def generator_matrix(system: StateSpace) -> Array:
    """The matrix G with d/dt [x; a] = G [x; a], a_j the j-th time derivative of the wheels' paths, j = 0..3.

    Between two samples each path is a cubic (as the profile's spline is between knots), so that exp(G t)
    moves the state exactly.

    Returns
    -------
    (n + 4 wheels, n + 4 wheels), the derivatives ordered by j, then wheel
    """
    n, wheels = len(system.A), len(system.wheel_positions)
    matrix = np.zeros((n + 4 * wheels, n + 4 * wheels))
    matrix[:n, :n] = system.A
    for j in range(3):
        matrix[:n, n + j * wheels : n + (j + 1) * wheels] = system.B[:, j]
        rows = slice(n + j * wheels, n + (j + 1) * wheels)
        matrix[rows, n + (j + 1) * wheels : n + (j + 2) * wheels] = np.eye(wheels)
    return matrix


@dataclass(frozen=True)
class StepTable:
    """The motion over every step t in 0..longest, as Taylor polynomials around evenly spaced nodes.

    ``motion`` (nodes, order, n, n + 4 wheels): the first n rows of exp(G t_i) Gᵏ / k!;
    ``noise`` (nodes, order, n, n): the same of Q(t) = ∫ e^(Aτ) d dᵀ e^(Aτ)ᵀ dτ, which the disturbances d add.
    """

    spacing: float
    motion: Array
    noise: Array


TAYLOR_ORDER = 13


def step_table(system: StateSpace, longest: float) -> StepTable:
    """Tabulate the motion over any step up to ``longest`` s, to round-off.

    Nodes lie so close that |λ| δ ≤ 1/4 for the fastest eigenvalue λ and the largest distance δ to a node:
    the first term left out is (1/4)¹³/13! = 2e-18 of the whole.
    """
    n = len(system.A)
    G = generator_matrix(system)
    fastest = np.max(np.abs(np.linalg.eigvals(system.A)))
    nodes = int(np.ceil(longest * fastest / 0.5)) + 1
    spacing = longest / max(nodes - 1, 1)
    powers = [np.eye(len(G))]
    for k in range(1, TAYLOR_ORDER):
        powers.append(powers[-1] @ G / k)
    motion = np.empty((nodes, TAYLOR_ORDER, n, len(G)))
    noise = np.zeros((nodes, TAYLOR_ORDER, n, n))
    intensity = system.disturbance @ system.disturbance.T
    step, stepped = expm(G * spacing), _noise_over(system.A, intensity, spacing)
    there, added = np.eye(len(G)), np.zeros((n, n))
    for i in range(nodes):
        for k, power in enumerate(powers):
            motion[i, k] = there[:n] @ power
        _noise_polynomial(system.A, intensity, added, noise[i])
        added = step[:n, :n] @ added @ step[:n, :n].T + stepped
        there = there @ step
    return StepTable(spacing, motion, noise)


def _noise_over(A: Array, intensity: Array, duration: float) -> Array:
    """∫ e^(Aτ) q e^(Aτ)ᵀ dτ over 0..duration, by the exponential of a block matrix (Van Loan 1978)."""
    n = len(A)
    block = np.block([[-A, intensity], [np.zeros((n, n)), A.T]])
    exponential = expm(block * duration)
    return np.asarray(exponential[n:, n:].T @ exponential[:n, n:], np.float64)


def _noise_polynomial(A: Array, intensity: Array, start: Array, out: Array) -> None:
    """Taylor coefficients of Q(t) around ``start``: Q' = A Q + Q Aᵀ + q."""
    out[0] = start
    for k in range(1, len(out)):
        product = A @ out[k - 1]
        out[k] = (product + product.T + (intensity if k == 1 else 0.0)) / k


def _supported(
    vehicle: Vehicle, track: PointTrack, full: Assembly, wheels: list[int]
) -> tuple[list[int], Array, Array, Array, Array]:
    """Free degrees of freedom, M, K and C over them, and the push (free, 3, wheels) of z, ż and z̈."""
    M = full.mass
    everything = list(range(len(full.degrees_of_freedom)))
    match track:
        case RigidTrack():
            free = [i for i in everything if i not in wheels]
            K, C = full.stiffness, full.damping
            on_free = np.zeros((len(free), len(wheels)))
            push = -np.stack([K[np.ix_(free, wheels)], C[np.ix_(free, wheels)], on_free], axis=1)
        case ElasticTrack():
            for wheel in vehicle.wheels:
                if not wheel.mass > 0:
                    raise ModelError(
                        f"vehicle {vehicle.name!r}: wheel {wheel.name!r} has no mass, so it cannot stand on an "
                        "elastic track; give it a mass or use the rigid track"
                    )
            free = everything
            on_wheels = np.zeros((len(free), len(wheels)))
            on_wheels[wheels, range(len(wheels))] = 1.0
            positions = np.array([wheel.position for wheel in vehicle.wheels])
            push = np.einsum("fw,kwv->fkv", on_wheels, wheel_matrices(track, positions))
            K = full.stiffness + push[:, 0] @ on_wheels.T
            C = full.damping + push[:, 1] @ on_wheels.T
            M = M + push[:, 2] @ on_wheels.T
    return free, M[np.ix_(free, free)], K[np.ix_(free, free)], C[np.ix_(free, free)], push


def _sensor_row(vehicle: Vehicle, full: Assembly, sensor: Sensor) -> Array:
    """The row that reads the sensor's displacement or pitch off all degrees of freedom."""
    parts = [*(body.name for body in vehicle.bodies), *(wheel.name for wheel in vehicle.wheels)]
    if sensor.body not in parts:
        raise ModelError(
            f"sensor {sensor.name!r} stands on {sensor.body!r}, which vehicle {vehicle.name!r} does not have; "
            f"it has {', '.join(parts)}"
        )
    freedoms = full.degrees_of_freedom
    if sensor.quantity == ROLL_RATE and not isinstance(vehicle, RollVehicle):
        raise ModelError(
            f"sensor {sensor.name!r} measures roll, which heave and pitch know nothing of; leave it out here"
        )
    if sensor.quantity == PITCH_RATE:
        if (sensor.body, PITCH) not in freedoms:
            raise ModelError(
                f"sensor {sensor.name!r} measures pitch, but {sensor.body!r} only heaves"
            )
        row = np.zeros(len(freedoms))
        row[freedoms.index((sensor.body, PITCH))] = 1.0
        return row
    on_wheel = [wheel.position for wheel in vehicle.wheels if wheel.name == sensor.body]
    centre = on_wheel[0] if on_wheel else vehicle.body(sensor.body).position
    return displacement_row(vehicle, freedoms, sensor.body, centre - sensor.position)


def _low_passed(system: StateSpace, sensors: Sequence[Sensor]) -> StateSpace:
    """Sensors with a bandwidth behind a Butterworth low-pass: l̇_1 = ω (y - l_2) - √2 ω l_1, l̇_2 = ω l_1."""
    rates = [(i, 2 * np.pi * one.bandwidth) for i, one in enumerate(sensors) if one.bandwidth]
    n, added = len(system.A), FILTER_STATES * len(rates)
    A, B, C, D = (
        np.pad(system.A, ((0, added), (0, added))),
        np.pad(system.B, ((0, added), (0, 0), (0, 0))),
        np.pad(system.C, ((0, 0), (0, added))),
        system.D.copy(),
    )
    for place, (sensor, rate) in enumerate(rates):
        first = n + FILTER_STATES * place
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
    """Each residual in what its sensor reads: ė_1 = -2ζω e_1 - ω e_2 + noise, ė_2 = ω e_1, y += e_1."""
    left = [(i, one.residual) for i, one in enumerate(sensors) if one.residual and len(signal_rms)]
    n, kinds, added = len(system.A), system.disturbance.shape[1], FILTER_STATES * len(left)
    A, C = np.pad(system.A, ((0, added), (0, added))), np.pad(system.C, ((0, 0), (0, added)))
    disturbance = np.pad(system.disturbance, ((0, added), (0, len(left))))
    for place, (sensor, residual) in enumerate(left):
        first, rate = n + FILTER_STATES * place, 2 * np.pi * residual.frequency
        A[first, first] = -2 * residual.damping * rate
        A[first, first + 1], A[first + 1, first] = -rate, rate
        C[sensor, first] = 1.0
        deviation = residual.share * signal_rms[sensor]
        disturbance[first, kinds + place] = deviation * np.sqrt(4 * residual.damping * rate)
    B = np.pad(system.B, ((0, added), (0, 0), (0, 0)))
    return replace(system, A=A, B=B, C=C, disturbance=disturbance)


def _with_flicker(system: StateSpace, sensors: Sequence[Sensor]) -> StateSpace:
    """Each sensor's 1/f noise in what it reads: ṗ = -ω p + noise, y += p, one p to a decade of frequency."""
    parts = [flicker_processes(sensor) for sensor in sensors]
    of_sensor = np.repeat(np.arange(len(sensors)), [len(one.rate) for one in parts])
    n, added = len(system.A), len(of_sensor)
    A, C = np.pad(system.A, ((0, added), (0, added))), np.pad(system.C, ((0, 0), (0, added)))
    states = n + np.arange(added)
    A[states, states] = -np.concatenate([one.rate for one in parts])
    C[of_sensor, states] = 1.0
    return replace(
        system, A=A, B=np.pad(system.B, ((0, added), (0, 0), (0, 0))), C=C,
        disturbance=np.pad(system.disturbance, ((0, added), (0, 0))),
        flicker=np.concatenate([one.variance for one in parts]),
    )  # fmt: skip


def _with_offsets(system: StateSpace) -> StateSpace:
    """One constant more for each sensor, added to what it reads."""
    added = len(system.C)
    return replace(
        system,
        A=np.pad(system.A, ((0, added), (0, added))),
        B=np.pad(system.B, ((0, added), (0, 0), (0, 0))),
        C=np.hstack([system.C, np.eye(added)]),
        disturbance=np.pad(system.disturbance, ((0, added), (0, 0))),
    )


def _shaken(vehicle: Vehicle, freedoms: tuple[tuple[str, str], ...]) -> list[tuple[int, float]]:
    """Freedoms of the first body that unmodelled accelerations act on, with their relative densities."""
    body = vehicle.bodies[0]
    shaken = [(freedoms.index((body.name, HEAVE)), 1.0)]
    if body.pitch_inertia is not None:
        radius = np.sqrt(body.pitch_inertia / body.mass)
        shaken.append((freedoms.index((body.name, PITCH)), float(1.0 / radius)))
    return shaken


def _shake(A: Array, shaken: list[tuple[int, float]], f: int, deviation: float) -> Array:
    """Put the accelerations into A, ẇ_1 = -2ζω w_1 - ω w_2 + noise, ẇ_2 = ω w_1, q̈ += w_2; their input."""
    frequencies = [_own_frequency(A[: 2 * f, : 2 * f], freedom) for freedom, _ in shaken]
    disturbance = np.zeros((len(A), len(shaken)))
    for kind, ((freedom, relative), rate) in enumerate(zip(shaken, frequencies, strict=True)):
        first = 2 * f + FILTER_STATES * kind
        A[first, first] = -2 * UNMODELLED_DAMPING * rate
        A[first, first + 1], A[first + 1, first] = -rate, rate
        A[f + freedom, first + 1] = 1.0
        # White noise of intensity 4ζω σ² gives both states the standard deviation σ.
        disturbance[first, kind] = relative * deviation * np.sqrt(4 * UNMODELLED_DAMPING * rate)
    return disturbance


def _own_frequency(A: Array, freedom: int) -> float:
    """|λ|, rad/s, of the mode in which a freedom has the largest share."""
    eigenvalues, modes = np.linalg.eig(A)
    displacements = modes[: len(A) // 2]
    shares = np.abs(displacements[freedom]) / np.linalg.norm(displacements, axis=0)
    return float(np.abs(eigenvalues[np.argmax(shares)]))

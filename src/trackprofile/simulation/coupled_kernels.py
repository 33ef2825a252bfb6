"""Compiled integration steps of a vehicle on a layered track, in a window of track that moves with the vehicle.

The wheels act on the rail as contact forces R, which are solved together with the vehicle from a small dense system.
Arrays that hold a state have displacement, velocity and acceleration along the first axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackprofile.simulation.track_kernels import (
    advance_state,
    combine_history,
    compiled,
    damp_window_ends,
    recover_displacements,
    shape_functions,
    shift_window,
    solve,
    track_load,
    track_window,
)

MAXIMUM_FORCE = 1e9
"""Contact force above which the simulation counts as diverged, N."""

MAXIMUM_DISPLACEMENT = 1.0
"""Displacement (m) or slope (rad) of the track above which the simulation counts as diverged."""

END_DECAY_RATE = 100.0
"""Rate at which motion decays at the ends of the window, 1/s.

Average acceleration has no numerical damping of the rail's stiffest modes, so they would persist."""

Array = NDArray[np.float64]


class CoupledVehicle(NamedTuple):
    """The vehicle as the kernels take it.

    Parameters
    ----------
    mass : (bodies,), diagonal of M, kg or kg m²
    C, K : (bodies + wheels, bodies + wheels)
    wheel_mass : (wheels,), kg
    weight : (bodies,), weight over ``gravity``: the mass of heave, 0 of pitch, kg
    offsets : (wheels,), distance behind the leading wheel, m
    gravity : m/s²
    """

    mass: Array
    C: Array
    K: Array
    wheel_mass: Array
    weight: Array
    offsets: Array
    gravity: float


class CoupledTrack(NamedTuple):
    """The layered track as the kernels take it.

    Parameters
    ----------
    supports : (sleepers, 8), in the order of `trackprofile.models.track.SUPPORT_FIELDS`
    first_node : number of the first of these sleepers
    absorbing : (nodes,), damping added under the ends of the window, N s/m
    bending, inertia : (4, 4), stiffness and mass of one bay of rail
    spacing : sleeper spacing, m
    """

    supports: Array
    first_node: int
    absorbing: Array
    bending: Array
    inertia: Array
    spacing: float


class CoupledPath(NamedTuple):
    """Motion and irregularity as the kernels take them.

    Parameters
    ----------
    equilibrium : (steps, 3), position, speed and acceleration of the leading wheel at each step's time of equilibrium
    irregularity : (steps, wheels, 3), r, r' and r'' at those positions
    ends : (steps, 3), the motion at the end of each step
    irregularity_at_ends : (recorded steps, wheels, 3)
    """

    equilibrium: Array
    irregularity: Array
    ends: Array
    irregularity_at_ends: Array


class CoupledState(NamedTuple):
    """The state, which the kernels change in place.

    Parameters
    ----------
    track : (3, nodes, 4)
    vehicle : (3, bodies)
    window : (2,), the window's first node, and the number of nodes behind the leading wheel
    """

    track: Array
    vehicle: Array
    window: NDArray[np.int64]


class CoupledRecord(NamedTuple):
    """Output of every ``every``-th step, which the kernels fill in.

    Parameters
    ----------
    every : number of steps per recorded step
    bodies : (3, n, bodies)
    wheels : (3, n, wheels)
    force, deflection : (n, wheels), contact force (N) and rail deflection (m)
    """

    every: int
    bodies: Array
    wheels: Array
    force: Array
    deflection: Array


@compiled
def _eliminated(matrix, right):  # pragma: no cover
    """Solve a small dense system in place by Gaussian elimination with partial pivoting."""
    n = len(right)
    for i in range(n):
        pivot = i
        for j in range(i + 1, n):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        if pivot != i:
            for k in range(n):
                matrix[i, k], matrix[pivot, k] = matrix[pivot, k], matrix[i, k]
            right[i], right[pivot] = right[pivot], right[i]
        for j in range(i + 1, n):
            factor = matrix[j, i] / matrix[i, i]
            if factor != 0.0:
                for k in range(i, n):
                    matrix[j, k] -= factor * matrix[i, k]
                right[j] -= factor * right[i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]


@compiled
def _paths(
    ax, bx, at, v, a, irregularity, N, columns, hM, hC, motion, by_force
):  # pragma: no cover
    """z, ż, z̈ of each wheel without contact forces (3, wheels), and their derivatives by force (3, wheels, wheels).

    z = N u + r, ż = N u̇ + v N'u + v r', z̈ = N ü + 2v N'u̇ + (v² N'' + a N')u + v² r'' + a r'.
    """
    wheels = len(at)
    for i in range(wheels):
        first = at[i]
        for c in range(wheels + 1):
            n0 = n1 = n2 = 0.0
            for j in range(4):
                value = columns[2 * first + j, c]
                n0 += N[i, 0, j] * value
                n1 += N[i, 1, j] * value
                n2 += N[i, 2, j] * value
            z, rate = n0, bx * n0 + v * n1
            second = ax * n0 + 2 * v * bx * n1 + v * v * n2 + a * n1
            if c > 0:
                by_force[0, i, c - 1], by_force[1, i, c - 1], by_force[2, i, c - 1] = (
                    z,
                    rate,
                    second,
                )
                continue
            m0 = c0 = c1 = 0.0
            for j in range(4):
                node, d = first + j // 2, j % 2
                m0 += N[i, 0, j] * hM[node, d]
                c0 += N[i, 0, j] * hC[node, d]
                c1 += N[i, 1, j] * hC[node, d]
            r, slope, bend = irregularity[i, 0], irregularity[i, 1], irregularity[i, 2]
            motion[0, i] = z + r
            motion[1, i] = rate - c0 + v * slope
            motion[2, i] = second - m0 - 2 * v * c1 + v * v * bend + a * slope


@compiled
def _forces(
    ax, bx, vehicle, wheel_mass, gravity, load, motion, by_force, matrix, right
):  # pragma: no cover
    """The vehicle's q followed by the contact forces R (up on the wheels), in ``right``."""
    mass, C, K = vehicle
    bodies, wheels = len(mass), len(wheel_mass)
    for i in range(bodies):
        for j in range(bodies):
            matrix[i, j] = bx * C[i, j] + K[i, j]
        matrix[i, i] += ax * mass[i]
        right[i] = load[i]
        for w in range(wheels):
            right[i] -= K[i, bodies + w] * motion[0, w] + C[i, bodies + w] * motion[1, w]
        for f in range(wheels):
            value = 0.0
            for w in range(wheels):
                value += K[i, bodies + w] * by_force[0, w, f] + C[i, bodies + w] * by_force[1, w, f]
            matrix[i, bodies + f] = -value
    for i in range(wheels):
        row = bodies + i
        for j in range(bodies):
            matrix[row, j] = -(bx * C[row, j] + K[row, j])
        right[row] = wheel_mass[i] * (motion[2, i] + gravity) + load[row]
        for w in range(wheels):
            right[row] += K[row, bodies + w] * motion[0, w] + C[row, bodies + w] * motion[1, w]
        for f in range(wheels):
            value = wheel_mass[i] * by_force[2, i, f]
            for w in range(wheels):
                value += (
                    K[row, bodies + w] * by_force[0, w, f] + C[row, bodies + w] * by_force[1, w, f]
                )
            matrix[row, bodies + f] = value
        matrix[row, row] += 1.0
    _eliminated(matrix, right)


@compiled
def _wheels_at(position, offsets, spacing, base, at, N, columns):  # pragma: no cover
    """Bay of each wheel in the window, its shape functions, and its unit force in columns 1, 2, ..."""
    columns[:, 1:] = 0.0
    for i in range(len(offsets)):
        bays = (position - offsets[i]) / spacing
        bay = int(np.floor(bays))
        at[i] = bay - base
        shape_functions(bays - bay, spacing, N[i])
        for j in range(4):
            columns[2 * at[i] + j, 1 + i] = N[i, 0, j]


@compiled
def _vehicle_load(a, b, q, vehicle, gravity, wheels, hMq, hCq, load):  # pragma: no cover
    """Load of weight and history terms: M hM + C hC on the bodies, -C hC on the wheels' contact."""
    mass, weight, C = vehicle
    bodies = len(mass)
    for i in range(bodies):
        hMq[i] = a[0] * q[0, i] + a[1] * q[1, i] + a[2] * q[2, i]
        hCq[i] = b[0] * q[0, i] + b[1] * q[1, i] + b[2] * q[2, i]
    for i in range(bodies + wheels):
        damped = 0.0
        for j in range(bodies):
            damped += C[i, j] * hCq[j]
        if i < bodies:
            load[i] = mass[i] * hMq[i] + damped - weight[i] * gravity
        else:
            load[i] = -damped


@compiled
def _read(state, at, N, v, a, irregularity, wheel_motion, deflection):  # pragma: no cover
    """z, ż, z̈ of each wheel and the rail deflection under it, from a state of the track."""
    for i in range(len(at)):
        u = np.zeros((3, 3))
        for j in range(4):
            node, d = at[i] + j // 2, j % 2
            for part in range(3):
                for derivative in range(3):
                    u[part, derivative] += N[i, derivative, j] * state[part, node, d]
        r, slope, bend = irregularity[i, 0], irregularity[i, 1], irregularity[i, 2]
        deflection[i] = u[0, 0]
        wheel_motion[0, i] = u[0, 0] + r
        wheel_motion[1, i] = u[1, 0] + v * u[0, 1] + v * slope
        wheel_motion[2, i] = (
            u[2, 0] + 2 * v * u[1, 1] + v * v * (u[0, 2] + bend) + a * (u[0, 1] + slope)
        )


@compiled
def _contact(vehicle, wheel_mass, gravity, q, wheel_motion, out):  # pragma: no cover
    """Contact force R = m_w (z̈ + g) - f of each wheel, up on the wheel, N."""
    _, C, K = vehicle
    bodies = q.shape[1]
    for i in range(len(wheel_mass)):
        row = bodies + i
        force = wheel_mass[i] * (wheel_motion[2, i] + gravity)
        for j in range(bodies):
            force += K[row, j] * q[0, j] + C[row, j] * q[1, j]
        for w in range(len(wheel_mass)):
            force += (
                K[row, bodies + w] * wheel_motion[0, w] + C[row, bodies + w] * wheel_motion[1, w]
            )
        out[i] = force


@compiled
def march_coupled(scheme, vehicle, track, path, state, record):  # pragma: no cover
    """March over the steps of a path; returns -1, or the step at which the motion diverged.

    ``scheme`` is (step, a, b, p, g, h); the others are `CoupledVehicle`, `CoupledTrack`, `CoupledPath`,
    `CoupledState` (changed in place) and `CoupledRecord` (filled in).
    """
    mass, C, K, wheel_mass, weight, offsets, gravity = vehicle
    supports, first_node, absorbing, bending, inertia, spacing = track
    equilibrium, irregularity, ends, irregularity_at_ends = path
    track_state, q, window_position = state
    every, bodies_out, wheels_out, force_out, deflection_out = record
    step, a, b, p, g, h = scheme
    matrices = (mass, C, K)
    bodies, wheels, nodes, base = len(mass), len(wheel_mass), len(absorbing), window_position[0]
    hM, hC = np.empty((nodes, 4)), np.empty((nodes, 4))
    columns, inner = np.empty((2 * nodes, 1 + wheels)), np.empty((nodes, 2))
    at, N = np.empty(wheels, np.int64), np.empty((wheels, 3, 4))
    motion, by_force = np.empty((3, wheels)), np.empty((3, wheels, wheels))
    matrix, right = np.empty((bodies + wheels, bodies + wheels)), np.empty(bodies + wheels)
    hMq, hCq, load = np.empty(bodies), np.empty(bodies), np.empty(bodies + wheels)
    decay = np.exp(-END_DECAY_RATE * step * absorbing / max(np.max(absorbing), 1e-300))
    displacement, wheel_motion = np.empty((nodes, 4)), np.empty((3, wheels))
    window, (L, D, condensed) = track_window(
        supports, base - first_node, absorbing, bending, inertia, a[0], b[0]
    )
    for k in range(len(equilibrium)):
        s, v, acceleration = equilibrium[k]
        needed = int(np.floor(s / spacing)) - window_position[1]
        if needed > base:
            shift_window(track_state, needed - base)
            base = needed
            window, (L, D, condensed) = track_window(
                supports, base - first_node, absorbing, bending, inertia, a[0], b[0]
            )
        _wheels_at(s, offsets, spacing, base, at, N, columns)
        combine_history(track_state, a, hM)
        combine_history(track_state, b, hC)
        track_load(window, inertia, hM, hC, condensed, columns, inner)
        solve(L, D, columns)
        _paths(
            a[0], b[0], at, v, acceleration, irregularity[k], N, columns, hM, hC, motion, by_force
        )
        _vehicle_load(a, b, q, (mass, weight, C), gravity, wheels, hMq, hCq, load)
        _forces(a[0], b[0], matrices, wheel_mass, gravity, load, motion, by_force, matrix, right)
        recover_displacements(window, condensed, inner, columns, right[bodies:], displacement)
        advance_state(step, p, g, h, track_state, displacement)
        damp_window_ends(track_state, decay)
        advance_state(
            step, p, g, h, q.reshape(3, bodies, 1), right[:bodies].copy().reshape(bodies, 1)
        )
        diverged = not np.max(np.abs(right[bodies:])) < MAXIMUM_FORCE
        if diverged or not np.max(np.abs(displacement)) < MAXIMUM_DISPLACEMENT:
            return k
        if (k + 1) % every == 0:
            n = (k + 1) // every - 1
            s, v, acceleration = ends[k]
            _wheels_at(s, offsets, spacing, base, at, N, columns)
            under = irregularity_at_ends[n]
            _read(track_state, at, N, v, acceleration, under, wheel_motion, deflection_out[n])
            _contact(matrices, wheel_mass, gravity, q, wheel_motion, force_out[n])
            bodies_out[:, n], wheels_out[:, n] = q, wheel_motion
    window_position[0] = base
    return -1

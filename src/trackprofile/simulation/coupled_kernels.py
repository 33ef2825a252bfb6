"""Compiled steps of a vehicle on a layered track, in a window of track that moves with it.

Each node of the rail has four freedoms: deflection and slope of the rail, sleeper, ballast. Sleeper and ballast
condense node by node; the rail is left with a symmetric matrix of half-bandwidth 3, which is factorised only when
the window moves on by a bay. The wheels enter as forces R on it, found together with the vehicle from a small
dense system. Arrays that hold a state have displacement, velocity and acceleration first.
"""

from __future__ import annotations

import numba
import numpy as np

RAIL, SLOPE, SLEEPER, BALLAST = range(4)
PAD_K, PAD_C, SLEEPER_M, BALLAST_K, BALLAST_C, BALLAST_M, GROUND_K, GROUND_C = range(8)
LARGEST = 1e9
"""N that no wheel presses with: beyond it the simulation has diverged."""

CALMING = 100.0
"""1/s, by which motion dies at the window's very ends: what stiff modes do from step to step, average acceleration
alone would keep, and each move of the window feed."""

compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@compiled
def factorised(supports, bending, inertia, ax, bx):  # pragma: no cover
    """Factors of a_x M + b_x C + K: L (2 n, 3) below the diagonal, D (2 n,), and what condensation needs (n, 4)."""
    n = len(supports)
    band, condensed = np.zeros((2 * n, 4)), np.empty((n, 4))
    for e in range(n - 1):
        for i in range(4):
            for j in range(i + 1):
                band[2 * e + i, i - j] += bending[i, j] + ax * inertia[i, j]
    for k in range(n):
        one = supports[k]
        pad = one[PAD_K] + bx * one[PAD_C]
        ballast = one[BALLAST_K] + bx * one[BALLAST_C]
        sleeper = ax * one[SLEEPER_M] + pad + ballast
        ground = ax * one[BALLAST_M] + ballast + one[GROUND_K] + bx * one[GROUND_C]
        determinant = sleeper * ground - ballast * ballast
        condensed[k, 0], condensed[k, 1] = ground / determinant, ballast / determinant
        condensed[k, 2], condensed[k, 3] = sleeper / determinant, pad
        band[2 * k, 0] += pad - pad * pad * condensed[k, 0]
    L, D = np.zeros((2 * n, 3)), np.empty(2 * n)
    for i in range(2 * n):
        for k in range(min(i, 3), 0, -1):
            value = band[i, k]
            for m in range(k + 1, min(i, 3) + 1):
                value -= L[i, m - 1] * L[i - k, m - k - 1] * D[i - m]
            L[i, k - 1] = value / D[i - k]
        D[i] = band[i, 0]
        for m in range(1, min(i, 3) + 1):
            D[i] -= L[i, m - 1] * L[i, m - 1] * D[i - m]
    return L, D, condensed


@compiled
def _solve(L, D, columns):  # pragma: no cover
    """Columns (2 n, m) become the solution."""
    rows, count = columns.shape
    for i in range(rows):
        for k in range(1, min(i, 3) + 1):
            factor = L[i, k - 1]
            for c in range(count):
                columns[i, c] -= factor * columns[i - k, c]
    for i in range(rows - 1, -1, -1):
        for c in range(count):
            columns[i, c] /= D[i]
        for k in range(1, min(rows - 1 - i, 3) + 1):
            factor = L[i + k, k - 1]
            for c in range(count):
                columns[i, c] -= factor * columns[i + k, c]


@compiled
def shapes(fraction, h, out):  # pragma: no cover
    """Hermite's N, N' and N'' (3, 4) at a fraction of a bay of length h."""
    x = fraction
    out[0, 0], out[0, 1] = 1 - 3 * x * x + 2 * x**3, h * (x - 2 * x * x + x**3)
    out[0, 2], out[0, 3] = 3 * x * x - 2 * x**3, h * (x**3 - x * x)
    out[1, 0], out[1, 1] = (6 * x * x - 6 * x) / h, 1 - 4 * x + 3 * x * x
    out[1, 2], out[1, 3] = (6 * x - 6 * x * x) / h, 3 * x * x - 2 * x
    out[2, 0], out[2, 1] = (12 * x - 6) / h**2, (6 * x - 4) / h
    out[2, 2], out[2, 3] = (6 - 12 * x) / h**2, (6 * x - 2) / h


@compiled
def _history(state, coefficients, out):  # pragma: no cover
    c0, c1, c2 = coefficients
    for k in range(out.shape[0]):
        for d in range(4):
            out[k, d] = c0 * state[0, k, d] + c1 * state[1, k, d] + c2 * state[2, k, d]


@compiled
def _track_load(supports, inertia, hM, hC, condensed, right, inner):  # pragma: no cover
    """M hM + C hC: of the rail, sleepers and ballast condensed onto it, in column 0; theirs in ``inner``."""
    n = len(supports)
    right[:, 0] = 0.0
    for e in range(n - 1):
        for i in range(4):
            value = 0.0
            for j in range(4):
                value += inertia[i, j] * hM[e + j // 2, j % 2]
            right[2 * e + i, 0] += value
    for k in range(n):
        one = supports[k]
        pad = one[PAD_C] * (hC[k, SLEEPER] - hC[k, RAIL])
        ballast = one[BALLAST_C] * (hC[k, BALLAST] - hC[k, SLEEPER])
        inner[k, 0] = one[SLEEPER_M] * hM[k, SLEEPER] + pad - ballast
        inner[k, 1] = one[BALLAST_M] * hM[k, BALLAST] + ballast + one[GROUND_C] * hC[k, BALLAST]
        lower = condensed[k, 0] * inner[k, 0] + condensed[k, 1] * inner[k, 1]
        right[2 * k, 0] += condensed[k, 3] * lower - pad


@compiled
def _eliminated(matrix, right):  # pragma: no cover
    """Solve a small dense system in place, with partial pivoting."""
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
    """z, ż, z̈ of each wheel without contact forces (3, wheels), and their slopes by each force (3, wheels, wheels).

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
    """Vehicle's q and the contact forces R, up on the wheels, one after the other in ``right``."""
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
    """Bay in the window and shape functions of each wheel; its unit force in columns 1, 2, ..."""
    columns[:, 1:] = 0.0
    for i in range(len(offsets)):
        place = (position - offsets[i]) / spacing
        bay = int(np.floor(place))
        at[i] = bay - base
        shapes(place - bay, spacing, N[i])
        for j in range(4):
            columns[2 * at[i] + j, 1 + i] = N[i, 0, j]


@compiled
def _vehicle_load(a, b, q, vehicle, gravity, wheels, hMq, hCq, load):  # pragma: no cover
    """Weight and history: M hM + C hC on the bodies, -C hC on the wheels' contact."""
    mass, weighs, C = vehicle
    bodies = len(mass)
    for i in range(bodies):
        hMq[i] = a[0] * q[0, i] + a[1] * q[1, i] + a[2] * q[2, i]
        hCq[i] = b[0] * q[0, i] + b[1] * q[1, i] + b[2] * q[2, i]
    for i in range(bodies + wheels):
        damped = 0.0
        for j in range(bodies):
            damped += C[i, j] * hCq[j]
        if i < bodies:
            load[i] = mass[i] * hMq[i] + damped - weighs[i] * gravity
        else:
            load[i] = -damped


@compiled
def _spread(supports, condensed, inner, right, forces, reached):  # pragma: no cover
    """The window's displacements from the rail's columns and the contact forces."""
    for k in range(len(supports)):
        for d in range(2):
            value = right[2 * k + d, 0]
            for f in range(len(forces)):
                value -= right[2 * k + d, 1 + f] * forces[f]
            reached[k, d] = value
        pushed = inner[k, 0] + condensed[k, 3] * reached[k, RAIL]
        reached[k, SLEEPER] = condensed[k, 0] * pushed + condensed[k, 1] * inner[k, 1]
        reached[k, BALLAST] = condensed[k, 1] * pushed + condensed[k, 2] * inner[k, 1]


@compiled
def _moved_on(step, p, g, h, state, reached):  # pragma: no cover
    for k in range(reached.shape[0]):
        for d in range(reached.shape[1]):
            x, v, a = state[0, k, d], state[1, k, d], state[2, k, d]
            after = p[0] * (reached[k, d] - x) + p[1] * v + p[2] * a
            state[2, k, d] = after
            state[1, k, d] = v + step * (g[0] * a + g[1] * after)
            state[0, k, d] = x + step * v + step * step * (h[0] * a + h[1] * after)


@compiled
def _forward(state, bays):  # pragma: no cover
    """The window moves on; what comes in is at rest."""
    nodes = state.shape[1]
    for part in range(3):
        for k in range(nodes):
            for d in range(4):
                state[part, k, d] = state[part, k + bays, d] if k + bays < nodes else 0.0


@compiled
def _calmed(state, kept):  # pragma: no cover
    """Take a share of the motion at the window's ends."""
    for k in range(len(kept)):
        if kept[k] < 1.0:
            for d in range(4):
                state[1, k, d] *= kept[k]
                state[2, k, d] *= kept[k]


@compiled
def _read(state, at, N, v, a, irregularity, wheel_motion, deflection):  # pragma: no cover
    """z, ż, z̈ of each wheel and the rail's deflection under it, from a state."""
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
    """R = m_w (z̈ + g) - f of each wheel, N, up on the wheel."""
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
def ride(
    scheme, vehicle, wheel_mass, weighs, offsets, gravity, supports, absorbing, first_node, bending, inertia,
    spacing, equilibrium, irregularity, ends, irregularity_at_ends, state, q, place, every, bodies_out, wheels_out,
    force_out, deflection_out,
):  # pragma: no cover  # fmt: skip
    """March over the steps; -1, or the step at which the motion diverged.

    ``equilibrium`` (steps, 3) holds position, speed and acceleration of the leading wheel where equilibrium is
    asked for, ``ends`` at each step's end; ``irregularity`` (steps, wheels, 3) r, r', r'' there. ``state``
    (3, nodes, 4), ``q`` (3, bodies) and ``place`` (2,), the window's first node and how many lie behind the leading
    wheel, go in and come out. Every ``every``-th step is written out.
    """
    step, a, b, p, g, h = scheme
    mass, C, _ = vehicle
    bodies, wheels, nodes, base = len(mass), len(wheel_mass), len(absorbing), place[0]
    hM, hC = np.empty((nodes, 4)), np.empty((nodes, 4))
    columns, inner = np.empty((2 * nodes, 1 + wheels)), np.empty((nodes, 2))
    at, N = np.empty(wheels, np.int64), np.empty((wheels, 3, 4))
    motion, by_force = np.empty((3, wheels)), np.empty((3, wheels, wheels))
    matrix, right = np.empty((bodies + wheels, bodies + wheels)), np.empty(bodies + wheels)
    hMq, hCq, load = np.empty(bodies), np.empty(bodies), np.empty(bodies + wheels)
    kept = np.exp(-CALMING * step * absorbing / max(np.max(absorbing), 1e-300))
    reached, wheel_motion = np.empty((nodes, 4)), np.empty((3, wheels))
    window = supports[base - first_node : base - first_node + nodes].copy()
    window[:, GROUND_C] += absorbing
    L, D, condensed = factorised(window, bending, inertia, a[0], b[0])
    for k in range(len(equilibrium)):
        s, v, acceleration = equilibrium[k]
        wanted = int(np.floor(s / spacing)) - place[1]
        if wanted > base:
            _forward(state, wanted - base)
            base = wanted
            window = supports[base - first_node : base - first_node + nodes].copy()
            window[:, GROUND_C] += absorbing
            L, D, condensed = factorised(window, bending, inertia, a[0], b[0])
        _wheels_at(s, offsets, spacing, base, at, N, columns)
        _history(state, a, hM)
        _history(state, b, hC)
        _track_load(window, inertia, hM, hC, condensed, columns, inner)
        _solve(L, D, columns)
        _paths(
            a[0], b[0], at, v, acceleration, irregularity[k], N, columns, hM, hC, motion, by_force
        )
        _vehicle_load(a, b, q, (mass, weighs, C), gravity, wheels, hMq, hCq, load)
        _forces(a[0], b[0], vehicle, wheel_mass, gravity, load, motion, by_force, matrix, right)
        _spread(window, condensed, inner, columns, right[bodies:], reached)
        _moved_on(step, p, g, h, state, reached)
        _calmed(state, kept)
        for i in range(bodies):
            x, rate, second = q[0, i], q[1, i], q[2, i]
            after = p[0] * (right[i] - x) + p[1] * rate + p[2] * second
            q[2, i] = after
            q[1, i] = rate + step * (g[0] * second + g[1] * after)
            q[0, i] = x + step * rate + step * step * (h[0] * second + h[1] * after)
        for i in range(wheels):
            if not abs(right[bodies + i]) < LARGEST:
                return k
        if (k + 1) % every == 0:
            n = (k + 1) // every - 1
            s, v, acceleration = ends[k]
            _wheels_at(s, offsets, spacing, base, at, N, columns)
            _read(
                state,
                at,
                N,
                v,
                acceleration,
                irregularity_at_ends[n],
                wheel_motion,
                deflection_out[n],
            )
            _contact(vehicle, wheel_mass, gravity, q, wheel_motion, force_out[n])
            bodies_out[:, n], wheels_out[:, n] = q, wheel_motion
    place[0] = base
    return -1

"""Reference model for tests: a vehicle on a track of fixed length, slow, simple, and independent of the kernels.

There is no moving window, condensation or added damping: rail, sleepers and ballast of the whole length, the bodies,
and the contact forces as further unknowns form one sparse system, which is solved at every step (theory, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from narrowing import not_none
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.track import LayeredTrack
from trackprofile.models.vehicle import HEAVE, Vehicle, assemble

Array = NDArray[np.float64]
HERMITE = (
    Polynomial([1, 0, -3, 2]),
    Polynomial([0, 1, -2, 1]),
    Polynomial([0, 0, 3, -2]),
    Polynomial([0, 0, -1, 1]),
)
"""Hermite polynomials of the fraction of a bay; those of the slopes are multiplied by its length where used."""


@dataclass(frozen=True)
class Track:
    """M, C and K; four freedoms per node: deflection and slope of the rail, sleeper, ballast."""

    spacing: float
    M: sparse.csr_array
    C: sparse.csr_array
    K: sparse.csr_array


@dataclass(frozen=True)
class Passage:
    """Bodies (3, n, freedoms), contact forces and rail deflections (n, wheels) at every step."""

    bodies: Array
    contact_force: Array
    rail_deflection: Array


def whole_track(track: LayeredTrack, nodes: int) -> Track:
    """Sleepers 0 to nodes - 1, at the multiples of the spacing; the rail's ends are free."""
    h, one, n = track.spacing, track.support, 4 * nodes
    M, C, K = (sparse.lil_matrix((n, n)) for _ in range(3))
    unit = np.array([1, h, 1, h])
    stiffness, inertia = np.empty((4, 4)), np.empty((4, 4))
    for i, f in enumerate(HERMITE):
        for j, g in enumerate(HERMITE):
            scale = unit[i] * unit[j]
            bent = (f.deriv(2) * g.deriv(2)).integ()(1)
            stiffness[i, j] = track.rail_bending_stiffness / h**3 * scale * bent
            inertia[i, j] = track.rail_mass * h * scale * (f * g).integ()(1)
    for bay in range(nodes - 1):
        at = np.ix_(*2 * [4 * bay + np.array([0, 1, 4, 5])])
        K[at] += stiffness
        M[at] += inertia
    between = np.array([[1, -1], [-1, 1]])
    for node in range(nodes):
        rail, sleeper, ballast = 4 * node, 4 * node + 2, 4 * node + 3
        M[sleeper, sleeper] += one.sleeper_mass
        M[ballast, ballast] += one.ballast_mass
        for matrix, pad, bed, ground in (
            (K, one.pad_stiffness, one.ballast_stiffness, one.subballast_stiffness),
            (C, one.pad_damping, one.ballast_damping, one.subballast_damping),
        ):
            matrix[np.ix_([rail, sleeper], [rail, sleeper])] += pad * between
            matrix[np.ix_([sleeper, ballast], [sleeper, ballast])] += bed * between
            matrix[ballast, ballast] += ground
    return Track(h, M.tocsr(), C.tocsr(), K.tocsr())


def interpolation(track: Track, places: Array) -> list[sparse.csr_array]:
    """N, N' and N'' at the wheels, (wheels, freedoms) each."""
    h = track.spacing
    unit = (1.0, h, 1.0, h)
    out = [sparse.lil_matrix((len(places), not_none(track.M.shape)[0])) for _ in range(3)]
    for wheel, place in enumerate(places):
        bay, fraction = divmod(place / h, 1)
        freedoms = 4 * int(bay) + np.array([0, 1, 4, 5])
        for order, matrix in enumerate(out):
            for freedom, length, f in zip(freedoms, unit, HERMITE, strict=True):
                value = f.deriv(order)(fraction) if order else f(fraction)
                matrix[wheel, freedom] = length * value / h**order
    return [matrix.tocsr() for matrix in out]


def passage(
    vehicle: Vehicle, track: Track, profile: Irregularity, motion: Array, step: float, gravity: float
) -> Passage:  # fmt: skip
    """Integrate with Newmark's average acceleration, from rest on the loaded track.

    ``motion`` (n + 1, 3) holds position, speed and acceleration of the leading wheel at 0, Δt, 2 Δt, ...
    """
    full = assemble(vehicle)
    b = len(full.degrees_of_freedom) - len(vehicle.wheels)
    weight = [
        gravity * m * (motion == HEAVE)
        for m, (_, motion) in zip(np.diag(full.mass), full.degrees_of_freedom, strict=True)
    ]
    offsets = np.array([wheel.position for wheel in vehicle.wheels])
    size = not_none(track.M.shape)[0]
    x, rate, second = np.zeros((3, size + b))
    records = []
    for k, (s, v, a) in enumerate(motion):
        # ẍ₊ = a_x x₊ - past₂ and ẋ₊ = b_x x₊ - past₁; both are 0 in the first step, which is the static solution.
        ax, bx = (4 / step**2, 2 / step) if k else (0.0, 0.0)
        past2 = ax * x + 2 * bx * rate + (second if k else 0.0)
        past1 = bx * x + (rate if k else 0.0)
        N, N1, N2 = interpolation(track, s - offsets)
        r, r1, r2 = profile.at(s - offsets)
        if not k:
            v = a = 0.0
        # z, ż and z̈ = (matrix) u₊ + (vector)
        z = (N, r)
        z1 = (bx * N + v * N1, v * r1 - N @ past1[:size])
        z2 = (
            ax * N + 2 * v * bx * N1 + v**2 * N2 + a * N1,
            v**2 * r2 + a * r1 - N @ past2[:size] - 2 * v * N1 @ past1[:size],
        )
        Kq, Cq = full.stiffness[:, :b], full.damping[:, :b]
        Kz, Cz = full.stiffness[:, b:], full.damping[:, b:]
        # The links act on the bodies and wheels with -(by_rail u₊ + by_body q₊ + known).
        by_rail, by_body = Kz @ z[0].toarray() + Cz @ z1[0].toarray(), Kq + bx * Cq
        known = Kz @ z[1] + Cz @ z1[1] - Cq @ past1[size:]
        body_mass, wheel_mass = np.diag(full.mass)[:b], np.diag(full.mass)[b:]
        # Rail: M ü + C u̇ + K u + Nᵀ R = 0; bodies; wheels: R - m (z̈ + g) + (links) = 0.
        matrix = sparse.bmat(
            [
                [ax * track.M + bx * track.C + track.K, None, N.T],
                [by_rail[:b], np.diag(ax * body_mass) + by_body[:b], None],
                [wheel_mass[:, None] * z2[0].toarray() + by_rail[b:], by_body[b:], -np.eye(len(r))],
            ],
            format="csc",
        )
        right = np.concatenate(
            [
                track.M @ past2[:size] + track.C @ past1[:size],
                body_mass * past2[size:] - known[:b] - weight[:b],
                -wheel_mass * z2[1] - weight[b:] - known[b:],
            ]
        )
        solution = np.asarray(spsolve(matrix, right))
        x, rate, second = (
            solution[: size + b],
            bx * solution[: size + b] - past1,
            ax * solution[: size + b] - past2,
        )
        if k:
            records.append(
                (np.array([x, rate, second])[:, size:], solution[size + b :], N @ x[:size])
            )
    bodies, force, deflection = (np.array(part) for part in zip(*records, strict=True))
    return Passage(np.moveaxis(bodies, 1, 0), force, deflection)

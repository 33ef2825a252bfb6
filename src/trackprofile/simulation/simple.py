"""Simulation of a run on a rigid or elastic track, where the matrices are constant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.models.integrate import Scheme, integrate_steps
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.track import ElasticTrack, RigidTrack, wheel_matrices
from trackprofile.simulation.coupled_kernels import MAXIMUM_FORCE, CoupledPath
from trackprofile.simulation.mechanics import GRAVITY, VehicleMatrices

Array = NDArray[np.float64]


@dataclass
class SimpleRun:
    """State of a run on a rigid or elastic track.

    Parameters
    ----------
    vehicle : matrices of the vehicle
    track : the track
    M, C, K : (free, free), over the free degrees of freedom
    path_load : (3, free, wheels), load per r, ṙ and r̈ of each wheel's path
    weight : (free,), downward, N
    state : (3, free), displacement, velocity and acceleration; changes while the simulation marches
    """

    vehicle: VehicleMatrices
    track: RigidTrack | ElasticTrack
    M: Array
    C: Array
    K: Array
    path_load: Array
    weight: Array
    state: Array

    @staticmethod
    def build(vehicle: VehicleMatrices, track: RigidTrack | ElasticTrack) -> SimpleRun:
        """A run without displacements; the wheels are free on an elastic track only.

        The load is path_load·(r, ṙ, r̈) - weight.
        """
        b, size, M = vehicle.bodies, len(vehicle.mass), np.diag(vehicle.mass)
        if isinstance(track, RigidTrack):
            stiffness, damping = vehicle.K[:b, b:], vehicle.C[:b, b:]
            path_load = -np.stack([stiffness, damping, np.zeros_like(stiffness)])
            free = slice(0, b)
            K, C = vehicle.K[:b, :b], vehicle.C[:b, :b]
        else:
            selection = np.eye(size)[:, b:]
            free = slice(0, size)
            path_load = selection @ wheel_matrices(track, vehicle.offsets)
            added = path_load @ selection.T
            K, C, M = vehicle.K + added[0], vehicle.C + added[1], M + added[2]
        state = np.zeros((3, len(K)))
        return SimpleRun(
            vehicle, track, M[free, free], C, K, path_load, vehicle.weight[free], state
        )

    @property
    def offsets(self) -> Array:
        """Distances of the wheels behind the leading one, (wheels,), m."""
        return self.vehicle.offsets

    def copy(self) -> SimpleRun:
        """An independent copy."""
        return replace(self, state=self.state.copy())

    def set_equilibrium(self, profile: Irregularity, position: float) -> None:
        """Set the state to static equilibrium at rest with the leading wheel at ``position`` (m)."""
        r = profile.at(position - self.offsets)[0]
        self.state[0] = np.linalg.solve(self.K, self.path_load[0] @ r - self.weight)
        self.state[1:] = 0.0

    def march(
        self, scheme: Scheme, path: CoupledPath, every: int
    ) -> tuple[Array, Array, Array, Array, int]:
        """Advance the state over all steps of a path; parameters and result as of `LayeredRun.march`."""
        inverse = np.linalg.inv(scheme.a[0] * self.M + scheme.b[0] * self.C + self.K)
        v, a = path.equilibrium[:, 1:2], path.equilibrium[:, 2:3]
        r, slope, curvature = np.moveaxis(path.irregularity, -1, 0)
        motion = (r, v * slope, v**2 * curvature + a * slope)
        load = (
            sum(one @ gain.T for one, gain in zip(motion, self.path_load, strict=True))
            - self.weight
        )
        transition = np.hstack(
            [inverse @ (scheme.a[i] * self.M + scheme.b[i] * self.C) for i in range(3)]
        )
        out = np.empty((3, len(load) + 1, len(self.K)))
        out[:, 0] = self.state
        integrate_steps(
            transition, load @ inverse.T, scheme.step, scheme.p, scheme.g, scheme.h, out
        )
        unbounded = ~np.all(np.abs(out[0, 1:]) < MAXIMUM_FORCE / np.max(self.K), axis=1)
        diverged = int(np.argmax(unbounded)) if np.any(unbounded) else -1
        self.state = out[:, -1].copy()
        ends = path.ends[every - 1 :: every]
        return *self._read(out[:, every::every], ends, path.irregularity_at_ends), diverged

    def _read(self, states: Array, ends: Array, under: Array) -> tuple[Array, Array, Array, Array]:
        """Bodies, wheels, contact forces and deflections at the ends of the recorded steps."""
        b = self.vehicle.bodies
        bodies = states[:, :, :b]
        v, a = ends[:, 1:2], ends[:, 2:3]
        r, slope, curvature = np.moveaxis(under, -1, 0)
        if isinstance(self.track, RigidTrack):
            wheels = np.stack([r, v * slope, v**2 * curvature + a * slope])
            deflection = np.zeros_like(r)
        else:
            wheels = states[:, :, b:]
            deflection = wheels[0] - r
        both = np.concatenate([bodies, wheels], axis=2)
        inertia = self.vehicle.mass[b:] * (wheels[2] + GRAVITY)
        force = inertia + both[0] @ self.vehicle.K[b:].T + both[1] @ self.vehicle.C[b:].T
        return bodies, wheels, force, deflection

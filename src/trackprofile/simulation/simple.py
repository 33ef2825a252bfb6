"""A run over a rigid path, or on a spring and damper under each wheel: constant matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.models.integrate import Scheme, integrate_steps
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.track import ElasticTrack, RigidTrack, wheel_matrices
from trackprofile.simulation.coupled_kernels import MAXIMUM_FORCE
from trackprofile.simulation.mechanics import GRAVITY, VehicleMatrices

Array = NDArray[np.float64]


@dataclass
class SimpleRun:
    """M, C and K over the free freedoms, the push of the paths, and the state (3, free) as it marches."""

    car: VehicleMatrices
    track: RigidTrack | ElasticTrack
    M: Array
    C: Array
    K: Array
    push: Array
    weight: Array
    state: Array

    @staticmethod
    def of(car: VehicleMatrices, track: RigidTrack | ElasticTrack) -> SimpleRun:
        """Free are the bodies, and on an elastic track the wheels: load = push·(r, ṙ, r̈) - weight."""
        b, every, M = car.bodies, len(car.mass), np.diag(car.mass)
        if isinstance(track, RigidTrack):
            push = -np.stack([car.K[:b, b:], car.C[:b, b:], np.zeros_like(car.K[:b, b:])])
            free = slice(0, b)
            K, C = car.K[:b, :b], car.C[:b, :b]
        else:
            on_wheels = np.eye(every)[:, b:]
            free = slice(0, every)
            push = on_wheels @ wheel_matrices(track, car.offsets)
            more = push @ on_wheels.T
            K, C, M = car.K + more[0], car.C + more[1], M + more[2]
        size = len(K)
        return SimpleRun(
            car, track, M[free, free], C, K, push, car.weight[free], np.zeros((3, size))
        )

    @property
    def offsets(self) -> Array:
        """Of the wheels, m behind the leading one."""
        return self.car.offsets

    def copy(self) -> SimpleRun:
        """The same run, which marches on by itself."""
        return replace(self, state=self.state.copy())

    def begin(self, profile: Irregularity, position: float) -> None:
        """Static equilibrium at ``position``, at rest."""
        r = profile.at(position - self.car.offsets)[0]
        self.state[0] = np.linalg.solve(self.K, self.push[0] @ r - self.weight)
        self.state[1:] = 0.0

    def march(
        self, scheme: Scheme, equilibrium: Array, under: Array, ends: Array, under_ends: Array, every: int
    ) -> tuple[Array, Array, Array, Array, int]:  # fmt: skip
        """As of a layered run."""
        inverse = np.linalg.inv(scheme.a[0] * self.M + scheme.b[0] * self.C + self.K)
        v, a = equilibrium[:, 1:2], equilibrium[:, 2:3]
        r, slope, bend = np.moveaxis(under, -1, 0)
        paths = (r, v * slope, v**2 * bend + a * slope)
        load = sum(path @ push.T for path, push in zip(paths, self.push, strict=True)) - self.weight
        onto = np.hstack(
            [inverse @ (scheme.a[i] * self.M + scheme.b[i] * self.C) for i in range(3)]
        )
        out = np.empty((3, len(load) + 1, len(self.K)))
        out[:, 0] = self.state
        integrate_steps(onto, load @ inverse.T, scheme.step, scheme.p, scheme.g, scheme.h, out)
        wild = ~np.all(np.abs(out[0, 1:]) < MAXIMUM_FORCE / np.max(self.K), axis=1)
        diverged = int(np.argmax(wild)) if np.any(wild) else -1
        self.state = out[:, -1].copy()
        return *self._read(out[:, every::every], ends[every - 1 :: every], under_ends), diverged

    def _read(self, states: Array, ends: Array, under: Array) -> tuple[Array, Array, Array, Array]:
        """Bodies, wheels, contact forces and deflections at the recorded ends."""
        b = self.car.bodies
        bodies = states[:, :, :b]
        v, a = ends[:, 1:2], ends[:, 2:3]
        r, slope, bend = np.moveaxis(under, -1, 0)
        if isinstance(self.track, RigidTrack):
            wheels = np.stack([r, v * slope, v**2 * bend + a * slope])
            deflection = np.zeros_like(r)
        else:
            wheels = states[:, :, b:]
            deflection = wheels[0] - r
        moved = np.concatenate([bodies, wheels], axis=2)
        inertia = self.car.mass[b:] * (wheels[2] + GRAVITY)
        force = inertia + moved[0] @ self.car.K[b:].T + moved[1] @ self.car.C[b:].T
        return bodies, wheels, force, deflection

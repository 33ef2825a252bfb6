"""Simulation of a run over a layered track, in a window of track that moves with the vehicle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.models.integrate import Scheme
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.track import LayeredTrack, beam_element, support_table
from trackprofile.simulation.coupled_kernels import (
    CoupledPath,
    CoupledRecord,
    CoupledState,
    CoupledTrack,
    CoupledVehicle,
    march_coupled,
)
from trackprofile.simulation.mechanics import GRAVITY, VehicleMatrices

Array = NDArray[np.float64]

MARGIN = 15.0
"""Modelled track before the first and behind the last wheel, m; the paper has 10 m to 15 m."""

UNDAMPED_LENGTH, END_DAMPING_RATIO = 2.0, 0.22
"""Length next to the outer wheels without added damping, m; added damping ratio at the ends of the window."""


@dataclass
class LayeredRun:
    """State of a run on a layered track: the only object that changes while a simulation marches.

    Parameters
    ----------
    vehicle : matrices of the vehicle
    track : the layered track
    margin : modelled track before the first and behind the last wheel, m
    state : (3, nodes, 4), displacement, velocity and acceleration of the track in the window
    q : (3, bodies), the same of the vehicle's bodies
    window : (2,), the window's first node, and the number of nodes behind the leading wheel
    """

    vehicle: VehicleMatrices
    track: LayeredTrack
    margin: float
    state: Array
    q: Array
    window: NDArray[np.int64]

    @staticmethod
    def build(
        vehicle: VehicleMatrices, track: LayeredTrack, margin: float, position: float
    ) -> LayeredRun:
        """The window around a vehicle with its leading wheel at ``position`` (m), without displacements."""
        length = float(np.max(vehicle.offsets))
        behind = int(np.ceil((length + margin) / track.spacing))
        nodes = behind + int(np.ceil(margin / track.spacing)) + 2
        first = int(np.floor(position / track.spacing)) - behind
        window = np.array([first, behind], np.int64)
        state, q = np.zeros((3, nodes, 4)), np.zeros((3, vehicle.bodies))
        return LayeredRun(vehicle, track, margin, state, q, window)

    @property
    def offsets(self) -> Array:
        """Distances of the wheels behind the leading one, (wheels,), m."""
        return self.vehicle.offsets

    def copy(self) -> LayeredRun:
        """An independent copy."""
        return replace(self, state=self.state.copy(), q=self.q.copy(), window=self.window.copy())

    def set_equilibrium(self, profile: Irregularity, position: float) -> None:
        """Set the state to static equilibrium at rest with the leading wheel at ``position`` (m)."""
        under = np.moveaxis(profile.at(position - self.offsets), 0, -1)[None]
        # With these coefficients, without mass and damping, one step is the static solution.
        static = Scheme(
            1.0, 1.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0]), np.array([1.0, 0]), np.array([0, 1.0])
        )  # fmt: skip
        path = CoupledPath(np.array([[position, 0.0, 0.0]]), under, np.zeros((1, 3)), under[:0])
        self.march(static, path, every=2)
        self.state[1:], self.q[1:] = 0.0, 0.0

    def march(
        self, scheme: Scheme, path: CoupledPath, every: int
    ) -> tuple[Array, Array, Array, Array, int]:
        """Advance the state over all steps of a path.

        Parameters
        ----------
        every : number of steps per recorded step

        Returns
        -------
        bodies and wheels (3, n, ...), contact forces and rail deflections (n, wheels); the step at which the motion
        diverged, or -1
        """
        records, wheels = len(path.equilibrium) // every, len(self.offsets)
        nodes = self.state.shape[1]
        first = int(self.window[0])
        last = float(np.max(path.equilibrium[:, 0])) / self.track.spacing
        count = max(int(last) + 1 - int(self.window[1]) - first, 0) + nodes + 1
        table = support_table(self.track, first, count)
        _check_support(self.track, table)
        record = CoupledRecord(
            every,
            np.empty((3, records, self.vehicle.bodies)),
            np.empty((3, records, wheels)),
            np.empty((records, wheels)),
            np.empty((records, wheels)),
        )
        absorbing = _absorbing(self.track, nodes, self.margin)
        diverged = march_coupled(
            (scheme.step, scheme.a, scheme.b, scheme.p, scheme.g, scheme.h),
            _kernel_vehicle(self.vehicle),
            CoupledTrack(table, first, absorbing, *beam_element(self.track), self.track.spacing),
            path,
            CoupledState(self.state, self.q, self.window),
            record,
        )
        return *record[1:], int(diverged)


def _kernel_vehicle(vehicle: VehicleMatrices) -> CoupledVehicle:
    b = vehicle.bodies
    return CoupledVehicle(
        vehicle.mass[:b], vehicle.C, vehicle.K, vehicle.mass[b:], vehicle.weight[:b] / GRAVITY,
        vehicle.offsets, GRAVITY,
    )  # fmt: skip


def _check_support(track: LayeredTrack, table: Array) -> None:
    """Some sleeper must support the rail; only a few in a row may hang."""
    pads, ballast, ground = table[:, 0], table[:, 3], table[:, 6]
    if not np.any((pads > 0) & (ballast > 0) & (ground > 0)):
        raise ModelError(
            f"track {track.name!r}: no sleeper supports the rail; give pads, ballast and sub-ballast stiffness"
        )


def _absorbing(track: LayeredTrack, nodes: int, margin: float) -> Array:
    """Damping under the window's ends (nodes,), N s/m, so that waves leave the window without reflection.

    It grows with the square of the distance into the outer part of the margin, up to a share of the support's
    critical damping.
    """
    one = track.support
    critical = 2 * np.sqrt(one.subballast_stiffness * (one.ballast_mass + one.sleeper_mass))
    position = track.spacing * np.arange(nodes)
    outer = max(margin - UNDAMPED_LENGTH, track.spacing)
    depth = np.clip(1 - np.minimum(position, position[::-1]) / outer, 0.0, 1.0)
    return np.asarray(END_DAMPING_RATIO * critical * depth**2, np.float64)

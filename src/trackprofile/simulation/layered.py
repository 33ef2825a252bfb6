"""A run over a layered track, in a window that moves with the vehicle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.models.integrate import Scheme
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.track import LayeredTrack, beam_element, support_table
from trackprofile.simulation import coupled_kernels
from trackprofile.simulation.mechanics import GRAVITY, VehicleMatrices

Array = NDArray[np.float64]

MARGIN = 15.0
"""m of track before the first and behind the last wheel, as in the paper (10 to 15 m)."""

UNDAMPED_LENGTH, END_DAMPING_RATIO = 2.0, 0.22
"""m about the wheels in which nothing is absorbed; critical damping's share at the window's ends."""


@dataclass
class LayeredRun:
    """The state of a run: the only thing that changes while a simulation marches.

    ``state`` (3, nodes, 4) of the track's window, ``q`` (3, bodies) of the vehicle, ``place`` its first node and
    how many nodes lie behind the leading wheel.
    """

    car: VehicleMatrices
    track: LayeredTrack
    margin: float
    state: Array
    q: Array
    place: NDArray[np.int64]

    @staticmethod
    def of(car: VehicleMatrices, track: LayeredTrack, margin: float, position: float) -> LayeredRun:
        """The window about a vehicle whose leading wheel stands at ``position`` m."""
        length = float(np.max(car.offsets))
        behind = int(np.ceil((length + margin) / track.spacing))
        nodes = behind + int(np.ceil(margin / track.spacing)) + 2
        first = int(np.floor(position / track.spacing)) - behind
        place = np.array([first, behind], np.int64)
        return LayeredRun(
            car, track, margin, np.zeros((3, nodes, 4)), np.zeros((3, car.bodies)), place
        )

    @property
    def offsets(self) -> Array:
        """Of the wheels, m behind the leading one."""
        return self.car.offsets

    def copy(self) -> LayeredRun:
        """The same run, which marches on by itself."""
        return replace(self, state=self.state.copy(), q=self.q.copy(), place=self.place.copy())

    def begin(self, profile: Irregularity, position: float) -> None:
        """Static equilibrium at ``position``, at rest."""
        under = np.moveaxis(profile.at(position - self.car.offsets), 0, -1)[None]
        # With neither mass nor damping in it, one step of these coefficients is the static solution.
        still = Scheme(
            1.0, 1.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0]), np.array([1.0, 0]), np.array([0, 1.0])
        )  # fmt: skip
        self.march(still, np.array([[position, 0.0, 0.0]]), under, np.zeros((1, 3)), under[:0], 2)
        self.state[1:], self.q[1:] = 0.0, 0.0

    def march(
        self, scheme: Scheme, equilibrium: Array, under: Array, ends: Array, under_ends: Array, every: int
    ) -> tuple[Array, Array, Array, Array, int]:  # fmt: skip
        """Bodies and wheels (3, n, ...), contact forces and deflections (n, wheels); the step that diverged or -1."""
        records, wheels = len(equilibrium) // every, len(self.car.offsets)
        nodes = self.state.shape[1]
        first = int(self.place[0])
        farthest = float(np.max(equilibrium[:, 0])) / self.track.spacing
        count = max(int(farthest) + 1 - int(self.place[1]) - first, 0) + nodes + 1
        table = support_table(self.track, first, count)
        _check_support(self.track, table)
        bodies_out, wheels_out = (
            np.empty((3, records, self.car.bodies)),
            np.empty((3, records, wheels)),
        )
        force, deflection = np.empty((records, wheels)), np.empty((records, wheels))
        bending, inertia = beam_element(self.track)
        absorbing = _absorbing(self.track, nodes, self.margin)
        b = self.car.bodies
        diverged = coupled_kernels.march_coupled(
            (scheme.step, scheme.a, scheme.b, scheme.p, scheme.g, scheme.h),
            (self.car.mass[:b], self.car.C, self.car.K), self.car.mass[b:], self.car.weight[:b] / GRAVITY,
            self.car.offsets, GRAVITY, table, absorbing, first, bending, inertia, self.track.spacing, equilibrium,
            under, ends, under_ends, self.state, self.q, self.place, every, bodies_out, wheels_out, force, deflection,
        )  # fmt: skip
        return bodies_out, wheels_out, force, deflection, int(diverged)


def _check_support(track: LayeredTrack, table: Array) -> None:
    """The rail must lie on something: at most a few sleepers in a row may hang."""
    pads, ballast, ground = table[:, 0], table[:, 3], table[:, 6]
    if not np.any((pads > 0) & (ballast > 0) & (ground > 0)):
        raise ModelError(f"track {track.name!r}: no sleeper carries the rail; give it stiffness")


def _absorbing(track: LayeredTrack, nodes: int, margin: float) -> Array:
    """Damping under the window's ends, N s/m by node, so that waves leave it rather than come back.

    It grows with the square of the way into the margin's outer part, to a share of the support's critical damping.
    """
    one = track.support
    critical = 2 * np.sqrt(one.subballast_stiffness * (one.ballast_mass + one.sleeper_mass))
    place = track.spacing * np.arange(nodes)
    outer = max(margin - UNDAMPED_LENGTH, track.spacing)
    depth = np.clip(1 - np.minimum(place, place[::-1]) / outer, 0.0, 1.0)
    return np.asarray(END_DAMPING_RATIO * critical * depth**2, np.float64)

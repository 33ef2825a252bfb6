"""Forward model of one window: the sensors' readings are affine in the profile elevations (theory, section 5).

y = y_free + G x, with x the elevations at the window's scans and y_free the response to the state and to the profile
behind, with x = 0. r' and r'' are backward differences of the elevations, so that no scan depends on the profile ahead.
They are of second order, like the integrator: with first-order differences the inverse of the car on a layered track
is unstable, and an error in one window grows from window to window.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.models.integrate import Scheme
from trackprofile.models.irregularity import Flat
from trackprofile.models.sensor import Sensor
from trackprofile.models.track import LayeredTrack, Track
from trackprofile.models.vehicle import HEAVE, Vehicle
from trackprofile.simulation.coupled_kernels import CoupledPath
from trackprofile.simulation.layered import MARGIN, LayeredRun
from trackprofile.simulation.mechanics import check_step, vehicle_matrices
from trackprofile.simulation.simple import SimpleRun
from trackprofile.simulation.simulate import Simulation, sensor_signal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForwardModel:
    """Signals of the sensors for given elevations, with one unknown elevation per integration step.

    Parameters
    ----------
    run : state of vehicle and track at the end of the decided profile
    scheme : integration scheme, one step per scan
    motion : (steps + 1, 3), position (m), speed (m/s) and acceleration (m/s²) of the leading wheel from the start on
    position : (before + steps,), positions of the elevations, the first ``before`` behind the first step, m
    before : number of elevations behind the first step
    acceleration_gain, velocity_gain : (freedoms, sensors), readings per acceleration and velocity of the freedoms
    """

    run: LayeredRun | SimpleRun
    scheme: Scheme
    motion: Array
    position: Array
    before: int
    acceleration_gain: Array
    velocity_gain: Array

    @property
    def time_invariant(self) -> bool:
        """Whether G is the same for every window: constant matrices, constant speed and evenly spaced scans."""
        even = np.ptp(np.diff(self.position)) < 1e-9 * np.ptp(self.position)
        return isinstance(self.run, SimpleRun) and bool(even and np.ptp(self.motion[:, 1]) == 0.0)

    def free_response(self, elevation: Array, first: int, count: int) -> Array:
        """y_free of ``count`` steps from step ``first`` on, (count, sensors).

        Parameters
        ----------
        elevation : (before + steps,), m; only the elevations before step ``first`` are used
        """
        return self.signals(self._decided(elevation, first), first, count)

    def gain_matrix(self, elevation: Array, first: int, count: int) -> Array:
        """G, (sensors, count, count): reading at each scan per elevation (1/m); 0 above the diagonal."""
        decided = self._decided(elevation, first)
        free = self.signals(decided, first, count)
        gain = np.empty((free.shape[1], count, count))
        for j in range(count):
            decided[self.before + first + j] = 1.0
            gain[:, :, j] = (self.signals(decided, first, count) - free).T
            decided[self.before + first + j] = 0.0
        return gain

    def _decided(self, elevation: Array, first: int) -> Array:
        decided = elevation.copy()
        decided[self.before + first :] = 0.0
        return decided

    def signals(self, elevation: Array, first: int, count: int) -> Array:
        """Readings for given elevations by direct simulation, (count, sensors)."""
        return self._simulate(elevation, first, count)[0]

    def advance(self, elevation: Array, first: int, count: int) -> ForwardModel:
        """The model with its state advanced over ``count`` decided steps."""
        return replace(self, run=self._simulate(elevation, first, count)[1])

    def _simulate(
        self, elevation: Array, first: int, count: int
    ) -> tuple[Array, LayeredRun | SimpleRun]:
        run = self.run.copy()
        theta, window = self.scheme.theta, self.motion[first : first + count + 1]
        under = self._under_wheels(elevation, first, count)
        # Wilson's scheme needs the path at t + θ Δt, beyond the step's end: linear extrapolation.
        equilibrium, path = (rows[:-1] + theta * np.diff(rows, axis=0) for rows in (window, under))
        bodies, wheels, _, _, diverged = run.march(
            self.scheme, CoupledPath(equilibrium, path, window[1:], under[1:]), 1
        )
        if diverged >= 0:
            raise DataError(
                f"The forward model diverged at {equilibrium[diverged, 0]:.2f} m: the trial elevations there are "
                "outside the model's range."
            )
        motion = np.concatenate([bodies, wheels], axis=2)
        return motion[2] @ self.acceleration_gain + motion[1] @ self.velocity_gain, run

    def _under_wheels(self, elevation: Array, first: int, count: int) -> Array:
        """r, r' and r'' under each wheel (count + 1, wheels, 3), linear between the elevations."""
        last = self.before + first + count
        # Only elevations that the wheels reach in this window are needed.
        rear = float(self.motion[first, 0] - np.max(self.run.offsets))
        begin = max(int(np.searchsorted(self.position, rear)) - 5, 0)
        position = self.position[begin:last]
        derivatives = backward_derivatives(position, elevation[begin:last])
        at = self.motion[first : first + count + 1, :1] - self.run.offsets
        return np.stack([np.interp(at, position, values) for values in derivatives], axis=2)


def backward_derivatives(position: Array, r: Array) -> tuple[Array, Array, Array]:
    """r, r' and r'' at each position from it and the three behind, of second order; 0 where there are fewer.

    Newton's divided differences: r' = r₀₁ + r₀₁₂ (x₀ - x₁), r'' = 2 r₀₁₂ + 2 r₀₁₂₃ (2 x₀ - x₁ - x₂).

    Parameters
    ----------
    position : (n,), increasing, m
    r : (n,), m

    Returns
    -------
    r (n,) in m, r' (n,) and r'' (n,) in 1/m
    """
    r1, r2, r3 = np.zeros((3, len(r)))
    r1[1:] = np.diff(r) / np.diff(position)
    r2[2:] = np.diff(r1[1:]) / (position[2:] - position[:-2])
    r3[3:] = np.diff(r2[2:]) / (position[3:] - position[:-3])
    back = np.diff(position, prepend=position[:1])
    twice = back + np.concatenate([position[:2] * 0.0, position[2:] - position[:-2]])
    return r, r1 + r2 * back, 2 * r2 + 2 * r3 * twice


def forward_model(
    vehicle: Vehicle, track: Track, sensors: tuple[Sensor, ...], scheme: Scheme, position: Array, speed: Array
) -> ForwardModel:  # fmt: skip
    """The forward model of a vehicle that starts in static equilibrium, with level track behind.

    Parameters
    ----------
    position, speed : (steps + 1,), of the leading wheel, m and m/s; the first is the start

    Raises
    ------
    ModelError
        Where the vehicle has no static equilibrium, the step is too long, or a sensor names a missing body.
    """
    matrices = vehicle_matrices(vehicle)
    check_step(matrices, track, scheme)
    start = float(position[0])
    run = (
        LayeredRun.build(matrices, track, MARGIN, start)
        if isinstance(track, LayeredTrack)
        else SimpleRun.build(matrices, track)
    )
    run.set_equilibrium(Flat(), start)
    spacing = float(np.mean(np.diff(position)))
    before = int(np.ceil(vehicle.length / spacing)) + 4
    behind = start - spacing * np.arange(before - 1, -1, -1.0)
    motion = np.stack([position, speed, np.gradient(speed, scheme.step)], axis=1)
    freedoms = (*matrices.freedoms, *((wheel.name, HEAVE) for wheel in vehicle.wheels))
    unit, zero = np.eye(len(freedoms)), np.zeros((len(freedoms),) * 2)
    acceleration_gain, velocity_gain = (
        np.stack(
            [sensor_signal(_unit_motion(freedoms, *pair), vehicle, one) for one in sensors], axis=1
        )
        for pair in ((zero, unit), (unit, zero))
    )
    positions = np.concatenate([behind, position[1:]])
    return ForwardModel(run, scheme, motion, positions, before, acceleration_gain, velocity_gain)


def _unit_motion(
    freedoms: tuple[tuple[str, str], ...], velocity: Array, acceleration: Array
) -> Simulation:
    """A simulation in which one degree of freedom moves at a time, to obtain each sensor's gains."""
    t, x = np.zeros(len(freedoms)), np.zeros_like(velocity)
    return Simulation(t, t, t, freedoms, x, velocity, acceleration, x, x, ())

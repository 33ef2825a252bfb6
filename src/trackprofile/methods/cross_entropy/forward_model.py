"""The forward model over a window: what the sensors read is affine in the elevations (theory, section 5).

y = y_free + G x, with x the elevations at the window's scans and y_free what the state and the track behind make
of x = 0. r' and r'' are backward differences of the elevations, so that no scan looks ahead. They are of second
order, as the integrator: with those of first order the inverse of the car on a layered track is unstable, and any
error of one window grows from window to window.
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
from trackprofile.simulation.layered import MARGIN, LayeredRun
from trackprofile.simulation.mechanics import check_step, vehicle_matrices
from trackprofile.simulation.simple import SimpleRun
from trackprofile.simulation.simulate import Simulation, sensor_signal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForwardModel:
    """A vehicle that tries elevations, window by window, one unknown to a step.

    Parameters
    ----------
    model : with the state at the end of what is decided
    scheme : of the steps
    motion : (steps + 1, 3), position (m), speed and acceleration of the leading wheel, from the start on
    place : (before + steps,), m, of the elevations; the first ``before`` lie behind the first step
    before : how many
    by_acceleration, by_velocity : (freedoms, sensors), from the model's freedoms to what the sensors feel
    """

    model: LayeredRun | SimpleRun
    scheme: Scheme
    motion: Array
    place: Array
    before: int
    by_acceleration: Array
    by_velocity: Array

    @property
    def steady(self) -> bool:
        """Whether G is the same everywhere: constant matrices, and scans evenly spaced."""
        even = np.ptp(np.diff(self.place)) < 1e-9 * np.ptp(self.place)
        return isinstance(self.model, SimpleRun) and bool(even and np.ptp(self.motion[:, 1]) == 0.0)

    def free(self, elevation: Array, first: int, count: int) -> Array:
        """y_free (count, sensors) of the steps from ``first`` on, after ``elevation`` (before + steps,) up to there."""
        return self.signals(self._known(elevation, first), first, count)

    def gain(self, elevation: Array, first: int, count: int) -> Array:
        """G (sensors, count, count): by scan, and by the elevation that is 1 m; zero above the diagonal."""
        known = self._known(elevation, first)
        free = self.signals(known, first, count)
        gain = np.empty((free.shape[1], count, count))
        for j in range(count):
            known[self.before + first + j] = 1.0
            gain[:, :, j] = (self.signals(known, first, count) - free).T
            known[self.before + first + j] = 0.0
        return gain

    def _known(self, elevation: Array, first: int) -> Array:
        known = elevation.copy()
        known[self.before + first :] = 0.0
        return known

    def signals(self, elevation: Array, first: int, count: int) -> Array:
        """What the sensors read over given elevations, (count, sensors), by the model itself."""
        return self._read(elevation, first, count)[0]

    def advanced(self, elevation: Array, first: int, count: int) -> ForwardModel:
        """With the state carried over ``count`` steps that are decided."""
        return replace(self, model=self._read(elevation, first, count)[1])

    def _read(
        self, elevation: Array, first: int, count: int
    ) -> tuple[Array, LayeredRun | SimpleRun]:
        model = self.model.copy()
        theta, window = self.scheme.theta, self.motion[first : first + count + 1]
        under = self._under(elevation, first, count)
        # Wilson asks for equilibrium at t + θ Δt, beyond the step's end: on by straight lines.
        now, below = (rows[:-1] + theta * np.diff(rows, axis=0) for rows in (window, under))
        bodies, wheels, _, _, diverged = model.march(
            self.scheme, now, below, window[1:], under[1:], 1
        )
        if diverged >= 0:
            raise DataError(
                f"The forward model diverged at {now[diverged, 0]:.2f} m: the elevations tried there are no track's."
            )
        moved = np.concatenate([bodies, wheels], axis=2)
        return moved[2] @ self.by_acceleration + moved[1] @ self.by_velocity, model

    def _under(self, elevation: Array, first: int, count: int) -> Array:
        """r, r' and r'' under each wheel (count + 1, wheels, 3), between the elevations by straight lines."""
        last = self.before + first + count
        # Only what the wheels of this window can reach.
        reach = float(self.motion[first, 0] - np.max(self.model.offsets))
        begin = max(int(np.searchsorted(self.place, reach)) - 5, 0)
        place = self.place[begin:last]
        paths = backward_derivatives(place, elevation[begin:last])
        at = self.motion[first : first + count + 1, :1] - self.model.offsets
        return np.stack([np.interp(at, place, values) for values in paths], axis=2)


def backward_derivatives(place: Array, r: Array) -> tuple[Array, Array, Array]:
    """r, r' and r'' at each place from it and the three behind, of second order; 0 where there are not as many.

    Newton's divided differences: r' = r₀₁ + r₀₁₂ (x₀ - x₁), r'' = 2 r₀₁₂ + 2 r₀₁₂₃ (2 x₀ - x₁ - x₂).
    """
    r1, r2, r3 = np.zeros((3, len(r)))
    r1[1:] = np.diff(r) / np.diff(place)
    r2[2:] = np.diff(r1[1:]) / (place[2:] - place[:-2])
    r3[3:] = np.diff(r2[2:]) / (place[3:] - place[:-3])
    back = np.diff(place, prepend=place[:1])
    twice = back + np.concatenate([place[:2] * 0.0, place[2:] - place[:-2]])
    return r, r1 + r2 * back, 2 * r2 + 2 * r3 * twice


def forward_model(
    vehicle: Vehicle, track: Track, sensors: tuple[Sensor, ...], scheme: Scheme, position: Array, speed: Array
) -> ForwardModel:  # fmt: skip
    """A vehicle in static equilibrium at the first position, on level track behind.

    Parameters
    ----------
    position, speed : (steps + 1,), m and m/s of the leading wheel; the first is where it starts

    Raises
    ------
    ModelError
        Where the vehicle cannot stand, the step is too coarse, or a sensor finds no body.
    """
    car = vehicle_matrices(vehicle)
    check_step(car, track, scheme)
    start = float(position[0])
    model = (
        LayeredRun.of(car, track, MARGIN, start)
        if isinstance(track, LayeredTrack)
        else SimpleRun.of(car, track)
    )
    model.begin(Flat(), start)
    spacing = float(np.mean(np.diff(position)))
    before = int(np.ceil(vehicle.length / spacing)) + 4
    behind = start - spacing * np.arange(before - 1, -1, -1.0)
    motion = np.stack([position, speed, np.gradient(speed, scheme.step)], axis=1)
    freedoms = (*car.freedoms, *((wheel.name, HEAVE) for wheel in vehicle.wheels))
    one, none = np.eye(len(freedoms)), np.zeros((len(freedoms),) * 2)
    felt_by = [
        np.stack(
            [sensor_signal(_moving(freedoms, *which), vehicle, sensor) for sensor in sensors],
            axis=1,
        )
        for which in ((none, one), (one, none))
    ]
    return ForwardModel(
        model, scheme, motion, np.concatenate([behind, position[1:]]), before, *felt_by
    )


def _moving(
    freedoms: tuple[tuple[str, str], ...], velocity: Array, acceleration: Array
) -> Simulation:
    """Freedoms that move one at a time, to ask the sensors what they feel of each."""
    t, x = np.zeros(len(freedoms)), np.zeros_like(velocity)
    return Simulation(t, t, t, freedoms, x, velocity, acceleration, x, x, ())

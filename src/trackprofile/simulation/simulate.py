"""Simulation of a run: motion of vehicle, wheels and rail over a given irregularity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError, ModelError
from trackprofile.models.integrate import Scheme
from trackprofile.models.irregularity import Irregularity
from trackprofile.models.sensor import PITCH_RATE, ROLL_RATE, Sensor
from trackprofile.models.track import LayeredTrack, Track
from trackprofile.models.vehicle import HEAVE, PITCH, Vehicle, displacement_row
from trackprofile.simulation.coupled_kernels import CoupledPath
from trackprofile.simulation.layered import MARGIN, LayeredRun
from trackprofile.simulation.mechanics import check_step, vehicle_matrices
from trackprofile.simulation.simple import SimpleRun
from trackprofile.simulation.speed_schedule import RecordedMotion, SpeedSchedule

Array = NDArray[np.float64]

CHUNK = 20_000
"""Number of steps between two reports of progress."""


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run.

    Parameters
    ----------
    start, end : positions of the leading wheel between which the run is recorded, m
    schedule : motion from ``run_in`` before ``start`` on
    run_in : distance run before the start, over the first half of which the irregularity grows, m
    every : number of steps per recorded step
    margin : modelled length of a layered track before the first and behind the last wheel, m
    """

    start: float
    end: float
    schedule: SpeedSchedule | RecordedMotion
    run_in: float = 100.0
    every: int = 1
    margin: float = MARGIN


@dataclass(frozen=True)
class Simulation:
    """Result of a simulation, from the leading wheel's ``start`` on; n recorded steps.

    Parameters
    ----------
    time, position, speed : (n,), of the leading wheel, s, m and m/s
    freedoms : (part, motion) of the bodies, then of the wheels
    displacement, velocity, acceleration : (n, freedoms), from the unloaded position, m or rad and per s and s²
    contact_force : (n, wheels), compression positive, N
    rail_deflection : (n, wheels), under each wheel, upward positive, m
    notes : warnings, one sentence each
    """

    time: Array
    position: Array
    speed: Array
    freedoms: tuple[tuple[str, str], ...]
    displacement: Array
    velocity: Array
    acceleration: Array
    contact_force: Array
    rail_deflection: Array
    notes: tuple[str, ...]


def simulate(
    vehicle: Vehicle,
    track: Track,
    irregularity: Irregularity,
    run: RunSettings,
    scheme: Scheme,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Simulation:
    """Simulate the run of a vehicle over a track (theory, sections 3 and 4).

    The vehicle starts at rest on the loaded track, ``run.run_in`` before the start, from where the irregularity grows
    smoothly. Contact is bilateral: where a contact force is negative the wheel would lift off; ``notes`` reports it.

    Parameters
    ----------
    vehicle : vehicle that runs
    track : rigid, elastic or layered track
    irregularity : unloaded profile of both rails
    run : section, motion and run-in
    scheme : integration scheme with its step
    progress : called with the stage and the share done

    Raises
    ------
    ModelError
        Where the model has no static equilibrium, or the step is too long for its stiffest mode.
    DataError
        Where the irregularity is shorter than the run, or the motion diverges.

    Examples
    --------
    >>> from trackprofile.models.integrate import newmark
    >>> from trackprofile.models.irregularity import Bell
    >>> from trackprofile.simulation.speed_schedule import constant_speed
    >>> from trackprofile.io.model_toml import read_track, read_vehicle
    >>> car, _ = read_vehicle("quarter-car")
    >>> run = RunSettings(100.0, 120.0, constant_speed(30.0))
    >>> made = simulate(car, read_track("rigid"), Bell(0.002, 0.5, 110.0), run, newmark(1e-3))
    >>> made.contact_force.shape
    (667, 1)
    """
    _check_run(run)
    matrices = vehicle_matrices(vehicle)
    check_step(matrices, track, scheme)
    first = run.start - run.run_in
    if isinstance(track, LayeredTrack):
        model = LayeredRun.build(matrices, track, run.margin, first)
    else:
        model = SimpleRun.build(matrices, track)
    steps = int(np.floor(run.schedule.duration(run.end - first) / scheme.step * (1 + 1e-12)))
    steps -= steps % run.every
    profile = RampedIrregularity(irregularity, first, 0.5 * run.run_in)
    model.set_equilibrium(profile, first)
    parts = []
    chunk = CHUNK - CHUNK % run.every
    for begin in range(0, steps, chunk):
        numbers = begin + np.arange(min(chunk, steps - begin))
        progress("simulating", begin / max(steps, 1))
        parts.append(_simulate_steps(model, profile, run, scheme, numbers))
    progress("simulating", 1.0)
    return _joined(vehicle, matrices.freedoms, parts, run)


@dataclass(frozen=True)
class RampedIrregularity:
    """An irregularity that grows from 0 at ``begin`` to its full size over a length.

    With u = (x - begin)/length it is multiplied by u³ (10 - 15 u + 6 u²), which has two continuous derivatives.

    Parameters
    ----------
    full : the irregularity without the ramp
    begin : start of the ramp, m
    length : length of the ramp, m
    """

    full: Irregularity
    begin: float
    length: float

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m] at ``distance`` (n,) [m]; (3, n)."""
        if self.length == 0:
            return self.full.at(distance)
        inside = distance > self.begin
        r, slope, curvature = np.zeros((3, len(distance)))
        r[inside], slope[inside], curvature[inside] = self.full.at(distance[inside])
        u = np.clip((distance - self.begin) / self.length, 0.0, 1.0)
        w = u**3 * (10 - 15 * u + 6 * u**2)
        dw = 30 * u**2 * (1 - u) ** 2 / self.length
        ddw = 60 * u * (1 - u) * (1 - 2 * u) / self.length**2
        return np.stack([w * r, w * slope + dw * r, w * curvature + 2 * dw * slope + ddw * r])


def sensor_signal(simulation: Simulation, vehicle: Vehicle, sensor: Sensor) -> Array:
    """Reading of a sensor without noise, with its gain and tilt, (n,), m/s² or rad/s.

    Both rails have the same profile in a simulation, so the roll rate is 0 and lateral positions have no effect.

    Raises
    ------
    ModelError
        Where the vehicle has no such body, or the body has no pitch.
    """
    freedom = (sensor.body, PITCH if sensor.quantity == PITCH_RATE else HEAVE)
    if freedom not in simulation.freedoms:
        parts = dict.fromkeys(part for part, _ in simulation.freedoms)
        raise ModelError(
            f"sensor {sensor.name!r} measures the {freedom[1]} of {sensor.body!r}, which {vehicle.name!r} does not "
            f"have; its parts are {', '.join(parts)}"
        )
    if sensor.quantity == ROLL_RATE:
        return np.zeros(len(simulation.time))
    if sensor.quantity == PITCH_RATE:
        return sensor.gain * simulation.velocity[:, simulation.freedoms.index(freedom)]
    if sensor.body in [wheel.name for wheel in vehicle.wheels]:
        column = simulation.freedoms.index(freedom)
        return sensor.effective_gain * simulation.acceleration[:, column]
    position = vehicle.body(sensor.body).position - sensor.position
    row = displacement_row(vehicle, simulation.freedoms, sensor.body, position)
    return np.asarray(sensor.effective_gain * (simulation.acceleration @ row), np.float64)


@dataclass(frozen=True)
class _RecordedSteps:
    """Time and motion (n, 4), bodies and wheels (3, n, ...), forces and deflections (n, wheels)."""

    motion: Array
    bodies: Array
    wheels: Array
    force: Array
    deflection: Array


def _simulate_steps(
    model: LayeredRun | SimpleRun, profile: RampedIrregularity, run: RunSettings, scheme: Scheme,
    numbers: NDArray[np.intp],
) -> _RecordedSteps:  # fmt: skip
    """Advance the model over the steps of the given numbers, counted from the start of the run-in."""
    first = run.start - run.run_in
    equilibrium = run.schedule.at(np.asarray((numbers + scheme.theta) * scheme.step, np.float64))
    time = np.asarray((numbers + 1) * scheme.step, np.float64)
    ends = run.schedule.at(time)
    equilibrium[:, 0] += first
    ends[:, 0] += first
    recorded = slice(run.every - 1, None, run.every)
    under = _under_wheels(profile, equilibrium[:, 0], model.offsets)
    # With θ = 1 equilibrium is at the end of the step, so that one evaluation serves both.
    same = scheme.theta == 1.0
    at_ends = under[recorded] if same else _under_wheels(profile, ends[recorded, 0], model.offsets)
    bodies, wheels, force, deflection, diverged = model.march(
        scheme, CoupledPath(equilibrium, under, ends, at_ends), run.every
    )
    if diverged >= 0:
        raise DataError(
            f"The simulation diverged after {time[diverged]:.3f} s, with the leading wheel at "
            f"{ends[diverged, 0]:.2f} m: check the parameters of vehicle and track there, or change the time step."
        )
    motion = np.asarray(np.column_stack([time, ends])[recorded], np.float64)
    return _RecordedSteps(motion, bodies, wheels, force, deflection)


def _under_wheels(profile: RampedIrregularity, position: Array, offsets: Array) -> Array:
    """r, r' and r'' under each wheel (n, wheels, 3)."""
    positions = position[:, None] - offsets
    values = profile.at(positions.ravel()).reshape(3, *positions.shape)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _joined(
    vehicle: Vehicle,
    freedoms: tuple[tuple[str, str], ...],
    parts: list[_RecordedSteps],
    run: RunSettings,
) -> Simulation:
    motion = np.concatenate([part.motion for part in parts])
    kept = motion[:, 1] >= run.start - 1e-9
    states = np.concatenate(
        [np.concatenate([part.bodies, part.wheels], axis=2) for part in parts], axis=1
    )[:, kept]
    force = np.concatenate([part.force for part in parts])[kept]
    deflection = np.concatenate([part.deflection for part in parts])[kept]
    time, position, speed, _ = motion[kept].T
    wheels = tuple((wheel.name, HEAVE) for wheel in vehicle.wheels)
    notes = _lift_off(vehicle, position, force)
    displacement, velocity, acceleration = states
    return Simulation(
        time - time[0], position, speed, (*freedoms, *wheels),
        displacement, velocity, acceleration, force, deflection, notes,
    )  # fmt: skip


def _lift_off(vehicle: Vehicle, position: Array, force: Array) -> tuple[str, ...]:
    lift_off = np.argwhere(force < 0)
    if not len(lift_off):
        return ()
    step, wheel = lift_off[0]
    share = float(np.mean(np.any(force < 0, axis=1)))
    return (
        f"contact forces are negative in {100 * share:.2g} % of the time, first at {vehicle.wheels[wheel].name!r} with "
        f"the leading wheel at {position[step]:.2f} m: the wheel would lift off there, and the model, which assumes "
        "permanent contact, is not valid",
    )


def _check_run(run: RunSettings) -> None:
    if not run.end > run.start:
        raise ModelError(
            f"A run needs an end beyond its start, got {run.start:g} m to {run.end:g} m."
        )
    if not run.margin >= 5:
        raise ModelError(
            f"A run needs a margin of at least 5 m of track beyond its outer wheels, got {run.margin:g} m."
        )
    if not run.run_in >= 0:
        raise ModelError(f"A run needs a run-in of at least 0 m, got {run.run_in:g} m.")
    if not run.every >= 1:
        raise ModelError(f"every must be at least 1 step per recorded step, got {run.every}.")

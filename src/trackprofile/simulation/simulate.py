"""simulate: what a vehicle, its wheels and the rail do on a run over a given irregularity."""

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
from trackprofile.simulation.layered import MARGIN, LayeredRun
from trackprofile.simulation.mechanics import check_step, vehicle_matrices
from trackprofile.simulation.simple import SimpleRun
from trackprofile.simulation.speed_schedule import RecordedMotion, SpeedSchedule

Array = NDArray[np.float64]

CHUNK = 20_000
"""Steps between two reports of progress."""


@dataclass(frozen=True)
class RunSettings:
    """Where and how a train runs.

    Parameters
    ----------
    start, end : of the leading wheel, m; what is recorded
    schedule : from ``run_in`` before ``start`` on
    run_in : m before the start, over the first half of which the irregularity sets in
    every : record one step in so many
    margin : m of a layered track that is modelled before the first and behind the last wheel
    """

    start: float
    end: float
    schedule: SpeedSchedule | RecordedMotion
    run_in: float = 100.0
    every: int = 1
    margin: float = MARGIN


@dataclass(frozen=True)
class Simulation:
    """What happened, from the leading wheel's ``start`` on; n recorded steps.

    Parameters
    ----------
    time, position, speed : (n,), s, m and m/s, of the leading wheel
    freedoms : (part, motion) of the bodies, then the wheels
    displacement, velocity, acceleration : (n, freedoms), m or rad, from the unloaded position
    contact_force : (n, wheels), N, compression positive
    rail_deflection : (n, wheels), m under each wheel, down negative
    notes : what a reader must know
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
    """Run a vehicle over a track (theory, sections 3 and 4).

    The vehicle starts at rest on the loaded track, ``run.run_in`` before the start, where the irregularity sets in
    smoothly. Contact is bilateral: where a contact force turns negative the wheel would lift off, and a note says so.

    Raises
    ------
    ModelError
        Where the model cannot stand, or a step is too coarse for its stiffest mode.
    DataError
        Where the irregularity is shorter than the run, or the motion diverges; says where.

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
    car = vehicle_matrices(vehicle)
    check_step(car, track, scheme)
    if isinstance(track, LayeredTrack):
        model = LayeredRun.of(car, track, run.margin, run.start - run.run_in)
    else:
        model = SimpleRun.of(car, track)
    first = run.start - run.run_in
    steps = int(np.floor(run.schedule.duration(run.end - first) / scheme.step * (1 + 1e-12)))
    steps -= steps % run.every
    profile = RampedIrregularity(irregularity, first, 0.5 * run.run_in)
    model.begin(profile, first)
    parts = []
    whole = CHUNK - CHUNK % run.every
    for begin in range(0, steps, whole):
        count = min(whole, steps - begin)
        progress("simulating", begin / max(steps, 1))
        parts.append(_chunk(model, profile, run, scheme, first, begin, count))
    progress("simulating", 1.0)
    return _collected(vehicle, car.freedoms, parts, run)


@dataclass(frozen=True)
class RampedIrregularity:
    """An irregularity that grows from nothing at ``begin`` to the whole ``length`` m further on.

    With u = (x - begin)/length it is multiplied by u³ (10 - 15 u + 6 u²), which has two continuous derivatives.
    """

    whole: Irregularity
    begin: float
    length: float

    def at(self, distance: Array) -> Array:
        """r, r' and r'' (3, n)."""
        if self.length == 0:
            return self.whole.at(distance)
        grown = distance > self.begin
        r, slope, bend = np.zeros((3, len(distance)))
        r[grown], slope[grown], bend[grown] = self.whole.at(distance[grown])
        u = np.clip((distance - self.begin) / self.length, 0.0, 1.0)
        share = u**3 * (10 - 15 * u + 6 * u**2)
        share1 = 30 * u**2 * (1 - u) ** 2 / self.length
        share2 = 60 * u * (1 - u) * (1 - 2 * u) / self.length**2
        return np.stack(
            [share * r, share * slope + share1 * r, share * bend + 2 * share1 * slope + share2 * r]
        )


def sensor_signal(simulation: Simulation, vehicle: Vehicle, sensor: Sensor) -> Array:
    """What a sensor with that gain and tilt, otherwise exact, would read at that place, (n,), m/s² or rad/s.

    Both rails are alike here, so that nothing rolls, and it is the same left and right.

    Raises
    ------
    ModelError
        Where the vehicle has no such body, or the body does not pitch.
    """
    wanted = (sensor.body, PITCH if sensor.quantity == PITCH_RATE else HEAVE)
    if wanted not in simulation.freedoms:
        parts = dict.fromkeys(part for part, _ in simulation.freedoms)
        raise ModelError(
            f"sensor {sensor.name!r} measures the {wanted[1]} of {sensor.body!r}, which {vehicle.name!r} does not "
            f"have; its parts are {', '.join(parts)}"
        )
    if sensor.quantity == ROLL_RATE:
        return np.zeros(len(simulation.time))
    if sensor.quantity == PITCH_RATE:
        return sensor.gain * simulation.velocity[:, simulation.freedoms.index(wanted)]
    if sensor.body in [wheel.name for wheel in vehicle.wheels]:
        return sensor.effective_gain * simulation.acceleration[:, simulation.freedoms.index(wanted)]
    place = vehicle.body(sensor.body).position - sensor.position
    row = displacement_row(vehicle, simulation.freedoms, sensor.body, place)
    return np.asarray(sensor.effective_gain * (simulation.acceleration @ row), np.float64)


@dataclass(frozen=True)
class _Chunk:
    """Recorded steps: time and motion (n, 4), bodies and wheels (3, n, ...), forces and deflections (n, wheels)."""

    motion: Array
    bodies: Array
    wheels: Array
    force: Array
    deflection: Array


def _chunk(
    model: LayeredRun | SimpleRun, profile: RampedIrregularity, run: RunSettings, scheme: Scheme,
    first: float, begin: int, count: int,
) -> _Chunk:  # fmt: skip
    number = begin + np.arange(count)
    equilibrium = run.schedule.at(np.asarray((number + scheme.theta) * scheme.step, np.float64))
    time = np.asarray((number + 1) * scheme.step, np.float64)
    ends = run.schedule.at(time)
    equilibrium[:, 0] += first
    ends[:, 0] += first
    recorded = slice(run.every - 1, None, run.every)
    under = _under_wheels(profile, equilibrium[:, 0], model.offsets)
    # Where equilibrium is that of the end, one evaluation serves both.
    same = scheme.theta == 1.0
    at_ends = under[recorded] if same else _under_wheels(profile, ends[recorded, 0], model.offsets)
    bodies, wheels, force, deflection, diverged = model.march(
        scheme, equilibrium, under, ends, at_ends, run.every
    )
    if diverged >= 0:
        raise DataError(
            f"The simulation diverged after {time[diverged]:.3f} s, with the leading wheel at "
            f"{ends[diverged, 0]:.2f} m: check the vehicle's and the track's numbers there, or take another step."
        )
    motion = np.asarray(np.column_stack([time, ends])[recorded], np.float64)
    return _Chunk(motion, bodies, wheels, force, deflection)


def _under_wheels(profile: RampedIrregularity, position: Array, offsets: Array) -> Array:
    """r, r' and r'' under each wheel (n, wheels, 3)."""
    places = position[:, None] - offsets
    values = profile.at(places.ravel()).reshape(3, *places.shape)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _collected(
    vehicle: Vehicle, freedoms: tuple[tuple[str, str], ...], parts: list[_Chunk], run: RunSettings
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
    lifted = np.argwhere(force < 0)
    if not len(lifted):
        return ()
    step, wheel = lifted[0]
    share = float(np.mean(np.any(force < 0, axis=1)))
    return (
        f"contact forces turn negative, first of {vehicle.wheels[wheel].name!r} with the leading wheel at "
        f"{position[step]:.2f} m, in {100 * share:.2g} % of the time: there the wheel would lift off, and the model, "
        "which assumes contact, is wrong",
    )


def _check_run(run: RunSettings) -> None:
    if not run.end > run.start:
        raise ModelError(
            f"A run needs an end beyond its start, got {run.start:g} m to {run.end:g} m."
        )
    if not run.margin >= 5:
        raise ModelError(
            f"A run needs at least 5 m of track beyond its wheels, got a margin of {run.margin:g} m."
        )
    if not run.run_in >= 0:
        raise ModelError(f"A run needs a running-in of at least 0 m, got {run.run_in:g} m.")
    if not run.every >= 1:
        raise ModelError(f"One step in {run.every} cannot be recorded; give 1 or more.")

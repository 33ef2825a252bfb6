"""Scenarios: a simulated run described in TOML by vehicle, track, irregularity, speed and sensors.

vehicle = "velaro"                      # a preset, or a TOML in the folder of this file
track = "zhai-layered"
sensors = "bogie-25ug"                  # a preset, a TOML, or tables [[sensor]] as in such a TOML
sampling = "500 Hz"                     # with a low-pass at a quarter of it, unless anti_alias = false
seed = 1                                # seed of the sensors' noise

[run]
start = "0 m"                           # leading wheel; the recording covers start to end
end = "200 m"
speed = "150 km/h"                      # or [{ time = "0 s", speed = "40 m/s" }, ...], from the start of the run-in
run_in = "100 m"                        # distance before the start; the irregularity grows over its first half

[integration]
scheme = "newmark"                      # or "wilson"
steps_per_sample = 4                    # a step of 0.5 ms

[[irregularity]]                        # any number of tables; their sum is the profile
kind = "bell"                           # "bell", "random", "dip" or "file"
depth = "2 mm"
width = "0.5 m"
centre = "100 m"

[[change]]                              # local change of the track's supports
field = "ballast_stiffness"
factor = 0.3
start = "120 m"
end = "123 m"
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import xarray as xr

from trackprofile.contracts import Channel, append_provenance, build_profile, build_recording
from trackprofile.errors import FileError, ModelError, TrackprofileError
from trackprofile.io.model_toml import read_instruments, read_track, read_vehicle
from trackprofile.io.scenario_tables import (
    ChangeTable,
    IntegrationTable,
    RunTable,
    ScenarioTable,
    preset_or_path,
)
from trackprofile.io.table import error_location
from trackprofile.io.toml_document import load
from trackprofile.models.integrate import Scheme, newmark, wilson
from trackprofile.models.irregularity import Irregularity, Sum
from trackprofile.models.sensor_errors import Instrument, measure, with_anti_alias_filter
from trackprofile.models.track import LayeredTrack, Track
from trackprofile.models.vehicle import HEAVE, Vehicle
from trackprofile.simulation.mechanics import check_step, vehicle_matrices
from trackprofile.simulation.simulate import RunSettings, Simulation, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import SpeedSchedule

PRESETS = Path(str(files("trackprofile") / "presets" / "scenario"))
TRUTH_SPACING = 0.25
"""Spacing of the true profile, m, as EN 13848-2 requires."""

SOURCE = "simulated by trackprofile simulate: no train measured this"


@dataclass(frozen=True)
class Scenario:
    """A checked scenario.

    Parameters
    ----------
    name : name of the scenario
    vehicle_name : name or path of the vehicle in the scenario
    vehicle, track, irregularity, run, scheme : models and settings of the simulation
    instruments : sensors with their errors
    sampling_interval : s
    steps_per_sample : number of integration steps per sample
    seed : seed of the sensors' noise
    """

    name: str
    vehicle_name: str
    vehicle: Vehicle
    track: Track
    irregularity: Irregularity
    run: RunSettings
    scheme: Scheme
    instruments: tuple[Instrument, ...]
    sampling_interval: float
    steps_per_sample: int
    seed: int


@dataclass(frozen=True)
class SimulatedRun:
    """Result of a scenario.

    Parameters
    ----------
    recording : the recording contract
    truth : the profile contract
    simulation : motion of vehicle, wheels and rail
    """

    recording: xr.Dataset
    truth: xr.Dataset
    simulation: Simulation


def scenarios() -> tuple[str, ...]:
    """Names of the built-in scenarios.

    Examples
    --------
    >>> "bell-model-a" in scenarios()
    True
    """
    return tuple(sorted(path.stem for path in PRESETS.glob("*.toml")))


def read_scenario(name_or_path: str | Path, seed: int | None = None) -> Scenario:
    """Read a scenario and check that it can run.

    Parameters
    ----------
    name_or_path : name of a built-in scenario, or path of a TOML
    seed : seed of the sensors' noise; None uses that of the scenario

    Raises
    ------
    FileError, UnitError, ModelError, DataError : the scenario is invalid; the message names the file and the key.

    Examples
    --------
    >>> read_scenario("bell-model-a").vehicle.name
    'quarter-car'
    """
    path = Path(name_or_path)
    if str(name_or_path) in scenarios():
        path = PRESETS / f"{name_or_path}.toml"
    elif not path.exists():
        known = ", ".join(scenarios())
        raise FileError(
            f"{name_or_path}: no such file; give the path of a scenario TOML or one of {known}."
        )
    table = load(path, ScenarioTable)
    try:
        return _scenario(path, table, table.seed if seed is None else seed)
    except TrackprofileError as error:
        raise type(error)(f"{path}: {error}") from error


def run_scenario(
    scenario: Scenario, progress: Callable[[str, float], None] = lambda stage, share: None
) -> SimulatedRun:
    """Simulate a scenario and its sensors.

    Parameters
    ----------
    progress : called with the stage and the share done

    Examples
    --------
    >>> run = run_scenario(read_scenario("bell-model-a"))
    >>> run.recording.attrs["kind_of_data"], run.truth.attrs["kind"]
    ('recording', 'truth')
    """
    simulation = simulate(
        scenario.vehicle, scenario.track, scenario.irregularity, scenario.run, scenario.scheme, progress
    )  # fmt: skip
    generator = np.random.default_rng(scenario.seed)
    channels = []
    for instrument in scenario.instruments:
        sensor = instrument.sensor
        exact = sensor_signal(simulation, scenario.vehicle, sensor)
        values, valid = measure(
            instrument, exact, scenario.scheme.step, scenario.sampling_interval, generator
        )
        channels.append(
            Channel(
                sensor.name, values, sensor.quantity, sensor.body, sensor.position, sensor.noise_density, valid,
                sensor.bandwidth, sensor.flicker or None, lateral=sensor.lateral,
            )
        )  # fmt: skip
    sampled = slice(None, None, scenario.steps_per_sample)
    provenance = (
        f"simulate: scenario {scenario.name}, step {scenario.scheme.step:g} s, seed {scenario.seed}"
    )
    recording = build_recording(
        channels, time=simulation.time[sampled], distance=simulation.position[sampled],
        speed=simulation.speed[sampled], source=SOURCE, vehicle=scenario.vehicle_name,
    )  # fmt: skip
    # Before the middle of the run-in the irregularity does not have its full size.
    full_size = scenario.run.start - 0.5 * scenario.run.run_in
    first = max(simulation.position[0] - scenario.vehicle.length, full_size)
    ends = np.ceil(first / TRUTH_SPACING), np.floor(simulation.position[-1] / TRUTH_SPACING) + 1
    distance = TRUTH_SPACING * np.arange(*ends)
    elevation = scenario.irregularity.at(distance)[0]
    truth = build_profile(distance, elevation, kind="truth", vehicle=scenario.vehicle.name)
    return SimulatedRun(
        append_provenance(recording, provenance), append_provenance(truth, provenance), simulation
    )


def step_errors(scenario: Scenario, run: SimulatedRun) -> dict[str, float]:
    """Estimate the error of the time step: relative change of each exact signal (L2 norm) when the step is halved.

    Both schemes are of second order, so that the error itself is about a third larger.

    Returns
    -------
    relative change by sensor name

    Examples
    --------
    >>> scenario = read_scenario("bell-model-a")
    >>> {name: round(error, 3) for name, error in step_errors(scenario, run_scenario(scenario)).items()}
    {'bogie_acceleration': 0.001}
    """
    half_step = replace(scenario.run, every=2)
    scheme = scenario.scheme
    finer = (
        newmark(scheme.step / 2) if scheme.theta == 1.0 else wilson(scheme.step / 2, scheme.theta)
    )
    refined = simulate(scenario.vehicle, scenario.track, scenario.irregularity, half_step, finer)
    errors = {}
    for instrument in scenario.instruments:
        coarse, fine = (
            sensor_signal(one, scenario.vehicle, instrument.sensor)
            for one in (run.simulation, refined)
        )
        common = min(len(coarse), len(fine))
        change = coarse[:common] - fine[:common]
        errors[instrument.sensor.name] = float(
            np.linalg.norm(change) / np.linalg.norm(fine[:common])
        )
    return errors


def _scenario(path: Path, table: ScenarioTable, seed: int) -> Scenario:
    folder = path.parent
    vehicle, _ = read_vehicle(preset_or_path(table.vehicle, folder))
    sampling_interval = 1.0 / _positive(table.sampling, "sampling")
    with error_location("[integration]"):
        scheme = _scheme(table.integration, sampling_interval)
    with error_location("[run]"):
        run = _run(table.run, sampling_interval)
    span = _span(run, scheme, vehicle.length)
    parts = []
    for number, one in enumerate(table.irregularity, start=1):
        with error_location(f"irregularity {number}, {one.kind}"):
            parts.append(one.made(folder, span))
    instruments = _instruments(table, folder)
    _check_bodies(vehicle, instruments)
    if table.anti_alias:
        instruments = tuple(with_anti_alias_filter(one, sampling_interval) for one in instruments)
    track = _with_changes(read_track(preset_or_path(table.track, folder)), table.change)
    check_step(vehicle_matrices(vehicle), track, scheme)
    return Scenario(
        path.stem, table.vehicle, vehicle, track, Sum(tuple(parts)), run, scheme, instruments, sampling_interval,
        table.integration.steps_per_sample, seed,
    )  # fmt: skip


def _positive(value: float, name: str) -> float:
    if not value > 0:
        raise ModelError(f"{name} must be above 0, got {value:g}")
    return value


def _scheme(table: IntegrationTable, sampling_interval: float) -> Scheme:
    step = sampling_interval / table.steps_per_sample
    return newmark(step) if table.scheme == "newmark" else wilson(step, table.theta)


def _run(table: RunTable, sampling_interval: float) -> RunSettings:
    schedule = SpeedSchedule(
        tuple(one.time for one in table.speed), tuple(one.speed for one in table.speed)
    )
    start, end, run_in = table.start, table.end, table.run_in
    if not end > start:
        raise ModelError(f"the run needs an end beyond its start, got {start:g} m to {end:g} m")
    if not run_in >= 10:
        raise ModelError(f"the run needs a run-in of at least 10 m, got {run_in:g} m")
    duration = schedule.duration(end - start + run_in) - schedule.duration(run_in)
    if duration < 2 * sampling_interval:
        raise ModelError(
            f"the run lasts {duration:.2g} s, less than two samples; extend it or raise the sampling rate"
        )
    return RunSettings(start, end, schedule, run_in)


def _span(run: RunSettings, scheme: Scheme, length: float) -> tuple[float, float]:
    """Distances between which the irregularity is needed, m; Wilson's θ extends them beyond the end of the run."""
    first = run.start - run.run_in
    until = run.schedule.duration(run.end - first) + scheme.theta * scheme.step
    return first - length, first + float(run.schedule.at(np.array([until]))[0, 0])


def _instruments(table: ScenarioTable, folder: Path) -> tuple[Instrument, ...]:
    if (table.sensors is None) == (not table.sensor):
        raise ModelError("give either the key sensors (a preset or a TOML) or tables [[sensor]]")
    if table.sensors is None:
        return tuple(one.to_instrument(table.source) for one in table.sensor)
    return read_instruments(preset_or_path(table.sensors, folder))


def _check_bodies(vehicle: Vehicle, instruments: tuple[Instrument, ...]) -> None:
    """Check that the vehicle has the body of every sensor, with the signals of an empty simulation."""
    freedoms = (*vehicle_matrices(vehicle).freedoms, *((one.name, HEAVE) for one in vehicle.wheels))
    t, x = np.zeros(0), np.zeros((0, len(freedoms)))
    empty = Simulation(t, t, t, freedoms, x, x, x, x, x, ())
    for one in instruments:
        sensor_signal(empty, vehicle, one.sensor)


def _with_changes(track: Track, changes: list[ChangeTable]) -> Track:
    if not changes:
        return track
    if not isinstance(track, LayeredTrack):
        raise ModelError("a change needs a layered track; this track has no supports")
    return replace(track, changes=(*track.changes, *(one.made() for one in changes)))

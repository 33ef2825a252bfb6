"""Scenarios: who runs where, over what, with which sensors on board, as a person writes it in TOML.

vehicle = "velaro"                      # a preset, or a TOML beside this file
track = "zhai-layered"
sensors = "bogie-25ug"                  # or tables [[sensor]], as such a TOML has them
sampling = "500 Hz"                     # behind a low-pass at a quarter of it, unless anti_alias = false
seed = 1                                # of the sensors' noise

[run]
start = "0 m"                           # of the leading wheel; what is recorded
end = "200 m"
speed = "150 km/h"                      # or [{ time = "0 s", speed = "40 m/s" }, ...] from the running in on
run_in = "100 m"                        # before the start; the irregularity grows over its first half

[integration]
scheme = "newmark"                      # or "wilson"
steps_per_sample = 4                    # so that a step is 0.5 ms

[[irregularity]]                        # as many as there are, on top of one another
kind = "bell"                           # or random, dip, file
depth = "2 mm"
width = "0.5 m"
centre = "100 m"

[[change]]                              # of the track's supports
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
"""m between the points of the true profile, as EN 13848-2 asks."""

SOURCE = "simulated by trackprofile simulate: no train measured this"


@dataclass(frozen=True)
class Scenario:
    """A scenario, checked and ready to run; ``sampling_interval`` in s, ``named`` what it calls the vehicle."""

    name: str
    named: str
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
    """What a scenario made: recording and truth by their contracts, and all that moved."""

    recording: xr.Dataset
    truth: xr.Dataset
    simulation: Simulation


def scenarios() -> tuple[str, ...]:
    """The names of the scenarios that are built in.

    Examples
    --------
    >>> "bell-model-a" in scenarios()
    True
    """
    return tuple(sorted(path.stem for path in PRESETS.glob("*.toml")))


def read_scenario(name_or_path: str | Path, seed: int | None = None) -> Scenario:
    """Read a scenario, and refuse what could not run.

    Parameters
    ----------
    name_or_path : of a built-in scenario, or of a TOML
    seed : of the sensors' noise, in place of the scenario's

    Raises
    ------
    FileError, UnitError, ModelError, DataError : with what is wrong and where.

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
            f"{name_or_path}: there is no such file; give a scenario's TOML or one of {known}."
        )
    table = load(path, ScenarioTable)
    try:
        return _scenario(path, table, table.seed if seed is None else seed)
    except TrackprofileError as error:
        raise type(error)(f"{path}: {error}") from error


def run_scenario(
    scenario: Scenario, progress: Callable[[str, float], None] = lambda stage, share: None
) -> SimulatedRun:
    """Simulate a scenario and record it.

    Examples
    --------
    >>> made = run_scenario(read_scenario("bell-model-a"))
    >>> sorted(made.recording.attrs["kind_of_data"] for made in [made])
    ['recording']
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
    taken = slice(None, None, scenario.steps_per_sample)
    said = (
        f"simulate: scenario {scenario.name}, step {scenario.scheme.step:g} s, seed {scenario.seed}"
    )
    recording = build_recording(
        channels, time=simulation.time[taken], distance=simulation.position[taken],
        speed=simulation.speed[taken], source=SOURCE, vehicle=scenario.named,
    )  # fmt: skip
    # Before the middle of the running in no wheel saw the whole irregularity.
    whole = scenario.run.start - 0.5 * scenario.run.run_in
    first = max(simulation.position[0] - scenario.vehicle.length, whole)
    ends = np.ceil(first / TRUTH_SPACING), np.floor(simulation.position[-1] / TRUTH_SPACING) + 1
    place = TRUTH_SPACING * np.arange(*ends)
    elevation = scenario.irregularity.at(place)[0]
    truth = build_profile(place, elevation, kind="truth", vehicle=scenario.vehicle.name)
    return SimulatedRun(
        append_provenance(recording, said), append_provenance(truth, said), simulation
    )


def step_errors(scenario: Scenario, made: SimulatedRun) -> dict[str, float]:
    """How much the step costs: by sensor, the exact signal's relative change in L2 when the step is halved.

    Both schemes are of second order, so that the error itself is about a third more.

    Examples
    --------
    >>> scenario = read_scenario("bell-model-a")
    >>> {name: round(error, 3) for name, error in step_errors(scenario, run_scenario(scenario)).items()}
    {'bogie_acceleration': 0.001}
    """
    half = replace(scenario.run, every=2)
    scheme = scenario.scheme
    finer = (
        newmark(scheme.step / 2) if scheme.theta == 1.0 else wilson(scheme.step / 2, scheme.theta)
    )
    again = simulate(scenario.vehicle, scenario.track, scenario.irregularity, half, finer)
    errors = {}
    for instrument in scenario.instruments:
        coarse, fine = (
            sensor_signal(one, scenario.vehicle, instrument.sensor)
            for one in (made.simulation, again)
        )
        common = min(len(coarse), len(fine))
        left = coarse[:common] - fine[:common]
        errors[instrument.sensor.name] = float(np.linalg.norm(left) / np.linalg.norm(fine[:common]))
    return errors


def _scenario(path: Path, table: ScenarioTable, seed: int) -> Scenario:
    beside = path.parent
    vehicle, _ = read_vehicle(preset_or_path(table.vehicle, beside))
    sampling_interval = 1.0 / _positive(table.sampling, "sampling")
    with error_location("[integration]"):
        scheme = _scheme(table.integration, sampling_interval)
    with error_location("[run]"):
        run = _run(table.run, sampling_interval)
    span = _span(run, scheme, vehicle.length)
    parts = []
    for number, one in enumerate(table.irregularity, start=1):
        with error_location(f"irregularity {number}, {one.kind}"):
            parts.append(one.made(beside, span))
    instruments = _instruments(table, beside)
    _check_bodies(vehicle, instruments)
    if table.anti_alias:
        instruments = tuple(with_anti_alias_filter(one, sampling_interval) for one in instruments)
    track = _changed(read_track(preset_or_path(table.track, beside)), table.change)
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
        raise ModelError(f"the run needs at least 10 m of running in, got {run_in:g} m")
    lasts = schedule.duration(end - start + run_in) - schedule.duration(run_in)
    if lasts < 2 * sampling_interval:
        raise ModelError(
            f"the run lasts {lasts:.2g} s, less than two samples; lengthen it or sample faster"
        )
    return RunSettings(start, end, schedule, run_in)


def _span(run: RunSettings, scheme: Scheme, length: float) -> tuple[float, float]:
    """Where a vehicle of that length may ask for the irregularity, m: Wilson's θ looks beyond the end."""
    first = run.start - run.run_in
    until = run.schedule.duration(run.end - first) + scheme.theta * scheme.step
    return first - length, first + float(run.schedule.at(np.array([until]))[0, 0])


def _instruments(table: ScenarioTable, beside: Path) -> tuple[Instrument, ...]:
    if (table.sensors is None) == (not table.sensor):
        raise ModelError("give either sensors, a preset or a TOML, or tables [[sensor]]")
    if table.sensors is None:
        return tuple(one.to_instrument(table.source) for one in table.sensor)
    return read_instruments(preset_or_path(table.sensors, beside))


def _check_bodies(vehicle: Vehicle, instruments: tuple[Instrument, ...]) -> None:
    """See that every sensor finds its body: by asking what it feels in no time at all."""
    freedoms = (*vehicle_matrices(vehicle).freedoms, *((one.name, HEAVE) for one in vehicle.wheels))
    t, x = np.zeros(0), np.zeros((0, len(freedoms)))
    still = Simulation(t, t, t, freedoms, x, x, x, x, x, ())
    for one in instruments:
        sensor_signal(still, vehicle, one.sensor)


def _changed(track: Track, changes: list[ChangeTable]) -> Track:
    if not changes:
        return track
    if not isinstance(track, LayeredTrack):
        raise ModelError("a change needs a layered track; this one has no supports to change")
    return replace(track, changes=(*track.changes, *(one.made() for one in changes)))

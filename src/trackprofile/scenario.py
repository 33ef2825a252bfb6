"""Scenarios: who runs where, over what, with which sensors on board, as a person writes it in TOML.

vehicle = "velaro"                      # a preset, or a TOML beside this file
track = "zhai-layered"
sensors = "bogie-25ug"
sampling = "500 Hz"                     # behind a low-pass at a quarter of it, unless anti_alias = false
seed = 1                                # of the sensors' noise

[run]
start = "0 m"                           # of the leading wheel; what is recorded
end = "200 m"
speed = "150 km/h"
run_in = "100 m"

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
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveInt

from trackprofile.contracts import Channel, build_profile, build_recording, with_provenance
from trackprofile.errors import FileError, ModelError, TrackprofileError
from trackprofile.instrument import Instrument, anti_aliased, measure
from trackprofile.integrate import PAPERS_THETA, Scheme, newmark, wilson
from trackprofile.io import read
from trackprofile.io.model_toml import read_instruments, read_roughness, read_track, read_vehicle
from trackprofile.io.table import located
from trackprofile.io.toml_document import Strict, load
from trackprofile.irregularity import Bell, Dip, Irregularity, Sampled, Sum, random
from trackprofile.simulation.drive import Drive
from trackprofile.simulation.mechanics import check_step, mechanics
from trackprofile.simulation.simulate import Run, Simulation, felt, simulate
from trackprofile.track import Change, LayeredTrack, Track
from trackprofile.units import quantity
from trackprofile.vehicle import Vehicle

PRESETS = Path(str(files("trackprofile") / "presets" / "scenario"))
TRUTH_SPACING = 0.25
"""m between the points of the true profile, as EN 13848-2 asks."""


class SpeedTable(Strict):
    time: str
    speed: str


class RunTable(Strict):
    start: str
    end: str
    speed: str | list[SpeedTable]
    run_in: str = "100 m"


class IntegrationTable(Strict):
    scheme: Literal["newmark", "wilson"] = "newmark"
    steps_per_sample: PositiveInt
    theta: float = PAPERS_THETA


class BellTable(Strict):
    kind: Literal["bell"]
    depth: str
    width: str
    centre: str

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """As the simulation takes it."""
        return Bell(*(quantity(one, "length") for one in (self.depth, self.width, self.centre)))


class DipTable(Strict):
    kind: Literal["dip"]
    depth: str
    half_length: str
    position: str
    count: PositiveInt = 1
    spacing: str = "25 m"

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """As the simulation takes it."""
        depth, half, place, spacing = (
            quantity(one, "length")
            for one in (self.depth, self.half_length, self.position, self.spacing)
        )
        return Dip(depth, half, place, self.count, spacing)


class RandomTable(Strict):
    kind: Literal["random"]
    spectrum: str
    seed: int
    shortest: str = "1.5 m"
    longest: str = "100 m"

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """As the simulation takes it."""
        shortest, longest = (quantity(one, "length") for one in (self.shortest, self.longest))
        return random(
            read_roughness(_place(self.spectrum, beside)), self.seed, shortest, longest, span[1] - span[0]
        )  # fmt: skip


class FileTable(Strict):
    kind: Literal["file"]
    path: str

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """As the simulation takes it; refused where it does not cover the span."""
        profile = read(beside / self.path)
        if profile.attrs["kind_of_data"] != "profile":
            raise FileError(f"{self.path}: it is no profile; give one with distance and elevation.")
        made = Sampled(profile["distance"].to_numpy(), profile["elevation"].to_numpy())
        made.at(np.array(span))
        return made


class ChangeTable(Strict):
    field: str
    factor: float
    start: str
    end: str

    def made(self) -> Change:
        """As the simulation takes it."""
        ends = (quantity(one, "length") for one in (self.start, self.end))
        return Change(self.field, self.factor, *ends)


AnyIrregularity = Annotated[
    BellTable | DipTable | RandomTable | FileTable, Field(discriminator="kind")
]


class ScenarioTable(Strict):
    source: str = ""
    vehicle: str
    track: str = "rigid"
    sensors: str
    sampling: str
    anti_alias: bool = True
    seed: int = 0
    run: RunTable
    integration: IntegrationTable
    irregularity: list[AnyIrregularity] = Field(default_factory=list)
    change: list[ChangeTable] = Field(default_factory=list)


@dataclass(frozen=True)
class Scenario:
    """A scenario, checked and ready to run; ``sampling_interval`` in s."""

    name: str
    vehicle: Vehicle
    track: Track
    irregularity: Irregularity
    run: Run
    scheme: Scheme
    instruments: tuple[Instrument, ...]
    sampling_interval: float
    steps_per_sample: int
    seed: int


@dataclass(frozen=True)
class Made:
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
) -> Made:
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
        exact = felt(simulation, scenario.vehicle, sensor)
        values, valid = measure(
            instrument, exact, scenario.scheme.step, scenario.sampling_interval, generator
        )
        channels.append(
            Channel(
                sensor.name, values, sensor.quantity, sensor.body, sensor.position, sensor.noise_density, valid,
                sensor.bandwidth,
            )
        )  # fmt: skip
    taken = slice(None, None, scenario.steps_per_sample)
    said = (
        f"simulate: scenario {scenario.name}, step {scenario.scheme.step:g} s, seed {scenario.seed}"
    )
    recording = build_recording(
        channels, time=simulation.time[taken], distance=simulation.position[taken], speed=simulation.speed[taken]
    )  # fmt: skip
    first = simulation.position[0] - scenario.vehicle.length
    place = np.arange(
        np.ceil(first / TRUTH_SPACING), np.floor(simulation.position[-1] / TRUTH_SPACING) + 1
    )
    place = TRUTH_SPACING * place
    truth = build_profile(
        place, scenario.irregularity.at(place)[0], kind="truth", loading="unloaded"
    )
    return Made(with_provenance(recording, said), with_provenance(truth, said), simulation)


def _scenario(path: Path, table: ScenarioTable, seed: int) -> Scenario:
    beside = path.parent
    vehicle, _ = read_vehicle(_place(table.vehicle, beside))
    sampling_interval = 1.0 / _positive(quantity(table.sampling, "frequency"), "sampling")
    with located("[integration]"):
        scheme = _scheme(table.integration, sampling_interval)
    with located("[run]"):
        run = _run(table.run)
    span = (run.start - run.run_in - vehicle.length, run.end)
    parts = []
    for number, one in enumerate(table.irregularity, start=1):
        with located(f"irregularity {number}, {one.kind}"):
            parts.append(one.made(beside, span))
    instruments = read_instruments(_place(table.sensors, beside))
    if table.anti_alias:
        instruments = tuple(anti_aliased(one, sampling_interval) for one in instruments)
    track = _changed(read_track(_place(table.track, beside)), table.change)
    check_step(mechanics(vehicle), track, scheme)
    return Scenario(
        path.stem, vehicle, track, Sum(tuple(parts)), run, scheme, instruments, sampling_interval,
        table.integration.steps_per_sample, seed,
    )  # fmt: skip


def _place(name: str, beside: Path) -> str | Path:
    """A preset's name as it is, or the file of that name beside the scenario."""
    return beside / name if (beside / name).is_file() else name


def _positive(value: float, name: str) -> float:
    if not value > 0:
        raise ModelError(f"{name} must be above 0, got {value:g}")
    return value


def _scheme(table: IntegrationTable, sampling_interval: float) -> Scheme:
    step = sampling_interval / table.steps_per_sample
    return newmark(step) if table.scheme == "newmark" else wilson(step, table.theta)


def _run(table: RunTable) -> Run:
    speeds = table.speed
    if isinstance(speeds, str):
        speeds = [SpeedTable(time="0 s", speed=speeds)]
    drive = Drive(
        tuple(quantity(one.time, "time") for one in speeds),
        tuple(quantity(one.speed, "speed") for one in speeds),
    )
    start, end, run_in = (quantity(one, "length") for one in (table.start, table.end, table.run_in))
    if not end > start:
        raise ModelError(f"the run needs an end beyond its start, got {start:g} m to {end:g} m")
    if not run_in >= 10:
        raise ModelError(f"the run needs at least 10 m of running in, got {run_in:g} m")
    return Run(start, end, drive, run_in)


def _changed(track: Track, changes: list[ChangeTable]) -> Track:
    if not changes:
        return track
    if not isinstance(track, LayeredTrack):
        raise ModelError("a change needs a layered track; this one has no supports to change")
    return replace(track, changes=(*track.changes, *(one.made() for one in changes)))

"""The cases of O'Brien, Bowe, Quirke and Cantero 2017: vehicle, track, profile, and simulated recordings.

The signals of each case are simulated in two ways: on the time-space grid of the search (Wilson θ, one step per scan),
as in the paper, and with Newmark's scheme at an eighth of that step, which is close to the exact solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Channel, build_profile, build_recording
from trackprofile.io.model_toml import (
    read_instruments,
    read_spectrum,
    read_track,
    read_vehicle,
)
from trackprofile.methods.cross_entropy.forward_model import ForwardModel, forward_model
from trackprofile.models.integrate import newmark, wilson
from trackprofile.models.irregularity import Bell, Irregularity, Sum, random_irregularity
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.models.sensor_errors import Instrument, measure
from trackprofile.models.track import Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import constant_speed

Array = NDArray[np.float64]

FINER = 8
"""Number of steps of the fine simulation per scan."""

CLASSES = ("fra-4", "fra-5", "fra-6")
SHORTEST, LONGEST = 1.5, 100.0
"""Shortest and longest wavelength of the random profiles, m; the paper does not state them."""
TAPER = 20.0
"""Length over which they grow from level track, on which the search starts, m."""
LENGTH = 200.0
"""Length of the random profiles, m; the paper does not state it. It suffices for wavelengths of 70 m and both flanks
of the settlement."""

LEAD = 100.0
"""Level track before a case in which free oscillations of the car decay, m."""

ACCELEROMETERS = {"A": "bogie-ms1010-stim300", "B": "bogie-adxl357-adxrs646", "C": "bogie-adxl345-lsm6dsv"}  # fmt: skip
"""Sensor presets in place of the paper's accelerometers, whose types it does not state; the gyroscope is that of A."""


@dataclass(frozen=True)
class Case:
    """One run of the paper.

    Parameters
    ----------
    name : name of the case
    vehicle, installation, track, sensors, irregularity : the models
    speed : m/s
    step : time between scans, s
    length : length of the run from the start, where the track is level, m
    start : start position of the leading wheel, m
    """

    name: str
    vehicle: Vehicle
    installation: Installation
    track: Track
    sensors: tuple[Sensor, ...]
    irregularity: Irregularity
    speed: float
    step: float
    length: float
    start: float = 0.0

    @property
    def scans(self) -> int:
        """Number of scans after the start."""
        return round(self.length / self.speed / self.step)

    @property
    def position(self) -> Array:
        """Position of the leading wheel at the start and at each scan, (scans + 1,), m."""
        run = self.speed * self.step * self.scans
        return np.linspace(self.start, self.start + run, self.scans + 1)

    @property
    def truth(self) -> xr.Dataset:
        """The true profile at each scan."""
        position = self.position[1:]
        return build_profile(position, self.irregularity.at(position)[0], kind="truth")


def bell() -> Case:
    """Figure 13: Model A over an inverted bell.

    Examples
    --------
    >>> bell().scans
    800
    """
    return _model_a("bell", Bell(2e-3, 0.5, 5.0), 20.0)


def model_a(grade: str) -> Case:
    """Figure 14: Model A over a random profile of a spectrum such as fra-4."""
    return _model_a(grade, _random(grade), LENGTH)


def model_b(grade: str) -> Case:
    """Figure 17: Model B over a random profile of a spectrum such as fra-4."""
    return _model_b(grade, _random(grade), LENGTH)


def settlement() -> Case:
    """Figure 18: Model B over a settlement of 40 mm and a random profile of FRA class 4."""
    return _model_b("settlement", Sum((Bell(40e-3, 10.0, 100.0), _random("fra-4"))), LENGTH)


def with_lead(case: Case) -> Case:
    """The same case with a lead of level track before, and more of its profile after, as in a real recording."""
    return replace(case, start=case.start - LEAD, length=case.length + 2 * LEAD)


def search_grid_signals(case: Case) -> Array:
    """Signals of the sensors on the grid of the search, (scans + 1, sensors), m/s² or rad/s."""
    car = case_model(case)
    r = case.irregularity.at(car.position)[0]
    r[: car.before] = 0.0
    return np.vstack([np.zeros(len(case.sensors)), car.signals(r, 0, case.scans)])


def case_model(case: Case) -> ForwardModel:
    """The forward model of the search for a case, at its start."""
    scheme, speed = wilson(case.step), np.full(case.scans + 1, case.speed)
    return forward_model(case.vehicle, case.track, case.sensors, scheme, case.position, speed)


def fine_signals(case: Case) -> Array:
    """Signals of the sensors by `simulate` at an eighth of the step, (scans + 1, sensors), m/s² or rad/s."""
    run = RunSettings(case.start, float(case.position[-1]), constant_speed(case.speed), run_in=1.0)
    simulation = simulate(
        case.vehicle, case.track, case.irregularity, run, newmark(case.step / FINER)
    )
    signals = [sensor_signal(simulation, case.vehicle, sensor) for sensor in case.sensors]
    return np.stack(signals, axis=1)[::FINER][: case.scans + 1]


def case_recording(
    case: Case, signals: Array, instruments: Sequence[Instrument] = (), seed: int = 0
) -> xr.Dataset:
    """A recording of a case: with exact signals, or as instruments read them.

    Parameters
    ----------
    signals : (scans + 1, sensors), m/s² or rad/s
    instruments : one per sensor; empty: exact signals
    seed : seed of the noise
    """
    generator, parts = np.random.default_rng(seed), []
    for i, sensor in enumerate(case.sensors):
        values, valid, noise = signals[:, i], np.ones(len(signals), bool), sensor
        if instruments:
            noise = instruments[i].sensor
            values, valid = measure(instruments[i], values, case.step, case.step, generator)
        parts.append(
            Channel(
                sensor.name, values, sensor.quantity, sensor.body, sensor.position,
                noise.noise_density, valid, flicker=noise.flicker or None,
            )
        )  # fmt: skip
    return build_recording(
        parts,
        time=case.step * np.arange(len(signals)),
        distance=case.position,
        speed=np.full(len(signals), case.speed),
        source=f"simulated: {case.name}",
        vehicle=case.vehicle.name,
    )


def instruments(accelerometer: str) -> tuple[Instrument, Instrument]:
    """Accelerometer A, B or C, and the gyroscope. Only their noise is used, as in the paper."""
    first, _ = read_instruments(ACCELEROMETERS[accelerometer])
    _, gyroscope = read_instruments(ACCELEROMETERS["A"])
    # The cut-off of its filter is above half the sampling rate, where it has no effect on the samples.
    return first, replace(gyroscope, sensor=replace(gyroscope.sensor, bandwidth=None))


def _random(grade: str) -> Irregularity:
    return random_irregularity(
        read_spectrum(grade),
        int(grade[-1]),
        SHORTEST,
        LONGEST,
        length=LENGTH,
        start=0.0,
        taper=TAPER,
    )


def _model_a(name: str, irregularity: Irregularity, length: float) -> Case:
    return Case(
        f"{name}, Model A",
        *read_vehicle("quarter-car"),
        read_track("rigid"),
        (Sensor("acceleration", VERTICAL_ACCELERATION, "bogie", noise_density=1e-5),),
        irregularity,
        speed=30.0,
        step=0.025 / 30.0,
        length=length,
    )


def _model_b(name: str, irregularity: Irregularity, length: float) -> Case:
    return Case(
        f"{name}, Model B",
        *read_vehicle("velaro"),
        read_track("zhai-layered"),
        (
            Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie", noise_density=1e-5),
            Sensor("pitch rate", PITCH_RATE, "leading bogie", noise_density=1e-6),
        ),
        irregularity,
        speed=150 / 3.6,
        step=2e-3,
        length=length,
    )

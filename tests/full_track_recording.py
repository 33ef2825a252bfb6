"""Recordings of a car on the full track, with noise: what the inference, that knows a reduced track, has to read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from trackprofile.contracts import Channel, build_profile, build_recording
from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import random_irregularity
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import Track
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import SpeedSchedule, constant_speed

VELARO = read_vehicle("velaro")[0]
LAYERED = read_track("zhai-layered")
STEADY = constant_speed(150 / 3.6)
STEP, SAMPLING = 1e-3, 500.0  # s, Hz


def recorded(
    length: float, seed: int, spectrum: Spectrum, sensors: Sequence[Sensor], schedule: SpeedSchedule = STEADY,
    *, track: Track = LAYERED, shortest: float = 1.5,
) -> tuple[xr.Dataset, xr.Dataset]:  # fmt: skip
    """The simulation's signals with noise, every 2 ms, and the unloaded profile, of waves from ``shortest`` m."""
    irregularity = random_irregularity(spectrum, seed, shortest, 300.0, length=length + 500.0)
    run = RunSettings(0.0, length, schedule, run_in=200.0, every=round(1 / SAMPLING / STEP))
    made = simulate(VELARO, track, irregularity, run, newmark(STEP))
    generator = np.random.default_rng(seed)
    channels = []
    for sensor in sensors:
        exact = sensor_signal(made, VELARO, sensor)
        assert sensor.noise_density is not None
        noise = sensor.noise_density * np.sqrt(SAMPLING / 2) * generator.standard_normal(len(exact))
        channels.append(
            Channel(sensor.name, exact + noise, sensor.quantity, sensor.body, sensor.position, sensor.noise_density)
        )  # fmt: skip
    recording = build_recording(channels, time=made.time, distance=made.position, speed=made.speed)
    place = np.arange(-50.0, length, 0.25)
    return recording, build_profile(
        place, irregularity.at(place)[0], kind="truth", loading="unloaded"
    )

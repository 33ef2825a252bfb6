"""Recordings of a night, simulated: three vehicles at varying speed over one line, each pass with its own noise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackprofile.contracts import Channel, build_recording
from trackprofile.io import write
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import random_irregularity
from trackprofile.models.receptance import point_track
from trackprofile.simulation.simulate import RunSettings, Simulation, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import SpeedSchedule

VEHICLES = ("velaro", "multiple-unit", "intercity-coach")
SPEEDS = (24.0, 31.0, 38.0)  # m/s, mean
STEP, EVERY = 1e-3, 5  # s; 200 Hz
RUN_IN = 200.0  # m
SENSORS = read_sensors("bogie-25ug")


@dataclass(frozen=True)
class Ride:
    """A vehicle's ride, and what its sensors felt before any noise."""

    vehicle: str
    made: Simulation
    exact: tuple[np.ndarray, ...]


def ride(number: int, length: float) -> Ride:
    """Of the vehicle and mean speed of that number, 0 to 8; the speed swings by a fifth every 40 s."""
    name, mean = VEHICLES[number % 3], SPEEDS[number // 3]
    vehicle, track = read_vehicle(name)[0], point_track(read_track("zhai"))
    times = np.arange(0.0, length / mean * 1.5 + 40.0, 20.0)
    swing = mean * (1 + 0.2 * (-1.0) ** np.arange(len(times)))
    schedule = SpeedSchedule(tuple(times.tolist()), tuple(swing.tolist()))
    level = random_irregularity(
        read_spectrum("german-low"), 5, 1.5, 250.0, length=length + 2 * RUN_IN
    )
    made = simulate(
        vehicle,
        track,
        level,
        RunSettings(0.0, length, schedule, run_in=RUN_IN, every=EVERY),
        newmark(STEP),
    )
    return Ride(name, made, tuple(sensor_signal(made, vehicle, sensor) for sensor in SENSORS))


def write_recording(one: Ride, seed: int, path: Path) -> None:
    """The ride as its sensors recorded it on the day of that seed."""
    generator = np.random.default_rng(seed)
    parts = []
    for sensor, exact in zip(SENSORS, one.exact, strict=True):
        assert sensor.noise_density is not None
        noise = sensor.noise_density * np.sqrt(0.5 / (STEP * EVERY))
        signal = exact + noise * generator.standard_normal(len(exact))
        parts.append(Channel(sensor.name, signal, sensor.quantity, sensor.body, sensor.position,
                             sensor.noise_density))  # fmt: skip
    recording = build_recording(
        parts, time=one.made.time - one.made.time[0], speed=one.made.speed, vehicle=one.vehicle
    )
    write(recording, path)


def write_night(folder: Path, count: int, length: float, rides: int = 9) -> Path:
    """A manifest of that many recordings of that length (m), with them beside it."""
    ridden = [ride(number, length) for number in range(min(rides, count))]
    lines = [
        'line = "Testline"',
        'direction = "up"',
        'track = "zhai"',
        'prior = "german-low"',
        'speed = "140 km/h"',
        "",
    ]
    for number in range(count):
        name = f"run-{number:03d}.nc"
        write_recording(ridden[number % len(ridden)], number, folder / name)
        lines += ["[[recording]]", f'file = "{name}"', f"day = 2026-05-{1 + number // 10:02d}",
                  f'run = "train {number}"', ""]  # fmt: skip
    manifest = folder / "night.toml"
    manifest.write_text("\n".join(lines), encoding="utf-8")
    return manifest

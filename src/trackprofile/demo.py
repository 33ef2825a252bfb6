"""The main job on a built-in recording, which is simulated, and says so.

The paper's car runs over random track at varying speed, with two sensors on its leading bogie. It
is integrated here by `scipy.signal.lsim` on a fine grid in time, another route than the smoother's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from trackprofile.assessment.compare import Comparison, compare
from trackprofile.contracts import Channel, build_profile, build_recording
from trackprofile.errors import FileError
from trackprofile.inference.infer import Estimate, estimate
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io import write
from trackprofile.io.model_toml import (
    read_sensors,
    read_spectrum,
    read_track,
    read_vehicle,
    write_vehicle,
)
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Sensor
from trackprofile.models.spectrum import Spectrum, random_profile
from trackprofile.models.statespace import StateSpace, state_space
from trackprofile.models.track import PointTrack
from trackprofile.models.vehicle import Vehicle
from trackprofile.reader import read
from trackprofile.reporting.result_files import write_estimate

Array = NDArray[np.float64]

SOURCE = "simulated by trackprofile demo: no train measured this"

SAMPLING = 250.0  # Hz
STEPS_PER_SAMPLE = 8
RUN_IN = 8.0  # s, in which the body's bounce fades to a thousandth
MEAN_SPEED, SPEED_CHANGE, SPEED_PERIOD = 30.0, 10.0, 60.0  # m/s, m/s, s
POINT_SPACING, SHORTEST_WAVE = 0.2, 1.0  # m
OFFSETS = {VERTICAL_ACCELERATION: 0.05}  # m/s²; a cheap sensor's
OTHER_OFFSET = 0.002  # rad/s

PROFILE = "profile.nc"
FILES = ("recording.csv", "recording.toml", "truth.csv", "vehicle.toml", PROFILE)


@dataclass(frozen=True)
class Demo:
    """What the demo made, and how well it went."""

    recording: Path
    truth: Path
    files: tuple[Path, ...]
    found: Estimate
    comparison: Comparison


def run(
    folder: str | Path, *, length: float = 2000.0, seed: int = 1, progress: Progress | None = None
) -> Demo:
    """Make a recording, infer the profile from it, and compare that with the truth.

    Parameters
    ----------
    folder : is created; all files are written there
    length : of the recorded track [m]
    seed : of track and noise

    Raises
    ------
    FileError : the folder cannot be written to, or holds such files that are no demo's.
    """
    folder = _ready(Path(folder))
    recording, truth = folder / "recording.toml", folder / "truth.csv"
    vehicle, installation = read_vehicle("velaro")
    track = point_track(read_track("zhai"))
    measured, level = simulated(
        vehicle, track, read_sensors("bogie-25ug"), read_spectrum("german-low"), length, seed
    )
    write(measured, recording)
    write(level, truth)
    write_vehicle(vehicle, installation, folder / "vehicle.toml")
    measured = read(recording)
    found = estimate(
        measured,
        vehicle,
        InferenceSettings(installation=installation, track=track),
        progress=progress,
    )
    files = write_estimate(found, measured, folder / PROFILE)
    return Demo(recording, truth, files, found, compare(found.profile, read(truth)))


def simulated(
    vehicle: Vehicle,
    track: PointTrack,
    sensors: tuple[Sensor, ...],
    spectrum: Spectrum,
    length: float,
    seed: int,
) -> tuple[xr.Dataset, xr.Dataset]:
    """A recording over random track, and that track's true profile.

    Parameters
    ----------
    sensors : each with its noise density
    length : that the leading wheel runs [m]

    Examples
    --------
    >>> recording, truth = simulated(
    ...     read_vehicle("velaro")[0], read_track("zhai"), read_sensors("bogie-25ug"),
    ...     read_spectrum("german-low"), length=60.0, seed=1)
    >>> recording.sizes["sample"], truth.attrs["kind"]
    (484, 'truth')
    """
    generator = np.random.default_rng(seed)
    time = _time(length)
    position, speed, acceleration = _motion(time)
    behind = vehicle.length + 5.0
    points = np.arange(position[0] - behind, length + 5.0, POINT_SPACING)
    profile = CubicSpline(points, random_profile(spectrum, points, generator, SHORTEST_WAVE))
    paths = position[:, None] - np.array([wheel.position for wheel in vehicle.wheels])
    v, a = speed[:, None], acceleration[:, None]
    z, z1, z2 = profile(paths), profile(paths, 1), profile(paths, 2)
    signals = _response(state_space(vehicle, track, sensors), time, (z, z1 * v, z2 * v**2 + z1 * a))
    recorded = slice(int(np.searchsorted(time, -1e-9)), None, STEPS_PER_SAMPLE)
    channels = [
        Channel(
            sensor.name,
            _noisy(signals[recorded, i], sensor, generator),
            sensor.quantity,
            sensor.body,
            sensor.position,
            sensor.noise_density,
        )
        for i, sensor in enumerate(sensors)
    ]
    recording = build_recording(
        channels,
        time=time[recorded],
        speed=speed[recorded],
        source=SOURCE,
        vehicle="vehicle.toml",
        provenance=[f"{SOURCE}, seed {seed}"],
    )
    # The wheels behind see track that the leading one had passed before the first sample.
    distance = np.arange(-np.floor(vehicle.length), length, 0.25)
    return recording, build_profile(distance, profile(distance), kind="truth", vehicle=vehicle.name)


def _time(length: float) -> Array:
    """From the start of the running in to where the leading wheel has run ``length`` [s]."""
    steps_per_second = SAMPLING * STEPS_PER_SAMPLE
    slowest = MEAN_SPEED - SPEED_CHANGE
    time = np.arange(-RUN_IN * steps_per_second, length / slowest * steps_per_second + 1)
    time /= steps_per_second
    return time[_motion(time)[0] <= length]


def _motion(time: Array) -> tuple[Array, Array, Array]:
    """Position [m], 0 at time 0, speed [m/s] and acceleration [m/s²]."""
    rate = 2 * np.pi / SPEED_PERIOD
    position = MEAN_SPEED * time + SPEED_CHANGE / rate * (1 - np.cos(rate * time))
    speed = MEAN_SPEED + SPEED_CHANGE * np.sin(rate * time)
    return position, speed, SPEED_CHANGE * rate * np.cos(rate * time)


def _response(system: StateSpace, time: Array, paths: tuple[Array, Array, Array]) -> Array:
    """What the sensors feel of the paths and their two time derivatives (steps, sensors)."""
    B, D = (matrix.reshape(len(matrix), -1) for matrix in (system.B, system.D))
    _, signals, _ = lsim((system.A, B, system.C, D), np.concatenate(paths, axis=1), time - time[0])
    return signals.reshape(len(time), -1)  # lsim drops the dimension of a lone sensor


def _noisy(signal: Array, sensor: Sensor, generator: np.random.Generator) -> Array:
    deviation = (sensor.noise_density or 0.0) * np.sqrt(SAMPLING / 2)
    offset = OFFSETS.get(sensor.quantity, OTHER_OFFSET)
    return signal + offset + deviation * generator.standard_normal(len(signal))


def _ready(folder: Path) -> Path:
    """The folder, made if need be; only what an earlier demo left there may be replaced."""
    recording = folder / "recording.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        ours = recording.is_file() and SOURCE in recording.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{folder}: cannot be used as a folder; name a new one.") from error
    there = [name for name in FILES if (folder / name).exists()]
    if there and not ours:
        raise FileError(f"{folder}: its {there[0]} is no earlier demo's; name a new folder.")
    return folder

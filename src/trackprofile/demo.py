"""Demonstration: inference of a profile from a simulated recording, and comparison with the truth.

The paper's car runs over random track at varying speed, with two sensors on its leading bogie. The simulation uses
`scipy.signal.lsim` on a fine time grid and is independent of the smoother's discretisation.
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
RUN_IN = 8.0  # s, in which the body's heave decays to a thousandth
MEAN_SPEED, SPEED_CHANGE, SPEED_PERIOD = 30.0, 10.0, 60.0  # m/s, m/s, s
POINT_SPACING, SHORTEST_WAVELENGTH = 0.2, 1.0  # m
OFFSETS = {VERTICAL_ACCELERATION: 0.05}  # m/s²; typical of a low-cost sensor
OTHER_OFFSET = 0.002  # rad/s

PROFILE = "profile.nc"
FILES = ("recording.csv", "recording.toml", "truth.csv", "vehicle.toml", PROFILE)


@dataclass(frozen=True)
class Demo:
    """Result of the demonstration.

    Parameters
    ----------
    recording, truth : files of the simulated recording and the true profile
    files : files of the inferred profile
    estimate : result of the inference
    comparison : profile compared with the truth
    """

    recording: Path
    truth: Path
    files: tuple[Path, ...]
    estimate: Estimate
    comparison: Comparison


def run(
    folder: str | Path, *, length: float = 2000.0, seed: int = 1, progress: Progress | None = None
) -> Demo:
    """Simulate a recording, infer the profile from it, and compare it with the truth.

    Parameters
    ----------
    folder : folder for all files; created where it does not exist
    length : length of the recorded track [m]
    seed : seed of track and noise
    progress : called with the stage and the share done

    Raises
    ------
    FileError : the folder cannot be written to, or has files of these names that no earlier demo wrote.
    """
    folder = _prepared(Path(folder))
    recording, truth = folder / "recording.toml", folder / "truth.csv"
    vehicle, installation = read_vehicle("velaro")
    track = point_track(read_track("zhai"))
    simulated_recording, simulated_truth = simulated(
        vehicle, track, read_sensors("bogie-25ug"), read_spectrum("german-low"), length, seed
    )
    write(simulated_recording, recording)
    write(simulated_truth, truth)
    write_vehicle(vehicle, installation, folder / "vehicle.toml")
    measured = read(recording)
    result = estimate(
        measured,
        vehicle,
        InferenceSettings(installation=installation, track=track),
        progress=progress,
    )
    files = write_estimate(result, measured, folder / PROFILE)
    return Demo(recording, truth, files, result, compare(result.profile, read(truth)))


def simulated(
    vehicle: Vehicle,
    track: PointTrack,
    sensors: tuple[Sensor, ...],
    spectrum: Spectrum,
    length: float,
    seed: int,
) -> tuple[xr.Dataset, xr.Dataset]:
    """Simulate a recording over random track.

    Parameters
    ----------
    sensors : sensors with their noise densities
    spectrum : spectrum of the track irregularity
    length : distance that the leading wheel runs [m]
    seed : seed of track and noise

    Returns
    -------
    the recording, and the true profile

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
    profile = CubicSpline(points, random_profile(spectrum, points, generator, SHORTEST_WAVELENGTH))
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
    # The rear wheels run over track that the leading wheel passed before the first sample.
    distance = np.arange(-np.floor(vehicle.length), length, 0.25)
    return recording, build_profile(distance, profile(distance), kind="truth", vehicle=vehicle.name)


def _time(length: float) -> Array:
    """Time from the start of the run-in until the leading wheel has run ``length`` [s]."""
    steps_per_second = SAMPLING * STEPS_PER_SAMPLE
    minimum_speed = MEAN_SPEED - SPEED_CHANGE
    time = np.arange(-RUN_IN * steps_per_second, length / minimum_speed * steps_per_second + 1)
    time /= steps_per_second
    return time[_motion(time)[0] <= length]


def _motion(time: Array) -> tuple[Array, Array, Array]:
    """Position [m] (0 at time 0), speed [m/s] and acceleration [m/s²]."""
    rate = 2 * np.pi / SPEED_PERIOD
    position = MEAN_SPEED * time + SPEED_CHANGE / rate * (1 - np.cos(rate * time))
    speed = MEAN_SPEED + SPEED_CHANGE * np.sin(rate * time)
    return position, speed, SPEED_CHANGE * rate * np.cos(rate * time)


def _response(system: StateSpace, time: Array, paths: tuple[Array, Array, Array]) -> Array:
    """Signals of the sensors for the wheels' paths and their two time derivatives, (steps, sensors)."""
    B, D = (matrix.reshape(len(matrix), -1) for matrix in (system.B, system.D))
    _, signals, _ = lsim((system.A, B, system.C, D), np.concatenate(paths, axis=1), time - time[0])
    return signals.reshape(len(time), -1)  # lsim drops the dimension of a single sensor


def _noisy(signal: Array, sensor: Sensor, generator: np.random.Generator) -> Array:
    deviation = (sensor.noise_density or 0.0) * np.sqrt(SAMPLING / 2)
    offset = OFFSETS.get(sensor.quantity, OTHER_OFFSET)
    return signal + offset + deviation * generator.standard_normal(len(signal))


def _prepared(folder: Path) -> Path:
    """The folder, created if necessary; only files of an earlier demo may be replaced."""
    recording = folder / "recording.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        earlier_demo = recording.is_file() and SOURCE in recording.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{folder}: cannot be used as a folder; give another one.") from error
    existing = [name for name in FILES if (folder / name).exists()]
    if existing and not earlier_demo:
        raise FileError(
            f"{folder}: its {existing[0]} was not written by an earlier demo; give another folder."
        )
    return folder

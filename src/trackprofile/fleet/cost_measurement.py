"""Cost of one recording on this machine: it is simulated, written as a train sends it, and processed into a store."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from trackprofile.contracts import Channel, build_recording
from trackprofile.errors import DataError, FileError
from trackprofile.fleet.capacity import Cost
from trackprofile.fleet.job import Job, Row, State, process_recording
from trackprofile.io import write
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.machine import in_one_thread, peak_memory
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import random_irregularity
from trackprofile.models.receptance import point_track
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import constant_speed
from trackprofile.store import Entry, Store, create, find
from trackprofile.store.entry import entry_document

LONGEST_STEP = 1e-3  # s
RUN_IN = 200.0  # m
LEVEL = "german-low"
WARM_UP = 1000.0
"""Length of the recording that is processed first, so that all code is compiled and loaded, m."""


@dataclass(frozen=True)
class Sample:
    """The recording that the cost is measured with.

    Parameters
    ----------
    length : [m]
    train_speed : steady [m/s]
    sampling : [Hz]
    vehicle, track, sensors : presets, or paths
    prior : the same; None is found from the data, which costs more
    """

    length: float = 10e3
    train_speed: float = 33.0
    sampling: float = 500.0
    vehicle: str = "velaro"
    track: str = "zhai"
    sensors: str = "bogie-25ug"
    prior: str | None = None


def cost(sample: Sample) -> Cost:
    """Cost of each metre of a recording, in a separate process with one thread.

    Raises
    ------
    DataError : the sample is no recording.
    """
    if not (sample.length >= WARM_UP and sample.train_speed > 0 and sample.sampling > 0):
        raise DataError(
            f"To measure needs a recording of at least {WARM_UP:g} m, a speed and a rate above 0, got "
            f"{sample.length:g} m, {sample.train_speed:g} m/s and {sample.sampling:g} Hz."
        )
    if sample.prior is not None:
        read_spectrum(sample.prior)
    with TemporaryDirectory() as folder:
        _write(sample, WARM_UP, Path(folder) / "first")
        table, as_csv = _write(sample, sample.length, Path(folder) / "run")
        arguments = f"of.Sample(**{vars(sample)!r}), {folder!r}"
        found = in_one_thread(__name__, f"of.process_two({arguments})")
    return Cost(
        cpu=found["cpu"] / found["length"],
        memory=found["memory"],
        recorded=table / sample.length,
        recorded_as_csv=as_csv / sample.length,
        stored=found["stored"] / found["length"],
        files=found["files"],
    )


def process_two(sample: Sample, folder: str) -> dict[str, float]:
    """Cost of processing the recording in a folder into a store, after a shorter one [s, B, m]."""
    import distributed  # noqa: F401 - a worker has it in memory too

    store = create(f"{folder}/store")
    for name in ("first", "run"):
        row = Row(
            number=1, file=Path(folder) / f"{name}.toml", line="Testline", direction="up", day=date(2026, 5, 31),
            run=name, vehicle=sample.vehicle, track=sample.track, prior=sample.prior, limits="en-13848",
            speed=sample.train_speed, offset=0.0, start=None, end=None, revision=0,
        )  # fmt: skip
        outcome = process_recording(Job(row, store.url))
        if outcome.state is not State.STORED or outcome.entry is None:
            raise FileError(outcome.reason)
    entry = outcome.entry
    return {
        "cpu": outcome.cpu,
        "length": entry.end - entry.start,
        "memory": 1e6 * peak_memory(),
        "stored": float(stored_bytes(entry)),
        "files": 1.0 + len(entry.files),
    }


def stored_bytes(entry: Entry) -> int:
    """Size of a pass in a store [B]."""
    return len(entry_document(entry)) + sum(one.size for one in entry.files.values())


def stored_per_metre(store: Store) -> float:
    """Average size of a metre of a pass in a store [B/m].

    Raises
    ------
    DataError : it has none.
    """
    entries = find(store, all_versions=True)
    length = sum(one.end - one.start for one in entries)
    if not length:
        raise DataError(
            f"{store.url}: it has no passes yet; leave --store out to measure with one here."
        )
    return sum(map(stored_bytes, entries)) / length


def _write(sample: Sample, length: float, stem: Path) -> tuple[int, int]:
    """Simulate a recording and write it, a table beside its TOML; the size of the table, and of one in CSV [B]."""
    vehicle, track = read_vehicle(sample.vehicle)[0], point_track(read_track(sample.track))
    every = int(np.ceil(1.0 / (sample.sampling * LONGEST_STEP)))
    step = 1.0 / (sample.sampling * every)
    level = random_irregularity(read_spectrum(LEVEL), 1, 1.5, 250.0, length=length + 2 * RUN_IN)
    run = RunSettings(0.0, length, constant_speed(sample.train_speed), run_in=RUN_IN, every=every)
    made = simulate(vehicle, track, level, run, newmark(step))
    generator = np.random.default_rng(1)
    channels = []
    for sensor in read_sensors(sample.sensors):
        noise = (sensor.noise_density or 0.0) * np.sqrt(sample.sampling / 2)
        signal = sensor_signal(made, vehicle, sensor) + noise * generator.standard_normal(
            len(made.time)
        )
        channels.append(
            Channel(
                sensor.name,
                signal,
                sensor.quantity,
                sensor.body,
                sensor.position,
                sensor.noise_density,
            )
        )
    recording = build_recording(channels, time=made.time - made.time[0], speed=made.speed)
    sizes = []
    for path in (stem.with_suffix(".parquet"), stem.with_name(f"{stem.name}-text.csv")):
        write(recording, path)
        sizes.append(path.stat().st_size)
    return sizes[0], sizes[1]

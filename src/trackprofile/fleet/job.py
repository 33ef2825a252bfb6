"""What a worker does with one recording: read, infer, assess, store, unless the store has it.

Only names and numbers go to a worker and come back from it: it reads the recording itself, and writes to the store
itself. Doing a job twice, at once or one after the other, leaves what doing it once leaves.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import date
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from trackprofile import __version__
from trackprofile.contracts.identity import digest
from trackprofile.errors import FileError, TrackprofileError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.limits import Limits
    from trackprofile.models.sensor import Installation
    from trackprofile.models.spectrum import Spectrum
    from trackprofile.models.track import Track
    from trackprofile.models.vehicle import Vehicle
    from trackprofile.store import Entry, Origin, PassKey, Store


@dataclass(frozen=True)
class Row:
    """One recording of a manifest, and all that it is to be treated with.

    Parameters
    ----------
    number : in its manifest, from 1
    file : the recording
    line, direction, day, run : where it belongs; runs tell the passes of one day apart
    vehicle, track, prior, limits : a preset's name, or an absolute path; a vehicle of None is the recording's own, a
        prior of None is found from the data
    speed : of the line [m/s]
    offset : the line's distance where the recording's is 0 [m]
    start, end : what is taken of it, by the line's distance [m]; None is open
    revision : the greatest is the one that a store shows, where it has a recording more than once
    """

    number: int
    file: Path
    line: str
    direction: str
    day: date
    run: str
    vehicle: str | None
    track: str
    prior: str | None
    limits: str
    speed: float
    offset: float
    start: float | None
    end: float | None
    revision: int

    @property
    def place(self) -> PassKey:
        """Key of the pass in a store."""
        from trackprofile.store import PassKey

        return PassKey(self.line, self.direction, self.day, self.run)


@dataclass(frozen=True)
class Job:
    """One recording to process into a store.

    Parameters
    ----------
    row : of the manifest
    store : URL of the store
    software : version that the worker must have, so that a batch is processed by one version
    """

    row: Row
    store: str
    software: str = __version__


class State(Enum):
    """How a job ended."""

    STORED = "stored"
    THERE = "there already"
    FAILED = "failed"


@dataclass(frozen=True)
class JobResult:
    """Result of one recording.

    Parameters
    ----------
    row : of the manifest
    state, reason : how the job ended; the reason where it failed
    entry : in the store; None where the job failed
    wall, cpu : time of the worker [s]
    """

    row: Row
    state: State
    reason: str = ""
    entry: Entry | None = None
    wall: float = 0.0
    cpu: float = 0.0


@dataclass(frozen=True)
class ProcessingSettings:
    """Everything that a profile and its assessment depend on, except the recording and the software version."""

    vehicle: Vehicle
    installation: Installation
    track: Track
    prior: Spectrum | None
    limits: Limits
    speed: float
    offset: float

    def digest(self) -> str:
        """Digest of all parameters of vehicle, installation, track, prior and limits, and of both numbers."""
        return digest(self)


def process_recording(job: Job) -> JobResult:
    """Process one recording into the store; an error of this package is a result, any other exception is raised."""
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        state, entry = _process(job)
        reason = ""
    except TrackprofileError as error:
        message = " ".join(str(error).split())
        state, entry, reason = State.FAILED, None, message.removeprefix(f"{job.row.file}: ")
    return JobResult(
        job.row, state, reason, entry, time.perf_counter() - wall, time.process_time() - cpu
    )


def _process(job: Job) -> tuple[State, Entry]:
    from trackprofile.assessment.assess import assess
    from trackprofile.contracts import Rail, select_rail
    from trackprofile.inference.infer import estimate
    from trackprofile.inference.settings import InferenceSettings
    from trackprofile.io.model_toml import presets, read_roughness
    from trackprofile.store import add, open_store

    if job.software != __version__:
        raise FileError(
            f"The worker has trackprofile {__version__}, this batch needs {job.software}; "
            "give all workers the same version."
        )
    row, store = job.row, open_store(job.store)
    recording = recording_of(row)
    settings = processing_settings(row, recording)
    place, origin = row.place, _origin(row, recording, settings)
    entry = _stored(store, place, origin)
    if entry is not None:
        return State.THERE, entry
    inference = InferenceSettings(settings.installation, settings.track, settings.prior)
    result = estimate(recording, settings.vehicle, inference)
    profile = _on_the_line(result.profile, row.offset)
    spectra = {name: read_roughness(name) for name in presets("spectrum")}
    assessment = assess(
        select_rail(profile, Rail.MEAN), settings.limits, row.speed, spectra=spectra
    )
    return State.STORED, add(store, place, profile, assessment, origin).entry


def _stored(store: Store, place: PassKey, origin: Origin) -> Entry | None:
    from trackprofile.store import entry_id
    from trackprofile.store.entry import parse_entry
    from trackprofile.store.layout import ENTRIES

    path = place.path(ENTRIES, entry_id(place, origin))
    try:
        return parse_entry(store.files.read(path), path)
    except FileNotFoundError:
        return None


def recording_of(row: Row) -> xr.Dataset:
    """The recording of a row, restricted to the row's stretch."""
    from trackprofile.contracts import select_stretch
    from trackprofile.reader import read

    recording = read(row.file)
    if recording.attrs["kind_of_data"] != "recording":
        raise FileError(
            f"{row.file}: expected a recording, this is a profile; give the right file."
        )
    start, end = (None if one is None else one - row.offset for one in (row.start, row.end))
    return select_stretch(recording, start, end)


def processing_settings(row: Row, recording: xr.Dataset) -> ProcessingSettings:
    """The settings of a row, read from its presets and files."""
    from trackprofile.assessment.limits_toml import read_limits
    from trackprofile.io.model_toml import read_spectrum, read_track
    from trackprofile.io.vehicle_of_recording import vehicle_of_recording

    return ProcessingSettings(
        *vehicle_of_recording(recording, row.file, row.vehicle),
        read_track(row.track),
        None if row.prior is None else read_spectrum(row.prior),
        read_limits(row.limits),
        row.speed,
        row.offset,
    )


def _origin(row: Row, recording: xr.Dataset, settings: ProcessingSettings) -> Origin:
    from trackprofile.contracts import legacy_fingerprint, recording_identity
    from trackprofile.store import Origin

    return Origin(
        recording=recording_identity(recording),
        fingerprint=legacy_fingerprint(recording),
        source=row.file.name,
        vehicle=settings.vehicle.name,
        method="smoother",
        track=_name(row.track),
        prior="" if row.prior is None else _name(row.prior),
        limits=settings.limits.name,
        speed=row.speed,
        settings=settings.digest(),
        revision=row.revision,
    )


def _name(name: str) -> str:
    """Name of a preset or of a file without its path, so that another machine's path makes no other version."""
    return Path(name).name


def _on_the_line(profile: xr.Dataset, offset: float) -> xr.Dataset:
    """A profile with the distance of the line instead of that of the recording."""
    from trackprofile.contracts import append_provenance

    if not offset:
        return profile
    distance = profile["distance"]
    moved = profile.assign_coords(
        distance=("distance", distance.to_numpy() + offset, distance.attrs)
    )
    return append_provenance(moved, f"{offset:g} m added to the distance")

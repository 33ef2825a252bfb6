"""A night: all recordings of a manifest brought into a store, whatever fails or dies on the way."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from trackprofile.contracts.identity import digest
from trackprofile.fleet.job import Job, JobResult, Row, State, process_recording
from trackprofile.fleet.scheduling import done

if TYPE_CHECKING:
    from distributed import Client

    from trackprofile.store import Store


@dataclass(frozen=True)
class BatchProgress:
    """How far a night is.

    Parameters
    ----------
    ended, failed, total : recordings
    workers : that are there now
    remaining : [s], None before the first recording was computed, or without workers
    """

    ended: int
    failed: int
    total: int
    workers: int
    remaining: float | None


ProgressCallback = Callable[[BatchProgress], None]


@dataclass(frozen=True)
class BatchResult:
    """What came of a manifest.

    Parameters
    ----------
    outcomes : in the manifest's order
    store : where it is
    wall : from the first job given out to the last result [s]
    workers : the most that were there at once
    """

    outcomes: tuple[JobResult, ...]
    store: str
    wall: float
    workers: int

    def of(self, state: State) -> tuple[JobResult, ...]:
        """The recordings that ended so."""
        return tuple(one for one in self.outcomes if one.state is state)

    @property
    def length(self) -> float:
        """Of what this night stored [m]."""
        entries = (one.entry for one in self.of(State.STORED))
        return sum(one.end - one.start for one in entries if one is not None)

    @property
    def cpu(self) -> float:
        """That the workers took for it [s]."""
        return sum(one.cpu for one in self.outcomes)


def run_batch(
    rows: Sequence[Row],
    store: Store,
    client: Client,
    retries: int,
    told: ProgressCallback = lambda now: None,
) -> BatchResult:
    """Bring all recordings into a store: each is there once, or is an outcome with its reason.

    Parameters
    ----------
    client : of Dask, see `trackprofile.fleet.cluster`
    retries : of a job that failed for a reason that this package does not know
    told : how far it is, at every recording's end and every few seconds

    Raises
    ------
    FileError : the scheduler is lost, or has not this package.
    """
    jobs, sharing = _jobs(rows, store)
    before = _entries(rows, store)
    watch = _Watch(len(rows), told)
    found: dict[int, JobResult] = {}
    for name, result in done(client, process_recording, jobs, retries, watch.counted):
        for row in sharing[name]:
            outcome = _outcome(row, result, retries)
            if outcome.entry is not None:
                # A job that ran twice, because its worker died after storing, says that it was there already.
                new = outcome.entry.id not in before
                outcome = replace(outcome, state=State.STORED if new else State.THERE)
            found[row.number] = outcome
            watch.ended(outcome)
    outcomes = tuple(found[row.number] for row in rows)
    return BatchResult(outcomes, store.url, watch.since(), watch.most)


def _jobs(rows: Sequence[Row], store: Store) -> tuple[dict[str, Job], Mapping[str, list[Row]]]:
    """The jobs by name, and the rows that each is for: rows that say the same are one job."""
    jobs: dict[str, Job] = {}
    sharing: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        job = Job(replace(row, number=0), store.url)
        name = _job_name(job)
        jobs[name] = job
        sharing[name].append(row)
    return jobs, sharing


def _job_name(job: Job) -> str:
    """Name of a job for the scheduler, equal for equal jobs."""
    content = {"row": {**vars(job.row), "file": str(job.row.file)}}
    content |= {"store": job.store, "software": job.software}
    return f"trackprofile-{digest(content)[:32]}"


def _entries(rows: Sequence[Row], store: Store) -> set[str]:
    """What the store had of these days."""
    from trackprofile.store.catalogue import entries_of_day

    days = {replace(row.place, run="") for row in rows}
    return {entry.id for place in days for entry in entries_of_day(store, place)}


def _outcome(row: Row, result: JobResult | Exception, retries: int) -> JobResult:
    from distributed import KilledWorker

    if isinstance(result, JobResult):
        return replace(result, row=row)
    if isinstance(result, KilledWorker):
        reason = f"its worker died {result.allowed_failures + 1} times: killed, or out of memory"
    else:
        said = " ".join(str(result).split())
        reason = f"{type(result).__name__} {retries + 1} times: {said}"
    return JobResult(row, State.FAILED, reason)


class _Watch:
    """Counts what ended, and tells."""

    def __init__(self, total: int, told: ProgressCallback) -> None:
        self._total, self._told = total, told
        self._start, self._ended, self._failed = time.monotonic(), 0, 0
        self._computed, self._seconds = 0, 0.0
        self._workers, self.most = 0, 0

    def counted(self, workers: int) -> None:
        self._workers, self.most = workers, max(workers, self.most)
        self._tell()

    def ended(self, outcome: JobResult) -> None:
        self._ended += 1
        self._failed += outcome.state is State.FAILED
        if outcome.state is State.STORED:
            self._computed += 1
            self._seconds += outcome.wall
        self._tell()

    def since(self) -> float:
        """s since the start."""
        return time.monotonic() - self._start

    def _tell(self) -> None:
        remaining = None
        if self._computed and self._workers:
            left = self._total - self._ended
            remaining = left * self._seconds / self._computed / self._workers
        self._told(BatchProgress(self._ended, self._failed, self._total, self._workers, remaining))

"""A batch: all recordings of a manifest processed into a store, even if workers fail or die."""

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
    """Progress of a batch.

    Parameters
    ----------
    ended, failed, total : number of recordings
    workers : number of connected workers
    remaining : estimated time to the end [s]; None before the first recording is computed, or without workers
    """

    ended: int
    failed: int
    total: int
    workers: int
    remaining: float | None


ProgressCallback = Callable[[BatchProgress], None]


@dataclass(frozen=True)
class BatchResult:
    """Result of a batch.

    Parameters
    ----------
    outcomes : one per recording, in the order of the manifest
    store : URL of the store
    wall : time from the first submitted job to the last result [s]
    workers : maximum number of simultaneous workers
    """

    outcomes: tuple[JobResult, ...]
    store: str
    wall: float
    workers: int

    def of(self, state: State) -> tuple[JobResult, ...]:
        """The recordings that ended in this state."""
        return tuple(one for one in self.outcomes if one.state is state)

    @property
    def length(self) -> float:
        """Length of the profiles that this batch stored [m]."""
        entries = (one.entry for one in self.of(State.STORED))
        return sum(one.end - one.start for one in entries if one is not None)

    @property
    def cpu(self) -> float:
        """Processor time of the workers [s]."""
        return sum(one.cpu for one in self.outcomes)


def run_batch(
    rows: Sequence[Row],
    store: Store,
    client: Client,
    retries: int,
    report: ProgressCallback = lambda now: None,
) -> BatchResult:
    """Process all recordings into a store: each is stored once, or fails with a reason.

    Parameters
    ----------
    client : Dask client, see `trackprofile.fleet.cluster`
    retries : number of retries of a job that raised an unexpected exception
    report : called with the progress after every recording and every few seconds

    Raises
    ------
    FileError : the scheduler is lost, or cannot import this package.
    """
    jobs, sharing = _jobs(rows, store)
    before = _entries(rows, store)
    watch = _Watch(len(rows), report)
    results: dict[int, JobResult] = {}
    for name, result in done(client, process_recording, jobs, retries, watch.counted):
        for row in sharing[name]:
            outcome = _outcome(row, result, retries)
            if outcome.entry is not None:
                # A job that ran twice, because its worker died after storing, reports that the entry exists already.
                new = outcome.entry.id not in before
                outcome = replace(outcome, state=State.STORED if new else State.THERE)
            results[row.number] = outcome
            watch.ended(outcome)
    outcomes = tuple(results[row.number] for row in rows)
    return BatchResult(outcomes, store.url, watch.since(), watch.most)


def _jobs(rows: Sequence[Row], store: Store) -> tuple[dict[str, Job], Mapping[str, list[Row]]]:
    """The jobs by name, and the rows of each: equal rows share one job."""
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
    """Entries of these days that the store has already."""
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
        message = " ".join(str(result).split())
        reason = f"{type(result).__name__} {retries + 1} times: {message}"
    return JobResult(row, State.FAILED, reason)


class _Watch:
    """Counts ended jobs and reports the progress."""

    def __init__(self, total: int, report: ProgressCallback) -> None:
        self._total, self._report_to = total, report
        self._start, self._ended, self._failed = time.monotonic(), 0, 0
        self._computed, self._seconds = 0, 0.0
        self._workers, self.most = 0, 0

    def counted(self, workers: int) -> None:
        self._workers, self.most = workers, max(workers, self.most)
        self._report()

    def ended(self, outcome: JobResult) -> None:
        self._ended += 1
        self._failed += outcome.state is State.FAILED
        if outcome.state is State.STORED:
            self._computed += 1
            self._seconds += outcome.wall
        self._report()

    def since(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._start

    def _report(self) -> None:
        remaining = None
        if self._computed and self._workers:
            waiting = self._total - self._ended
            remaining = waiting * self._seconds / self._computed / self._workers
        self._report_to(
            BatchProgress(self._ended, self._failed, self._total, self._workers, remaining)
        )

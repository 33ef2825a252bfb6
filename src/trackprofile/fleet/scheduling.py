"""Submission of jobs to Dask, as many at a time as there are workers, until each has a result or a reason of failure.

Each worker has one job, and no job waits at a worker: a worker that dies affects its own job only, and waiting jobs go
to any free worker. A job whose worker died, or that raised an unexpected exception, is retried a limited number of
times.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, TypeVar, cast

from trackprofile.errors import FileError

if TYPE_CHECKING:
    from distributed import Client

POLL = 0.02
"""Interval of checks for ended jobs, s."""

COUNT = 2.0
"""Interval of counts of the workers, s."""

Job = TypeVar("Job")
Result = TypeVar("Result")


def done(
    client: Client,
    work: Callable[[Job], Result],
    jobs: Mapping[str, Job],
    retries: int,
    counted: Callable[[int], None] = lambda workers: None,
) -> Iterator[tuple[str, Result | Exception]]:
    """Run jobs; each job's name with its result or exception, in the order in which they end.

    Parameters
    ----------
    work : a function that workers can import; doing a job twice must be harmless
    jobs : by names that are unique on the scheduler
    retries : of a job that raised an exception
    counted : called with the number of workers, every `COUNT` seconds

    Raises
    ------
    FileError : the scheduler is lost, or cannot import the work.
    """
    from distributed import as_completed

    waiting, running, workers = deque(jobs), {}, _Workers(client, counted)
    ended = as_completed(loop=client.loop, with_results=True, raise_errors=False)
    try:
        while waiting or running:
            if client.status != "running":
                _await_scheduler(client)
                # A restarted scheduler does not know the jobs.
                waiting.extendleft(running.values())
                running.clear()
                ended.clear()
            for _ in range(min(len(waiting), workers.count() - len(running))):
                name = waiting.popleft()
                future = client.submit(work, jobs[name], key=name, pure=False, retries=retries)
                running[future] = name
                ended.add(future)
            for future, result in ended.next_batch(block=False):
                name = running.pop(future)
                if isinstance(result, CancelledError):
                    waiting.appendleft(name)
                elif future.status == "error":
                    yield name, _checked(result[1])
                else:
                    yield name, result
            time.sleep(POLL)
    finally:
        if running and client.status == "running":
            client.cancel(list(running))


def _checked(error: Exception) -> Exception:
    """The exception of a job; one that every job would raise is raised here."""
    if isinstance(error, RuntimeError) and "deserialization of the task graph" in str(error):
        raise FileError(
            "The Dask scheduler cannot import trackprofile; give scheduler, workers and this command the same "
            "environment."
        ) from error
    return error


class _Workers:
    """Number of jobs that can run at a time, updated every `COUNT` seconds."""

    def __init__(self, client: Client, counted: Callable[[int], None]) -> None:
        self._client, self._counted = client, counted
        self._number, self._asked = 0, -COUNT

    def count(self) -> int:
        if time.monotonic() - self._asked >= COUNT:
            self._asked = time.monotonic()
            try:
                threads = cast(Mapping[str, int], self._client.nthreads())
            except OSError:  # the connection broke: `done` handles it
                return 0
            self._number = sum(threads.values())
            self._counted(self._number)
        return self._number


def _await_scheduler(client: Client) -> None:
    """Wait while the client reconnects to the scheduler, until its timeout."""
    while client.status == "connecting":
        time.sleep(POLL)
    if client.status != "running":
        raise FileError(
            "The Dask scheduler is lost; start it and its workers again, then the same command: what is stored is not "
            "computed again."
        )

"""Jobs given to Dask, as many at a time as there are workers, until each has a result or a reason why it has none.

One job per worker is under way, none waits on a worker: a worker that dies takes down its own job only, and what waits
goes to whoever is there. A job whose worker died, or that failed for an unforeseen reason, is given out again, so often
and no more.
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
"""s between looks at what is done."""

COUNT = 2.0
"""s between counts of the workers."""

Job = TypeVar("Job")
Result = TypeVar("Result")


def done(
    client: Client,
    work: Callable[[Job], Result],
    jobs: Mapping[str, Job],
    retries: int,
    counted: Callable[[int], None] = lambda workers: None,
) -> Iterator[tuple[str, Result | Exception]]:
    """Each job's name with its result, or the exception that it ended with, in the order of their ends.

    Parameters
    ----------
    work : a function that workers can import; doing a job twice must be harmless
    jobs : by names that are unique on the scheduler
    retries : of a job that raised an exception
    counted : told how many workers there are, every `COUNT` seconds

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
                # It has forgotten what it was given, or is another.
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
    """What a job raised; what would befall every job is raised here."""
    if isinstance(error, RuntimeError) and "deserialization of the task graph" in str(error):
        raise FileError(
            "The Dask scheduler cannot import trackprofile; give scheduler, workers and this command the same "
            "environment."
        ) from error
    return error


class _Workers:
    """How many jobs can run at a time, asked now and then."""

    def __init__(self, client: Client, counted: Callable[[int], None]) -> None:
        self._client, self._counted = client, counted
        self._number, self._asked = 0, -COUNT

    def count(self) -> int:
        if time.monotonic() - self._asked >= COUNT:
            self._asked = time.monotonic()
            try:
                threads = cast(Mapping[str, int], self._client.nthreads())
            except OSError:  # the line broke just now: `done` sees to it
                return 0
            self._number = sum(threads.values())
            self._counted(self._number)
        return self._number


def _await_scheduler(client: Client) -> None:
    """Wait while the client calls a scheduler that does not answer; it gives up in the end."""
    while client.status == "connecting":
        time.sleep(POLL)
    if client.status != "running":
        raise FileError(
            "The Dask scheduler is lost; start it and its workers again, then the same command: what is stored is not "
            "computed again."
        )

"""Workers of a batch: processes on this machine, or a Dask scheduler with its workers."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING

from trackprofile.errors import DataError, FileError
from trackprofile.machine import ONE_THREAD

if TYPE_CHECKING:
    from distributed import Client

ANSWER = 10.0
"""Time in which a scheduler must answer, at the first connection and after a lost one, s."""


@contextmanager
def local(workers: int | None, memory: str, retries: int) -> Iterator[Client]:
    """Worker processes on this machine within the context; they end with this process.

    Parameters
    ----------
    workers : number of processes; None is one per core
    memory : limit of each worker, such as "2 GB", or "auto", its share of the machine's memory
    retries : number of retries of a job after its worker died

    Raises
    ------
    DataError : that is no amount of memory.
    FileError : Dask is not installed.
    """
    _need_dask()
    from dask import config
    from dask.utils import parse_bytes
    from distributed import Client, LocalCluster

    try:
        size = memory if memory == "auto" else parse_bytes(memory)
    except ValueError as error:
        raise DataError(
            f"{memory!r} is no amount of memory; write such as '2 GB', or auto."
        ) from error

    settings = {
        "distributed.scheduler.allowed-failures": retries,
        "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    }
    with _quiet(), config.set(settings):
        with _ignoring_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers or _cores(), threads_per_worker=1, processes=True, memory_limit=size,
                host="127.0.0.1", dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL,
            )  # fmt: skip
        with cluster, Client(cluster, timeout=ANSWER) as client:
            yield client


@contextmanager
def existing(scheduler: str) -> Iterator[Client]:
    """The workers of a running scheduler.

    Parameters
    ----------
    scheduler : its address, such as ``tcp://10.0.0.5:8786``, or the file that it wrote with ``--scheduler-file``

    Raises
    ------
    FileError : Dask is not installed, or no scheduler answers there within `ANSWER`.
    """
    _need_dask()
    from distributed import Client

    _check(scheduler)
    address, file = (None, scheduler) if _is_file(scheduler) else (scheduler, None)
    with _quiet():
        try:
            client = Client(address, scheduler_file=file, timeout=ANSWER)
        except OSError as error:
            raise FileError(
                f"{scheduler}: no Dask scheduler answers there within {ANSWER:g} s; "
                "see that it runs, and that the address is right."
            ) from error
        with client:
            yield client


def _check(scheduler: str) -> None:
    """Refuse an invalid address of a scheduler."""
    from distributed.comm.registry import backends

    if _is_file(scheduler):
        if not Path(scheduler).is_file():
            raise FileError(
                f"{scheduler}: there is no such file; see that the scheduler writes it."
            )
        return
    scheme, mark, _ = scheduler.partition("://")
    if mark and scheme not in backends:
        raise FileError(
            f"{scheduler}: an address begins with one of {', '.join(sorted(backends))}."
        )


def _is_file(scheduler: str) -> bool:
    return Path(scheduler).suffix == ".json"


def _need_dask() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise FileError("A fleet needs Dask: pip install 'trackprofile[network]'.") from error


def _cores() -> int:
    """Number of processor cores available to this process."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's logs: the results report the same per recording."""
    logs = [logging.getLogger(name) for name in _LOGS]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


_LOGS = ("distributed", "distributed.client")


@contextmanager
def _ignoring_ctrl_c() -> Iterator[None]:
    """Threads and processes that start in the context leave Ctrl-C to this process, which ends them in order."""
    # It unblocks the signal when it starts, so it has to run before.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""Who does the work: processes of this machine, or a Dask scheduler and its workers, wherever they are."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from trackprofile.errors import DataError, FileError

if TYPE_CHECKING:
    from distributed import Client

ANSWER = 10.0
"""s in which a scheduler has to answer, when it is called and when the line to it broke."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""A worker computes one recording at a time, on one core."""


@contextmanager
def local(workers: int | None, memory: str, retries: int) -> Iterator[Client]:
    """Processes of this machine, for as long as the context lasts; they end with this process, however it ends.

    Parameters
    ----------
    workers : None is one per core
    memory : that a worker may take before it is ended: such as "2 GB", or "auto", its share of the machine's
    retries : how often a job is given to another worker after its worker died

    Raises
    ------
    DataError : that is no amount of memory.
    FileError : Dask is not installed.
    """
    _need_dask()
    import dask
    from dask.utils import parse_bytes
    from distributed import Client, LocalCluster

    try:
        size = memory if memory == "auto" else parse_bytes(memory)
    except ValueError as error:
        raise DataError(f"{memory!r} is no amount of memory; write such as '2 GB', or auto.") from error

    settings = {
        "distributed.scheduler.allowed-failures": retries,
        "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    }
    with (
        _quiet(),
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers or _cores(), threads_per_worker=1, processes=True, memory_limit=size,
            host="127.0.0.1", dashboard_address=None, silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, timeout=ANSWER) as client,
    ):  # fmt: skip
        yield client


@contextmanager
def existing(scheduler: str) -> Iterator[Client]:
    """The workers of a scheduler that runs already.

    Parameters
    ----------
    scheduler : its address, such as ``tcp://10.0.0.5:8786``, or the file that it wrote with ``--scheduler-file``

    Raises
    ------
    FileError : Dask is not installed, or no scheduler answers there within `ANSWER`.
    """
    _need_dask()
    from distributed import Client

    of_file = Path(scheduler).suffix == ".json"
    with _quiet():
        try:
            client = Client(
                None if of_file else scheduler,
                scheduler_file=scheduler if of_file else None,
                timeout=ANSWER,
            )
        except (OSError, ValueError) as error:
            raise FileError(
                f"{scheduler}: no Dask scheduler answers there within {ANSWER:g} s; "
                "see that it runs, and that the address is right."
            ) from error
        with client:
            yield client


def _need_dask() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise FileError("A fleet needs Dask: pip install 'trackprofile[network]'.") from error


def _cores() -> int:
    """That this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask's log says of its own accord what the rows say of each recording."""
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)

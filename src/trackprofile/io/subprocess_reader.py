"""Reading of files in a subprocess, which a damaged file may crash, hang or fill.

With damaged files, the libraries for HDF5, MATLAB files and MDF run into endless loops, exhaust the memory or overwrite
it. The subprocess has limits of time and memory; the columns that it reads come back as plain numbers, as
`trackprofile.io.column_info.Column`. It is started once, and ends with this process.
"""

from __future__ import annotations

import atexit
import importlib
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from trackprofile.errors import DataError, FileError, TrackprofileError
from trackprofile.io.column_info import Column, ColumnInfo

TIME_LIMIT = 15.0
"""Time limit for a small file [s]."""

MIN_READ_RATE = 5e6
"""Lowest accepted read rate of a large file [B/s]."""

EXTRA_MEMORY = 1 << 30
"""Memory limit, in addition to that of the libraries and to twice the size of the file [B]."""

LARGE_FILE = 1 << 26
"""Size of a file after which the subprocess is stopped, to free its memory [B]."""

_CHUNK = 1 << 20
"""Size of one read from the pipe [B]."""

_lock = Lock()
_workers: list[subprocess.Popen[bytes]] = []


class _WorkerDiedError(Exception):
    """The subprocess ended unexpectedly."""


def headings_in_subprocess(path: Path, module: str) -> tuple[ColumnInfo, ...]:
    """Call the function ``headings_in_process`` of a module in the subprocess.

    Raises
    ------
    FileError, DataError : those of the function; or the subprocess crashed, took too long or too much memory.
    """
    answer, _ = _request(path, module, None)
    return tuple(ColumnInfo(**one) for one in answer["headings"])


def columns_in_subprocess(path: Path, module: str, names: Sequence[str]) -> dict[str, Column]:
    """Call the function ``read_in_process`` of a module in the subprocess.

    Raises
    ------
    FileError, DataError : as `headings_in_subprocess`.
    """
    return _request(path, module, names)[1]


def _request(
    path: Path, module: str, names: Sequence[str] | None
) -> tuple[dict[str, Any], dict[str, Column]]:
    with _lock:
        # A worker that has read a damaged file before may crash later.
        for _ in range(2 if _workers else 1):
            worker = _running_worker()
            limit = time.monotonic() + TIME_LIMIT + path.stat().st_size / MIN_READ_RATE
            try:
                answer, columns = _receive(worker, (str(path.absolute()), module, names), limit)
            except _WorkerDiedError:
                _stop(worker)
                continue
            except TimeoutError:
                _stop(worker)
                break
            if message := answer.get("refused"):
                raise DataError(message) if answer["of_data"] else FileError(message)
            if path.stat().st_size > LARGE_FILE:
                _stop(worker)
            return answer, columns
    raise FileError(
        f"{path}: damaged, reading it crashed or exceeded the limits of time and memory; copy or export it again."
    )


def _receive(
    worker: subprocess.Popen[bytes], question: tuple[object, ...], limit: float
) -> tuple[dict[str, Any], dict[str, Column]]:
    assert worker.stdin is not None
    try:
        worker.stdin.write(json.dumps(question).encode() + b"\n")
        worker.stdin.flush()
    except BrokenPipeError as error:
        raise _WorkerDiedError from error
    received = bytearray()
    while (end := received.find(b"\n")) < 0:
        received += _read_chunk(worker, _CHUNK, limit)
    answer = json.loads(received[:end])
    del received[: end + 1]
    columns = {}
    for name, rows in answer["columns"]:
        columns[name] = np.empty(rows)
        data, filled = columns[name].view(np.uint8), 0
        while filled < len(data):
            piece = received[: len(data) - filled] or _read_chunk(
                worker, min(_CHUNK, len(data) - filled), limit
            )
            data[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
            filled += len(piece)
            del received[: len(piece)]
    return answer, columns


def _read_chunk(worker: subprocess.Popen[bytes], size: int, limit: float) -> bytes:
    """Next bytes from the subprocess, waiting for them until the time limit."""
    assert worker.stdout is not None
    ready, _, _ = select.select([worker.stdout], [], [], max(limit - time.monotonic(), 0.0))
    if not ready:
        raise TimeoutError
    piece = os.read(worker.stdout.fileno(), size)
    if not piece:
        raise _WorkerDiedError
    return piece


def _running_worker() -> subprocess.Popen[bytes]:
    if _workers and _workers[0].poll() is None:
        return _workers[0]
    if not _workers:
        atexit.register(stop_worker)
    _workers.clear()
    _workers.append(
        subprocess.Popen(
            [sys.executable, "-c", "from trackprofile.io.subprocess_reader import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # Ctrl-C is for this process only; the worker ends at the end of its input.
            start_new_session=True,
        )
    )
    return _workers[0]


def _stop(worker: subprocess.Popen[bytes]) -> None:
    worker.kill()
    worker.wait()
    for stream in (worker.stdin, worker.stdout):
        if stream is not None:
            stream.close()
    _workers.clear()


def stop_worker() -> None:
    """Stop the subprocess, if there is one; the next file starts another."""
    for worker in tuple(_workers):
        _stop(worker)


def serve() -> None:
    """Read the requested files, one per line of standard input, and answer each on standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the answers
    for line in sys.stdin:
        name, module, names = json.loads(line)
        path = Path(name)
        _limit_memory(path)
        answer, columns = _read(path, importlib.import_module(module), names)
        lengths = [(one, len(values)) for one, values in columns.items()]
        answers.write(json.dumps({**answer, "columns": lengths}).encode() + b"\n")
        for values in columns.values():
            answers.write(np.asarray(values, np.float64).tobytes())
        answers.flush()


def _read(
    path: Path, module: Any, names: Sequence[str] | None
) -> tuple[dict[str, Any], Mapping[str, Column]]:
    headings: Callable[[Path], Sequence[ColumnInfo]]
    read: Callable[[Path, Sequence[str]], Mapping[str, Column]]
    try:
        if names is None:
            headings = module.headings_in_process
            return {"headings": [asdict(one) for one in headings(path)]}, {}
        read = module.read_in_process
        return {}, read(path, names)
    except TrackprofileError as error:
        return {"refused": str(error), "of_data": isinstance(error, DataError)}, {}
    except OSError as error:
        message = f"{path}: {error.strerror}; make it readable, or choose another file."
        return {"refused": message, "of_data": False}, {}


def _limit_memory(path: Path) -> None:
    try:
        import resource
    except ImportError:  # without this limit, the time limit remains
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc").is_dir() else 0
    limit = pages * resource.getpagesize() + EXTRA_MEMORY + 2 * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))

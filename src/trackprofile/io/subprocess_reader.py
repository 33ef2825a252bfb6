"""Files are read by a process apart, which a damaged file may crash, hang or fill as it likes.

The libraries behind HDF5, MATLAB's files and MDF run on damaged files into endless loops, out of their memory and over
the memory of others. What the process apart has read to the end within its limits comes back as plain numbers, as
`trackprofile.io.column_info.Column`. It is started once, and ends with this one.
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
"""s that a small file may take."""

MIN_READ_RATE = 5e6
"""Bytes per s of a large one."""

EXTRA_MEMORY = 1 << 30
"""Bytes beyond what the libraries take, and twice the file's size."""

LARGE_FILE = 1 << 26
"""Bytes of a file after which the process is ended, so that its memory is free."""

_CHUNK = 1 << 20
"""Bytes that are taken from a pipe in one go."""

_lock = Lock()
_workers: list[subprocess.Popen[bytes]] = []


class _WorkerDiedError(Exception):
    """The process apart died."""


def headings_in_subprocess(path: Path, module: str) -> tuple[ColumnInfo, ...]:
    """What ``module``'s function ``headings_here`` says of a file.

    Raises
    ------
    FileError, DataError : what it refuses; it died of the file, or took too long or too much memory.
    """
    answer, _ = _request(path, module, None)
    return tuple(ColumnInfo(**one) for one in answer["headings"])


def columns_in_subprocess(path: Path, module: str, names: Sequence[str]) -> dict[str, Column]:
    """Columns that ``module``'s function ``read_here`` reads from a file.

    Raises
    ------
    FileError, DataError : as `headings_in_subprocess`.
    """
    return _request(path, module, names)[1]


def _request(
    path: Path, module: str, names: Sequence[str] | None
) -> tuple[dict[str, Any], dict[str, Column]]:
    with _lock:
        # One that has read a damaged file before may die of that.
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
            if words := answer.get("refused"):
                raise DataError(words) if answer["of_data"] else FileError(words)
            if path.stat().st_size > LARGE_FILE:
                _stop(worker)
            return answer, columns
    raise FileError(
        f"{path}: damaged so that it cannot be read to its end; copy or export it again."
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
    taken = bytearray()
    while (end := taken.find(b"\n")) < 0:
        taken += _read_chunk(worker, _CHUNK, limit)
    answer = json.loads(taken[:end])
    del taken[: end + 1]
    columns = {}
    for name, rows in answer["columns"]:
        columns[name] = np.empty(rows)
        data, filled = columns[name].view(np.uint8), 0
        while filled < len(data):
            piece = taken[: len(data) - filled] or _read_chunk(
                worker, min(_CHUNK, len(data) - filled), limit
            )
            data[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
            filled += len(piece)
            del taken[: len(piece)]
    return answer, columns


def _read_chunk(worker: subprocess.Popen[bytes], most: int, limit: float) -> bytes:
    """What the process apart has to say, when it says it."""
    assert worker.stdout is not None
    ready, _, _ = select.select([worker.stdout], [], [], max(limit - time.monotonic(), 0.0))
    if not ready:
        raise TimeoutError
    piece = os.read(worker.stdout.fileno(), most)
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
            # A keyboard's Ctrl-C is for this process alone; the other ends when its input does.
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
    """End the process apart, if there is one; the next file starts another."""
    for worker in tuple(_workers):
        _stop(worker)


def serve() -> None:
    """Read the files that are asked for on standard input, one a line, and answer each on standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    for line in sys.stdin:
        name, module, names = json.loads(line)
        path = Path(name)
        _limit_memory(path)
        answer, columns = _read(path, importlib.import_module(module), names)
        told = [(one, len(values)) for one, values in columns.items()]
        answers.write(json.dumps({**answer, "columns": told}).encode() + b"\n")
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
        words = f"{path}: {error.strerror}; make it readable, or choose another file."
        return {"refused": words, "of_data": False}, {}


def _limit_memory(path: Path) -> None:
    try:
        import resource
    except ImportError:  # where there is no such limit, the time's has to do
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc").is_dir() else 0
    most = pages * resource.getpagesize() + EXTRA_MEMORY + 2 * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))

"""Files are read first by a process apart, which a damaged file may crash, hang or fill as it likes.

The libraries behind HDF5 and MDF run on damaged files into endless loops and out of their memory. What the process
apart has read to the end within its limits is then read here. It is started once, and ends with this one.
"""

from __future__ import annotations

import atexit
import importlib
import os
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Lock

from trackprofile.errors import FileError, TrackprofileError

PATIENCE = 15.0
"""s that a small file may take."""

SLOWEST = 5e6
"""Bytes per s of a large one."""

MOST_MEMORY = 1 << 30
"""Bytes beyond what the libraries take, and twice the file's size."""

_DONE, _REFUSED = "done", "refused"
_lock = Lock()
_workers: list[subprocess.Popen[str]] = []


def tried_apart(path: Path, module: str) -> None:
    """See that ``module``'s function ``walk`` reads a file to its end.

    Raises
    ------
    FileError : it does not, or takes too long or too much memory.
    """
    with _lock:
        worker = _worker()
        assert worker.stdin is not None
        assert worker.stdout is not None
        limit = PATIENCE + path.stat().st_size / SLOWEST
        try:
            worker.stdin.write(f"{module}\t{path.absolute()}\n")
            worker.stdin.flush()
            ready, _, _ = select.select([worker.stdout], [], [], limit)
            answer = worker.stdout.readline().strip() if ready else ""
        except BrokenPipeError:
            answer = ""
        kind, _, words = answer.partition("\t")
        if kind == _DONE:
            return
        if kind == _REFUSED:
            raise FileError(words)
        _end(worker)
    raise FileError(
        f"{path}: damaged so that it cannot be read to its end; copy or export it again."
    )


def _worker() -> subprocess.Popen[str]:
    if _workers and _workers[0].poll() is None:
        return _workers[0]
    if not _workers:
        atexit.register(_end_all)
    _workers.clear()
    _workers.append(
        subprocess.Popen(
            [sys.executable, "-c", "from trackprofile.io.apart import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            # A keyboard's Ctrl-C is for this process alone; the other ends when its input does.
            start_new_session=True,
        )
    )
    return _workers[0]


def _end(worker: subprocess.Popen[str]) -> None:
    worker.kill()
    worker.wait()
    for stream in (worker.stdin, worker.stdout):
        if stream is not None:
            stream.close()
    _workers.clear()


def _end_all() -> None:
    for worker in tuple(_workers):
        _end(worker)


def serve() -> None:
    """Walk the files that are named on standard input, one a line, and answer each on standard output."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    for line in sys.stdin:
        module, _, name = line.rstrip("\n").partition("\t")
        walk: Callable[[Path], None] = importlib.import_module(module).walk
        path = Path(name)
        _limit_memory(path)
        try:
            walk(path)
            answer = _DONE
        except TrackprofileError as error:
            answer = f"{_REFUSED}\t{error}"
        except OSError as error:
            answer = (
                f"{_REFUSED}\t{path}: {error.strerror}; make it readable, or choose another file."
            )
        answers.write(answer + "\n")
        answers.flush()


def _limit_memory(path: Path) -> None:
    try:
        import resource
    except ImportError:  # where there is no such limit, the time's has to do
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc").is_dir() else 0
    most = pages * resource.getpagesize() + MOST_MEMORY + 2 * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))

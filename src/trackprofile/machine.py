"""Description of this machine, and memory of a process: context for figures of speed and memory."""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""Environment variables of a process that computes on one core."""


def machine() -> str:
    """Number of cores, processor model, architecture and Python version, as text."""
    return f"{_processor()}, {platform.machine()}, Python {platform.python_version()}"


def peak_memory() -> float:
    """Peak memory of this process so far [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # on Linux ru_maxrss of a child begins at the peak of its parent
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def in_one_thread(module: str, expression: str) -> Any:
    """Evaluate an expression in a separate process with one thread, and return the result through JSON.

    Parameters
    ----------
    module : name of the module that the expression uses, as ``of``
    expression : Python expression with a value that JSON can hold

    Examples
    --------
    >>> in_one_thread("math", "of.sqrt(4.0)")
    2.0
    """
    code = f"import json; import {module} as of; print(json.dumps({expression}))"
    process = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | ONE_THREAD,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(process.stdout)


def _processor() -> str:
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.exists() else []
    models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} cores of {models[0] if models else platform.processor()}"

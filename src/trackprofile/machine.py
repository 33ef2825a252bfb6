"""What this machine is, and what a process takes of it: for figures of speed and memory."""

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
"""Environment of a process that computes on one core."""


def machine() -> str:
    """Cores, processor and Python, in words."""
    return f"{_processor()}, {platform.machine()}, Python {platform.python_version()}"


def peak_memory() -> float:
    """The most that this process has had so far [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # Linux hands the parent's peak down to the child in ru_maxrss, not here
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def in_one_thread(module: str, expression: str) -> Any:
    """What an expression about a module, ``of``, is, as JSON has it, in a process of its own on one thread.

    Examples
    --------
    >>> in_one_thread("math", "of.sqrt(4.0)")
    2.0
    """
    code = f"import json; import {module} as of; print(json.dumps({expression}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | ONE_THREAD,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def _processor() -> str:
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.exists() else []
    models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} cores of {models[0] if models else platform.processor()}"

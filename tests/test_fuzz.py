"""Every reader against damaged files, for ``FUZZ_SECONDS`` (60 unless told)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trackprofile.contracts import Channel, build_recording
from trackprofile.io import write

SECONDS = os.environ.get("FUZZ_SECONDS", "60")


@pytest.mark.acceptance
@pytest.mark.parametrize(
    "suffix", [".csv", ".parquet", ".nc", ".h5", ".mat", ".mf4", ".tdms", ".toml"]
)
def test_damaged_file_raises_an_error_of_this_package(tmp_path: Path, suffix: str) -> None:
    time = np.arange(40) / 10.0
    floor = Channel("floor", np.sin(time), "vertical acceleration", "body", 0.0, 1e-3)
    rate = Channel("rate", np.cos(time), "pitch rate", "body", 0.0)
    recording = build_recording([floor, rate], time=time, speed=time + 10.0, line="a line")
    seeds, place = tmp_path / "seeds", tmp_path / "place"
    seeds.mkdir()
    place.mkdir()
    write(recording, seeds / f"run{suffix}")
    if suffix == ".nc":
        (seeds / "run.toml").write_text("")
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("fuzz.py"), place, seeds / f"run{suffix}", SECONDS],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    sys.stdout.write(f"\n{suffix}: {done.stdout.strip()}\n")
    assert done.returncode == 0, f"{done.returncode}: {done.stdout[-500:]} {done.stderr[-3000:]}"

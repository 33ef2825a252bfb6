"""Long rides: blocks that join, bounded memory, speed, and work that is taken up again after kill -9."""

from __future__ import annotations

import os
import random
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, MutableMapping
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.fft import irfft, rfftfreq

from narrowing import floats
from trackprofile.assessment.compare import compare
from trackprofile.bands import BANDS, band_pass
from trackprofile.checkpoint import CheckpointStore, checkpoint_key, checkpoint_store
from trackprofile.cli import main
from trackprofile.contracts import Channel, build_profile, build_recording
from trackprofile.errors import DataError, FileError
from trackprofile.inference import blocks
from trackprofile.inference.blocks import BlockResult
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io import write
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import Sampled
from trackprofile.models.receptance import point_track
from trackprofile.reader import read
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import constant_speed

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
PRIOR = read_spectrum("german-low")
SPEED = 150 / 3.6  # m/s
RUN_IN = 300.0  # m
OPTIONS = ["--track", "zhai", "--prior", "german-low"]


def long_ride(length: float, every: int = 2, seed: int = 7) -> tuple[xr.Dataset, xr.Dataset]:
    """A recording at 1000/``every`` Hz over random track of the prior's spectrum, and that track."""
    generator = np.random.default_rng(seed)
    at = np.arange(-RUN_IN - 100.0, length + 20.0, 0.25)
    omega = 2 * np.pi * rfftfreq(len(at), 0.25)
    waves = (omega > 2 * np.pi / 500) & (omega < 2 * np.pi)
    height = np.zeros(len(omega), complex)
    white = generator.standard_normal((2, int(waves.sum())))
    height[waves] = np.sqrt(PRIOR.density(floats(omega[waves])) * omega[1] / 2) * (
        white[0] + 1j * white[1]
    )
    level = irfft(height * len(at), len(at))
    run = RunSettings(0.0, length, constant_speed(SPEED), run_in=RUN_IN, every=every)
    made = simulate(VELARO, ZHAI, Sampled(at, level), run, newmark(1e-3))
    parts = []
    for sensor in read_sensors("bogie-25ug"):
        assert sensor.noise_density is not None
        noise = sensor.noise_density * np.sqrt(500.0 / every)
        signal = sensor_signal(made, VELARO, sensor) + noise * generator.standard_normal(
            len(made.time)
        )
        parts.append(Channel(sensor.name, signal, sensor.quantity, sensor.body, sensor.position,
                             sensor.noise_density))  # fmt: skip
    recording = build_recording(
        parts, time=made.time - made.time[0], speed=made.speed, vehicle="velaro"
    )
    on = (at > -25.0) & (at <= length)
    return recording, build_profile(at[on], level[on], kind="truth")


@pytest.fixture(scope="module")
def ride() -> tuple[xr.Dataset, xr.Dataset]:
    return long_ride(4000.0, every=4)


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "LENGTH", 1500.0)


def inferred(
    recording: xr.Dataset, kept: MutableMapping[int, BlockResult] | None = None
) -> xr.Dataset:
    return estimate(
        recording, VELARO, InferenceSettings(track=ZHAI, prior=PRIOR, samples=16), checkpoint=kept
    ).profile


def test_blocks_join_without_a_trace(
    ride: tuple[xr.Dataset, xr.Dataset], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, truth = ride
    whole = inferred(recording)
    monkeypatch.setattr(blocks, "LENGTH", 1500.0)
    parts = inferred(recording)
    np.testing.assert_array_equal(parts["distance"], whole["distance"])
    np.testing.assert_array_equal(parts["quality"], whole["quality"])
    between = parts["elevation"].to_numpy() - whole["elevation"].to_numpy()
    for band in BANDS:
        stated = whole[f"standard_deviation_{band.name}"].to_numpy()
        assert np.max(np.abs(band_pass(between, 0.25, band)) / stated) < 0.5
        one, other = (
            compare(p, truth, from_m=300.0, to_m=3700.0).bands[band.name] for p in (whole, parts)
        )
        assert one is not None
        assert other is not None
        assert other.rms_error_mm == pytest.approx(one.rms_error_mm, rel=0.02)


@pytest.mark.usefixtures("short_blocks")
def test_interrupted_run_goes_on_to_the_same_bits(
    ride: tuple[xr.Dataset, xr.Dataset], tmp_path: Path
) -> None:
    recording, _ = ride
    whole = inferred(recording)

    class Full(CheckpointStore):
        """A disk that is full after the first block."""

        def __setitem__(self, number: int, piece: BlockResult) -> None:
            if number == 1:
                raise FileError("no space left")
            super().__setitem__(number, piece)

    key = checkpoint_key(recording)
    with pytest.raises(FileError, match="no space left"):
        inferred(recording, Full(tmp_path / ".p.nc.blocks", key))
    kept, said = checkpoint_store(tmp_path / "p.nc", key, resume=True)
    assert said == ("resuming after 1 block of the interrupted run",)
    assert list(kept) == [0]
    xr.testing.assert_identical(inferred(recording, kept), whole)
    assert len(kept) == 3
    kept.discard()
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("short_blocks")
def test_what_is_kept_of_another_run_is_refused_or_thrown_away(
    ride: tuple[xr.Dataset, xr.Dataset], tmp_path: Path
) -> None:
    recording, _ = ride
    kept = CheckpointStore(tmp_path / ".p.nc.blocks", checkpoint_key(recording, draws=16))
    inferred(recording, kept)
    other = checkpoint_key(recording, draws=17)
    with pytest.raises(DataError, match="of another recording, other options or another version"):
        checkpoint_store(tmp_path / "p.nc", other, resume=True)
    _, said = checkpoint_store(tmp_path / "p.nc", other, resume=False)
    assert "3 blocks of an interrupted run discarded" in said[0]
    assert not kept.folder.exists()
    _, said = checkpoint_store(tmp_path / "p.nc", other, resume=True)
    assert "starting from the beginning" in said[0]


@pytest.mark.usefixtures("short_blocks")
def test_damaged_block_is_refused(ride: tuple[xr.Dataset, xr.Dataset], tmp_path: Path) -> None:
    recording, _ = ride
    kept = CheckpointStore(tmp_path / ".p.nc.blocks", checkpoint_key(recording))
    inferred(recording, kept)
    path = kept.folder / "000001.npz"
    contents = bytearray(path.read_bytes())
    contents[len(contents) // 2] ^= 0xFF
    path.write_bytes(contents)
    with pytest.raises(FileError, match="the block is damaged; remove the file"):
        inferred(recording, kept)


def test_key_changes_with_every_number_and_option(ride: tuple[xr.Dataset, xr.Dataset]) -> None:
    recording, _ = ride
    changed = recording.copy(deep=True)
    changed["speed"][7] += 1e-12
    keys = [
        checkpoint_key(recording, seed=1),
        checkpoint_key(recording, seed=2),
        checkpoint_key(changed, seed=1),
    ]
    assert len(set(keys)) == 3
    assert checkpoint_key(recording.copy(deep=True), seed=1) == keys[0]


def test_resume_is_of_the_smoother_only(
    ride: tuple[xr.Dataset, xr.Dataset], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(ride[0], tmp_path / "run.nc")[0]
    with pytest.raises(SystemExit) as ended:
        main(
            [
                "infer",
                str(path),
                "-o",
                str(tmp_path / "p.nc"),
                "--method",
                "cross-entropy",
                "--resume",
            ]
        )
    assert ended.value.code == 1
    assert "--resume has no effect with --method cross-entropy" in capsys.readouterr().err


def command(folder: Path, name: str, *more: str) -> list[str]:
    trackprofile = str(Path(sys.executable).parent / "trackprofile")
    return [trackprofile, "infer", "run.nc", *OPTIONS, "-o", name, *more]


def killed_runs(folder: Path, name: str, kills: int) -> Iterator[float]:
    """Runs of the command, each killed after a random time, then one to the end."""
    moments = random.Random(11)
    for number in range(kills):
        more = ["--resume"] if number else []
        process = subprocess.Popen(command(folder, name, *more), cwd=folder, stderr=subprocess.DEVNULL,
                                   stdout=subprocess.DEVNULL)  # fmt: skip
        until = moments.uniform(2.0, 16.0)
        try:
            process.wait(until)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            assert not (folder / name).exists() or read(folder / name) is not None
            yield until


@pytest.mark.acceptance
def test_killed_at_twenty_random_moments_nothing_is_lost_and_nothing_different(
    tmp_path: Path,
) -> None:
    write(long_ride(120_000.0)[0], tmp_path / "run.nc")
    kills = len(list(killed_runs(tmp_path, "killed.nc", 20)))
    assert kills == 20
    for name, more in (("killed.nc", ["--resume"]), ("whole.nc", [])):
        subprocess.run(command(tmp_path, name, *more), cwd=tmp_path, check=True)
    assert (tmp_path / "killed.nc").read_bytes() == (tmp_path / "whole.nc").read_bytes()
    left = sorted(path.name for path in tmp_path.iterdir())
    ends = (".html", ".nc", ".png")
    assert left == sorted(["run.nc", *(stem + end for stem in ("killed", "whole") for end in ends)])


def resident(pid: int) -> float:
    """GB of a process; the most it ever had says what it was forked from too."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    except OSError:  # it has ended
        return 0.0
    return int(pages) * resource.getpagesize() / 1e9


def children(pid: int) -> list[int]:
    try:
        return list(map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))
    except OSError:
        return []


@pytest.mark.acceptance
def test_500_km_within_two_gigabytes_and_twenty_times_faster_than_the_train(tmp_path: Path) -> None:
    length = 500_000.0
    recording, truth = long_ride(length)
    write(recording, tmp_path / "run.nc")
    del recording
    one_thread = dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        ["taskset", "-c", "0", *command(tmp_path, "p.nc")],
        cwd=tmp_path,
        env=os.environ | one_thread,
    )
    memory = 0.0
    while process.poll() is None:
        memory = max(memory, sum(map(resident, [process.pid, *children(process.pid)])))
        time.sleep(0.1)
    assert process.returncode == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    faster = length / SPEED / seconds
    found = compare(read(tmp_path / "p.nc"), truth, from_m=500.0, to_m=length - 500.0)
    lines = [f"{seconds:.0f} s, {faster:.1f} times faster than the train, {memory:.2f} GB"]
    lines += [
        f"{name}: {band.rms_error_mm:.4f} mm, {100 * (band.coverage_95 or 0):.1f} % inside 95 %"
        for name, band in found.bands.items()
        if band
    ]
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
    assert memory < 2.0
    assert faster > 20.0

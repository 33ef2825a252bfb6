"""A night through a scheduler and two workers that are separate processes: how fast, and what kill -9 does to it.

``TRACKPROFILE_FLEET="100 5000 10"`` (recordings, metres each, kills) is the night that the project promises; without it
a small one runs.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path

import pytest

from fleet_recordings import write_night
from trackprofile.store import clean, find, open_store, verify

COUNT, LENGTH, KILLS = map(int, os.environ.get("TRACKPROFILE_FLEET", "12 1500 3").split())
BARE = 6  # recordings that the bare command is timed with
BIN = Path(sys.executable).parent
ENVIRONMENT = os.environ | dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
# A job that is hit by each of the kills is to be done all the same.
ENVIRONMENT["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"] = str(KILLS)
TICKS = os.sysconf("SC_CLK_TCK")

pytestmark = pytest.mark.acceptance


def seconds(pid: int) -> float:
    """Of processor time that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


@dataclass
class Cluster:
    """A scheduler and workers, each a process of its own."""

    folder: Path
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def add_worker(self) -> None:
        """Start one more."""
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", "."]
        self.workers.append(started(self.folder, "worker", self.address, *options))

    def stop(self) -> None:
        """End all of it."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def started(folder: Path, *command: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [BIN / "dask", *command], cwd=folder, env=ENVIRONMENT,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@contextmanager
def cluster(folder: Path, workers: int = 2, port: int | None = None) -> Iterator[Cluster]:
    """A scheduler with that many workers."""
    port = port or free_port()
    options = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    there = Cluster(folder, f"tcp://127.0.0.1:{port}", started(folder, "scheduler", *options))
    try:
        until = time.monotonic() + 60
        while not answers(port):
            assert time.monotonic() < until, "the scheduler does not come up"
            time.sleep(0.1)
        for _ in range(workers):
            there.add_worker()
        yield there
    finally:
        there.stop()


def answers(port: int) -> bool:
    with socket.socket() as line:
        return line.connect_ex(("127.0.0.1", port)) == 0


def command(manifest: Path, store: Path, *cluster: str) -> list[str]:
    to = [str(manifest), "--store", str(store), "--json", "-o", f"{store}.html"]
    return [str(BIN / "trackprofile"), "fleet", *to, *cluster]


def begun(manifest: Path, store: Path, *cluster: str) -> subprocess.Popen[str]:
    """A night that has stored its first recording and goes on; it and its processes are a group."""
    night = subprocess.Popen(
        command(manifest, store, *cluster), env=ENVIRONMENT, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    while not stored(store):
        assert night.poll() is None
        time.sleep(0.05)
    return night


def check_goes_on(whole: Whole, manifest: Path, store: Path) -> None:
    """The same command brings the rest, on processes of this machine, and the store is that of a night undisturbed."""
    before = stored(store)
    assert 0 < before < COUNT
    line = command(manifest, store, "--workers", "2")
    done = subprocess.run(line, env=ENVIRONMENT, check=True, capture_output=True, text=True)
    told = json.loads(done.stdout)
    assert (told["stored"], told["there"], told["failed"]) == (COUNT - before, before, 0)
    check_same(whole, store)


def check_same(whole: Whole, store: Path) -> None:
    clean(open_store(str(store)), older=timedelta(0))
    assert tree(store) == tree(whole.store)


def processes_of(group: int) -> list[int]:
    """That live."""
    living = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of = stat.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(of) == group and state != "Z":
            living.append(int(stat.parent.name))
    return living


def tree(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def stored(store: Path) -> int:
    return len(list(store.glob("entries/*/*/*/[0-9a-f]*.json")))


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_night(tmp_path_factory.mktemp("night"), COUNT, LENGTH)


@dataclass(frozen=True)
class Whole:
    """A night that nothing disturbed; ``cpu`` of its workers [s]."""

    store: Path
    said: dict
    cpu: float


@pytest.fixture(scope="module")
def whole(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    folder = tmp_path_factory.mktemp("whole")
    with cluster(folder) as there:
        line = command(manifest, folder / "store", "--scheduler", there.address)
        done = subprocess.run(line, env=ENVIRONMENT, check=True, capture_output=True, text=True)
        cpu = sum(seconds(worker.pid) for worker in there.workers)
    return Whole(folder / "store", json.loads(done.stdout), cpu)


def test_a_night_is_whole(whole: Whole) -> None:
    assert (whole.said["stored"], whole.said["there"], whole.said["failed"]) == (COUNT, 0, 0)
    assert whole.said["workers"] == 2
    store = open_store(str(whole.store))
    assert len({entry.key.run for entry in find(store, all_versions=True)}) == COUNT
    assert not verify(store)


def test_throughput_of_a_worker_is_that_of_the_bare_command(
    whole: Whole, manifest: Path, tmp_path: Path
) -> None:
    count = min(BARE, COUNT)
    options = ["--track", "zhai", "--prior", "german-low"]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    for number in range(count):
        run = manifest.with_name(f"run-{number:03d}.nc")
        subprocess.run(
            [BIN / "trackprofile", "infer", run, *options, "-o", tmp_path / f"{number}.nc"],
            env=ENVIRONMENT, check=True, capture_output=True,
        )  # fmt: skip
    wall = (time.monotonic() - start) / count
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    bare = (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / count
    fleet, fleet_wall = whole.cpu / COUNT, 2 * whole.said["wall_s"] / COUNT
    sys.stdout.write(
        f"\n{COUNT} recordings of {LENGTH} m: the bare command {bare:.2f} s of processor time for each "
        f"({wall:.2f} s on the clock, alone), a worker {fleet:.2f} s ({fleet_wall:.2f} s on the clock, two at once), "
        f"its jobs {whole.said['cpu_s'] / COUNT:.2f} s: throughput {100 * bare / fleet:.0f} % "
        f"(on the clock {100 * wall / fleet_wall:.0f} %)\n"
    )
    assert bare / fleet >= 0.8


def test_kill_9_of_workers_at_random_moments_leaves_the_same_store(
    whole: Whole, manifest: Path, tmp_path: Path
) -> None:
    moments = random.Random(3)
    store = tmp_path / "store"
    each = whole.said["wall_s"] * 2 / COUNT
    after = sorted(moments.sample(range(COUNT - 6), KILLS))
    with cluster(tmp_path) as there:
        night = begun(manifest, store, "--scheduler", there.address)
        for enough in after:
            while stored(store) < enough:
                assert night.poll() is None
                time.sleep(0.05)
            time.sleep(moments.uniform(0.0, each))
            assert night.poll() is None, "the night was over before the kill"
            victim = there.workers.pop(moments.randrange(len(there.workers)))
            os.kill(victim.pid, signal.SIGKILL)
            victim.wait()
            there.add_worker()
        said, _ = night.communicate()
    assert night.returncode == 0
    told = json.loads(said)
    assert not any(told["recordings"]["reason"]), told["recordings"]["reason"]
    assert (told["stored"], told["there"], told["failed"]) == (COUNT, 0, 0)
    check_same(whole, store)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_night_that_was_stopped_is_taken_up_again(
    whole: Whole, manifest: Path, tmp_path: Path, how: signal.Signals
) -> None:
    store = tmp_path / "store"
    night = begun(manifest, store, "--workers", "2")
    if how is signal.SIGINT:
        os.killpg(night.pid, how)  # as a terminal does it
    else:
        night.send_signal(how)
    said, noted = night.communicate()
    assert (night.returncode, said) == (130 if how is signal.SIGINT else -how, "")
    if how is signal.SIGINT:
        assert noted == "Interrupted: what is in the store stays, and the same command goes on.\n"
    until = time.monotonic() + 60
    while processes_of(night.pid):
        assert time.monotonic() < until, "workers outlive their night"
        time.sleep(0.1)
    check_goes_on(whole, manifest, store)


def test_a_scheduler_that_is_lost_ends_the_night_which_is_taken_up_again(
    whole: Whole, manifest: Path, tmp_path: Path
) -> None:
    store = tmp_path / "store"
    with cluster(tmp_path) as there:
        night = begun(manifest, store, "--scheduler", there.address)
    said, noted = night.communicate(timeout=60)
    assert (night.returncode, said) == (1, "")
    assert noted.startswith(
        "trackprofile: The Dask scheduler is lost; start it and its workers again"
    )
    assert len(noted.splitlines()) == 1
    check_goes_on(whole, manifest, store)


def test_a_scheduler_that_comes_back_goes_on_with_the_night(
    whole: Whole, manifest: Path, tmp_path: Path
) -> None:
    store, port = tmp_path / "store", free_port()
    with cluster(tmp_path, port=port) as there:
        night = begun(manifest, store, "--scheduler", there.address)
    with cluster(tmp_path, port=port):
        said, noted = night.communicate()
    assert night.returncode == 0, noted
    told = json.loads(said)
    assert (told["stored"], told["there"], told["failed"]) == (COUNT, 0, 0)
    check_same(whole, store)


def test_a_job_that_kills_its_workers_ends_and_the_others_are_done() -> None:
    script = Path(__file__).with_name("deadly.py")
    done = subprocess.run(
        [sys.executable, script], env=ENVIRONMENT, check=True, capture_output=True
    )
    found = json.loads(done.stdout)
    assert found.pop("job 3").startswith("KilledWorker('job 3'")
    assert found.pop("job 4") == "ZeroDivisionError('a bug')"
    assert found == {f"job {number}": str(number) for number in (0, 1, 2, 5, 6, 7)}

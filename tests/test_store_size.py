"""Size of the store of a network, and time to open a line.

The full size, 2,000 km with 20 passes, 1.7 GB, is created once by

    python tests/network.py FOLDER --lines 20 --length 100000 --passes 20

and measured here with ``TRACKPROFILE_STORE=FOLDER``; without that, one line of 100 km with 2 passes represents it.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from network import Network, fill
from trackprofile import store as stores
from trackprofile.store import PassKey, entry_id
from trackprofile.store.entry import entry_document
from trackprofile.store.layout import ENTRIES

VIEWS = """
import json, resource, sys, time
from trackprofile import store as stores

def timed(what, work):
    wall, processor = time.perf_counter(), time.process_time()
    result = work()
    times[what] = [time.perf_counter() - wall, time.process_time() - processor]
    return result

def drawn(start, end):
    for entry in passes:
        for column in ("elevation", "D1", "D2", "D3"):
            assert stores.envelope(store, entry, column, start, end, 1000).low.size
    return stores.defects(store, passes, start, end)

def opened():
    line = timed("lines", lambda: stores.lines(store))[-1]
    global passes
    passes = stores.find(store, line=line.line, first=line.days[-1], last=line.days[-1])
    return drawn(line.start, line.end)

times = {}
store = stores.open_store(sys.argv[1])
timed("line", opened)
middle = 0.5 * (passes[0].start + passes[0].end)
timed("kilometre", lambda: drawn(middle, middle + 1000))
timed("line again", opened)
timed("all passes over a kilometre", lambda: [
    stores.envelope(store, one, "D1", middle, middle + 1000, 1000) for one in stores.find(store, line=passes[0].line)])
stores.read_profile(store, passes[0], middle, middle + 1000)  # once: xarray imports its backends
timed("a profile of a kilometre", lambda: stores.read_profile(store, passes[0], middle, middle + 1000))
times["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(json.dumps(times))
"""


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if "TRACKPROFILE_STORE" in os.environ:
        return Path(os.environ["TRACKPROFILE_STORE"])
    folder = tmp_path_factory.mktemp("network")
    fill(stores.create(str(folder)), Network(1, 100_000.0, 2))
    return folder


@pytest.mark.acceptance
def test_a_line_opens_within_a_second_and_a_kilometre_within_a_third(network: Path) -> None:
    command = [sys.executable, "-c", VIEWS, str(network)]
    times = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    print(times)  # noqa: T201
    assert times["line"][0] < 1.0
    assert times["kilometre"][0] < 0.3
    assert times["a profile of a kilometre"][0] < 0.05
    assert times["memory"] < 1e9


CATALOGUE = """
import json, sys, time
from trackprofile import store as stores

def timed(work):
    began = time.process_time()
    work()
    return time.process_time() - began

store = stores.open_store(sys.argv[1])
print(json.dumps([timed(lambda: stores.lines(store)), timed(lambda: stores.lines(store))]))
"""


@pytest.mark.acceptance
def test_eight_thousand_passes_are_listed_in_less_than_half_a_second(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    (added,) = fill(store, Network(1, 600.0, 1))
    for number in range(8000):  # 2,000 km with 20 passes, in recordings of 5 km
        line, day, piece = number // 400, number // 20 % 20, number % 20
        key = PassKey(f"Line {line}", "up", date(2026, 5, 1 + day), "06:12")
        origin = replace(
            added.entry.origin, recording=hashlib.sha256(str(number).encode()).hexdigest()
        )
        begin = 5000.0 * piece
        entry = replace(
            added.entry,
            id=entry_id(key, origin),
            key=key,
            origin=origin,
            start=begin,
            end=begin + 5000,
        )
        path = tmp_path / entry.path(ENTRIES)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(entry_document(entry))
    command = [sys.executable, "-c", CATALOGUE, str(tmp_path)]
    without = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    stores.build_index(store)
    with_index = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    print(f"s of processor time, first and second: {without} without index, {with_index} with")  # noqa: T201
    assert max(without) < 3.0
    assert max(with_index) < 0.5


@pytest.mark.acceptance
def test_a_metre_of_a_pass_takes_less_than_50_bytes(network: Path) -> None:
    entries = stores.find(stores.open_store(str(network)))
    size = sum(path.stat().st_size for path in network.rglob("*") if path.is_file())
    metres = sum(one.end - one.start for one in entries)
    print(f"{size / 1e9:.3f} GB of {metres / 1e3:.0f} km: {size / metres:.1f} B/m")  # noqa: T201
    assert size / metres < 50

"""Response time of the web viewer and memory of its server, for 2,000 km with twenty passes.

pytest -s -m acceptance tests/test_server_speed.py
"""

from __future__ import annotations

import json
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

import httpx
import pytest

pytest.importorskip("fastapi")

from many_passes import fill_with_copies
from network import Network, fill
from trackprofile.store import create, find

pytestmark = pytest.mark.acceptance

MAX_LINE_SECONDS, MAX_KILOMETRE_SECONDS = 1.0, 0.3

LINES, PASSES, LENGTH, SIMULATED = 20, 20, 100_000.0, 3
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
BANDS = ("D1", "D2", "D3")


def say(sentence: str) -> None:
    """Print a sentence; pytest shows it with ``-s``."""
    sys.stdout.write(f"{sentence}\n")


@dataclass(frozen=True)
class Served:
    """A server in its own process."""

    process: subprocess.Popen[str]
    address: str
    day: str

    def peak_memory(self) -> float:
        """Peak memory of the process [MB]."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        match = re.search(r"VmHWM:\s+(\d+) kB", status)
        assert match is not None
        return int(match[1]) / 1e3

    def processor_time(self) -> float:
        """Processor time used by the process [s]."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / 100


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server of a store of twenty lines with twenty passes each, which repeat three passes of 100 km."""
    folder = tmp_path_factory.mktemp("network") / "store"
    network = Network(lines=1, length=LENGTH, passes=SIMULATED)
    store = create(str(folder))
    fill(store, network)
    days = [network.day(number) for number in range(PASSES)]
    fill_with_copies(store, find(store), [network.name(line) for line in range(LINES)], days)
    command = [sys.executable, "-m", "trackprofile", "serve", "--store", str(folder), "--port", "0"]
    with subprocess.Popen([*command, "--json"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield Served(process, json.loads(process.stdout.readline())["address"], str(days[-1]))
        process.terminate()
    shutil.rmtree(folder)


def view(where: Mapping[str, str], start: float, end: float) -> list[tuple[str, dict[str, object]]]:
    """Requests that the viewer sends to show a stretch."""
    stretch = {"from": start, "to": end}
    width = 2400 if end - start > 500 else 8000
    strips = [("level", {**where, **stretch, "band": band, "max_bins": width}) for band in BANDS]
    return [
        *strips,
        ("schematic", {**where, "bins": 400}),
        ("defects", {**where, **stretch, "count": 500}),
        ("sections", {**where, **stretch, "band": "D1", "count": 300}),
    ]


def response_time(client: httpx.Client, wanted: list[tuple[str, dict[str, object]]]) -> float:
    """Time until all requests are answered, as many at once as a browser sends [s]."""

    def ask(one: tuple[str, dict[str, object]]) -> None:
        answer = client.get(f"/api/{one[0]}", params={k: str(v) for k, v in one[1].items()})
        assert answer.status_code == 200, answer.text

    start = time.perf_counter()
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(ask, wanted))
    return time.perf_counter() - start


def test_a_line_and_a_kilometre_open_fast_in_little_memory(served: Served) -> None:
    wholes, kilometres = [], []
    where = {"line": "Line 1", "direction": "up", "day": served.day}
    with httpx.Client(base_url=served.address, timeout=60, trust_env=False) as client:
        client.get("/api/lines")
        used = served.processor_time()
        for line in range(LINES):
            where["line"] = f"Line {line + 1}"
            wholes.append(response_time(client, view(where, 0.0, LENGTH)))
            for start in (20_000.0, 70_500.0):
                kilometres.append(response_time(client, view(where, start - 500, start + 1500)))
        each = (served.processor_time() - used) / (3 * LINES)
        for endpoint in ("development", "quality", "compare"):
            parameters = {**where, "band": "D1", "at": 40_000.0, "compared_day": "2026-05-01"}
            more = {"development": ("at",), "quality": (), "compare": ("day", "compared_day")}[
                endpoint
            ]
            chosen = {name: parameters[name] for name in ("line", "direction", "band", *more)}
            say(f"{endpoint}: {response_time(client, [(endpoint, chosen)]):.2f} s")
    memory = served.peak_memory()
    line, kilometre = statistics.median(wholes), statistics.median(kilometres)
    say(f"line: {line:.3f} s (worst {max(wholes):.3f})")
    say(f"1 km: {kilometre:.3f} s (worst {max(kilometres):.3f})")
    say(f"processor time of a view: {each:.3f} s; server: {memory:.0f} MB")
    assert line < MAX_LINE_SECONDS
    assert kilometre < MAX_KILOMETRE_SECONDS
    assert memory < 1000


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this system")
def test_the_viewer_draws_them_in_a_browser_as_fast(served: Served) -> None:
    from playwright.sync_api import sync_playwright

    from test_server_viewer import FLAGS

    wholes, kilometres, following = [], [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        for line in range(6):
            for where, times in (({}, wholes), ({"from": 30_000, "to": 31_000}, kilometres)):
                state = {"line": f"Line {line + 1}", "direction": "up", "day": served.day, **where}
                page.goto(f"{served.address}?{urlencode(state)}")
                page.wait_for_selector('main[aria-busy="false"]')
                drawn = page.evaluate("performance.getEntriesByName('drawn').at(-1).startTime")
                times.append(drawn / 1e3)
            page.get_by_label("kilometre to go to").fill(str(55 + line))
            start = page.evaluate("performance.now()")
            page.keyboard.press("Enter")
            page.wait_for_url(lambda url: "at=" in url)
            page.wait_for_selector('main[aria-busy="false"]')
            drawn = page.evaluate("performance.getEntriesByName('drawn').at(-1).startTime")
            following.append((drawn - start) / 1e3)
        browser.close()
    line, kilometre = statistics.median(wholes), statistics.median(kilometres)
    say(f"drawn in the browser from nothing: line {line:.2f} s, 1 km {kilometre:.2f} s")
    say(f"the next kilometre, in the page that is open: {statistics.median(following):.2f} s")
    assert line < MAX_LINE_SECONDS
    assert statistics.median(following) < MAX_KILOMETRE_SECONDS

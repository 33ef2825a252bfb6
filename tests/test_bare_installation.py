"""The package without its extra ``plot``: the main job works, and figures name what they need."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from trackprofile.demo import run as run_demo

WITHOUT_PLOT = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"matplotlib", "plotly"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
from trackprofile.cli import main
main(sys.argv[1:])
"""
INSTALL = "pip install 'trackprofile[plot]'"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs the command where neither matplotlib nor plotly is installed."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_PLOT, *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bare") / "demo"
    run_demo(folder, length=300.0)
    return folder


def test_infer_without_plot_writes_the_profile_and_names_the_extra(
    demo: Path, tmp_path: Path
) -> None:
    profile = tmp_path / "profile.nc"
    done = run("infer", demo / "recording.toml", "--track", "zhai", "-o", profile)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["profile.nc"]
    assert f"No figures were drawn: they need {INSTALL}" in done.stderr
    assert "See it in" not in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["report", "profile.nc", "--speed", "140 km/h", "-o", "report.pdf"],
        ["reproduce", "-o", "reproduction"],
        ["calibrate", "recording.toml", "--vehicle", "vehicle.toml", "-o", "new.toml", "--figure", "c.png"],
    ],
    ids=lambda arguments: arguments[0],
)  # fmt: skip
def test_command_that_needs_plot_ends_with_one_sentence(demo: Path, arguments: list[str]) -> None:
    paths = [str(demo / one) if "." in one else one for one in arguments]
    done = run(*paths)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert INSTALL in done.stderr
    assert not (demo / "report.pdf").exists()


def test_html_report_needs_no_extra(demo: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    done = run("report", demo / "profile.nc", "--speed", "140 km/h", "-o", report)
    assert done.returncode == 0, done.stderr
    assert report.exists()

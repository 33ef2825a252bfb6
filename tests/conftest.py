"""What all tests share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from trackprofile.cli import main

# How fast examples are drawn says how busy the machine is, and nothing of the code.
settings.register_profile(
    "same every time",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("same every time")

Run = Callable[..., tuple[int, str, str]]
"""Runs the command: exit code, standard output, standard error."""

SHARED = Path(__file__).parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Callable[[str], Path]:
    """Finds a file that stands beside the project, such as ``data/hokuriku/section_a.csv``."""

    def find(name: str) -> Path:
        path = SHARED / name
        if not path.exists():
            pytest.skip(f"{name} does not stand beside the project")
        return path

    return find


@pytest.fixture(scope="session")
def dated_store(tmp_path_factory: pytest.TempPathFactory):
    """A small store of dated passes, see `dated_passes`; not to be written to."""
    pytest.importorskip("duckdb")
    from dated_passes import fill
    from trackprofile.store import create

    store = create(str(tmp_path_factory.mktemp("dated") / "store"))
    fill(store)
    return store


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the command in this process."""

    def command(*arguments: str | Path) -> tuple[int, str, str]:
        try:
            main([str(one) for one in arguments])
        except SystemExit as exit_:
            code = exit_.code
        else:
            code = 0
        captured = capsys.readouterr()
        assert isinstance(code, int)
        return code, captured.out, captured.err

    return command

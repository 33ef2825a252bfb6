"""The files of the project agree with each other and with the package."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import metadata
from pathlib import Path

import trackprofile

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_version_has_one_source() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", trackprofile.__version__)
    assert "version" not in PROJECT
    assert metadata("trackprofile")["Version"] == trackprofile.__version__


def test_citation_has_the_version_of_the_package() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"(?m)^version: (.*)$", text) == [trackprofile.__version__]

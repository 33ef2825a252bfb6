"""The files of the project agree with each other and with the package."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import metadata
from pathlib import Path

import pytest

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


def test_changelog_has_the_version_of_the_package() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "## [Unreleased]" in text
    assert f"## [{trackprofile.__version__}]" in text


def test_contribution_guide_names_thirty_features_with_existing_modules() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| ([^|`]+) \| `([\w/]+\.py)` \|$", text)
    assert len(rows) == 30
    assert len({feature for feature, _ in rows}) == 30
    package = Path(trackprofile.__file__).parent
    assert [module for _, module in rows if not (package / module).is_file()] == []


def test_each_feature_shares_a_word_with_its_module() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for feature, module in re.findall(r"(?m)^\| ([^|`]+) \| `([\w/]+\.py)` \|$", text):
        words = {word[:5] for word in re.findall(r"\w+", feature.lower())}
        assert words & {word[:5] for word in re.findall(r"[a-z]+", module)}, feature


def test_contribution_guide_names_existing_files() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"`((?:docs|tests|src)/[\w/.-]+)`", text):
        assert (ROOT / path).exists(), path
    for package in re.findall(r"`(\w+)/`", text):
        assert (ROOT / "src" / "trackprofile" / package).is_dir(), package


def test_workflows_and_templates_are_valid_yaml() -> None:
    yaml = pytest.importorskip("yaml")
    paths = [*ROOT.glob(".github/**/*.yml"), ROOT / ".pre-commit-config.yaml"]
    assert paths
    for path in paths:
        assert yaml.safe_load(path.read_text(encoding="utf-8")), path.name


def test_workflow_tests_every_python_that_the_package_declares() -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    matrix = yaml.safe_load(text)["jobs"]["test"]["strategy"]["matrix"]
    prefix = "Programming Language :: Python :: 3."
    declared = [one for one in PROJECT["classifiers"] if one.startswith(prefix)]
    assert [f"3.{one.removeprefix(prefix)}" for one in declared] == matrix["python"]
    assert len(matrix["os"]) == 3


@pytest.mark.parametrize("name", ["requirements.lock", "pyproject.toml"])
def test_dependencies_name_no_package_index(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    addresses = re.findall(r"\w+://[^\s\"]+", text)
    assert all(one.startswith("https://github.com/trackprofile/") for one in addresses)
    assert not re.search(r"index-url|find-links", text)

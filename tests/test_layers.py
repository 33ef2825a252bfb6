"""Imports go strictly downward; packages of one layer do not import each other."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import trackprofile

ROOT = Path(trackprofile.__file__).parent
LAYERS = (
    {"errors", "machine", "arrays"},
    {"units", "bands"},
    {"contracts"},
    {"models"},
    {"kalman", "preprocessing", "simulation"},
    {"positioning"},
    {"inference", "io"},
    {"calibration", "methods", "reader"},
    {"assessment"},
    {"checkpoint", "fusion", "scenario", "store"},
    {"reporting"},
    {"demo", "reproduction", "server"},
    {"bench", "fleet"},
    {"cli"},
    {"__main__"},
)
LAYER = {package: number for number, layer in enumerate(LAYERS) for package in layer}
MODULES = sorted(path.relative_to(ROOT) for path in ROOT.rglob("*.py"))


def package_of(module: Path) -> str:
    return module.parts[0].removesuffix(".py")


def imported_packages(source: str) -> Iterator[str]:
    """The packages that a module imports, inside functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            assert "trackprofile" not in names, "import from the module that defines it"
        else:
            continue
        yield from (name.split(".")[1] for name in names if name.startswith("trackprofile."))


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_a_module_imports_only_from_below(module: Path) -> None:
    package = package_of(module)
    if package == "__init__":  # the package's own: it lists the public names, and loads none
        return
    assert package in LAYER, f"{module} has no layer: give it one here, and in the architecture"
    for other in imported_packages((ROOT / module).read_text(encoding="utf-8")):
        if other in {package, "__version__"}:
            continue
        assert other in LAYER, f"{module} imports {other}: import from the module that defines it"
        assert LAYER[other] < LAYER[package], f"{module} may not know {other}"


@pytest.mark.parametrize(
    ("source", "packages"),
    [
        ("from trackprofile.io.atomic import whole_files", ["io"]),
        ("from trackprofile import cli, demo", ["cli", "demo"]),
        ("import trackprofile.units as u\nimport numpy", ["units"]),
        ("def late():\n    from trackprofile.reporting import html", ["reporting"]),
    ],
)
def test_every_way_to_import_is_seen(source: str, packages: list[str]) -> None:
    assert list(imported_packages(source)) == packages


def test_importing_the_package_loads_no_numpy() -> None:
    code = "import sys, trackprofile; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_public_name_is_there() -> None:
    for name in trackprofile.__all__:
        assert getattr(trackprofile, name) is not None
    with pytest.raises(AttributeError, match="attribute profle"):
        _ = getattr(trackprofile, "profle")  # noqa: B009

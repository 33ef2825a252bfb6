"""Scripts and styles of the web viewer and the report: one palette, one chart library, one module."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

import pytest

from trackprofile.reporting import palette
from trackprofile.reporting.html import _BUTTONS
from trackprofile.reporting.web_files import report_script, report_style

PACKAGE = Path(str(files("trackprofile")))
SOURCES = [
    path
    for folder in ("reporting", "server", "fleet")
    for path in sorted((PACKAGE / folder).rglob("*"))
    if path.suffix in {".py", ".js", ".css", ".html"}
    and "vendor" not in path.parts
    and path.name != "palette.py"
]
COLOURS = {
    colour.lower()
    for name in ("ACTIONS", "ACTION_TEXT", "LINES", "SPECTRA", "CLASSES", "CERTAINTY")
    for value in [getattr(palette, name)]
    for colour in (value.values() if isinstance(value, dict) else value)
}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_colour_of_the_palette_is_defined_again(path: Path) -> None:
    text = path.read_text(encoding="utf-8").lower()
    assert not COLOURS & set(re.findall(r"#[0-9a-f]{6}\b", text))


def test_every_custom_property_of_the_scripts_is_in_the_palette() -> None:
    css = palette.palette_css()
    used = {
        name
        for path in SOURCES
        if path.suffix == ".js"
        for name in re.findall(r'colour\("([\w-]+)"', path.read_text(encoding="utf-8"))
    }
    assert used
    assert [name for name in sorted(used) if f"--{name}: " not in css] == []


def test_actions_have_the_contrast_that_text_needs() -> None:
    def luminance(colour: str) -> float:
        parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
        linear = [
            one / 12.92 if one <= 0.04045 else ((one + 0.055) / 1.055) ** 2.4 for one in parts
        ]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    for colour in (*palette.ACTION_TEXT.values(), palette.MUTED, palette.INK):
        assert 1.05 / (luminance(colour) + 0.05) >= 4.5


def test_report_script_is_one_module_without_imports_and_repeated_names() -> None:
    module = report_script().split('<script type="module">')[1]
    assert not re.search(r"^(import|export)\b", module, re.MULTILINE)
    names = re.findall(r"^(?:async )?(?:function|const|let|class) (\w+)", module, re.MULTILINE)
    assert len(names) > 30
    assert len(names) == len(set(names))
    assert report_script().count("</script>") == 2
    assert ":root {" in report_style()


def test_buttons_of_the_report_are_those_of_the_web_viewer() -> None:
    script = (PACKAGE / "reporting/web/view.js").read_text(encoding="utf-8")
    assert [tuple(one) for one in re.findall(r'\["(\S+)", "([^"]+)", "(\S+)"\]', script)] == list(
        _BUTTONS
    )


def test_the_chart_library_is_there_once_with_its_licence() -> None:
    folder = PACKAGE / "reporting/vendor/uplot"
    assert len(list(PACKAGE.rglob("uPlot*.js"))) == 1
    assert "MIT License" in (folder / "LICENSE").read_text(encoding="utf-8")
    version = re.match(r"uPlot ([\d.]+),", (folder / "README.md").read_text(encoding="utf-8"))
    assert version is not None
    banner = (folder / "uPlot.iife.min.js").read_text(encoding="utf-8")[:100]
    assert f"(v{version[1]})" in banner

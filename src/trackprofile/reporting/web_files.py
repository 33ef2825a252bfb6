"""Scripts and style sheets that the report contains: one module from several, each in the order of its imports."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

from trackprofile.reporting.palette import palette_css

_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ", re.MULTILINE)


@cache
def report_script() -> str:
    """uPlot and the modules of the report as two script elements; no name may be declared in two modules."""
    modules: dict[str, str] = {}
    _collect("report.js", modules)
    library = _text("vendor/uplot", "uPlot.iife.min.js")
    return f'<script>{library}</script>\n<script type="module">\n{"".join(modules.values())}</script>\n'


@cache
def report_style() -> str:
    """Palette, uPlot and report styles as one style sheet."""
    return "".join(
        [palette_css(), _text("vendor/uplot", "uPlot.min.css"), _text("web", "report.css")]
    )


def _collect(name: str, modules: dict[str, str]) -> None:
    """Add a module after those it imports."""
    text = _text("web", name)
    for imported in _IMPORT.findall(text):
        if imported not in modules:
            _collect(imported, modules)
    modules[name] = _EXPORT.sub("", _IMPORT.sub("", text))


def _text(folder: str, name: str) -> str:
    return (files("trackprofile.reporting") / folder / name).read_text(encoding="utf-8")

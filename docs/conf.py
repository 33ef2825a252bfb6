"""How the manual is built: `make docs`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

from trackprofile import __version__

project = "trackprofile"
copyright = "the trackprofile authors"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.doctest"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"trackprofile {version}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_math_renderer = "presentation"

# The docstrings' own examples run with the tests.
doctest_test_doctest_blocks = ""

default_role = "py:obj"
add_module_names = False
python_use_unqualified_type_names = True
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
_ALIASES = ("Array", "ArrayLike", "ComplexArray", "Indices", "NDArray", "PointTrack", "Progress")
autodoc_type_aliases = {name: name for name in (*_ALIASES, "Roughness", "Track")}

# A docstring may name what this manual does not describe, such as NumPy's types; a page may not.
nitpick_ignore_regex = [("py:(class|obj|data)", r".*")]


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _readable)
    app.connect("autodoc-process-signature", _aliased)
    app.add_html_math_renderer("presentation", (_inline, None), (_display, None))


def _inline(writer: Any, node: Any) -> None:
    writer.body.append(_mathml(node.astext()))
    raise SkipNode


def _display(writer: Any, node: Any) -> None:
    writer.body.append(f'<div class="formula">{_mathml(node.astext(), as_block=True)}</div>')
    raise SkipNode


def _mathml(formula: str, *, as_block: bool = False) -> str:
    """A formula as MathML, which a browser lays out by itself: nothing is loaded for it."""
    # Where there is no mathematical font, an accent would be drawn across its letter.
    return tex2mathml(formula, as_block=as_block).replace(' accent="true"', "")


def _readable(app: Sphinx, what: str, name: str, it: object, options: object, lines: list) -> None:
    """Docstrings here have NumPy's sections, with ``name : meaning`` in one line."""
    parts = [*_parts(lines)]
    lines[:] = [line for title, body in parts for line in _FORMS[title](body)]


def _aliased(
    app: Sphinx, what: str, name: str, it: object, options: object,
    arguments: str | None, returned: str | None,
) -> tuple[str | None, str | None]:  # fmt: skip
    """A type alias by its name, inside of other types too; nothing for what is never called."""
    if arguments == "(*args, **kwargs)":
        return "", None
    return _unwrapped(arguments), _unwrapped(returned)


def _unwrapped(text: str | None) -> str | None:
    return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def _parts(lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """The sections by title, that before the first without one."""
    title, body = "", []
    for line in lines:
        if body and re.fullmatch("-{3,}", line) and body[-1] in _FORMS:
            following = body.pop()
            yield title, body
            title, body = following, []
        else:
            body.append(line)
    yield title, body


def _prose(body: list[str]) -> list[str]:
    """Text, in which an indented paragraph, or TOML to the end, is meant as it stands."""
    made: list[str] = []
    toml = next((n for n, line in enumerate(body) if re.match(r"\w+ = ", line)), len(body))
    for line in (*body[:toml], *(f"    {line}".rstrip() for line in body[toml:])):
        indented = line.startswith("    ")
        if indented and len(made) > 1 and not made[-1] and _begins_block(made[-2]):
            made += ["::", ""]
        made.append(line if indented else _escaped(line))
    return made


def _begins_block(before: str) -> bool:
    return bool(before) and not before.startswith((" ", ".. ")) and not before.endswith("::")


def _entries(body: list[str]) -> Iterator[tuple[str, str]]:
    """Names and meaning, from ``names : meaning`` or the meaning indented below the names."""
    names, meaning = "", []
    for line in filter(str.strip, body):
        if line.startswith(" "):
            meaning.append(line.strip())
            continue
        if names:
            yield names, " ".join(meaning)
        names, _, first = line.partition(" : ")
        meaning = [first] if first else []
    if names:
        yield names, " ".join(meaning)


def _parameters(body: list[str]) -> list[str]:
    return _field(
        "Parameters", [(f"**{_escaped(names)}**", text) for names, text in _entries(body)]
    )


def _raises(body: list[str]) -> list[str]:
    role = ":py:exc:`~trackprofile.errors.{}`".format
    entries = [(", ".join(map(role, names.split(", "))), text) for names, text in _entries(body)]
    return _field("Raises", entries)


def _field(title: str, entries: list[tuple[str, str]]) -> list[str]:
    made = [f"* {names}: {_escaped(text)}" for names, text in entries]
    return [f":{title}:", *(f"    {line}" for line in made), ""]


def _returns(body: list[str]) -> list[str]:
    text = " ".join(line.strip() for line in body)
    return [":Returns:", f"    {_escaped(text)}", ""]


def _examples(body: list[str]) -> list[str]:
    return [".. rubric:: Example", "", *body]


def _escaped(line: str) -> str:
    """What is no markup here: stars, bars and trailing underscores outside of quotation."""
    parts = re.split(r"((?::[a-z:]+:)?`+[^`]+`+)", line)
    parts[::2] = [re.sub(r"([*|]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


_FORMS = {
    "": _prose,
    "Parameters": _parameters,
    "Returns": _returns,
    "Raises": _raises,
    "Examples": _examples,
}

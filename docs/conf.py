"""Configuration of Sphinx, which builds the manual: `make docs`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

from trackprofile import __version__, errors

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

# The examples in docstrings run with the tests.
doctest_test_doctest_blocks = ""

default_role = "py:obj"
add_module_names = False
python_use_unqualified_type_names = True
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
_ALIASES = ("Array", "ArrayLike", "ComplexArray", "Indices", "NDArray", "PointTrack", "Progress")
autodoc_type_aliases = {name: name for name in (*_ALIASES, "Roughness", "Track")}

# Docstrings refer to objects without a page, such as NumPy's types and compiled kernels.
nitpick_ignore_regex = [("py:(class|obj|data)", r".*"), ("py:(mod|func)", r".*kernels.*")]


def setup(app: Sphinx) -> None:
    """Connect the functions of this file to Sphinx."""
    app.connect("autodoc-process-docstring", _numpy_docstring)
    app.connect("autodoc-process-signature", _short_signature)
    app.add_html_math_renderer("presentation", (_inline, None), (_display, None))


def _inline(writer: Any, node: Any) -> None:
    writer.body.append(_mathml(node.astext()))
    raise SkipNode


def _display(writer: Any, node: Any) -> None:
    writer.body.append(f'<div class="formula">{_mathml(node.astext(), as_block=True)}</div>')
    raise SkipNode


def _mathml(formula: str, *, as_block: bool = False) -> str:
    """A formula as MathML, which browsers lay out without scripts or fonts of the page."""
    # Without a mathematical font an accent would be drawn across its letter.
    return tex2mathml(formula, as_block=as_block).replace(' accent="true"', "")


def _numpy_docstring(
    app: Sphinx, what: str, name: str, it: object, options: object, lines: list
) -> None:
    """Convert a docstring with NumPy's sections, whose entries are ``name : meaning`` in one line."""
    sections = [*_sections(lines)]
    lines[:] = [line for title, body in sections for line in _FORMATS[title](body)]


def _short_signature(
    app: Sphinx, what: str, name: str, it: object, options: object,
    arguments: str | None, returned: str | None,
) -> tuple[str | None, str | None]:  # fmt: skip
    """Type aliases by their names, inside of other types too; no signature for objects that are not callable."""
    if arguments == "(*args, **kwargs)":
        return "", None
    return _alias_names(arguments), _alias_names(returned)


def _alias_names(text: str | None) -> str | None:
    return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def _sections(lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Titles and lines of the sections; the text before the first section has no title."""
    title, body = "", []
    for line in lines:
        if body and re.fullmatch("-{3,}", line) and body[-1] in _FORMATS:
            following = body.pop()
            yield title, body
            title, body = following, []
        else:
            body.append(line)
    yield title, body


def _prose(body: list[str]) -> list[str]:
    """Text, in which an indented paragraph, and TOML up to the end, is a literal block."""
    text: list[str] = []
    toml = next((n for n, line in enumerate(body) if re.match(r"\w+ = [\"\[{\d]", line)), len(body))
    for line in (*body[:toml], *(f"    {line}".rstrip() for line in body[toml:])):
        indented = line.startswith("    ")
        if indented and len(text) > 1 and not text[-1] and _begins_block(text[-2]):
            text += ["::", ""]
        text.append(line if indented else _escaped(line))
    return text


def _begins_block(previous: str) -> bool:
    return bool(previous) and not previous.startswith((" ", ".. ")) and not previous.endswith("::")


def _entries(body: list[str]) -> Iterator[tuple[str, str]]:
    """Names and meaning, from ``names : meaning`` or from a meaning that is indented below the names."""
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
    entries = [
        (", ".join(map(_exception, names.split(", "))), text) for names, text in _entries(body)
    ]
    return _field("Raises", entries)


def _exception(name: str) -> str:
    """Reference to an exception of the package; a built-in one as text."""
    return f":py:exc:`~trackprofile.errors.{name}`" if hasattr(errors, name) else f"``{name}``"


def _field(title: str, entries: list[tuple[str, str]]) -> list[str]:
    lines = [f"* {names}: {_escaped(text)}" for names, text in entries]
    return [f":{title}:", *(f"    {line}" for line in lines), ""]


def _returns(body: list[str]) -> list[str]:
    text = " ".join(line.strip() for line in body)
    return [":Returns:", f"    {_escaped(text)}", ""]


def _examples(body: list[str]) -> list[str]:
    return [".. rubric:: Example", "", *body]


def _escaped(line: str) -> str:
    """Stars, bars and trailing underscores outside of quotation escaped: they are no markup."""
    parts = re.split(r"((?::[a-z:]+:)?`+[^`]+`+)", line)
    parts[::2] = [re.sub(r"([*|]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
    # A quotation has to be separated from a letter or superscript that follows it.
    return "".join(
        "\\ " + part if number and number % 2 == 0 and part[:1].isalnum() else part
        for number, part in enumerate(parts)
    )


_FORMATS = {
    "": _prose,
    "Parameters": _parameters,
    "Returns": _returns,
    "Raises": _raises,
    "Examples": _examples,
}

"""Files of the web viewer: its own, those that it shares with the report, and the style sheet of the palette."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files

from trackprofile.contracts.identity import digest_bytes
from trackprofile.reporting.palette import palette_css

MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}

SHARED_FOLDERS = ("web", "vendor/uplot")
"""Folders of `trackprofile.reporting` that are served below ``shared/``."""

_TAG_DIGITS = 16


@dataclass(frozen=True)
class StaticFile:
    """One file as it is sent.

    Parameters
    ----------
    content : bytes of the file
    media_type : value of the header ``Content-Type``
    tag : value of the header ``ETag``; changes with the content
    """

    content: bytes
    media_type: str
    tag: str


def static_files() -> dict[str, StaticFile]:
    """All files by name; a request is looked up here, so that no path of the file system is ever built from it.

    Examples
    --------
    >>> static_files()["index.html"].media_type
    'text/html; charset=utf-8'
    >>> "shared/charts.js" in static_files()
    True
    """
    return {
        name: StaticFile(content, media_type, f'"{digest_bytes(content)[:_TAG_DIGITS]}"')
        for name, content in _contents()
        if (media_type := MEDIA_TYPES.get(name[name.rfind(".") :]))
    }


def _contents() -> Iterator[tuple[str, bytes]]:
    yield "shared/palette.css", palette_css().encode()
    for one in (files("trackprofile.server") / "static").iterdir():
        if one.is_file():
            yield one.name, one.read_bytes()
    for folder in SHARED_FOLDERS:
        for one in (files("trackprofile.reporting") / folder).iterdir():
            if one.is_file():
                yield f"shared/{one.name}", one.read_bytes()

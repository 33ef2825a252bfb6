"""The page's own files: read once, from this package alone."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.resources import files

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


@dataclass(frozen=True)
class File:
    """One file as it is sent.

    Parameters
    ----------
    content : all of it
    media_type : what it is
    tag : changes with the content
    """

    content: bytes
    media_type: str
    tag: str


def page_files() -> dict[str, File]:
    """All files by name. What is asked for is looked up here: no path of the file system is ever made of it.

    Examples
    --------
    >>> page_files()["index.html"].media_type
    'text/html; charset=utf-8'
    """
    found = {}
    for one in (files("trackprofile.server") / "static").iterdir():
        suffix = one.name[one.name.rfind(".") :]
        if suffix in TYPES:
            content = one.read_bytes()
            tag = f'"{hashlib.sha256(content).hexdigest()[:16]}"'
            found[one.name] = File(content, TYPES[suffix], tag)
    return found

"""A store: made once, opened ever after."""

from __future__ import annotations

import json
from dataclasses import dataclass

from trackprofile.errors import FileError
from trackprofile.store.layout import SCHEMA, STORE_FILE, UNFINISHED_PATH
from trackprofile.store.object_files import Files, files_at

HEAD = json.dumps({"schema": SCHEMA}).encode() + b"\n"
"""What a store's own file says."""


@dataclass(frozen=True)
class Store:
    """A store that is there.

    Parameters
    ----------
    url : as it was given
    files : what lies there
    """

    url: str
    files: Files


def create(url: str) -> Store:
    """A new store, or the one that is there already.

    Parameters
    ----------
    url : a folder of this machine, or a URL that fsspec knows, such as ``s3://bucket/passes``

    Raises
    ------
    FileError : something else is there, or it cannot be written.

    Examples
    --------
    >>> store = create("memory://example-of-create")
    >>> open_store("memory://example-of-create") == store
    True
    """
    files = files_at(str(url))
    if _stated(files) is None:
        if any(not UNFINISHED_PATH.fullmatch(one.path) for one in files.listing("")):
            raise FileError(f"{url}: the folder is no store and not empty; choose another.")
        files.put(STORE_FILE, HEAD)
    return open_store(url)


def open_store(url: str) -> Store:
    """The store that is there.

    Raises
    ------
    FileError : there is none, it is damaged, or of a newer schema.

    Examples
    --------
    >>> open_store("memory://nowhere")
    Traceback (most recent call last):
    trackprofile.errors.FileError: memory://nowhere: there is no store; check the place, ...
    """
    files = files_at(str(url))
    stated = _stated(files)
    if stated is None:
        raise FileError(
            f"{url}: there is no store; check the place, or begin one with trackprofile store add."
        )
    try:
        schema = json.loads(stated)["schema"]
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(
            f'{url}: {STORE_FILE} is damaged; it should say {{"schema": {SCHEMA}}}.'
        ) from error
    if not isinstance(schema, int) or schema < 1:
        raise FileError(f"{url}: {STORE_FILE} states schema {schema!r}; expected {SCHEMA}.")
    if schema > SCHEMA:
        raise FileError(
            f"{url}: a store of schema {schema}, this version knows up to {SCHEMA}; update trackprofile."
        )
    return Store(str(url), files)


def _stated(files: Files) -> bytes | None:
    try:
        return files.read(STORE_FILE)
    except (FileNotFoundError, NotADirectoryError):
        return None

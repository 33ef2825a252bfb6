"""Creating and opening a store."""

from __future__ import annotations

import json
from dataclasses import dataclass

from trackprofile.errors import FileError
from trackprofile.store.layout import SCHEMA, STORE_FILE, UNFINISHED_PATH
from trackprofile.store.object_files import Files, files_at


@dataclass(frozen=True)
class Store:
    """An existing store.

    Parameters
    ----------
    url : path or URL as it was given
    files : access to the files below it
    """

    url: str
    files: Files


def create(url: str) -> Store:
    """Create a store, or open the existing one.

    Parameters
    ----------
    url : a local folder, or a URL of a file system that fsspec supports, such as ``s3://bucket/passes``

    Raises
    ------
    FileError : the folder holds other files, or is not writable.

    Examples
    --------
    >>> store = create("memory://example-of-create")
    >>> open_store("memory://example-of-create") == store
    True
    """
    files = files_at(str(url))
    if _store_file(files) is None:
        if any(not UNFINISHED_PATH.fullmatch(one.path) for one in files.listing("")):
            raise FileError(f"{url}: the folder is not empty and not a store; choose another.")
        files.put(STORE_FILE, store_file_content(SCHEMA))
    return open_store(url)


def open_store(url: str) -> Store:
    """Open an existing store, of this schema or an earlier one.

    Raises
    ------
    FileError : there is no store at the URL, it is damaged, or its schema is newer.

    Examples
    --------
    >>> open_store("memory://nowhere")
    Traceback (most recent call last):
    trackprofile.errors.FileError: memory://nowhere: there is no store at this location; check it, ...
    """
    files = files_at(str(url))
    content = _store_file(files)
    if content is None:
        raise FileError(
            f"{url}: there is no store at this location; check it, or create a store with trackprofile store add."
        )
    try:
        schema = json.loads(content)["schema"]
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(
            f'{url}: {STORE_FILE} is damaged; its content should be {{"schema": {SCHEMA}}}.'
        ) from error
    if not isinstance(schema, int) or schema < 1:
        raise FileError(f"{url}: {STORE_FILE} has the schema {schema!r}; expected 1 to {SCHEMA}.")
    if schema > SCHEMA:
        raise FileError(
            f"{url}: the store has schema {schema}, this version reads schemas up to {SCHEMA}; update trackprofile."
        )
    return Store(str(url), files)


def store_file_content(schema: int) -> bytes:
    """Content of ``store.json``."""
    return json.dumps({"schema": schema}).encode() + b"\n"


def raise_schema(store: Store) -> None:
    """Set the schema of a store to that of this version, before the first entry of this schema is written.

    Earlier entries remain as they are; versions that know only the earlier schema then refuse the store.

    Raises
    ------
    FileError : the store is not writable.
    """
    if store.files.read(STORE_FILE) != store_file_content(SCHEMA):
        store.files.put(STORE_FILE, store_file_content(SCHEMA))


def _store_file(files: Files) -> bytes | None:
    try:
        return files.read(STORE_FILE)
    except (FileNotFoundError, NotADirectoryError):
        return None

"""File operations of a store, on a local folder or on any file system that fsspec supports.

A file appears under its name complete: locally it is written under a temporary name, flushed to the disk and renamed;
on an object store one put is atomic.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC
from pathlib import Path, PurePosixPath
from typing import IO, Any, Protocol

from trackprofile.errors import FileError
from trackprofile.io.atomic import whole_files

_MAX_ATTEMPTS = 5  # to create a folder that another process removes because it is empty


@dataclass(frozen=True)
class FileInfo:
    """A file in a listing.

    Parameters
    ----------
    path : path below the root, parts joined by ``/``
    size : [B]
    stamp : text that changes when the file is replaced
    modified : seconds since 1970, None if the file system does not provide it
    """

    path: str
    size: int
    stamp: str
    modified: float | None


class Files(Protocol):
    """Access to the files of a store; every path is below its root, its parts joined by ``/``."""

    def listing(self, folder: str) -> Iterator[FileInfo]: ...
    def read(self, path: str) -> bytes: ...
    def open(self, path: str) -> IO[bytes]: ...
    def put(self, path: str, content: bytes) -> None: ...
    def remove(self, path: str) -> None: ...
    def remove_empty_folders(self, before: float) -> None: ...


@dataclass(frozen=True)
class LocalFiles:
    """A local folder."""

    root: str

    def listing(self, folder: str) -> Iterator[FileInfo]:
        """All files below a folder, hidden ones included; none if the folder does not exist."""
        location = os.path.join(self.root, folder)
        try:
            with _read_errors(location):
                entries = sorted(os.scandir(location), key=lambda one: one.name)
        except (FileNotFoundError, NotADirectoryError):
            return
        for one in entries:
            path = f"{folder}/{one.name}" if folder else one.name
            if one.is_dir(follow_symlinks=False):
                yield from self.listing(path)
                continue
            try:
                stat = one.stat(follow_symlinks=False)
            except FileNotFoundError:  # removed since the scan
                continue
            yield FileInfo(path, stat.st_size, str(stat.st_mtime_ns), stat.st_mtime)

    def read(self, path: str) -> bytes:
        """Content of a file; FileNotFoundError if it does not exist."""
        with _read_errors(f"{self.root}/{path}"):
            return Path(self.root, path).read_bytes()

    def open(self, path: str) -> IO[bytes]:
        """Open a file for random access; FileNotFoundError if it does not exist."""
        with _read_errors(f"{self.root}/{path}"):
            return Path(self.root, path).open("rb")

    def put(self, path: str, content: bytes) -> None:
        """Write a file, replacing an existing one."""
        target = Path(self.root, path)
        for remaining in reversed(range(_MAX_ATTEMPTS)):
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                reason = error.strerror or error
                raise FileError(
                    f"{target.parent}: the folder cannot be created ({reason}); check its permissions."
                ) from error
            try:
                with whole_files(target) as (part,), part.open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                _sync_folder(target.parent)
                return
            except FileError:
                if target.parent.is_dir() or not remaining:
                    raise

    def remove(self, path: str) -> None:
        """Remove a file, if it exists."""
        Path(self.root, path).unlink(missing_ok=True)

    def remove_empty_folders(self, before: float) -> None:
        """Remove empty folders that were last changed before a time (seconds since 1970)."""
        for folder, _, _ in os.walk(self.root, topdown=False):
            if folder == self.root or os.stat(folder).st_mtime > before:
                continue
            if not os.listdir(folder):
                os.rmdir(folder)


@dataclass(frozen=True)
class RemoteFiles:
    """Files below a URL, through fsspec."""

    system: Any
    root: str

    def listing(self, folder: str) -> Iterator[FileInfo]:
        """All files below a folder; none if the folder does not exist."""
        self.system.invalidate_cache()
        with _read_errors(self._full_path(folder)):
            details = self.system.find(self._full_path(folder), detail=True)
        for path, detail in sorted(details.items()):
            modified = next(
                (detail[key] for key in _MODIFIED_KEYS if detail.get(key) is not None), None
            )
            yield FileInfo(
                str(PurePosixPath(path).relative_to(self.root)),
                int(detail.get("size") or 0),
                str(detail.get("ETag") or modified),
                _seconds(modified),
            )

    def read(self, path: str) -> bytes:
        """Content of a file; FileNotFoundError if it does not exist."""
        with _read_errors(self._full_path(path)):
            return self.system.cat_file(self._full_path(path))

    def open(self, path: str) -> IO[bytes]:
        """Open a file for random access; FileNotFoundError if it does not exist."""
        with _read_errors(self._full_path(path)):
            return self.system.open(self._full_path(path), "rb")

    def put(self, path: str, content: bytes) -> None:
        """Write a file, replacing an existing one."""
        full_path = self._full_path(path)
        try:
            self.system.makedirs(str(PurePosixPath(full_path).parent), exist_ok=True)
            self.system.pipe_file(full_path, content)
        except OSError as error:
            raise FileError(
                f"{full_path}: cannot be written ({error.strerror or error}); check its permissions."
            ) from error

    def remove(self, path: str) -> None:
        """Remove a file, if it exists."""
        if self.system.exists(self._full_path(path)):
            self.system.rm_file(self._full_path(path))

    def remove_empty_folders(self, before: float) -> None:
        """Do nothing: in object stores folders are parts of names, and elsewhere empty ones do no harm."""

    def _full_path(self, path: str) -> str:
        return f"{self.root}/{path}" if path else self.root


_MODIFIED_KEYS = ("mtime", "LastModified", "last_modified", "updated", "created")


def files_at(url: str) -> Files:
    """Files below a local path or a URL.

    Raises
    ------
    FileError : the URL's file system is unknown, or its library is not installed.
    """
    if not re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", url):
        return LocalFiles(os.path.abspath(url))
    if url.startswith("file://"):
        return LocalFiles(os.path.abspath(url.removeprefix("file://")))
    try:
        import fsspec
    except ImportError as error:
        raise FileError(
            f"{url}: a store that is not a local folder needs fsspec: pip install 'trackprofile[network]'."
        ) from error
    try:
        system, root = fsspec.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise FileError(
            f"{url}: no installed library supports this URL ({error}); install it, or correct the URL."
        ) from error
    return RemoteFiles(system, str(root).rstrip("/"))


@contextmanager
def _read_errors(path: str) -> Iterator[None]:
    """Turn errors of the system into `FileError`, except that of a missing file."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise FileError(
            f"{path}: cannot be read ({error.strerror or error}); check its permissions."
        ) from error


def _sync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, so that they survive a loss of power."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _seconds(modified: Any) -> float | None:
    """Seconds since 1970 of a file system's modification time."""
    if modified is None or isinstance(modified, str):
        return None
    if isinstance(modified, int | float):
        return float(modified)
    return (modified if modified.tzinfo else modified.replace(tzinfo=UTC)).timestamp()

"""The few things that a store asks of where it lies: a folder here, or anything that fsspec reaches.

A file appears under its name whole: here by writing beside it and renaming, after its bytes have reached the disk; on
an object store because a put is one step.
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

_TRIES = 5  # to make a folder that another removes because it is empty


@dataclass(frozen=True)
class FoundFile:
    """A file that a listing shows.

    Parameters
    ----------
    path : below the root, parts joined by ``/``
    size : [B]
    stamp : changes when the file is replaced
    modified : s since 1970, None where the place does not tell
    """

    path: str
    size: int
    stamp: str
    modified: float | None


class Files(Protocol):
    """Where a store lies; every path is below its root, its parts joined by ``/``."""

    def listing(self, folder: str) -> Iterator[FoundFile]: ...
    def read(self, path: str) -> bytes: ...
    def open(self, path: str) -> IO[bytes]: ...
    def put(self, path: str, content: bytes) -> None: ...
    def remove(self, path: str) -> None: ...
    def remove_empty_folders(self, before: float) -> None: ...


@dataclass(frozen=True)
class LocalFiles:
    """A folder of this machine."""

    root: str

    def listing(self, folder: str) -> Iterator[FoundFile]:
        """All files below a folder, hidden ones too; none where there is no such folder."""
        place = os.path.join(self.root, folder)
        try:
            with _told(place):
                entries = sorted(os.scandir(place), key=lambda one: one.name)
        except (FileNotFoundError, NotADirectoryError):
            return
        for one in entries:
            path = f"{folder}/{one.name}" if folder else one.name
            if one.is_dir(follow_symlinks=False):
                yield from self.listing(path)
                continue
            try:
                stat = one.stat(follow_symlinks=False)
            except FileNotFoundError:  # removed since
                continue
            yield FoundFile(path, stat.st_size, str(stat.st_mtime_ns), stat.st_mtime)

    def read(self, path: str) -> bytes:
        """Its content; FileNotFoundError where there is none."""
        with _told(f"{self.root}/{path}"):
            return Path(self.root, path).read_bytes()

    def open(self, path: str) -> IO[bytes]:
        """To read from, anywhere in it; FileNotFoundError where there is none."""
        with _told(f"{self.root}/{path}"):
            return Path(self.root, path).open("rb")

    def put(self, path: str, content: bytes) -> None:
        """Write a file, in the place of one of the same name if there is one."""
        target = Path(self.root, path)
        for left in reversed(range(_TRIES)):
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                reason = error.strerror or error
                raise FileError(f"{target.parent}: cannot be made ({reason}).") from error
            try:
                with whole_files(target) as (part,), part.open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                _sync_folder(target.parent)
                return
            except FileError:
                if target.parent.is_dir() or not left:
                    raise

    def remove(self, path: str) -> None:
        """Remove a file, if it is there."""
        Path(self.root, path).unlink(missing_ok=True)

    def remove_empty_folders(self, before: float) -> None:
        """Remove folders that hold nothing and were last changed before a time (s since 1970)."""
        for folder, _, _ in os.walk(self.root, topdown=False):
            if folder == self.root or os.stat(folder).st_mtime > before:
                continue
            if not os.listdir(folder):
                os.rmdir(folder)


@dataclass(frozen=True)
class RemoteFiles:
    """What stands below a URL; every call goes through fsspec."""

    system: Any
    root: str

    def listing(self, folder: str) -> Iterator[FoundFile]:
        """All files below a folder; none where there is no such folder."""
        self.system.invalidate_cache()
        with _told(self._whole(folder)):
            found = self.system.find(self._whole(folder), detail=True)
        for path, about in sorted(found.items()):
            modified = next((about[key] for key in _MODIFIED if about.get(key) is not None), None)
            yield FoundFile(
                str(PurePosixPath(path).relative_to(self.root)),
                int(about.get("size") or 0),
                str(about.get("ETag") or modified),
                _seconds(modified),
            )

    def read(self, path: str) -> bytes:
        """Its content; FileNotFoundError where there is none."""
        with _told(self._whole(path)):
            return self.system.cat_file(self._whole(path))

    def open(self, path: str) -> IO[bytes]:
        """To read from, anywhere in it; FileNotFoundError where there is none."""
        with _told(self._whole(path)):
            return self.system.open(self._whole(path), "rb")

    def put(self, path: str, content: bytes) -> None:
        """Write a file, in the place of one of the same name if there is one."""
        whole = self._whole(path)
        try:
            self.system.makedirs(str(PurePosixPath(whole).parent), exist_ok=True)
            self.system.pipe_file(whole, content)
        except OSError as error:
            raise FileError(
                f"{whole}: cannot be written ({error.strerror or error}); see that it may be."
            ) from error

    def remove(self, path: str) -> None:
        """Remove a file, if it is there."""
        if self.system.exists(self._whole(path)):
            self.system.rm_file(self._whole(path))

    def remove_empty_folders(self, before: float) -> None:
        """Nothing: where folders are more than a part of names, they do no harm."""

    def _whole(self, path: str) -> str:
        return f"{self.root}/{path}" if path else self.root


_MODIFIED = ("mtime", "LastModified", "last_modified", "updated", "created")


def files_at(url: str) -> Files:
    """The files at a path of this machine, or at a URL.

    Raises
    ------
    FileError : the libraries for such a URL are not there, or it is of an unknown kind.
    """
    if not re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", url):
        return LocalFiles(os.path.abspath(url))
    if url.startswith("file://"):
        return LocalFiles(os.path.abspath(url.removeprefix("file://")))
    try:
        import fsspec
    except ImportError as error:
        raise FileError(
            f"{url}: a store that is no local folder needs more: pip install 'trackprofile[network]'."
        ) from error
    try:
        system, root = fsspec.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise FileError(f"{url}: no library here reaches that ({error}).") from error
    return RemoteFiles(system, str(root).rstrip("/"))


@contextmanager
def _told(path: str) -> Iterator[None]:
    """What cannot be read though it is there is told as ours."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error}).") from error


def _sync_folder(folder: Path) -> None:
    """See that names in a folder outlast a loss of power."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _seconds(modified: Any) -> float | None:
    """s since 1970, of what a file system calls the time of a change."""
    if modified is None or isinstance(modified, str):
        return None
    if isinstance(modified, int | float):
        return float(modified)
    return (modified if modified.tzinfo else modified.replace(tzinfo=UTC)).timestamp()

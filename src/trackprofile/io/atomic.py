"""Output files are written completely or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trackprofile.errors import FileError


@contextmanager
def whole_files(*paths: str | Path) -> Iterator[tuple[Path, ...]]:
    """Temporary paths to write to, one per path; they are renamed to the paths only if nothing fails.

    They are in the same folders, so that renaming is one operation of the file system, and have the same suffix, for
    writers that choose the format by it.

    Raises
    ------
    FileError : a folder is missing or not writable, or the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with whole_files(folder / "profile.csv") as (file,):
    ...     _ = file.write_text("distance_m,elevation_m")
    >>> [file.name for file in folder.iterdir()]
    ['profile.csv']
    """
    targets = tuple(Path(path) for path in paths)
    check_writable(*targets)
    token = secrets.token_hex(4)
    parts = tuple(path.with_name(f".{path.stem}.{token}{path.suffix}") for path in targets)
    try:
        yield parts
        for part, target in zip(parts, targets, strict=True):
            os.replace(part, target)
    except OSError as error:
        names = ", ".join(map(str, targets))
        raise FileError(
            f"{names}: cannot be written ({error.strerror or error}); choose another folder, or free space."
        ) from error
    finally:
        for part in parts:
            part.unlink(missing_ok=True)


def check_writable(*paths: str | Path) -> None:
    """Check that files can be written to these paths, before a long computation.

    Raises
    ------
    FileError : a path is a folder, or its folder does not exist or is not writable.
    """
    for path in map(Path, paths):
        if path.is_dir():
            raise FileError(f"{path}: expected a file to write, got a folder; add a file name.")
        if not path.parent.is_dir():
            raise FileError(f"{path}: the folder {path.parent} does not exist; create it first.")
        if not os.access(path.parent, os.W_OK):
            raise FileError(
                f"{path}: the folder {path.parent} is not writable; choose another folder."
            )

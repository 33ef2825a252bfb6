"""Exceptions, by what the user has to correct.

Every message is one sentence: what is wrong, where, what is expected, what was read, and the remedy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


def printable(text: str) -> str:
    r"""Text with non-printable characters as escape sequences: names in a damaged file may contain any of them.

    Examples
    --------
    >>> print(printable("speed\n\x1b[2J"))
    speed\n\x1b[2J
    """
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


class TrackprofileError(ValueError):
    """Any error that this package raises for unusable input; the command line exits with code 1."""

    def __str__(self) -> str:
        return printable(super().__str__())


class DataError(TrackprofileError):
    """Measured data cannot be used: a recording, a profile, or the contents of a file."""


class RowError(DataError):
    """One row cannot be used; a reader replaces `variable` by its file and column.

    Parameters
    ----------
    variable : name of the variable, or of the column
    row : number of the row; 1 is the first row of data
    problem : what is expected, what was read, and the remedy
    """

    def __init__(self, variable: str, row: int, problem: str) -> None:
        super().__init__(variable, row, problem)
        self.variable, self.row, self.problem = variable, row, problem

    def __str__(self) -> str:
        return printable(f"{self.variable}, data row {self.row}: {self.problem}")


class UnitError(DataError):
    """A unit is unknown or of another dimension."""


class FileError(TrackprofileError):
    """A file is missing, unreadable, of an unknown format, or has a wrong key."""


class ModelError(TrackprofileError):
    """Parameters of a vehicle, track or sensor contradict each other."""


class UndeterminedError(TrackprofileError):
    """The data do not determine the requested quantity."""


class MissingExtraError(TrackprofileError):
    """A task needs a library that only an optional extra of this package installs."""


@contextmanager
def importing_extra(extra: str, task: str) -> Iterator[None]:
    """Turn the import error of an optional library into a sentence that names the extra.

    Parameters
    ----------
    extra : name of the extra in ``pyproject.toml``
    task : what needs the library, as the subject of a sentence

    Raises
    ------
    MissingExtraError : a library that is imported inside is not installed.

    Examples
    --------
    >>> with importing_extra("plot", "A PNG figure"):
    ...     import no_such_library
    Traceback (most recent call last):
    trackprofile.errors.MissingExtraError: A PNG figure needs the library no_such_library: pip install ...
    """
    try:
        yield
    except ModuleNotFoundError as error:
        library = (error.name or "").split(".")[0]
        if library in {"", "trackprofile"}:
            raise
        raise MissingExtraError(
            f"{task} needs the library {library}: pip install 'trackprofile[{extra}]'."
        ) from error

"""What can go wrong, by whose hands it can be mended.

Every message is one sentence: what, where, what was expected, what was found, what to do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


def printable(text: str) -> str:
    r"""A text with all that is no letter, sign or blank shown as its code: names in a damaged file may hold anything.

    Examples
    --------
    >>> print(printable("speed\n\x1b[2J"))
    speed\n\x1b[2J
    """
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


class TrackprofileError(ValueError):
    """Anything that this package refuses; the command line turns it into exit code 1."""

    def __str__(self) -> str:
        return printable(super().__str__())


class DataError(TrackprofileError):
    """What was measured cannot be used: a recording, a profile, the contents of a file."""


class RowError(DataError):
    """One row cannot be used; a reader puts its file and column in the place of `variable`.

    Parameters
    ----------
    variable : name of the variable, or of the column
    row : counted from 1, which is the first row of data
    problem : what was expected, what was found, what to do
    """

    def __init__(self, variable: str, row: int, problem: str) -> None:
        super().__init__(variable, row, problem)
        self.variable, self.row, self.problem = variable, row, problem

    def __str__(self) -> str:
        return printable(f"{self.variable}, data row {self.row}: {self.problem}")


class UnitError(DataError):
    """A unit is unknown or belongs to another quantity."""


class FileError(TrackprofileError):
    """A file is missing, unreadable, of an unknown format, or has a wrong key."""


class ModelError(TrackprofileError):
    """A vehicle, track or sensor contradicts itself or another."""


class UndeterminedError(TrackprofileError):
    """The data cannot tell what was asked of them."""


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

"""Folders and file names of a store.

``<table>/line=L/direction=D/day=YYYY-MM-DD/<entry>.parquet``: names of lines and directions are data and may hold any
characters; in a path everything but letters, digits and ``-._~`` is percent-encoded, as Hive and DuckDB expect.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from urllib.parse import quote

from trackprofile.assessment.tables import ASSESSMENT_TABLES
from trackprofile.errors import DataError

SCHEMA = 2
"""Schema that this version writes; it reads all earlier ones and refuses later ones.

Schema 1 identified a recording by the digest of its arrays, estimated positions included (`Origin.fingerprint` of
schema 2), and named three keys of an entry differently.
"""

PROFILES, OVERVIEWS, ENTRIES = "profiles", "overviews", "entries"
DATA = (PROFILES, OVERVIEWS, *ASSESSMENT_TABLES)
"""Folders in which every entry has one file."""

INDEX = "index"
"""Folder of the index, one file with all entries."""

STORE_FILE = "store.json"

_MAX_ENCODED_LENGTH = 200  # B of an encoded name: file systems allow 255

_PART = r"line=[^/]+/direction=[^/]+/day=\d{4}-\d{2}-\d{2}/"
_ID = r"[0-9a-f]{16}-[0-9a-f]{16}"
DATA_PATH = re.compile(rf"({'|'.join(DATA)})/{_PART}{_ID}\.parquet")
INDEX_PATH = re.compile(rf"{INDEX}/[0-9a-f]{{64}}\.parquet")
ENTRY_PATH = re.compile(rf"{ENTRIES}/{_PART}{_ID}\.json")
UNFINISHED_PATH = re.compile(
    rf"(\w+/{_PART}\.{_ID}|{INDEX}/\.[0-9a-f]{{64}}|\.store)\.[0-9a-f]{{8}}\.(parquet|json)"
)
"""Temporary name of a file that a writer has not finished, as `trackprofile.io.atomic` names it."""


@dataclass(frozen=True)
class PassKey:
    """What identifies a pass: the track and the time of the run.

    Parameters
    ----------
    line, direction : names, any characters
    day : day of the pass
    run : distinguishes the passes of a day, for example ``06:12`` or the train's number

    Raises
    ------
    DataError : a name is empty or too long, or the day is not a date.

    Examples
    --------
    >>> PassKey("Main / North", "up", date(2026, 5, 1)).folder("profiles")
    'profiles/line=Main%20%2F%20North/direction=up/day=2026-05-01'
    """

    line: str
    direction: str
    day: date
    run: str = ""

    def __post_init__(self) -> None:
        for what, name in (("line", self.line), ("direction", self.direction)):
            if not name:
                raise DataError(f"A pass needs the name of its {what}; give one.")
            if len(encoded(name, what)) > _MAX_ENCODED_LENGTH:
                raise DataError(
                    f"The name of the {what}, {name[:20]!r}..., takes more than {_MAX_ENCODED_LENGTH} bytes in a path; "
                    "shorten it."
                )
        encoded(self.run, "run")
        if type(self.day) is not date:  # a datetime is a date too
            raise DataError(
                f"A pass needs the date of its day, got {self.day!r}; give its time as the run."
            )

    def folder(self, table: str) -> str:
        """Folder of a table's files of this line, direction and day."""
        line, direction = encoded(self.line, "line"), encoded(self.direction, "direction")
        return f"{table}/line={line}/direction={direction}/day={self.day.isoformat()}"

    def path(self, table: str, entry: str) -> str:
        """Path of an entry's file of a table."""
        return f"{self.folder(table)}/{entry}.{'json' if table == ENTRIES else 'parquet'}"


def encoded(name: str, what: str = "name") -> str:
    """A name with percent-encoding, as in paths.

    Raises
    ------
    DataError : the name is not valid Unicode text.
    """
    try:
        return quote(name, safe="")
    except UnicodeEncodeError as error:
        raise DataError(
            f"The name of the {what}, {name!r}, is not valid Unicode text; correct it."
        ) from error

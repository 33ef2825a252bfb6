"""Where what stands in a store, and how a place is named in its paths.

``<table>/line=L/direction=D/day=YYYY-MM-DD/<entry>.parquet``: names of lines and directions are data, whatever
signs they are made of; in a path everything but letters, digits and ``-._~`` is percent-encoded, as Hive and
DuckDB read it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from urllib.parse import quote

from trackprofile.errors import DataError

SCHEMA = 1
"""Of what this version writes; it refuses stores of a newer one."""

PROFILES, OVERVIEWS, ENTRIES = "profiles", "overviews", "entries"
TABLES = ("defects", "sections", "not_assessed", "spectra")
"""Of an assessment, as of `trackprofile.assessment.tables`."""

DATA = (PROFILES, OVERVIEWS, *TABLES)
"""Of which every entry has one file each."""

INDEX = "index"
"""Of the entries gathered in one file."""

STORE_FILE = "store.json"

_LONGEST = 200  # B of an encoded name: file systems end at 255

_PART = r"line=[^/]+/direction=[^/]+/day=\d{4}-\d{2}-\d{2}/"
_ID = r"[0-9a-f]{16}-[0-9a-f]{16}"
DATA_PATH = re.compile(rf"({'|'.join(DATA)})/{_PART}{_ID}\.parquet")
INDEX_PATH = re.compile(rf"{INDEX}/[0-9a-f]{{64}}\.parquet")
ENTRY_PATH = re.compile(rf"{ENTRIES}/{_PART}{_ID}\.json")
UNFINISHED_PATH = re.compile(
    rf"(\w+/{_PART}\.{_ID}|{INDEX}/\.[0-9a-f]{{64}}|\.store)\.[0-9a-f]{{8}}\.(parquet|json)"
)
"""A file that a writer has not ended, as `trackprofile.io.atomic` names it."""


@dataclass(frozen=True)
class PassKey:
    """Which track was passed, and when.

    Parameters
    ----------
    line, direction : in words, any signs
    day : of the pass
    run : what tells it from the other passes of that day, such as ``06:12`` or the train's number

    Raises
    ------
    DataError : a name is empty or too long, or the day is none.

    Examples
    --------
    >>> Place("Main / North", "up", date(2026, 5, 1)).folder("profiles")
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
            if len(encoded(name, what)) > _LONGEST:
                raise DataError(
                    f"The {what}'s name {name[:20]!r}... takes more than {_LONGEST} bytes in a path; shorten it."
                )
        encoded(self.run, "run")
        if type(self.day) is not date:  # a datetime is one too
            raise DataError(
                f"A pass needs the day it was on, got {self.day!r}; its time is its run."
            )

    def folder(self, table: str) -> str:
        """Of a table's files of this place and day."""
        line, direction = encoded(self.line, "line"), encoded(self.direction, "direction")
        return f"{table}/line={line}/direction={direction}/day={self.day.isoformat()}"

    def path(self, table: str, entry: str) -> str:
        """Of an entry's file."""
        return f"{self.folder(table)}/{entry}.{'json' if table == ENTRIES else 'parquet'}"


def encoded(name: str, what: str = "name") -> str:
    """A name as it stands in a path.

    Raises
    ------
    DataError : it is no text, but half of a sign.
    """
    try:
        return quote(name, safe="")
    except UnicodeEncodeError as error:
        raise DataError(f"The {what}'s name {name!r} is no text; give it in Unicode.") from error

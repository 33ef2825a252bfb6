"""How a CSV file is written: its encoding, separator, decimal mark, and where its header and its numbers begin.

Loggers and spreadsheets agree on none of these. They are read off the beginning of the file: the separator and decimal
mark under which most cells are numbers, timestamps or empty; above them the last row of as many words is the header,
and one more row of words below that its units. What stands above is left aside.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from trackprofile.errors import FileError

HEADER_SIZE = 1 << 16
"""Bytes that tell how a file is written."""

SEPARATORS = (",", ";", "\t", "|", " ")
"""A blank stands for any number of blanks and tabs."""

MISSING = (
    "",
    "-",
    "--",
    "---",
    "*",
    "n/a",
    "N/A",
    "NA",
    "#N/A",
    "null",
    "NULL",
    "NaN",
    "nan",
    "NAN",
)
"""Words for a value that is not there."""

_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|Inf)"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?|[+-]?(inf|Inf)"),
}
_TIMESTAMP = re.compile(
    r"(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]*)?(\d{1,2}:\d{2}(:\d{2}([.,]\d*)?)?)?(Z|[+-]\d{2}:?\d{2})?"
)
_BOOLEAN = re.compile(r"true|false", re.IGNORECASE)
_UNIT = re.compile(r"(.*\S)\s*[\[(]([^\])]*)[\])]")


@dataclass(frozen=True)
class Dialect:
    """How one CSV file is written.

    Parameters
    ----------
    encoding : of its bytes, by Python's name
    separator : one of `SEPARATORS`
    decimal : "." or ","
    names : of its columns
    units : as the header states them, "" where it does not
    skipped : lines above the first row of data
    first : the first value in each column, "" where its beginning has none
    """

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    skipped: int
    first: tuple[str, ...]


def find_dialect(path: Path) -> Dialect:
    """How a CSV file is written.

    Raises
    ------
    FileError : nothing in it looks like a table.
    """
    with path.open("rb") as file:
        beginning = file.read(HEADER_SIZE)
    encoding = _encoding(beginning)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(beginning)
    if not text.strip():
        raise FileError(f"{path}: the file is empty; copy or export it again.")
    if "\0" in text:
        raise unreadable_table(path)
    lines = text.splitlines()
    if len(beginning) == HEADER_SIZE:
        lines = lines[:-1]  # cut short by the reading
    if max(map(len, lines), default=0) > csv.field_size_limit():
        raise unreadable_table(path)
    guesses = [
        (_score(rows, decimal), -number, rows, separator, decimal)
        for number, separator in enumerate(SEPARATORS)
        for rows in [_rows(lines, separator)]
        for decimal in (".", ",")
        if decimal != separator
    ]
    _, _, rows, separator, decimal = max(guesses, key=lambda one: (one[0], one[1]))
    header, first = _header(rows, decimal)
    names, units = _names(rows, header, first)
    if not all(name.isprintable() for name in names):
        raise unreadable_table(path)
    values = tuple(
        next((row[i] for row in rows[first:] if i < len(row) and row[i].strip() not in MISSING), "")
        for i in range(len(names))
    )
    return Dialect(encoding, separator, decimal, names, units, first, values)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number, a truth or empty.

    Examples
    --------
    >>> is_number("1,5", ","), is_number("noon", ",")
    (True, False)
    """
    kind = _kind(cell, decimal)
    return kind in {"number", "empty"} or _BOOLEAN.fullmatch(cell.strip()) is not None


def unreadable_table(path: Path) -> FileError:
    """What is said of a file that is none."""
    return FileError(f"{path}: not a readable CSV table; copy or export it again.")


def _encoding(beginning: bytes) -> str:
    """By its mark; else UTF-8 where it is that, else the usual one of old Windows programs."""
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if beginning.startswith(mark):
            return encoding
    try:
        codecs.getincrementaldecoder("utf-8")().decode(beginning)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _rows(lines: list[str], separator: str) -> list[list[str]]:
    """Cells of each line; a quoted cell does not go on over lines."""
    if separator == " ":
        return [line.split() for line in lines]
    return [next(csv.reader([line], delimiter=separator), []) for line in lines]


def _kind(cell: str, decimal: str) -> str:
    """What a cell holds: "number", "other" value (a time or a truth), "empty" or "word"."""
    cell = cell.strip()
    if cell in MISSING:
        return "empty"
    if _NUMBER[decimal].fullmatch(cell):
        return "number"
    return "other" if _TIMESTAMP.fullmatch(cell) or _BOOLEAN.fullmatch(cell) else "word"


def _score(rows: list[list[str]], decimal: str) -> tuple[float, int]:
    """How well this explains the file: the share of lines that are rows of values, and how many values they have."""
    width = _width(rows)
    kinds = [[_kind(cell, decimal) for cell in row] for row in rows if len(row) == width]
    values = sum(1 for row in kinds if "number" in row)
    words = sum(row.count("word") for row in kinds if "number" in row)
    if not values:
        return 0.0, 0
    return round((values - words / width) / len(rows), 1), width


def _width(rows: list[list[str]]) -> int:
    """How many cells most rows have."""
    counts = Counter(len(row) for row in rows if row)
    return max(counts, key=lambda width: (counts[width], width), default=0)


def _header(rows: list[list[str]], decimal: str) -> tuple[int | None, int]:
    """The row of the columns' names, if there is one, and the first row of values."""
    width = _width(rows)
    kinds = [[_kind(cell, decimal) for cell in row] for row in rows]

    def words(row: int) -> bool:
        return (
            len(rows[row]) == width
            and "number" not in kinds[row]
            and ("word" in kinds[row] or "other" in kinds[row])
        )

    first = next(
        (i for i, row in enumerate(kinds) if len(row) == width and "number" in row), len(rows)
    )
    # A cell that is damaged in the first row of values does not make it a header: that stands above.
    above = [i for i in range(first) if words(i)]
    if not above:
        return None, first
    if len(above) > 1 and above[-1] == above[-2] + 1 and _are_units(rows[above[-1]]):
        return above[-2], above[-1] + 1
    return above[-1], above[-1] + 1


def _are_units(row: list[str]) -> bool:
    return all(len(cell.strip(" []()")) <= 10 and " " not in cell.strip() for cell in row)


def _names(
    rows: list[list[str]], header: int | None, first: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns."""
    if header is None:
        count = _width(rows)
        return tuple(f"column {i}" for i in range(1, count + 1)), ("",) * count
    named = [cell.strip() for cell in rows[header]]
    below = rows[header + 1] if first > header + 1 else [""] * len(named)
    units = [cell.strip().strip("[]()") for cell in below]
    for i, name in enumerate(named):
        if not name:
            named[i] = f"column {i + 1}"
        elif not units[i] and (found := _UNIT.fullmatch(name)):
            units[i] = found[2].strip()
    return tuple(named), tuple(units)

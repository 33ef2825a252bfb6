"""Dialect of a CSV file: encoding, separator, decimal mark, and the rows of header and data.

Loggers and spreadsheets differ in all of these. They are determined from the beginning of the file: the separator and
decimal mark with which most cells are numbers, timestamps or empty. Above the data, the last row of text with as many
cells is the header, and a row of short texts directly below it holds the units. Rows above the header are ignored.
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
"""Bytes from which the dialect is determined."""

SEPARATORS = (",", ";", "\t", "|", " ")
"""Separators; a space stands for any number of spaces and tabs."""

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
"""Texts of a missing value."""

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
    """Dialect of one CSV file.

    Parameters
    ----------
    encoding : name of the encoding in Python
    separator : one of `SEPARATORS`
    decimal : "." or ","
    names : names of the columns
    units : units in the header; "": not stated
    skipped : number of lines above the first row of data
    first : first value of each column; "": none in the beginning of the file
    """

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    skipped: int
    first: tuple[str, ...]


def find_dialect(path: Path) -> Dialect:
    """Determine the dialect of a CSV file.

    Raises
    ------
    FileError : the file does not contain a table.
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
        lines = lines[:-1]  # the last line is incomplete
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
    """Whether a cell is a number, a boolean or empty.

    Examples
    --------
    >>> is_number("1,5", ","), is_number("noon", ",")
    (True, False)
    """
    kind = _kind(cell, decimal)
    return kind in {"number", "empty"} or _BOOLEAN.fullmatch(cell.strip()) is not None


def unreadable_table(path: Path) -> FileError:
    """Error for a file that is not a table."""
    return FileError(f"{path}: not a readable CSV table; copy or export it again.")


def _encoding(beginning: bytes) -> str:
    """Encoding by the byte order mark; without one UTF-8 if valid, else that of older Windows programs."""
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
    """Cells of each line; a quoted cell ends on its line."""
    if separator == " ":
        return [line.split() for line in lines]
    return [next(csv.reader([line], delimiter=separator), []) for line in lines]


def _kind(cell: str, decimal: str) -> str:
    """Kind of a cell: "number", "other" value (a time or a boolean), "empty" or "word"."""
    cell = cell.strip()
    if cell in MISSING:
        return "empty"
    if _NUMBER[decimal].fullmatch(cell):
        return "number"
    return "other" if _TIMESTAMP.fullmatch(cell) or _BOOLEAN.fullmatch(cell) else "word"


def _score(rows: list[list[str]], decimal: str) -> tuple[float, int]:
    """Score of a dialect: share of lines that are rows of values, and number of values in a row."""
    width = _width(rows)
    kinds = [[_kind(cell, decimal) for cell in row] for row in rows if len(row) == width]
    values = sum(1 for row in kinds if "number" in row)
    words = sum(row.count("word") for row in kinds if "number" in row)
    if not values:
        return 0.0, 0
    return round((values - words / width) / len(rows), 1), width


def _width(rows: list[list[str]]) -> int:
    """Most frequent number of cells in a row."""
    counts = Counter(len(row) for row in rows if row)
    return max(counts, key=lambda width: (counts[width], width), default=0)


def _header(rows: list[list[str]], decimal: str) -> tuple[int | None, int]:
    """Row of the column names, None if there is none, and first row of values."""
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
    # A damaged cell in the first row of values does not make that row a header: the header is above it.
    candidates = [i for i in range(first) if words(i)]
    if not candidates:
        return None, first
    if (
        len(candidates) > 1
        and candidates[-1] == candidates[-2] + 1
        and _are_units(rows[candidates[-1]])
    ):
        return candidates[-2], candidates[-1] + 1
    return candidates[-1], candidates[-1] + 1


def _are_units(row: list[str]) -> bool:
    return all(len(cell.strip(" []()")) <= 10 and " " not in cell.strip() for cell in row)


def _names(
    rows: list[list[str]], header: int | None, first: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns; unnamed columns are numbered."""
    if header is None:
        count = _width(rows)
        return tuple(f"column {i}" for i in range(1, count + 1)), ("",) * count
    named = [cell.strip() for cell in rows[header]]
    below = rows[header + 1] if first > header + 1 else [""] * len(named)
    units = [cell.strip().strip("[]()") for cell in below]
    for i, name in enumerate(named):
        if not name:
            named[i] = f"column {i + 1}"
        elif not units[i] and (match := _UNIT.fullmatch(name)):
            units[i] = match[2].strip()
    return tuple(named), tuple(units)

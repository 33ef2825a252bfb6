"""Conversion of times and dates that are text to seconds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
from numpy.typing import NDArray

from trackprofile.errors import RowError

Array = NDArray[np.float64]

pc: Any = (
    pyarrow.compute
)  # its functions are created on import, where type checkers do not see them

_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2})(?:[.,](?P<f>\d*))?"
_ZONE = r" ?(?:Z|(?P<zone>[+-]\d{2}):?(?P<quarter>\d{2})?)?"


def _date(first: str, second: str, third: str) -> str:
    parts = {"Y": r"(?P<Y>\d{4})", "M": r"(?P<M>\d{1,2})", "D": r"(?P<D>\d{1,2})"}
    return rf"^{parts[first]}[-./]{parts[second]}[-./]{parts[third]}(?: +|T){_CLOCK}{_ZONE}$"


TIMESTAMP_FORMS: Mapping[str, str] = {
    "Y-M-D": _date("Y", "M", "D"),
    "D.M.Y": _date("D", "M", "Y"),
    "M/D/Y": _date("M", "D", "Y"),
    "h:m:s": rf"^{_CLOCK}$",
}
"""Forms of a timestamp, given instead of a unit, and their patterns; any of - . / separates the numbers of a date."""

DAY = 86400.0  # s


def timestamp_form(text: str) -> str:
    """Form of a timestamp; "text" if it has none.

    A date with slashes is taken as month first, as in the United States, unless its first number exceeds 12.

    Examples
    --------
    >>> [timestamp_form(text) for text in ("2.3.2024 12:00:00", "2/3/2024 12:00:00", "13/3/2024 12:00:00", "noon")]
    ['D.M.Y', 'M/D/Y', 'D.M.Y', 'text']
    """
    text = text.strip()
    forms = [form for form, pattern in TIMESTAMP_FORMS.items() if re.match(pattern, text)]
    if "M/D/Y" in forms and "/" in text:
        return "M/D/Y" if int(text.split("/")[0]) <= 12 else "D.M.Y"
    return forms[0] if forms else "text"


def timestamp_seconds(path: Path, column: str, texts: NDArray[np.object_], form: str) -> Array:
    """Convert timestamps, (n,), to seconds since 1970, or since the first midnight; NaN where one is missing.

    Raises
    ------
    RowError : a text is not of that form.

    Examples
    --------
    >>> path = Path("a.csv")
    >>> timestamp_seconds(path, "t", np.array(["23:59:59,5", None, "0:00:00"], object), "h:m:s")
    array([86399.5,     nan, 86400. ])
    >>> timestamp_seconds(path, "t", np.array(["02.01.1970 01:00:00.25 +01"], object), "D.M.Y")
    array([86400.25])
    """
    stamps = pc.utf8_trim_whitespace(pa.array(texts, pa.string()))
    fields = pc.extract_regex(stamps, TIMESTAMP_FORMS[form])
    bad = (stamps.is_valid().to_numpy(False)) & ~fields.is_valid().to_numpy(False)
    if bad.any():
        row = int(np.argmax(bad))
        problem = f"expected a time as {form}, got {texts[row]!r}; correct it, or leave it empty."
        raise RowError(f"{path}: column {column!r}", row + 1, problem)
    part = {field.name: fields.field(field.name) for field in fields.type}
    h, m, s = (_integers(part[name]) for name in ("h", "m", "s"))
    fraction = pc.binary_join_element_wise("0.", part["f"], "0", "").cast(pa.float64())
    result = 3600.0 * h + 60.0 * m + s + fraction.to_numpy(zero_copy_only=False)
    if form != "h:m:s":
        months = 12 * (_integers(part["Y"]) - 1970) + _integers(part["M"]) - 1
        days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
        zone = _integers(part["zone"]) * 3600.0
        zone += np.where(zone < 0, -60.0, 60.0) * _integers(part["quarter"])
        result += DAY * (days + _integers(part["D"]) - 1) - zone
    result[~fields.is_valid().to_numpy(False)] = np.nan
    return result if form != "h:m:s" else _unwrap_midnight(result)


def _integers(texts: pa.Array) -> NDArray[np.int64]:
    """Integers; 0 where there is none."""
    signed = pc.replace_substring(texts, "+", "")
    filled = pc.if_else(pc.equal(pc.utf8_length(signed), 0), "0", signed)
    return np.asarray(pc.fill_null(filled, "0").cast(pa.int64()))


def _unwrap_midnight(times: Array) -> Array:
    """Times of day as increasing times: a day is added at each midnight."""
    known = np.isfinite(times)
    is_midnight = np.diff(times[known], prepend=times[known][:1]) < -DAY / 2
    times[known] += DAY * np.cumsum(is_midnight)
    return times

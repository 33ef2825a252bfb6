"""TOML documents that people write: read strictly, and written in the same layout.

The writer is not `tomli_w`: that puts each number of a matrix on a line of its own and a column with its unit into a
table of its own, and people read and correct the files that are written here.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar, TypeGuard, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from trackprofile.errors import FileError


class Strict(BaseModel):
    """A table with known keys only, values of the declared types, and finite numbers.

    ``renamed`` has keys of earlier versions, each with the key that takes its place; they are refused with that hint.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    renamed: ClassVar[Mapping[str, str]] = {}


Document = TypeVar("Document", bound=BaseModel)


def load(path: Path, model: type[Document]) -> Document:
    """Read a document from a file.

    Raises
    ------
    FileError : the file cannot be read, is not TOML, or has a missing, unknown or wrong key; the
        message names the first.
    """
    try:
        return parse(path.read_text(encoding="utf-8"), path, model)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not valid TOML: {error}.") from error


def parse(text: str, path: Path, model: type[Document]) -> Document:
    """Read a document from text; error messages name ``path``.

    Raises
    ------
    FileError : see `load`.
    """
    try:
        return checked(tomllib.loads(text), path, model)
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path}: not valid TOML: {error}.") from error


def checked(tables: Mapping[str, Any], path: Path, model: type[Document]) -> Document:
    """Check tables that were read already; error messages name ``path``.

    Raises
    ------
    FileError : see `load`.
    """
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        raise FileError(f"{path}: {_first_problem(error, model)}") from error


def toml_value(value: object) -> str:
    """A value in TOML: text, number, boolean, list, or a mapping as an inline table.

    Raises
    ------
    TypeError : TOML has no such type.

    Examples
    --------
    >>> toml_value({"column": "speed", "unit": "m/s"})
    '{ column = "speed", unit = "m/s" }'
    """
    if isinstance(value, Mapping):
        pairs = (f"{_key(key)} = {toml_value(one)}" for key, one in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, str):
        # JSON escapes as TOML does, except for the delete character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))  # the repr of a NumPy float would name its type
    if isinstance(value, int):
        return repr(value)
    raise TypeError(f"TOML has no type for {type(value).__name__}, got {value!r}")


def toml_text(table: Mapping[str, object]) -> str:
    """A whole document: mappings become tables, sequences of them arrays of tables; None is left out.

    Examples
    --------
    >>> print(toml_text({"name": "car", "source": None, "wheel": [{"mass": 1.0}]}), end="")
    name = "car"
    <BLANKLINE>
    [[wheel]]
    mass = 1.0
    """
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: Mapping[str, object], prefix: str) -> Iterator[str]:
    for key, value in table.items():
        if value is not None and not isinstance(value, Mapping) and not _is_tables(value):
            yield f"{_key(key)} = {toml_value(value)}"
    for key, value in table.items():
        name = prefix + _key(key)
        if isinstance(value, Mapping):
            # A table that holds only tables needs no header.
            if not value or not all(isinstance(one, Mapping) for one in value.values()):
                yield from ("", f"[{name}]")
            yield from _lines(value, name + ".")
        elif _is_tables(value):
            for one in value:
                yield from ("", f"[[{name}]]", *_lines(one, name + "."))


def _is_tables(value: object) -> TypeGuard[Sequence[Mapping[str, object]]]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return False
    return len(value) > 0 and all(isinstance(one, Mapping) for one in value)


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else toml_value(name)


def _first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    """A sentence on the first problem: what is wrong, where, and what is expected."""
    problems = error.errors()
    # An unknown key explains why another is missing, so it goes first.
    problem = next((one for one in problems if one["type"] == "extra_forbidden"), problems[0])
    *table, key = problem["loc"]
    where = f" in {_location(table)}" if table else ""
    if problem["type"] == "extra_forbidden":
        owner = _model_at(model, table)
        known = list(owner.model_fields)
        return (
            f"unknown key {key!r}{where}{_suggestion(str(key), owner)}; the keys of this table are "
            f"{', '.join(known)}."
        )
    if problem["type"] == "missing":
        return f"key {key!r} is missing{where}; add it."
    location = _location(problem["loc"])
    if problem["type"] == "model_type":
        known = list(_model_at(model, problem["loc"]).model_fields)
        return f"{location}: expected a table with the keys {', '.join(known)}."
    got = f", got {problem['input']!r}" if not isinstance(problem["input"], dict | list) else ""
    return f"{location}: {problem['msg'][0].lower()}{problem['msg'][1:]}{got}."


def _suggestion(key: str, model: type[BaseModel]) -> str:
    """The key that was probably meant, in parentheses."""
    if new := getattr(model, "renamed", {}).get(key):
        return f" (its name is now {new!r})"
    similar = get_close_matches(key, model.model_fields, n=1)
    return f" (did you mean {similar[0]!r}?)" if similar else ""


def _location(keys: Sequence[str | int]) -> str:
    """Location in a document, such as ``sensor 2.unit``; tables of an array count from 1.

    Examples
    --------
    >>> _location(["sensor", 1, "unit"])
    'sensor 2.unit'
    """
    text = ""
    for key in keys:
        text += f" {key + 1}" if isinstance(key, int) else f"{'.' if text else ''}{key}"
    return text


def _model_at(model: Any, location: Sequence[str | int]) -> type[BaseModel]:
    """Model of the table at a location."""
    keyed = False  # whether the next part is a key of a dict and not of a model
    for part in location:
        if isinstance(part, str) and not keyed:
            kind = model.model_fields[part].annotation
            keyed = get_origin(kind) is dict
            inner = (kind, *get_args(kind))
            model = next(
                one for one in inner if isinstance(one, type) and issubclass(one, BaseModel)
            )
        elif isinstance(part, str):
            keyed = False
    return model

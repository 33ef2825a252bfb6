"""What a person writes in TOML, read strictly, and written back."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from trackprofile.errors import FileError


class Strict(BaseModel):
    """A table whose every key is known, whose types fit, and whose numbers are finite."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


Document = TypeVar("Document", bound=BaseModel)


def load(path: Path, model: type[Document]) -> Document:
    """The document in a file.

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
    """The document in a text, which errors place at ``path``.

    Raises
    ------
    FileError : as of `load`.
    """
    try:
        return checked(tomllib.loads(text), path, model)
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path}: not valid TOML: {error}.") from error


def checked(tables: Mapping[str, Any], path: Path, model: type[Document]) -> Document:
    """The document in what was read already, which errors place at ``path``.

    Raises
    ------
    FileError : as of `load`.
    """
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        raise FileError(f"{path}: {_first_problem(error, model)}") from error


def written(value: object) -> str:
    """A value as TOML: text, number, truth, list, or a mapping as an inline table.

    Examples
    --------
    >>> written({"column": "speed", "unit": "m/s"})
    '{ column = "speed", unit = "m/s" }'
    """
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{_key(key)} = {written(one)}" for key, one in value.items()) + " }"
        )
    if isinstance(value, str):
        # JSON escapes as TOML does, but for the delete character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))  # NumPy's floats too, which repr would name
    if isinstance(value, int):
        return repr(value)
    raise TypeError(f"TOML knows no {type(value).__name__}, got {value!r}")


def document(table: Mapping[str, object]) -> str:
    """A whole document: mappings become tables, sequences of them lists of tables, None nothing.

    Examples
    --------
    >>> print(document({"name": "car", "source": None, "wheel": [{"mass": 1.0}]}), end="")
    name = "car"
    <BLANKLINE>
    [[wheel]]
    mass = 1.0
    """
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: Mapping[str, object], above: str) -> Iterator[str]:
    for key, value in table.items():
        if value is not None and not isinstance(value, Mapping) and not _is_tables(value):
            yield f"{_key(key)} = {written(value)}"
    for key, value in table.items():
        name = above + _key(key)
        if isinstance(value, Mapping):
            # A table of nothing but tables needs no head of its own.
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
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else written(name)


def _first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    problems = error.errors()
    # An unknown key explains why another is missing, so it goes first.
    problem = next((one for one in problems if one["type"] == "extra_forbidden"), problems[0])
    *above, key = problem["loc"]
    where = f" in {_place(above)}" if above else ""
    if problem["type"] == "extra_forbidden":
        known = _keys(model, above)
        return f"unknown key {key!r}{where}; the keys there are {', '.join(known)}."
    if problem["type"] == "missing":
        return f"key {key!r} is missing{where}; add it."
    if problem["type"] == "model_type":
        known = _keys(model, problem["loc"])
        return f"{_place(problem['loc'])}: expected a table with the keys {', '.join(known)}."
    got = f", got {problem['input']!r}" if not isinstance(problem["input"], dict | list) else ""
    return f"{_place(problem['loc'])}: {problem['msg'][0].lower()}{problem['msg'][1:]}{got}."


def _place(location: Sequence[str | int]) -> str:
    """Such as ``[sensor 2] unit``: tables of a list count from 1."""
    text = ""
    for part in location:
        text += f" {part + 1}" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


def _keys(model: Any, location: Sequence[str | int]) -> list[str]:
    keyed = False  # whether the next part is a key of a dict, not of a model
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
    return list(model.model_fields)

"""An entry of the catalogue: what was stored of a pass, from what, by what, and how to know its files again.

Nothing in it depends on when or by whom it was written: the same pass gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from datetime import date
from typing import Any

import numpy as np

from trackprofile import __version__
from trackprofile.assessment.limits import Action
from trackprofile.errors import DataError, FileError
from trackprofile.store.layout import DATA, ENTRIES, SCHEMA, PassKey

_CHECKSUM = "checksum"


@dataclass(frozen=True)
class Origin:
    """What a stored pass was made from, and how.

    Parameters
    ----------
    recording : its identity, as of `trackprofile.contracts.recording_identity`, 64 hexadecimal digits
    source : where it was read from, for people; it tells no two passes apart
    vehicle, method, track, prior, limits : in words
    speed : of the line, that limits were taken for [m/s]
    settings : a digest of all that the words do not say, such as the parameters of the vehicle
    software : version that made it
    revision : the greatest is the one to show, where a recording was stored more than once

    Raises
    ------
    DataError : the recording's hash is none.
    """

    recording: str
    source: str = ""
    vehicle: str = ""
    method: str = ""
    track: str = ""
    prior: str = ""
    limits: str = ""
    speed: float = 0.0
    settings: str = ""
    software: str = __version__
    revision: int = 0

    def __post_init__(self) -> None:
        if not re.fullmatch("[0-9a-f]{64}", self.recording):
            raise DataError(
                f"Expected the SHA-256 of a recording in 64 hexadecimal digits, got {self.recording!r}."
            )

    @property
    def version(self) -> str:
        """16 hexadecimal digits, the same for all that was made in one way."""
        made = {name: value for name, value in asdict(self).items() if name not in _NOT_HOW}
        return _digest(made)[:16]


_NOT_HOW = ("recording", "source")


@dataclass(frozen=True)
class StoredFile:
    """How to know a file again.

    Parameters
    ----------
    size : [B]
    sha256 : of its bytes, in hexadecimal digits
    """

    size: int
    sha256: str


@dataclass(frozen=True)
class Entry:
    """One pass in the store.

    Parameters
    ----------
    id : 16 digits of the recording's hash, a dash, 16 of how and in which run
    place, origin : what it is of, and what it was made from
    kind : of the profile, one of `trackprofile.contracts.KINDS`
    start, end, points : of the profile [m, m, -]
    known : share of its points that are not in a gap
    deviations : per band, the median of the standard deviation [m]; without those not stated
    defects : how many are likely beyond the limit of which action, by its words
    notes : of the assessment, in sentences
    files : per table, its file
    """

    id: str
    place: PassKey
    origin: Origin
    kind: str
    start: float
    end: float
    points: int
    known: float
    deviations: Mapping[str, float]
    defects: Mapping[str, int]
    notes: tuple[str, ...]
    files: Mapping[str, StoredFile]

    @property
    def line(self) -> str:
        """Of its place."""
        return self.place.line

    @property
    def direction(self) -> str:
        """Of its place."""
        return self.place.direction

    @property
    def day(self) -> date:
        """Of its place."""
        return self.place.day

    @property
    def run(self) -> str:
        """Of its place."""
        return self.place.run

    @property
    def paths(self) -> dict[str, str]:
        """Of its data files, to the table each is of."""
        return {self.path(table): table for table in self.files}

    def path(self, table: str) -> str:
        """Of its file of a table, below the store's root."""
        return self.place.path(table, self.id)


def entry_id(place: PassKey, origin: Origin) -> str:
    """What an entry is called, before it is made.

    Examples
    --------
    >>> place = Place("Main", "up", date(2026, 5, 1))
    >>> one, other = (entry_id(place, Origin(64 * "a", revision=number)) for number in (0, 1))
    >>> one[:17] == other[:17] == 16 * "a" + "-", one == other
    (True, False)
    """
    return f"{origin.recording[:16]}-{_digest([origin.version, place.run])[:16]}"


def digest(**given: object) -> str:
    """16 hexadecimal digits of everything that a result was made with: parameters, settings, arrays.

    Examples
    --------
    >>> one, same, other = (digest(speed=v, at=np.arange(n)) for v, n in ((1.0, 3), (1.0, 3), (1.0, 4)))
    >>> len(one), one == same, one == other
    (16, True, False)
    """
    return _digest(_plain(given))[:16]


def document(entry: Entry) -> bytes:
    """An entry as JSON, the same bytes for the same entry."""
    body = {"schema": SCHEMA, **asdict(entry)}
    body["place"]["day"] = entry.day.isoformat()
    return _canonical(body | {_CHECKSUM: _digest(body)}) + b"\n"


def parsed(content: bytes, path: str) -> Entry:
    """The entry in a file.

    Parameters
    ----------
    path : of the file, for messages

    Raises
    ------
    FileError : it is damaged, or of a newer schema.
    """
    try:
        body = json.loads(content)
        whole = body.pop(_CHECKSUM) == _digest(body)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise FileError(
            f"{path}: no whole entry; see what trackprofile store verify says."
        ) from error
    if not whole:
        raise FileError(f"{path}: the entry was changed; see what trackprofile store verify says.")
    if not isinstance(body.get("schema"), int) or body["schema"] > SCHEMA:
        raise FileError(
            f"{path}: an entry of schema {body.get('schema')!r}, this version knows up to {SCHEMA}; update it."
        )
    try:
        entry = _entry(body)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileError(f"{path}: not an entry as this version knows it ({error}).") from error
    if entry.path(ENTRIES) != path or set(entry.files) != set(DATA):
        raise FileError(
            f"{path}: the entry does not belong there; remove it, and add the pass again."
        )
    return entry


def _entry(body: Mapping[str, Any]) -> Entry:
    place = body["place"]
    return Entry(
        id=body["id"],
        place=PassKey(
            place["line"], place["direction"], date.fromisoformat(place["day"]), place["run"]
        ),
        origin=Origin(**body["origin"]),
        kind=body["kind"],
        start=float(body["start"]),
        end=float(body["end"]),
        points=int(body["points"]),
        known=float(body["known"]),
        deviations=dict(body["deviations"]),
        defects={one.words: int(body["defects"][one.words]) for one in Action},
        notes=tuple(body["notes"]),
        files={name: StoredFile(**one) for name, one in body["files"].items()},
    )


def file_checksum(content: bytes) -> StoredFile:
    """How to know a file's content again."""
    return StoredFile(len(content), hashlib.sha256(content).hexdigest())


def _plain(value: Any) -> Any:
    """As JSON can hold it."""
    if is_dataclass(value) and not isinstance(value, type):
        return [
            type(value).__name__,
            {one.name: _plain(getattr(value, one.name)) for one in fields(value)},
        ]
    if isinstance(value, np.ndarray | np.generic):
        return [value.dtype.str, _plain(value.tolist())]
    if isinstance(value, Mapping):
        return [[_plain(key), _plain(one)] for key, one in value.items()]
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return repr(value)


def _canonical(value: Any) -> bytes:
    said = json.dumps(
        value, ensure_ascii=True, allow_nan=False, sort_keys=True, separators=(",", ":")
    )
    return said.encode("ascii")


def _digest(value: Any) -> str:
    return hashlib.sha256(_canonical(value)).hexdigest()

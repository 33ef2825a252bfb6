"""Entries of the catalogue: one small JSON document per pass, with its origin and the checksums of its files.

An entry does not depend on when or by whom it was written: the same pass gives the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import KW_ONLY, asdict, dataclass
from datetime import date
from typing import Any

from trackprofile import __version__
from trackprofile.assessment.limits import Action
from trackprofile.contracts.identity import canonical_json, digest, digest_bytes, is_digest
from trackprofile.errors import DataError, FileError
from trackprofile.store.layout import DATA, ENTRIES, SCHEMA, PassKey

_CHECKSUM = "checksum"
_SHORT_DIGEST = 16  # hexadecimal digits
_NAMES_OF_SCHEMA_1 = {
    "key": "place",
    "known_share": "known",
    "standard_deviations": "deviations",
}


@dataclass(frozen=True)
class Origin:
    """Recording that a stored pass was computed from, and how.

    Parameters
    ----------
    recording : identity of the recording, as in `trackprofile.contracts.recording_identity`, 64 hexadecimal digits
    source : name of the file it was read from, for information; it does not distinguish passes
    vehicle, method, track, prior, limits : names
    speed : line speed of the limits [m/s]
    settings : digest of all settings that the names do not determine, such as the parameters of the vehicle
    software : version that computed the pass
    revision : the largest revision of a recording is the current one
    fingerprint : identity of the same recording in stores of schema 1, as in
        `trackprofile.contracts.legacy_fingerprint`; empty where it is unknown

    Raises
    ------
    DataError : the identity or the fingerprint is not a digest.
    """

    recording: str
    _: KW_ONLY
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
    fingerprint: str = ""

    def __post_init__(self) -> None:
        identities = [self.recording, *([self.fingerprint] if self.fingerprint else [])]
        for identity in identities:
            if not is_digest(identity):
                raise DataError(
                    f"Identity of a recording: expected a SHA-256 in 64 hexadecimal digits, got {identity!r}; give "
                    "the profile as infer wrote it."
                )

    @property
    def version(self) -> str:
        """16 hexadecimal digits, equal for all passes that were computed in the same way."""
        settings = {
            name: value for name, value in asdict(self).items() if name not in _RECORDING_FIELDS
        }
        return digest(settings)[:_SHORT_DIGEST]

    @property
    def identities(self) -> frozenset[str]:
        """All known identities of the recording; two passes are of one recording if they have one in common."""
        return frozenset({self.recording, self.fingerprint or self.recording})


_RECORDING_FIELDS = ("recording", "source", "fingerprint")


@dataclass(frozen=True)
class StoredFile:
    """Checksum of a file.

    Parameters
    ----------
    size : [B]
    sha256 : SHA-256 of the bytes, in hexadecimal digits
    """

    size: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One pass in the store.

    Parameters
    ----------
    id : 16 digits of the recording's identity, a hyphen, and 16 digits of the origin and the run
    key, origin : line, direction, day and run; and what the pass was computed from
    kind : kind of the profile, one of `trackprofile.contracts.KINDS`
    start, end, points : ends of the profile [m], and its number of points
    known_share : share of its points that are not in a gap
    standard_deviations : median of the standard deviation, by band [m]; without bands that state none
    defects : number of defects that probably exceed the limit of an action, by the action's name
    notes : notes of the assessment, in sentences
    files : checksum of the file of each table
    schema : schema of the entry's document
    """

    id: str
    key: PassKey
    origin: Origin
    kind: str
    start: float
    end: float
    points: int
    known_share: float
    standard_deviations: Mapping[str, float]
    defects: Mapping[str, int]
    notes: tuple[str, ...]
    files: Mapping[str, StoredFile]
    schema: int = SCHEMA

    @property
    def line(self) -> str:
        """Name of the line."""
        return self.key.line

    @property
    def direction(self) -> str:
        """Name of the direction."""
        return self.key.direction

    @property
    def day(self) -> date:
        """Day of the pass."""
        return self.key.day

    @property
    def run(self) -> str:
        """Name of the run."""
        return self.key.run

    @property
    def paths(self) -> dict[str, str]:
        """Table of each data file, by its path."""
        return {self.path(table): table for table in self.files}

    def path(self, table: str) -> str:
        """Path of the file of a table, below the store's root."""
        return self.key.path(table, self.id)


def entry_id(key: PassKey, origin: Origin) -> str:
    """Identifier of the entry of a pass; it is known before the pass is computed.

    Examples
    --------
    >>> key = PassKey("Main", "up", date(2026, 5, 1))
    >>> first, second = (entry_id(key, Origin(64 * "a", revision=number)) for number in (0, 1))
    >>> first[:17] == second[:17] == 16 * "a" + "-", first == second
    (True, False)
    """
    version = digest([origin.version, key.run])
    return f"{origin.recording[:_SHORT_DIGEST]}-{version[:_SHORT_DIGEST]}"


def entry_document(entry: Entry) -> bytes:
    """An entry as JSON of the current schema; equal entries give equal bytes."""
    body: dict[str, Any] = asdict(entry) | {"schema": SCHEMA}
    body["key"]["day"] = entry.day.isoformat()
    return canonical_json(body | {_CHECKSUM: digest(body)}) + b"\n"


def parse_entry(content: bytes, path: str) -> Entry:
    """Parse an entry's document, of the current schema or an earlier one.

    Parameters
    ----------
    content : the document
    path : path of the file below the store's root

    Raises
    ------
    FileError : the document is damaged, of a newer schema, or belongs to another path.
    """
    try:
        body = json.loads(content)
        intact = body.pop(_CHECKSUM) == digest(body)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise FileError(
            f"{path}: the entry is incomplete; run trackprofile store verify."
        ) from error
    if not intact:
        raise FileError(
            f"{path}: the entry does not match its checksum; run trackprofile store verify."
        )
    if not isinstance(body.get("schema"), int) or body["schema"] > SCHEMA:
        raise FileError(
            f"{path}: the entry has schema {body.get('schema')!r}, this version reads schemas up to {SCHEMA}; update "
            "trackprofile."
        )
    try:
        entry = _entry(body)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileError(
            f"{path}: the entry does not have the expected content ({error}); remove it, and add the pass again."
        ) from error
    if entry.path(ENTRIES) != path or set(entry.files) != set(DATA):
        raise FileError(
            f"{path}: the entry does not belong at this path; remove it, and add the pass again."
        )
    return entry


def _entry(body: dict[str, Any]) -> Entry:
    if body["schema"] == 1:
        body = body | {name: body[old] for name, old in _NAMES_OF_SCHEMA_1.items()}
    key = body["key"]
    return Entry(
        id=body["id"],
        key=PassKey(key["line"], key["direction"], date.fromisoformat(key["day"]), key["run"]),
        origin=Origin(**body["origin"]),
        kind=body["kind"],
        start=float(body["start"]),
        end=float(body["end"]),
        points=int(body["points"]),
        known_share=float(body["known_share"]),
        standard_deviations=dict(body["standard_deviations"]),
        defects={one.text: int(body["defects"][one.text]) for one in Action},
        notes=tuple(body["notes"]),
        files={name: StoredFile(**one) for name, one in body["files"].items()},
        schema=body["schema"],
    )


def file_checksum(content: bytes) -> StoredFile:
    """Checksum of a file's content."""
    return StoredFile(len(content), digest_bytes(content))

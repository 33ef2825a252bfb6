"""Digests of content: the one scheme by which recordings, settings, results and files are identified.

A digest is the SHA-256 of a canonical form, as 64 hexadecimal digits. Plain values have canonical JSON (keys sorted, no
spaces, ASCII, floats with the fewest digits that round-trip); arrays enter it by the digest of their little-endian
bytes. The same values have the same digest in every process, on every platform and with every library version.

The identity of a recording is the digest of its raw content and of the description given with it, taken before anything
is estimated from it. The reader puts it in the attribute ``identity`` (see `trackprofile.io.recording_identity`). A
recording that was built from arrays has no such attribute; the digest of its arrays is its identity.

Versions before the attribute existed used the digest of the arrays for every recording, estimated positions included.
`legacy_fingerprint` gives that digest, by which a store recognises a pass that one of those versions stored.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.errors import DataError

IDENTITY = "identity"
"""Attribute of a recording: the digest that identifies it, 64 hexadecimal digits."""

RECORDING = "recording"
"""Attribute of a profile: the identity of the recording that it was inferred from."""

RECORDING_FINGERPRINT = "recording_fingerprint"
"""Attribute of a profile: the recording's `legacy_fingerprint`, by which a store finds what earlier versions stored."""

_CHUNK = 1 << 18
"""Values of an array that are hashed at a time."""

_DIGEST = re.compile("[0-9a-f]{64}")


def is_digest(value: object) -> bool:
    """Whether a value is text of 64 hexadecimal digits.

    Examples
    --------
    >>> is_digest(64 * "a"), is_digest("a")
    (True, False)
    """
    return isinstance(value, str) and _DIGEST.fullmatch(value) is not None


def digest(value: object) -> str:
    """Digest of a value: plain data, a dataclass, an array, or any nesting of these.

    Parameters
    ----------
    value : None, bool, int, float, str, date, enumeration, NumPy scalar or array, dataclass, mapping, list, tuple, set

    Returns
    -------
    SHA-256 of `canonical_json`, 64 hexadecimal digits

    Raises
    ------
    TypeError : a value of another type has no canonical form.

    Examples
    --------
    >>> digest({"speed": 1.0, "at": np.arange(3)}) == digest({"at": np.arange(3), "speed": 1.0})
    True
    >>> digest({"speed": 1.0}) == digest({"speed": 2.0})
    False
    """
    return digest_bytes(canonical_json(value))


def digest_bytes(content: bytes) -> str:
    """Digest of bytes, such as a file's content.

    Examples
    --------
    >>> digest_bytes(b"")[:8]
    'e3b0c442'
    """
    return hashlib.sha256(content).hexdigest()


def digest_array(values: NDArray[Any]) -> str:
    """Digest of an array: its type, its shape and its values, little-endian; all NaN count as one value.

    Parameters
    ----------
    values : numbers, booleans, dates or text, of any shape; None among text is a missing value

    Examples
    --------
    >>> digest_array(np.array([1.0, 2.0])) == digest_array(np.array([1.0, 2.0], ">f8"))
    True
    """
    is_text = values.dtype.kind in "OUST"
    kind = "text" if is_text else values.dtype.newbyteorder("<").str
    checksum = hashlib.sha256(canonical_json([kind, list(values.shape)]))
    flat = values.reshape(-1)
    for start in range(0, flat.size, _CHUNK):
        chunk = flat[start : start + _CHUNK]
        checksum.update(_text_bytes(chunk) if is_text else _number_bytes(chunk))
    return checksum.hexdigest()


def canonical_json(value: object) -> bytes:
    """Canonical JSON of a value, as `digest` hashes it.

    Raises
    ------
    TypeError : a value has no canonical form.

    Examples
    --------
    >>> canonical_json({"b": (1, 2.5), "a": None})
    b'{"a":null,"b":[1,2.5]}'
    """
    return json.dumps(
        _plain(value), ensure_ascii=True, allow_nan=False, sort_keys=True, separators=(",", ":")
    ).encode("ascii")


def content_digest(dataset: xr.Dataset) -> str:
    """Digest of a dataset's variables; its attributes make no difference.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> one, other = (build_profile([0, 1], [0, end], kind="truth") for end in (1e-3, 2e-3))
    >>> content_digest(one) == content_digest(one.assign_attrs(method="levelling"))
    True
    >>> content_digest(one) == content_digest(other)
    False
    """
    checksum = hashlib.sha256()
    for name, variable in sorted(dataset.variables.items(), key=lambda item: str(item[0])):
        values = np.ascontiguousarray(variable.to_numpy())
        values = values.astype(values.dtype.newbyteorder("<"), copy=False)
        checksum.update(json.dumps([str(name), values.dtype.str, values.shape]).encode())
        checksum.update(values.data)
    return checksum.hexdigest()


def legacy_fingerprint(recording: xr.Dataset) -> str:
    """Identity that versions without the attribute ``identity`` gave a recording: its `content_digest`."""
    return content_digest(recording)


def recording_identity(recording: xr.Dataset) -> str:
    """Identity of a recording: its attribute ``identity``, or its `content_digest` where it has none.

    Raises
    ------
    DataError : the attribute is not a digest.

    Examples
    --------
    >>> from trackprofile.contracts import Channel, build_recording
    >>> floor = Channel("floor", [0.0, 0.1, 0.0], "vertical acceleration", "body", 6.9)
    >>> recording = build_recording([floor], time=[0.0, 0.1, 0.2], speed=[20.0, 20.0, 20.0])
    >>> recording_identity(recording) == content_digest(recording)
    True
    >>> recording_identity(recording.assign_attrs(identity=64 * "a"))[:8]
    'aaaaaaaa'
    """
    check_identity(recording)
    return str(recording.attrs.get(IDENTITY) or content_digest(recording))


def check_identity(recording: xr.Dataset) -> None:
    """Refuse an attribute ``identity`` that is not a digest.

    Raises
    ------
    DataError : it is not.
    """
    value = recording.attrs.get(IDENTITY)
    if value is not None and not is_digest(value):
        raise DataError(
            f"Recording, attribute {IDENTITY}: expected 64 hexadecimal digits, got {value!r}; remove the attribute."
        )


def stretch_identity(identity: str, from_m: float | None, to_m: float | None) -> str:
    """Identity of a recording that is restricted to a stretch of track.

    It depends on the requested stretch and not on the samples inside it, because which samples these are depends on
    estimated positions.

    Parameters
    ----------
    identity : of the whole recording
    from_m, to_m : ends of the stretch [m]; None or infinite: open

    Returns
    -------
    digest of the three; ``identity`` itself where both ends are open

    Examples
    --------
    >>> whole = 64 * "a"
    >>> stretch_identity(whole, None, None) == whole, stretch_identity(whole, 0.0, None) == whole
    (True, False)
    """
    ends = [None if end is None or math.isinf(end) else float(end) for end in (from_m, to_m)]
    if ends == [None, None]:
        return identity
    return digest({"recording": identity, "from_m": ends[0], "to_m": ends[1]})


def _plain(value: Any) -> Any:
    """A value in the types of JSON; what JSON lacks becomes an object with one key that begins with "$"."""
    if isinstance(value, Enum):
        return {"$enum": [type(value).__name__, _plain(value.value)]}
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else {"$float": str(value)}
    if isinstance(value, date):
        return {"$date": value.isoformat()}
    if isinstance(value, np.ndarray):
        return {"$array": digest_array(value)}
    if is_dataclass(value) and not isinstance(value, type):
        members = {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
        return {"$dataclass": [type(value).__name__, members]}
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {str(key): _plain(one) for key, one in value.items()}
        return {"$mapping": sorted(_pairs(value), key=canonical_json)}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, set | frozenset):
        return {"$set": sorted(map(_plain, value), key=canonical_json)}
    raise TypeError(f"No canonical form of {type(value).__name__}, got {value!r}")


def _pairs(mapping: Mapping[Any, Any]) -> Iterator[list[Any]]:
    yield from ([_plain(key), _plain(value)] for key, value in mapping.items())


def _number_bytes(values: NDArray[Any]) -> memoryview:
    """Little-endian bytes of numbers, every NaN as the same one."""
    little_endian = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    if little_endian.dtype.kind == "f" and (missing := np.isnan(little_endian)).any():
        little_endian = np.where(missing, little_endian.dtype.type(np.nan), little_endian)
    return little_endian.view(np.uint8).data


def _text_bytes(texts: NDArray[Any]) -> bytes:
    """Each text as its length in bytes, a colon and its UTF-8; a missing one as a hyphen."""
    encoded = (None if text is None else str(text).encode() for text in texts)
    return b"".join(b"-" if text is None else b"%d:%b" % (len(text), text) for text in encoded)

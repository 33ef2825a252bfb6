"""Identity of a recording in a file: the digest of its raw content and of its description.

The raw content is every column that the description names, as the file holds it: before units are converted, clocks
are repaired and positions are estimated. The description counts as it is given, without defaults, in any order of keys.
Names and texts for people do not count: a renamed file or a corrected text is not another recording.

A recording that was read and is written again keeps its identity. The file then states it, with the digest of what was
written next to it; where the content has changed since, the stated identity is ignored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import xarray as xr

from trackprofile.contracts.identity import (
    IDENTITY,
    canonical_json,
    content_digest,
    digest,
    recording_identity,
)
from trackprofile.io.column_info import Column
from trackprofile.io.recording_document import RecordingDocument
from trackprofile.positioning.chainage import ChainageTable

SCHEME = 1
"""Number of the rule by which `raw_identity` is computed."""

CONTENT = "identity_content"
"""Attribute of a written recording: the digest of what was written with the attribute ``identity``."""

TEXTS = ("line", "direction", "source", "vehicle", "provenance")
"""Keys of ``[recording]`` with texts and names, which do not count."""

_NOT_DESCRIPTION = {"data", "chainage", IDENTITY, CONTENT, *TEXTS}


@dataclass(frozen=True, eq=False)
class RawTables:
    """Columns that a description names, by name, as the files hold them.

    Parameters
    ----------
    recording : numbers (float64), flags (bool) and times as text of the recording's table
    posts : the same of the table of kilometre posts; empty where there is none
    chainage : kilometre posts and coordinates of the line; None where there are none
    """

    recording: Mapping[str, Column]
    posts: Mapping[str, Column] = field(default_factory=dict)
    chainage: ChainageTable | None = None


def raw_identity(document: RecordingDocument, tables: RawTables) -> str:
    """Identity of a recording, from its description and its raw columns.

    Returns
    -------
    digest, 64 hexadecimal digits
    """
    return digest(
        {
            "scheme": SCHEME,
            "description": _description(document),
            "recording": tables.recording,
            "posts": tables.posts,
            "chainage": tables.chainage,
        }
    )


def file_identity(document: RecordingDocument, tables: RawTables) -> str:
    """Identity that a file states, if its content is still the one that was written with it; else `raw_identity`."""
    raw, head = raw_identity(document, tables), document.recording
    return head.identity if head.identity and head.identity_content == raw else raw


def with_content(recording: xr.Dataset) -> xr.Dataset:
    """Recording with the digest of its content next to its identity, as it is written to a file.

    A recording without the attribute ``identity`` stays as it is: its content is its identity.
    """
    if IDENTITY not in recording.attrs:
        return recording
    recording_identity(recording)
    return recording.assign_attrs({CONTENT: _dataset_content(recording)})


def without_content(recording: xr.Dataset) -> xr.Dataset:
    """Recording as it was before `with_content`; without its identity where the content has changed since."""
    if CONTENT not in recording.attrs:
        return recording
    attributes = {key: value for key, value in recording.attrs.items() if key != CONTENT}
    if recording.attrs[CONTENT] != _dataset_content(recording):
        attributes.pop(IDENTITY, None)
    changed = recording.copy(deep=False)
    changed.attrs = attributes
    return changed


def _description(document: RecordingDocument) -> dict[str, Any]:
    given = document.model_dump(exclude_unset=True)
    head = {key: value for key, value in given["recording"].items() if key not in _NOT_DESCRIPTION}
    if "posts" in head:
        head["posts"] = {key: value for key, value in head["posts"].items() if key != "data"}
    return {"recording": head, "sensor": sorted(given["sensor"], key=canonical_json)}


def _dataset_content(recording: xr.Dataset) -> str:
    """Digest of the variables of a recording, and of the attributes that say how to interpret them."""
    described = {str(name): variable.attrs for name, variable in recording.variables.items()}
    own = {
        key: recording.attrs[key]
        for key in ("wheel_scale", "leading_end")
        if key in recording.attrs
    }
    return digest([content_digest(recording), described, own])

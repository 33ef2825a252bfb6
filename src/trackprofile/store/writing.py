"""Adding a pass atomically, and removing what killed writers left.

The data files are written first, each complete under its name, and the entry last. A writer that is killed in between
leaves files to which no entry refers; the next attempt writes the same bytes again. Two writers that add the same pass
at the same time write the same files.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta

import numpy as np
import xarray as xr

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import tables
from trackprofile.contracts import Quality, has_rate, validate_profile
from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.store.assessment_tables import assessment_table_to_parquet
from trackprofile.store.catalogue import current_versions, entries_of_day
from trackprofile.store.columns import columns_to_parquet, json_attributes, profile_columns
from trackprofile.store.entry import (
    Entry,
    Origin,
    entry_document,
    entry_id,
    file_checksum,
    parse_entry,
)
from trackprofile.store.envelopes import overview
from trackprofile.store.index import read_entry_rows
from trackprofile.store.layout import (
    DATA_PATH,
    ENTRIES,
    OVERVIEWS,
    PROFILES,
    SCHEMA,
    UNFINISHED_PATH,
    PassKey,
)
from trackprofile.store.recording_conflicts import check_conflict
from trackprofile.store.store import Store, raise_schema

ABANDONED_AFTER = timedelta(days=1)
"""Age from which a file without an entry counts as left by a killed writer."""


@dataclass(frozen=True)
class AddResult:
    """Result of adding a pass.

    Parameters
    ----------
    entry : the pass
    new : whether the store did not have it before
    shown : whether it is the current version of its recording, which `find` returns
    """

    entry: Entry
    new: bool
    shown: bool


def add(
    store: Store,
    key: PassKey,
    profile: xr.Dataset,
    assessment: Assessment,
    origin: Origin,
    *,
    chainage: ChainageTable | None = None,
) -> AddResult:
    """Store a pass: its profile, its assessment, and from which recording and how both were computed.

    The same recording, processed in the same way, is one entry however often it is added; processed in another way it
    is a new version. Concurrent writers and a kill at any time are safe.

    Parameters
    ----------
    store : the store
    key : line, direction, day and run
    profile : profile contract; its distance is the chainage of the line
    assessment : assessment of that profile
    origin : recording and settings
    chainage : kilometre posts and coordinates, for the tables

    Raises
    ------
    DataError : the profile is a fused one; the store has another recording of the same run over the same track, or
        another stretch of this recording as the same run; or the assessment is of another profile. Nothing is written.
    FileError : the store is not readable or writable.
    """
    start, end = _checked_ends(profile, assessment)
    existing = entries_of_day(store, key)
    identifier = entry_id(key, origin)
    same = next((one for one in existing if one.id == identifier), None)
    check_conflict(existing, key, origin, start, end)
    if same is not None:
        if (same.start, same.end) != (start, end):
            raise DataError(
                f"The pass {identifier} is stored from {same.start:g} m to {same.end:g} m, not from {start:g} m to "
                f"{end:g} m; give the other stretch of the recording its own run."
            )
        return AddResult(same, False, same.path(ENTRIES) in current_versions(existing))
    contents = _contents(identifier, key, profile, assessment, chainage or ChainageTable())
    entry = _entry(identifier, key, origin, profile, assessment, contents)
    raise_schema(store)
    for table, content in contents.items():
        store.files.put(entry.path(table), content)
    store.files.put(entry.path(ENTRIES), entry_document(entry))
    return AddResult(entry, True, entry.path(ENTRIES) in current_versions((*existing, entry)))


def _checked_ends(profile: xr.Dataset, assessment: Assessment) -> tuple[float, float]:
    """Ends of a profile that can be stored with this assessment [m]."""
    validate_profile(profile)
    if has_rate(profile):
        raise DataError(
            "The profile is a fused one, and a store keeps single passes; add the passes, and fuse them with fuse "
            "--store."
        )
    distance = profile["distance"].to_numpy()
    start, end = float(distance[0]), float(distance[-1])
    if (assessment.start, assessment.end) != (start, end):
        raise DataError(
            f"The assessment is from {assessment.start:g} m to {assessment.end:g} m, the profile from {start:g} m to "
            f"{end:g} m; assess the profile that is to be stored."
        )
    return start, end


def clean(store: Store, older: timedelta = ABANDONED_AFTER) -> tuple[str, ...]:
    """Remove what killed writers left unfinished.

    Parameters
    ----------
    store : the store
    older : age from which a file without an entry is removed; 0 if no writer is active

    Returns
    -------
    paths of the removed files, below the store's root

    Raises
    ------
    FileError : an entry is damaged, so that its files are unknown. Nothing is removed.
    """
    before = time.time() - older.total_seconds() if older else math.inf
    files = tuple(store.files.listing(""))
    referenced = {
        path
        for row in read_entry_rows(store, ENTRIES)
        for path in parse_entry(row.document, row.path).paths
    }
    removed = []
    for one in files:
        unreferenced = DATA_PATH.fullmatch(one.path) and one.path not in referenced
        old = before == math.inf or (one.modified is not None and one.modified <= before)
        if old and (unreferenced or UNFINISHED_PATH.fullmatch(one.path)):
            store.files.remove(one.path)
            removed.append(one.path)
    store.files.remove_empty_folders(before)
    return tuple(removed)


def _contents(
    identifier: str,
    key: PassKey,
    profile: xr.Dataset,
    assessment: Assessment,
    chainage: ChainageTable,
) -> dict[str, bytes]:
    """Content of all data files of a pass, by table."""
    columns = profile_columns(profile, assessment.levels)
    metadata = {
        "schema": SCHEMA,
        "entry": identifier,
        "line": key.line,
        "direction": key.direction,
        "day": key.day.isoformat(),
        "run": key.run,
    }
    attributes = {"attributes": json_attributes(profile)}
    contents = {
        PROFILES: columns_to_parquet(columns, metadata | attributes),
        OVERVIEWS: columns_to_parquet(overview(columns), metadata),
    }
    for table, rows in tables(assessment, chainage).items():
        contents[table] = assessment_table_to_parquet(rows, identifier, key)
    return contents


def _entry(
    identifier: str,
    key: PassKey,
    origin: Origin,
    profile: xr.Dataset,
    assessment: Assessment,
    contents: Mapping[str, bytes],
) -> Entry:
    gap = (profile["quality"].to_numpy() & Quality.GAP) != 0
    prefix = "standard_deviation_"
    stated = sorted(str(one) for one in profile if str(one).startswith(prefix))
    medians = {
        one.removeprefix(prefix): float(np.median(profile[one].to_numpy()[~gap]))
        for one in stated
        if not gap.all()
    }
    probable = [one.required_action for one in assessment.defects]
    return Entry(
        id=identifier,
        key=key,
        origin=origin,
        kind=str(profile.attrs["kind"]),
        start=assessment.start,
        end=assessment.end,
        points=gap.size,
        known_share=float(1 - gap.mean()),
        standard_deviations=medians,
        defects={action.text: probable.count(action) for action in Action},
        notes=tuple(assessment.notes),
        files={table: file_checksum(content) for table, content in contents.items()},
    )

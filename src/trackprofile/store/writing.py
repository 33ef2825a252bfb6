"""Adding a pass, whole or not at all, and clearing away what a killed writer left.

The data files come first, each whole under its name; the entry comes last. Whoever dies in between leaves files that no
entry names, which another try writes again, byte for byte. Two that add the same pass at once write the same.
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
from trackprofile.store.assessment_tables import table_bytes
from trackprofile.store.catalogue import entries_of_day, newest
from trackprofile.store.columns import attributes_of, parquet_bytes, profile_columns
from trackprofile.store.entry import Entry, Origin, document, entry_id, file_checksum, parsed
from trackprofile.store.envelopes import overview
from trackprofile.store.index import rows_below
from trackprofile.store.layout import (
    DATA_PATH,
    ENTRIES,
    OVERVIEWS,
    PROFILES,
    SCHEMA,
    UNFINISHED_PATH,
    PassKey,
)
from trackprofile.store.store import Store

OVERLAP = 600.0
"""m that recordings of one run may share: their ends, where a filter settles, twice."""

LIVING = timedelta(days=1)
"""After which a file that no entry names is taken as left by the dead."""


@dataclass(frozen=True)
class AddResult:
    """What came of adding a pass.

    Parameters
    ----------
    entry : of the pass
    new : whether it was not there before
    shown : whether it is the one of its recording that `find` gives, or another version is
    """

    entry: Entry
    new: bool
    shown: bool


def add(
    store: Store,
    place: PassKey,
    profile: xr.Dataset,
    assessment: Assessment,
    origin: Origin,
    *,
    way: ChainageTable | None = None,
) -> AddResult:
    """Store a pass: its profile, its assessment, and from what and how both were made.

    The same recording, made in the same way, is one entry however often it is added. Made in another way it is a new
    version beside the first. It is safe beside other writers, and if it is killed at any moment.

    Parameters
    ----------
    place : which track, and when
    profile : the profile contract; its distance is the chainage of the line
    assessment : of that profile
    origin : what it was made from
    way : kilometre posts and coordinates, for the tables

    Raises
    ------
    DataError : it is a line made of many passes; another recording is there of the same run over the same track; or
        this one is there over another stretch; or the assessment is of another profile. Nothing is written.
    FileError : the store cannot be read or written.
    """
    validate_profile(profile)
    if has_rate(profile):
        raise DataError(
            "This is a line made of many passes. A store keeps the passes: add those, and fuse --store makes the line."
        )
    distance = profile["distance"].to_numpy()
    start, end = float(distance[0]), float(distance[-1])
    if (assessment.start, assessment.end) != (start, end):
        raise DataError(
            f"The assessment is from {assessment.start:g} m to {assessment.end:g} m, the profile from {start:g} m to "
            f"{end:g} m; assess the profile that is to be stored."
        )
    there = entries_of_day(store, place)
    name = entry_id(place, origin)
    same = next((one for one in there if one.id == name), None)
    check_claim(there, place, origin.recording, start, end)
    if same is not None:
        if (same.start, same.end) != (start, end):
            raise DataError(
                f"The pass {name} is stored from {same.start:g} m to {same.end:g} m, not from {start:g} m to "
                f"{end:g} m; give the other stretch of the recording a run of its own."
            )
        return AddResult(same, False, same.path(ENTRIES) in newest(there))
    contents = _contents(name, place, profile, assessment, way or ChainageTable())
    entry = _entry(name, place, origin, profile, assessment, contents)
    for table, content in contents.items():
        store.files.put(entry.path(table), content)
    store.files.put(entry.path(ENTRIES), document(entry))
    return AddResult(entry, True, entry.path(ENTRIES) in newest((*there, entry)))


def check_claim(
    there: tuple[Entry, ...], place: PassKey, recording: str, start: float, end: float
) -> None:
    """Refuse a second recording of one run over the same track.

    Two recordings contradict each other if they state the same line, direction, day and run, and share more track than
    `OVERLAP`, or than half of the shorter of both.

    Parameters
    ----------
    there : entries of that day
    place, recording : what is to be stored
    start, end : of its profile [m]

    Raises
    ------
    DataError : an entry contradicts it.
    """
    for one in there:
        if one.origin.recording == recording or one.place != place:
            continue
        shared = min(end, one.end) - max(start, one.start)
        if shared > min(OVERLAP, (end - start) / 2, (one.end - one.start) / 2):
            run = f"run {place.run!r}" if place.run else "a run without a name"
            raise DataError(
                f"{place.line}, {place.direction}, {place.day}, {run}: the store has another recording "
                f"({one.origin.source or one.origin.recording[:16]}) of {shared:.0f} m of this track; "
                "give each pass of a day its run, or leave one out."
            )


def clean(store: Store, older: timedelta = LIVING) -> tuple[str, ...]:
    """Remove what killed writers left unfinished.

    Parameters
    ----------
    older : than that, a file that no entry names is taken as left; 0 where nobody writes

    Returns
    -------
    what was removed, as paths below the store's root

    Raises
    ------
    FileError : an entry is damaged: what it names cannot be told. Nothing was removed.
    """
    before = time.time() - older.total_seconds() if older else math.inf
    found = tuple(store.files.listing(""))
    named = {
        path for row in rows_below(store, ENTRIES) for path in parsed(row.document, row.path).paths
    }
    left = []
    for one in found:
        unnamed = DATA_PATH.fullmatch(one.path) and one.path not in named
        old = before == math.inf or (one.modified is not None and one.modified <= before)
        if old and (unnamed or UNFINISHED_PATH.fullmatch(one.path)):
            store.files.remove(one.path)
            left.append(one.path)
    store.files.remove_empty_folders(before)
    return tuple(left)


def _contents(
    name: str, place: PassKey, profile: xr.Dataset, assessment: Assessment, way: ChainageTable
) -> dict[str, bytes]:
    """All data files of a pass, by their table."""
    columns = profile_columns(profile, assessment.levels)
    about = {
        "schema": SCHEMA,
        "entry": name,
        "line": place.line,
        "direction": place.direction,
        "day": place.day.isoformat(),
        "run": place.run,
    }
    contents = {
        PROFILES: parquet_bytes(columns, about | {"attributes": attributes_of(profile)}),
        OVERVIEWS: parquet_bytes(overview(columns), about),
    }
    for table, rows in tables(assessment, way).items():
        contents[table] = table_bytes(rows, name, place)
    return contents


def _entry(
    name: str,
    place: PassKey,
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
    likely = [one.likely for one in assessment.defects]
    return Entry(
        id=name,
        place=place,
        origin=origin,
        kind=str(profile.attrs["kind"]),
        start=assessment.start,
        end=assessment.end,
        points=gap.size,
        known=float(1 - gap.mean()),
        deviations=medians,
        defects={action.words: likely.count(action) for action in Action},
        notes=tuple(assessment.notes),
        files={table: file_checksum(content) for table, content in contents.items()},
    )

"""Conflicts in a manifest: two different recordings of the same run over the same stretch."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackprofile.contracts import recording_identity, select_stretch
from trackprofile.errors import DataError, TrackprofileError
from trackprofile.fleet.job import Row, recording_of
from trackprofile.store import PassKey
from trackprofile.store.recording_conflicts import MAX_OVERLAP


@dataclass(frozen=True)
class _Claim:
    """Content and stretch [m] of the recording of a row."""

    row: Row
    content: str
    start: float
    end: float


def check_conflicts(rows: Sequence[Row]) -> None:
    """Check that no two rows give the same line, direction, day, run and stretch different content.

    Only recordings of one line, direction, day and run are read. A recording that cannot be read is passed over here,
    and fails when it is processed.

    Raises
    ------
    DataError : two rows conflict.
    """
    by_place: dict[PassKey, list[Row]] = defaultdict(list)
    for row in rows:
        by_place[row.place].append(row)
    for together in by_place.values():
        claims: list[_Claim] = []
        for row in together if len(together) > 1 else ():
            try:
                claim = _claim(row)
            except TrackprofileError:
                continue
            for other in claims:
                _check(other, claim)
            claims.append(claim)


def _claim(row: Row) -> _Claim:
    recording = recording_of(row)
    run = select_stretch(recording, -np.inf, None)["distance"].to_numpy() + row.offset
    return _Claim(row, recording_identity(recording), float(run[0]), float(run[-1]))


def _check(one: _Claim, other: _Claim) -> None:
    shared = min(one.end, other.end) - max(one.start, other.start)
    shorter = min(one.end - one.start, other.end - other.start)
    if one.content == other.content or shared <= min(MAX_OVERLAP, shorter / 2):
        return
    row = one.row
    raise DataError(
        f"Recordings {row.number} ({row.file.name}) and {other.row.number} ({other.row.file.name}) both claim "
        f"{shared:.0f} m of {row.line}, {row.direction}, {row.day}, run {row.run!r}, and differ; give each pass of a "
        "day a run of its own, or leave one out."
    )

"""Two recordings cannot be of one train at one place and time and yet differ: one of them is of something else."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from trackprofile.contracts import between, fingerprint
from trackprofile.errors import DataError, TrackprofileError
from trackprofile.fleet.job import Row, recording_of
from trackprofile.store import Place
from trackprofile.store.writing import OVERLAP


@dataclass(frozen=True)
class _Claim:
    """That a recording of this content is of this stretch [m]."""

    row: Row
    content: str
    start: float
    end: float


def check_claims(rows: Sequence[Row]) -> None:
    """See that no two rows claim the same line, direction, day, run and stretch with different content.

    Only recordings of one place and time are read; one that cannot be read claims nothing, and fails when its turn
    comes.

    Raises
    ------
    DataError : two do.
    """
    by_place: dict[Place, list[Row]] = defaultdict(list)
    for row in rows:
        by_place[row.place].append(row)
    for place, together in by_place.items():
        for one, other in combinations(_claims(together), 2):
            shared = min(one.end, other.end) - max(one.start, other.start)
            shorter = min(one.end - one.start, other.end - other.start)
            if one.content != other.content and shared > min(OVERLAP, shorter / 2):
                raise DataError(
                    f"Recordings {one.row.number} ({one.row.file.name}) and {other.row.number} "
                    f"({other.row.file.name}) both claim {shared:.0f} m of {place.line}, {place.direction}, "
                    f"{place.day}, run {place.run!r}, and differ; give each pass of a day a run of its own, or leave "
                    "one out."
                )


def _claims(rows: Sequence[Row]) -> list[_Claim]:
    if len(rows) < 2:
        return []
    claims = []
    for row in rows:
        try:
            recording = recording_of(row)
        except TrackprofileError:
            continue
        run = between(recording, -np.inf, None)["distance"].to_numpy() + row.offset
        claims.append(_Claim(row, fingerprint(recording), float(run[0]), float(run[-1])))
    return claims

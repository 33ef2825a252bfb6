"""Conflicts between recordings: two recordings of one run over the same track cannot both be right."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from trackprofile.errors import DataError
from trackprofile.store.entry import Entry, Origin
from trackprofile.store.layout import ENTRIES, PassKey

MAX_OVERLAP = 600.0
"""Length of track that consecutive recordings of one run may share, because filters need it to settle [m]."""


def conflicting_entries(
    existing: Collection[Entry], key: PassKey, origin: Origin, start: float, end: float
) -> Iterator[tuple[Entry, str]]:
    """Entries of other recordings of the same run over the same track, each with a message.

    Two recordings are in conflict if they have the same line, direction, day and run, and share more track than
    `MAX_OVERLAP`, or than half of the shorter one.

    Parameters
    ----------
    existing : entries of the day
    key, origin : the pass
    start, end : ends of its profile [m]
    """
    same_run = [one for one in existing if one.key == key]
    identities = linked_identities(origin, same_run)
    for one in same_run:
        if one.origin.identities & identities:
            continue
        shared = min(end, one.end) - max(start, one.start)
        if shared > min(MAX_OVERLAP, (end - start) / 2, (one.end - one.start) / 2):
            yield one, _message(one, shared)


def check_conflict(
    existing: Collection[Entry], key: PassKey, origin: Origin, start: float, end: float
) -> None:
    """Refuse a second recording of one run over the same track; see `conflicting_entries`.

    Raises
    ------
    DataError : an entry is in conflict with the pass.
    """
    for _, message in conflicting_entries(existing, key, origin, start, end):
        raise DataError(message)


def linked_identities(origin: Origin, entries: Collection[Entry]) -> frozenset[str]:
    """All identities of a recording, as far as versions in the store link them.

    Entries of schema 1 identify a recording by its fingerprint, later ones by the identity of the raw content; an entry
    that has both links the two.
    """
    identities, size = origin.identities, 0
    while len(identities) > size:
        size = len(identities)
        linked = [one.origin.identities for one in entries if one.origin.identities & identities]
        identities = identities.union(*linked)
    return identities


def _message(one: Entry, shared: float) -> str:
    run = f"run {one.run!r}" if one.run else "a run without a name"
    message = (
        f"{one.line}, {one.direction}, {one.day}, {run}: the store has another recording "
        f"({one.origin.source or one.origin.recording[:16]}) of {shared:.0f} m of this track; give each pass of a day "
        "its own run, or leave one out"
    )
    if one.schema == 1:
        message += (
            "; the stored entry has schema 1, in which the identity of a recording depends on estimated positions: if "
            f"it is the same recording, remove {one.path(ENTRIES)} and add the pass again"
        )
    return f"{message}."

"""A large store from a small one: every pass is one of a few again, on another day or another line.

What is copied is whole and of its own recording, so that the store is as any other but for its track, which repeats.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import date

from trackprofile.store import Entry, Store
from trackprofile.store.entry import document, entry_id
from trackprofile.store.layout import ENTRIES


def again(store: Store, entry: Entry, line: str, day: date) -> Entry:
    """Put a pass there once more, as one of another line and day."""
    recording = hashlib.sha256(f"{entry.origin.recording} {line} {day}".encode()).hexdigest()
    place = replace(entry.place, line=line, day=day)
    origin = replace(entry.origin, recording=recording)
    other = replace(entry, id=entry_id(place, origin), place=place, origin=origin)
    for table in entry.files:
        store.files.put(other.path(table), store.files.read(entry.path(table)))
    store.files.put(other.path(ENTRIES), document(other))
    return other


def spread(
    store: Store, entries: Sequence[Entry], lines: Sequence[str], days: Sequence[date]
) -> None:
    """Passes over all lines on all days, those that are there in turn."""
    there = {(one.line, one.day) for one in entries}
    for i, line in enumerate(lines):
        for k, day in enumerate(days):
            if (line, day) not in there:
                again(store, entries[(i + k) % len(entries)], line, day)

"""A large store from a small one: its passes are copies of a few passes, on other days and lines.

Each copy is complete and has its own recording, so that the store differs from others only in its repeated track.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import date

from trackprofile.store import Entry, Store
from trackprofile.store.entry import entry_document, entry_id
from trackprofile.store.layout import ENTRIES


def copy_pass(store: Store, entry: Entry, line: str, day: date) -> Entry:
    """Store a copy of a pass as one of another line and day."""
    recording = hashlib.sha256(f"{entry.origin.recording} {line} {day}".encode()).hexdigest()
    key = replace(entry.key, line=line, day=day)
    origin = replace(entry.origin, recording=recording)
    other = replace(entry, id=entry_id(key, origin), key=key, origin=origin)
    for table in entry.files:
        store.files.put(other.path(table), store.files.read(entry.path(table)))
    store.files.put(other.path(ENTRIES), entry_document(other))
    return other


def fill_with_copies(
    store: Store, entries: Sequence[Entry], lines: Sequence[str], days: Sequence[date]
) -> None:
    """Store copies of the given passes in turn, so that all lines have a pass on all days."""
    existing = {(one.line, one.day) for one in entries}
    for i, line in enumerate(lines):
        for k, day in enumerate(days):
            if (line, day) not in existing:
                copy_pass(store, entries[(i + k) % len(entries)], line, day)

"""Lines and passes of a store, read again after some seconds and not for every request."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from datetime import date
from typing import TypeVar

from trackprofile.assessment.limits import Action
from trackprofile.errors import TrackprofileError
from trackprofile.server.assessment_rows import limit_heights
from trackprofile.server.cache import Cache
from trackprofile.store import Entry, Store, StoredLine, find, lines
from trackprofile.store.layout import ENTRIES

Value = TypeVar("Value")

LIFETIME = 5.0
"""Time after which a list of passes is read again, so that added passes appear [s]."""

_MAX_LISTS, _MAX_RESULTS = 200, 2000


class UnknownError(TrackprofileError):
    """The store does not have what a request names."""


class LineCatalogue:
    """Lines and passes of a store, cached for `LIFETIME`; safe for many threads.

    Parameters
    ----------
    store : store to read
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._lists = Cache(_MAX_LISTS, LIFETIME)
        self._results = Cache(_MAX_RESULTS)

    def lines(self) -> tuple[StoredLine, ...]:
        """All lines."""
        return self._lists.get("lines", lambda: lines(self.store))

    def line(self, line: str, direction: str) -> StoredLine:
        """One line in one direction.

        Raises
        ------
        UnknownError : the store has no such line and direction.
        """
        for one in self.lines():
            if (one.line, one.direction) == (line, direction):
                return one
        raise UnknownError(f"The store has no line {line!r} in direction {direction!r}.")

    def passes(
        self, line: str, direction: str, first: date | None = None, last: date | None = None
    ) -> tuple[Entry, ...]:
        """The newest version of each pass, by day.

        Raises
        ------
        UnknownError : the store has no such line and direction.
        """
        self.line(line, direction)
        return self._lists.get(
            (line, direction, first, last),
            lambda: find(self.store, line=line, direction=direction, first=first, last=last),
        )

    def passes_of_day(
        self, line: str, direction: str, day: date, entry: str | None = None
    ) -> tuple[Entry, ...]:
        """All passes of a day, or one entry of that day in any version.

        Raises
        ------
        UnknownError : the store has no such pass.
        """
        newest = self.passes(line, direction, day, day)
        if entry is None:
            if newest:
                return newest
            raise UnknownError(
                f"The store has no pass of {line!r} in direction {direction!r} on {day}."
            )
        matches = [one for one in newest if one.id == entry] or [
            one
            for one in find(
                self.store, line=line, direction=direction, first=day, last=day, all_versions=True
            )
            if one.id == entry
        ]
        if not matches:
            raise UnknownError(f"The store has no pass {entry} of {line!r} on {day}.")
        return tuple(matches)

    def cached(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """A result computed from entries, which never change."""
        return self._results.get(key, compute)

    def limit_heights(self, entries: Sequence[Entry], band: str) -> dict[Action, float]:
        """Limits by which passes were assessed in a band [m]: those of the last pass that has any."""
        for one in reversed(entries):
            heights = self.cached(
                ("limit heights", one.path(ENTRIES), band),
                lambda one=one: limit_heights(self.store, one, band),
            )
            if heights:
                return heights
        return {}

"""The store's catalogue as the server uses it: asked again after some seconds, not for every question."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from datetime import date
from typing import TypeVar

from trackprofile.assessment.limits import Action
from trackprofile.errors import TrackprofileError
from trackprofile.server.assessment_rows import heights
from trackprofile.server.cache import Cache
from trackprofile.store import Entry, Store, StoredLine, find, lines
from trackprofile.store.layout import ENTRIES

Value = TypeVar("Value")

LASTS = 5.0
"""s that a list of passes is taken as true; what was added since is shown after that."""

_LINES, _FACTS = 200, 2000  # that are remembered


class UnknownError(TrackprofileError):
    """What was asked for is not in the store."""


class Catalogue:
    """Lines and passes of a store, remembered for `LASTS`; safe for many threads.

    Parameters
    ----------
    store : that is read
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._lists = Cache(most=_LINES, lasts=LASTS)
        self._facts = Cache(most=_FACTS)

    def lines(self) -> tuple[StoredLine, ...]:
        """All lines."""
        return self._lists.recall("lines", lambda: lines(self.store))

    def line(self, line: str, direction: str) -> StoredLine:
        """One of them.

        Raises
        ------
        UnknownError : the store has no such line and direction.
        """
        for one in self.lines():
            if (one.line, one.direction) == (line, direction):
                return one
        raise UnknownError(f"The store holds no line {line!r} in direction {direction!r}.")

    def passes(
        self, line: str, direction: str, first: date | None = None, last: date | None = None
    ) -> tuple[Entry, ...]:
        """The newest version of each pass, by day.

        Raises
        ------
        UnknownError : the store has no such line and direction.
        """
        self.line(line, direction)
        return self._lists.recall(
            (line, direction, first, last),
            lambda: find(self.store, line=line, direction=direction, first=first, last=last),
        )

    def of_day(
        self, line: str, direction: str, day: date, entry: str | None = None
    ) -> tuple[Entry, ...]:
        """All passes of a day, or one of them in whichever version.

        Raises
        ------
        UnknownError : there is none.
        """
        of_day = self.passes(line, direction, day, day)
        if entry is None:
            if of_day:
                return of_day
            raise UnknownError(f"There is no pass of {line!r} in direction {direction!r} on {day}.")
        found = [one for one in of_day if one.id == entry] or [
            one
            for one in find(
                self.store, line=line, direction=direction, first=day, last=day, all_versions=True
            )
            if one.id == entry
        ]
        if not found:
            raise UnknownError(f"There is no pass {entry} of {line!r} on {day}.")
        return tuple(found)

    def recall(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """What was worked out from entries, which never change."""
        return self._facts.recall(key, make)

    def heights(self, entries: Sequence[Entry], band: str) -> dict[Action, float]:
        """The limits that passes were judged by in a band [m]: those of the last that has any."""
        for one in reversed(entries):
            found = self.recall(
                ("heights", one.path(ENTRIES), band), lambda one=one: heights(self.store, one, band)
            )
            if found:
                return found
        return {}

"""What was worked out lately, so that it is not worked out for every question."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import TypeVar

Value = TypeVar("Value")


class Cache:
    """Some values by their keys, the least used forgotten first; safe for many threads.

    Parameters
    ----------
    most : values that are kept
    lasts : s after which a value is worked out again

    Examples
    --------
    >>> memory = Memory(most=1)
    >>> memory.recall("a", lambda: 1), memory.recall("a", lambda: 2), memory.recall("b", lambda: 3)
    (1, 1, 3)
    >>> memory.recall("a", lambda: 4)
    4
    """

    def __init__(self, most: int, lasts: float = float("inf")) -> None:
        self.most, self.lasts = most, lasts
        self._known: OrderedDict[Hashable, tuple[float, object]] = OrderedDict()
        self._lock = Lock()

    def recall(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value of a key, made now if it is not known."""
        with self._lock:
            made, value = self._known.get(key, (0.0, None))
            if key in self._known and time.monotonic() - made <= self.lasts:
                self._known.move_to_end(key)
                return value  # type: ignore[return-value]
        new = make()
        with self._lock:
            self._known[key] = (time.monotonic(), new)
            self._known.move_to_end(key)
            while len(self._known) > self.most:
                self._known.popitem(last=False)
        return new

"""A cache of values that requests have computed, safe for many threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, TypeVar

from cachetools import TTLCache

Value = TypeVar("Value")


class Cache:
    """Values by key; the least recently used is dropped first, and each expires after some time.

    Parameters
    ----------
    max_values : maximum number of values
    lifetime : time after which a value is computed again [s]

    Examples
    --------
    >>> cache = Cache(max_values=1)
    >>> cache.get("a", lambda: 1), cache.get("a", lambda: 2), cache.get("b", lambda: 3)
    (1, 1, 3)
    >>> cache.get("a", lambda: 4)
    4
    """

    def __init__(self, max_values: int, lifetime: float = math.inf) -> None:
        self._values: TTLCache[Hashable, Any] = TTLCache(max_values, lifetime)
        self._lock = Lock()

    def get(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Value of a key, computed if the cache does not have it; threads may compute it at the same time."""
        with self._lock:
            try:
                return self._values[key]
            except KeyError:
                pass
        value = compute()
        with self._lock:
            self._values[key] = value
        return value

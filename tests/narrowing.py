"""Narrower types for the type checker, checked when the tests run."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")


def not_none(value: T | None) -> T:
    """The value, which is not None."""
    assert value is not None
    return value


def floats(values: ArrayLike) -> NDArray[np.float64]:
    """The values as an array of double precision, without a copy if they are one."""
    return np.asarray(values, np.float64)

"""Small array functions that several packages use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NORMAL_95 = 1.96
"""Half-width of the two-sided 95 % interval of a normal distribution, in standard deviations [-]."""

MAX_DISTINCT_SHARE = 0.2
"""Largest share of distinct values with which a channel counts as recorded in steps."""


def runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Slices of consecutive true values of a mask, (n,).

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(3, 4, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask, [0]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def recorded_step(values: Array) -> float:
    """Step in which values, (n,), were recorded; 0 where they are practically continuous.

    Examples
    --------
    >>> recorded_step(np.repeat([10.0, 10.5, 11.0, 11.5], 10))
    0.5
    """
    distinct = np.unique(values)
    if len(distinct) < 2 or len(distinct) > MAX_DISTINCT_SHARE * len(values):
        return 0.0
    return float(np.min(np.diff(distinct)))


def integral(values: Array, at: Array) -> Array:
    """Cumulative integral of sampled values, (n,), by the trapezoidal rule; 0 at the first sample.

    Parameters
    ----------
    values : (n,)
    at : positions or times of the samples, (n,)

    Examples
    --------
    >>> integral(np.array([1.0, 3.0, 3.0]), np.array([0.0, 1.0, 3.0]))
    array([0., 2., 8.])
    """
    return np.concatenate([[0.0], np.cumsum(np.diff(at) * 0.5 * (values[1:] + values[:-1]))])

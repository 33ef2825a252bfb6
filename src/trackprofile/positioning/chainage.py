"""Chainage table of a line: kilometre posts, direction of travel and coordinates by distance.

A profile is given over the distance that the train ran. The kilometrage of a line differs from it: it may decrease
along the run, its kilometres may be longer or shorter than 1000 m, and it jumps where the line was rebuilt. A
`ChainageTable` converts between both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackprofile.errors import RowError

Array = NDArray[np.float64]

KILOMETRE = 1000.0
"""m, length of a kilometre outside the table."""

MAX_STRETCH = 0.1
"""Largest relative difference between the posts' kilometres and the distance between them."""

MIN_STRETCH_LENGTH = 100.0
"""m, shortest distance relative to which that difference is taken."""


@dataclass(frozen=True)
class ChainageTable:
    """Kilometre posts and coordinates of a line by distance.

    The kilometrage is linear between two posts, and changes by 1 km per 1000 m before the first and after the last one.
    Two posts at the same distance are a jump of the kilometrage: the second one applies from this distance on.

    Parameters
    ----------
    post_distance, kilometre : (posts,), distance of each post and its kilometre [m, km]; none, or two and more
    point_distance, latitude, longitude : (points,), [m, °, °], WGS 84; none, or two and more

    Raises
    ------
    RowError : posts or points are not in ascending order of distance, the kilometres contradict the distances, or a
        coordinate is out of range.

    Examples
    --------
    >>> table = ChainageTable([0.0, 2000.0], [12.0, 10.0])
    >>> table.name(500.0), table.direction
    ('km 11.500', 'against the kilometrage')
    """

    post_distance: ArrayLike = ()
    kilometre: ArrayLike = ()
    point_distance: ArrayLike = ()
    latitude: ArrayLike = ()
    longitude: ArrayLike = ()

    def __post_init__(self) -> None:
        for name in ("post_distance", "kilometre", "point_distance", "latitude", "longitude"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        _check_posts(np.asarray(self.post_distance), np.asarray(self.kilometre))
        _check_points(
            np.asarray(self.point_distance), np.asarray(self.latitude), np.asarray(self.longitude)
        )

    @property
    def direction(self) -> str:
        """Direction of travel relative to the kilometrage."""
        at = np.asarray(self.kilometre)
        if at.size and np.median(np.diff(at)) < 0:
            return "against the kilometrage"
        return "with the kilometrage"

    @property
    def has_coordinates(self) -> bool:
        """Whether the table has coordinates."""
        return bool(np.size(self.latitude))

    def kilometres(self, distance: ArrayLike) -> Array:
        """Kilometres at distances (n) [km]."""
        at, posts = np.asarray(distance, np.float64), np.asarray(self.post_distance)
        if not posts.size:
            return at / KILOMETRE
        kilometre = np.asarray(self.kilometre)
        sign = -1.0 if self.direction.startswith("against") else 1.0
        after = np.clip(np.searchsorted(posts, at, side="right"), 1, posts.size - 1)
        # A jump at the first or last post has no interval: the neighbouring one is extrapolated.
        while (flat := posts[after] == posts[after - 1]).any():
            after = np.where(flat, np.where(after > 1, after - 1, after + 1), after)
        low, high = posts[after - 1], posts[after]
        slope = (kilometre[after] - kilometre[after - 1]) / (high - low)
        inside = kilometre[after - 1] + slope * (at - low)
        before = kilometre[0] + sign * (at - posts[0]) / KILOMETRE
        beyond = kilometre[-1] + sign * (at - posts[-1]) / KILOMETRE
        return np.where(at < posts[0], before, np.where(at >= posts[-1], beyond, inside))

    def distances(self, kilometre: ArrayLike) -> Array:
        """Distances of kilometres (n) [m]; NaN for a kilometre that occurs twice or never.

        Examples
        --------
        >>> ChainageTable([0.0, 2000.0], [12.0, 10.0]).distances([11.5, 9.0])
        array([ 500., 3000.])
        """
        wanted, at = np.asarray(kilometre, np.float64), np.asarray(self.post_distance)
        if not at.size:
            return wanted * KILOMETRE
        sign = -1.0 if self.direction.startswith("against") else 1.0
        posts, wanted = sign * np.asarray(self.kilometre), sign * wanted
        distance = np.where(wanted < posts[0], at[0] - KILOMETRE * (posts[0] - wanted), np.nan)
        distance = np.where(
            wanted >= posts[-1], at[-1] + KILOMETRE * (wanted - posts[-1]), distance
        )
        count = (wanted < posts[0]) * 1 + (wanted >= posts[-1])
        for i in np.flatnonzero(np.diff(at) > 0):
            inside = (wanted >= posts[i]) & (wanted < posts[i + 1])
            share = (wanted - posts[i]) / (posts[i + 1] - posts[i])
            distance = np.where(inside, at[i] + share * (at[i + 1] - at[i]), distance)
            count += inside
        return np.where(count == 1, distance, np.nan)

    def name(self, distance: float) -> str:
        """Kilometre at a distance as text, such as ``km 12.345``."""
        return f"km {float(self.kilometres(distance)):.3f}"

    def coordinates(self, distance: ArrayLike) -> tuple[Array, Array]:
        """Latitude and longitude at distances (n) [°]; NaN outside the points."""
        at, known = np.asarray(distance, np.float64), np.asarray(self.point_distance)
        if not known.size:
            return np.full(at.shape, np.nan), np.full(at.shape, np.nan)
        latitude, longitude = (
            np.asarray(self.latitude),
            np.unwrap(np.asarray(self.longitude), period=360.0),
        )
        inside = (at >= known[0]) & (at <= known[-1])
        east = np.interp(at, known, longitude)
        return (
            np.where(inside, np.interp(at, known, latitude), np.nan),
            np.where(inside, (east + 180.0) % 360.0 - 180.0, np.nan),
        )


def _check_posts(distance: Array, kilometre: Array) -> None:
    if distance.size == 1:
        raise RowError("kilometre", 1, "expected two posts or more, got one; add a second post.")
    run = np.diff(distance)
    _refuse(
        run < 0, "kilometre", "the post lies before the one in the row above; sort by distance."
    )
    length = KILOMETRE * np.abs(np.diff(kilometre))
    _refuse(
        (run > 0) & (np.abs(length - run) > MAX_STRETCH * np.maximum(run, MIN_STRETCH_LENGTH)),
        "kilometre",
        "its kilometre differs by more than 10 % from the distance since the post above; enter a jump of the "
        "kilometrage as two posts at the same distance.",
    )
    steps = np.diff(kilometre)[run > 0]
    wrong = np.zeros(run.size, bool)
    wrong[run > 0] = steps * steps[:1] < 0
    _refuse(
        wrong, "kilometre", "the kilometrage changes its direction; use a table for each direction."
    )


def _check_points(distance: Array, latitude: Array, longitude: Array) -> None:
    if distance.size == 1:
        raise RowError(
            "latitude_deg", 1, "expected two points or more, got one; add a second point."
        )
    _refuse(
        np.diff(distance) <= 0,
        "latitude_deg",
        "the point does not lie behind the one in the row above; sort by distance.",
    )
    for name, values, limit in (("latitude_deg", latitude, 90), ("longitude_deg", longitude, 180)):
        wrong = np.abs(values) > limit
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            raise RowError(name, row, f"expected -{limit} to {limit}, got {values[row - 1]:g}.")


def _refuse(wrong: NDArray[np.bool_], column: str, problem: str) -> None:
    """Raise an error at the first row below a wrong step."""
    if wrong.any():
        raise RowError(column, int(np.argmax(wrong)) + 2, problem)

"""Where a place is, as people on the line say it: kilometre posts, direction of travel, coordinates.

A profile knows the distance that the train ran. The kilometrage of a line is another thing: it may fall with distance,
its kilometres may be longer or shorter than 1000 m, and it jumps where the line was rebuilt. A `Way` is the table that
leads from one to the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackprofile.errors import RowError

Array = NDArray[np.float64]

KILOMETRE = 1000.0
"""m of a kilometre that nobody measured."""

STRETCHED = 0.1
"""Share by which the posts' kilometre may differ from the distance's."""


@dataclass(frozen=True)
class ChainageTable:
    """The way of a train, in posts and coordinates.

    Between two posts the kilometrage runs evenly; before the first and after the last as from the distance. Two posts
    at the same distance are a jump: before it the first counts, from it on the second.

    Parameters
    ----------
    post_distance, kilometre : (posts,), where a post stands and what it says [m, km]; two or none
    point_distance, latitude, longitude : (points,), [m, °, °], WGS 84; two or none

    Raises
    ------
    RowError : a post or point stands before the one above it, kilometres run otherwise than metres, or a
        coordinate is none.

    Examples
    --------
    >>> way = Way([0.0, 2000.0], [12.0, 10.0])
    >>> way.name(500.0), way.direction
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
        """Of travel, in words."""
        at = np.asarray(self.kilometre)
        if at.size and np.median(np.diff(at)) < 0:
            return "against the kilometrage"
        return "with the kilometrage"

    @property
    def has_coordinates(self) -> bool:
        """Whether places have a latitude and longitude."""
        return bool(np.size(self.latitude))

    def kilometres(self, distance: ArrayLike) -> Array:
        """What the posts say at some distances (n) [km]."""
        at, posts = np.asarray(distance, np.float64), np.asarray(self.post_distance)
        if not posts.size:
            return at / KILOMETRE
        kilometre = np.asarray(self.kilometre)
        upward = -1.0 if self.direction.startswith("against") else 1.0
        after = np.clip(np.searchsorted(posts, at, side="right"), 1, posts.size - 1)
        # A jump at the very end or beginning has no stretch to run in.
        while (flat := posts[after] == posts[after - 1]).any():
            after = np.where(flat, np.where(after > 1, after - 1, after + 1), after)
        low, high = posts[after - 1], posts[after]
        slope = (kilometre[after] - kilometre[after - 1]) / (high - low)
        inside = kilometre[after - 1] + slope * (at - low)
        before = kilometre[0] + upward * (at - posts[0]) / KILOMETRE
        beyond = kilometre[-1] + upward * (at - posts[-1]) / KILOMETRE
        return np.where(at < posts[0], before, np.where(at >= posts[-1], beyond, inside))

    def distances(self, kilometre: ArrayLike) -> Array:
        """Where posts that say so stand (n) [m]; NaN where the kilometrage says it twice, or never.

        Examples
        --------
        >>> Way([0.0, 2000.0], [12.0, 10.0]).distances([11.5, 9.0])
        array([ 500., 3000.])
        """
        said, at = np.asarray(kilometre, np.float64), np.asarray(self.post_distance)
        if not at.size:
            return said * KILOMETRE
        upward = -1.0 if self.direction.startswith("against") else 1.0
        posts, said = upward * np.asarray(self.kilometre), upward * said
        found = np.where(said < posts[0], at[0] - KILOMETRE * (posts[0] - said), np.nan)
        found = np.where(said >= posts[-1], at[-1] + KILOMETRE * (said - posts[-1]), found)
        times = (said < posts[0]) * 1 + (said >= posts[-1])
        for i in np.flatnonzero(np.diff(at) > 0):
            inside = (said >= posts[i]) & (said < posts[i + 1])
            share = (said - posts[i]) / (posts[i + 1] - posts[i])
            found = np.where(inside, at[i] + share * (at[i + 1] - at[i]), found)
            times += inside
        return np.where(times == 1, found, np.nan)

    def name(self, distance: float) -> str:
        """Of a place, such as ``km 12.345``."""
        return f"km {float(self.kilometres(distance)):.3f}"

    def coordinates(self, distance: ArrayLike) -> tuple[Array, Array]:
        """Latitude and longitude at some distances (n) [°]; NaN outside what is known."""
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
        raise RowError("kilometre", 1, "one post leads nowhere; give two or more.")
    run = np.diff(distance)
    _refuse(run < 0, "kilometre", "the post stands before the one above it; sort the table.")
    said = KILOMETRE * np.abs(np.diff(kilometre))
    _refuse(
        (run > 0) & (np.abs(said - run) > STRETCHED * np.maximum(run, KILOMETRE / 10)),
        "kilometre",
        "its kilometres are not the metres since the post above; a jump of the kilometrage is two posts at the same "
        "distance.",
    )
    steps = np.diff(kilometre)[run > 0]
    wrong = np.zeros(run.size, bool)
    wrong[run > 0] = steps * steps[:1] < 0
    _refuse(wrong, "kilometre", "the kilometrage turns round here; give each direction its own.")


def _check_points(distance: Array, latitude: Array, longitude: Array) -> None:
    if distance.size == 1:
        raise RowError("latitude_deg", 1, "one point leads nowhere; give two or more.")
    _refuse(
        np.diff(distance) <= 0, "latitude_deg", "the point does not follow the one above it; sort."
    )
    for name, values, most in (("latitude_deg", latitude, 90), ("longitude_deg", longitude, 180)):
        wrong = np.abs(values) > most
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            raise RowError(name, row, f"expected -{most} to {most}, found {values[row - 1]:g}.")


def _refuse(wrong: NDArray[np.bool_], column: str, problem: str) -> None:
    if wrong.any():
        raise RowError(column, int(np.argmax(wrong)) + 2, problem)

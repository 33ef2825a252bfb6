"""Satellite positions brought to a line: how far along it each one is, and how far beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563
"""Of the ellipsoid of WGS 84, m."""

DENSE = 20.0
"""m between points of a line, among which the nearest is looked for, but no more than ``MOST`` of them."""

MOST = 1_000_000


def cartesian(latitude: Array, longitude: Array) -> Array:
    """Places on the ellipsoid of WGS 84, (n,) in °, in metres from the Earth's centre, (n, 3).

    Source: NGA.STND.0036, 4.2.

    Examples
    --------
    >>> cartesian(np.array([0.0, 90.0]), np.array([0.0, 0.0])).round(0)
    array([[6378137.,       0.,       0.],
           [      0.,       0., 6356752.]])
    """
    north, east = np.radians(latitude), np.radians(longitude)
    squared = FLATTENING * (2.0 - FLATTENING)
    across = SEMI_MAJOR / np.sqrt(1.0 - squared * np.sin(north) ** 2)
    return np.stack(
        [
            across * np.cos(north) * np.cos(east),
            across * np.cos(north) * np.sin(east),
            (1.0 - squared) * across * np.sin(north),
        ],
        axis=-1,
    )


@dataclass(frozen=True)
class Polyline:
    """Points (n, 3) in m from the Earth's centre, at distances (n,) in m along the line, rising."""

    distance: Array
    point: Array

    def placed(self, points: Array) -> tuple[Array, Array]:
        """Distance along the line of the place nearest to each point, and how far beside it, (m,) each in m.

        NaN along the line for points beyond its ends.
        """
        distance, point = self._dense()
        nearest = KDTree(point).query(points)[1]
        along, beside = np.full(len(points), np.nan), np.full(len(points), np.inf)
        last = len(distance) - 1
        for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, last - 1)):
            chord = point[first + 1] - point[first]
            share = np.sum((points - point[first]) * chord, axis=1) / np.sum(chord**2, axis=1)
            inside = np.clip(share, 0.0, 1.0)
            off = np.linalg.norm(points - point[first] - inside[:, None] * chord, axis=1)
            beyond = ((first == 0) & (share < 0.0)) | ((first == last - 1) & (share > 1.0))
            at = distance[first] + inside * (distance[first + 1] - distance[first])
            closer = off < beside
            along[closer] = np.where(beyond, np.nan, at)[closer]
            beside[closer] = off[closer]
        return along, beside

    def _dense(self) -> tuple[Array, Array]:
        """The line with points no farther than ``DENSE`` apart."""
        apart = max(DENSE, float(self.distance[-1] - self.distance[0]) / MOST)
        pieces = np.maximum(np.ceil(np.diff(self.distance) / apart), 1).astype(np.int64)
        start = np.concatenate([[0], np.cumsum(pieces)])
        at = np.interp(np.arange(start[-1] + 1), start, self.distance)
        return at, np.stack([np.interp(at, self.distance, one) for one in self.point.T], axis=1)


def line_of(way: ChainageTable) -> Polyline:
    """The line of a way that has coordinates."""
    point = cartesian(np.asarray(way.latitude), np.asarray(way.longitude))
    return Polyline(np.asarray(way.point_distance), point)

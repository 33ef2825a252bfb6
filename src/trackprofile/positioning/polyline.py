"""Polyline of a track's axis and the projection of points onto it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from trackprofile.positioning.chainage import ChainageTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563
"""Semi-major axis, m, and flattening of the WGS 84 ellipsoid."""

MAX_POINT_SPACING = 20.0
"""m between the points among which the nearest one is searched, unless that makes more than `MAX_POINTS`."""

MAX_POINTS = 1_000_000


def cartesian(latitude: Array, longitude: Array) -> Array:
    """Cartesian coordinates of points on the WGS 84 ellipsoid.

    Parameters
    ----------
    latitude, longitude : (n,), °

    Returns
    -------
    (n, 3), m from the Earth's centre

    Source: NGA.STND.0036, section 4.2.

    Examples
    --------
    >>> cartesian(np.array([0.0, 90.0]), np.array([0.0, 0.0])).round(0)
    array([[6378137.,       0.,       0.],
           [      0.,       0., 6356752.]])
    """
    north, east = np.radians(latitude), np.radians(longitude)
    eccentricity_squared = FLATTENING * (2.0 - FLATTENING)
    radius = SEMI_MAJOR / np.sqrt(1.0 - eccentricity_squared * np.sin(north) ** 2)
    return np.stack(
        [
            radius * np.cos(north) * np.cos(east),
            radius * np.cos(north) * np.sin(east),
            (1.0 - eccentricity_squared) * radius * np.sin(north),
        ],
        axis=-1,
    )


@dataclass(frozen=True)
class Polyline:
    """Points of a line.

    Parameters
    ----------
    distance : (n,), along the line, m, increasing
    point : (n, 3), m from the Earth's centre
    """

    distance: Array
    point: Array

    def project(self, points: Array) -> tuple[Array, Array]:
        """Project points onto the line.

        Parameters
        ----------
        points : (m, 3), m from the Earth's centre

        Returns
        -------
        distance : (m,), along the line, m; NaN for points beyond its ends
        offset : (m,), lateral offset from the line, m
        """
        distance, point = self._densified()
        nearest = KDTree(point).query(points)[1]
        along, offset = np.full(len(points), np.nan), np.full(len(points), np.inf)
        last = len(distance) - 1
        for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, last - 1)):
            chord = point[first + 1] - point[first]
            share = np.sum((points - point[first]) * chord, axis=1) / np.sum(chord**2, axis=1)
            inside = np.clip(share, 0.0, 1.0)
            away = np.linalg.norm(points - point[first] - inside[:, None] * chord, axis=1)
            beyond = ((first == 0) & (share < 0.0)) | ((first == last - 1) & (share > 1.0))
            at = distance[first] + inside * (distance[first + 1] - distance[first])
            closer = away < offset
            along[closer] = np.where(beyond, np.nan, at)[closer]
            offset[closer] = away[closer]
        return along, offset

    def _densified(self) -> tuple[Array, Array]:
        """Distances and points, at most `MAX_POINT_SPACING` apart."""
        extent = float(self.distance[-1] - self.distance[0])
        spacing = max(MAX_POINT_SPACING, extent / MAX_POINTS)
        pieces = np.maximum(np.ceil(np.diff(self.distance) / spacing), 1).astype(np.int64)
        start = np.concatenate([[0], np.cumsum(pieces)])
        at = np.interp(np.arange(start[-1] + 1), start, self.distance)
        return at, np.stack([np.interp(at, self.distance, one) for one in self.point.T], axis=1)


def chainage_polyline(chainage: ChainageTable) -> Polyline:
    """Polyline of a chainage table with coordinates."""
    point = cartesian(np.asarray(chainage.latitude), np.asarray(chainage.longitude))
    return Polyline(np.asarray(chainage.point_distance), point)

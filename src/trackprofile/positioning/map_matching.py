"""Matching of GNSS fixes and kilometre posts to one line, and the direction of travel on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.gnss_alignment import align_to_own_line
from trackprofile.positioning.polyline import cartesian, chainage_polyline
from trackprofile.positioning.position_observations import (
    PositionObservations,
    Source,
    gnss_observations,
    post_observations,
    valid_fixes,
)
from trackprofile.positioning.sources import GnssFixes, KilometrePosts

Array = NDArray[np.float64]

MAX_OFFSET_RATIO = 5.0
"""Largest lateral offset of a fix over the median one at which the fix still determines the distance."""

MIN_MAX_OFFSET = 10.0
"""m, lateral offset up to which every fix determines the distance."""

MAX_MEDIAN_OFFSET = 500.0
"""m, median lateral offset from which the chainage table is that of another line."""

MAX_BACKWARD = 100.0
"""m by which the fixes go backwards in a train that has turned."""

MEDIAN_LENGTH = 11
"""Number of fixes whose median is robust against outliers."""

MAX_SPEED = 170.0
"""m/s, largest mean speed of a recording."""

MIN_DURATION = 1.0
"""s, shortest duration over which a mean speed is computed."""

DEFAULT_SPEED = 20.0
"""m/s, speed at a post where no source determines it."""


@dataclass(frozen=True)
class TravelledDistance:
    """Distance travelled since the first time, by dead reckoning.

    Parameters
    ----------
    time, distance : (n,), s and m
    """

    time: Array
    distance: Array

    def at(self, time: Array) -> Array:
        """Distance at other times, (m,) m."""
        return np.interp(time, self.time, self.distance)


@dataclass(frozen=True)
class MatchedPositions:
    """Absolute positions on one line, increasing in the direction of travel.

    Parameters
    ----------
    observations : those of fixes and of posts, as far as there are any
    own_line : whether the line is known only from the fixes
    sign : -1 for a run against the line's distances, 1 for a run with them, 0 if not determined
    direction : of travel relative to the kilometrage; "" if not determined
    notes : sentences about the matching
    """

    observations: tuple[PositionObservations, ...] = ()
    own_line: bool = False
    sign: float = 0.0
    direction: str = ""
    notes: tuple[str, ...] = ()


def travelled_distance(observations: Sequence[PositionObservations]) -> TravelledDistance | None:
    """Travelled distance by the first of odometer, displayed speed and GNSS speed; None if there is none of them."""
    for source in (Source.ODOMETRY, Source.DISPLAYED_SPEED, Source.GNSS_SPEED):
        for one in observations:
            if one.source is source and len(one.time) > 1:
                if source is Source.ODOMETRY:
                    return TravelledDistance(one.time, one.value - one.value[0])
                steps = 0.5 * (one.value[1:] + one.value[:-1]) * np.diff(one.time)
                return TravelledDistance(one.time, np.concatenate([[0.0], np.cumsum(steps)]))
    return None


def match_positions(
    fixes: GnssFixes | None,
    posts: KilometrePosts | None,
    chainage: ChainageTable | None,
    motion: Sequence[PositionObservations],
) -> MatchedPositions:
    """Match GNSS fixes and kilometre posts to the chainage table's line, or fixes to the curve through them.

    Distances of a run against the line, or against the kilometrage without a table, are negated.

    Parameters
    ----------
    motion : observations of odometer and speeds

    Raises
    ------
    DataError : the fixes are far from the line, the train turns, or it is faster than any.
    """
    travelled, matched = travelled_distance(motion), MatchedPositions()
    if travelled is not None:
        _check_speed(travelled.time, travelled.distance)
    if fixes is not None:
        rows = valid_fixes(fixes)
        if chainage is not None and chainage.has_coordinates:
            matched = _match_to_table(fixes, rows, chainage)
        else:
            matched = _match_to_own_line(fixes, rows, travelled)
    if posts is not None and len(posts.time):
        matched = _with_posts(matched, posts, chainage or ChainageTable(), travelled)
    return matched


def _match_to_table(
    fixes: GnssFixes, rows: NDArray[np.intp], chainage: ChainageTable
) -> MatchedPositions:
    points = cartesian(fixes.latitude[rows], fixes.longitude[rows])
    distance, offset = chainage_polyline(chainage).project(points)
    usable = np.isfinite(distance)
    typical = float(np.median(offset[usable])) if np.count_nonzero(usable) > 1 else np.inf
    _check_offset(typical)
    usable &= offset <= max(MIN_MAX_OFFSET, MAX_OFFSET_RATIO * typical)
    distance, rows = distance[usable], rows[usable]
    sign = _sign(distance)
    _check_one_direction(sign * distance, fixes.time[rows])
    return MatchedPositions(
        (gnss_observations(fixes, rows, sign * distance),),
        sign=sign,
        direction=_direction(chainage, sign) if np.size(chainage.kilometre) else "",
        notes=_note_on_sign("the line of the chainage table", sign),
    )


def _match_to_own_line(
    fixes: GnssFixes, rows: NDArray[np.intp], travelled: TravelledDistance | None
) -> MatchedPositions:
    time = fixes.time[rows]
    points = cartesian(fixes.latitude[rows], fixes.longitude[rows])
    approximate = None if travelled is None else travelled.at(time)
    _check_speed(time, np.linalg.norm(points - points[0], axis=1))
    distance, offset = align_to_own_line(time, points, approximate)
    usable = offset <= max(MIN_MAX_OFFSET, MAX_OFFSET_RATIO * float(np.median(offset)))
    return MatchedPositions(
        (gnss_observations(fixes, rows[usable], distance[usable]),), own_line=True
    )


def _with_posts(
    matched: MatchedPositions,
    posts: KilometrePosts,
    chainage: ChainageTable,
    travelled: TravelledDistance | None,
) -> MatchedPositions:
    distance = chainage.distances(posts.kilometre)
    unique = np.isfinite(distance)
    distance, time = distance[unique], posts.time[unique]
    notes = matched.notes
    if not unique.all():
        ignored = ", ".join(f"{one:g}" for one in posts.kilometre[~unique][:3])
        notes += (f"posts of kilometre {ignored} are ignored: not exactly once in the kilometrage",)
    if not len(distance):
        return replace(matched, notes=notes)
    sign = matched.sign or _sign(distance)
    if not matched.sign:
        line = (
            "the line of the chainage table" if np.size(chainage.kilometre) else "the kilometrage"
        )
        notes += _note_on_sign(line, sign) if len(distance) > 1 else _note_on_one_post()
    speed = _speed_at(time, travelled or TravelledDistance(time, sign * distance))
    observations = post_observations(replace(posts, time=time), sign * distance, speed)
    return replace(
        matched,
        observations=(*matched.observations, observations),
        sign=sign,
        direction=_direction(chainage, sign),
        notes=notes,
    )


def _speed_at(time: Array, travelled: TravelledDistance) -> Array:
    """Mean speed over 2 s about each time, (n,) m/s."""
    if len(travelled.time) < 2:
        return np.full(len(time), DEFAULT_SPEED)
    late = np.minimum(time + 1.0, travelled.time[-1])
    early = np.maximum(time - 1.0, travelled.time[0])
    distance = travelled.at(late) - travelled.at(early)
    return np.abs(distance) / np.maximum(late - early, 1e-3)


def _sign(distance: Array) -> float:
    """1 if distances increase during the run, else -1."""
    half = max(len(distance) // 2, 1)
    return -1.0 if np.median(distance[-half:]) < np.median(distance[:half]) else 1.0


def _check_offset(typical: float) -> None:
    if typical > MAX_MEDIAN_OFFSET:
        where = (
            f"{typical / 1000:.3g} km from the line of the chainage table"
            if np.isfinite(typical)
            else "beyond the ends of the chainage table"
        )
        raise DataError(
            f"The GNSS fixes lie {where}, expected them on it; name the chainage table of this run's line, or none."
        )


def _check_speed(time: Array, distance: Array) -> None:
    duration = max(float(time[-1] - time[0]), MIN_DURATION)
    mean = float(np.median(np.abs(distance[-MEDIAN_LENGTH:] - distance[0]))) / duration
    if not mean < MAX_SPEED:
        raise DataError(
            f"The position sources give a mean speed of {3.6 * mean:.3g} km/h, expected less than "
            f"{3.6 * MAX_SPEED:.0f} km/h; check the columns and their units."
        )


def _check_one_direction(distance: Array, time: Array) -> None:
    smooth = median_filter(distance, MEDIAN_LENGTH, mode="nearest")
    backward = np.maximum.accumulate(smooth) - smooth
    if np.max(backward) > MAX_BACKWARD:
        turn = float(time[int(np.argmax(backward > MAX_BACKWARD))])
        raise DataError(
            f"The GNSS fixes go back by {MAX_BACKWARD:.0f} m before {turn:.0f} s: the train turns, expected one "
            "direction in a recording; split the recording where it turns."
        )


def _direction(chainage: ChainageTable, sign: float) -> str:
    with_kilometrage = chainage.direction.startswith("with") == (sign > 0)
    return "with the kilometrage" if with_kilometrage else "against the kilometrage"


def _note_on_sign(line: str, sign: float) -> tuple[str, ...]:
    if sign > 0:
        return ()
    return (f"the train runs against {line}: distances are negated, so that they increase",)


def _note_on_one_post() -> tuple[str, ...]:
    return ("one post does not determine the direction: assumed with the kilometrage",)

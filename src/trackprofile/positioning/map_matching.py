"""Positions and kilometre posts brought to one line, and which way a train runs on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.gnss_alignment import align_to_own_line
from trackprofile.positioning.polyline import cartesian, line_of
from trackprofile.positioning.position_observations import (
    PositionObservations,
    Source,
    fresh_fixes,
    gnss_observations,
    post_observations,
)
from trackprofile.positioning.sources import GnssFixes, KilometrePosts

Array = NDArray[np.float64]
Run = tuple[Array, Array]

BESIDE = 5.0
"""Times farther beside the line than is usual, from which a fix says nothing of the place along it."""

NARROW = 10.0
"""m beside a line, up to which any fix may be."""

FAR_OFF = 500.0
"""m beside its way, from which half of all fixes show that the way is another one's."""

BACK = 100.0
"""m by which fixes have to go back before a train has turned."""

AROUND = 11
"""Fixes whose median says whether it did."""

FASTEST, SHORTEST = 170.0, 1.0
"""m/s, faster than any train, on average over a recording of at least so many s."""

USUAL_SPEED = 20.0
"""m/s at a post, where nothing says it."""


@dataclass(frozen=True)
class MatchedPositions:
    """What says where a train was, along one line in the direction of travel.

    Parameters
    ----------
    readings : of fixes and of posts, where there are any
    own_line : whether the line is known from the fixes alone
    sign : -1 where the train runs against the line's distances, 1 with them, 0 where nothing tells
    direction : of travel by the kilometrage, in words; "" where nothing tells
    notes : in sentences
    """

    readings: tuple[PositionObservations, ...] = ()
    own_line: bool = False
    sign: float = 0.0
    direction: str = ""
    notes: tuple[str, ...] = ()


def run_of(moves: Sequence[PositionObservations]) -> Run | None:
    """Times in s and how far a train had run by then in m, by the first of what says so; None where nothing does."""
    for source in (Source.ROLLED, Source.SHOWN, Source.FIX_SPEED):
        for one in moves:
            if one.source is source and len(one.time) > 1:
                if source is Source.ROLLED:
                    return one.time, one.value - one.value[0]
                steps = 0.5 * (one.value[1:] + one.value[:-1]) * np.diff(one.time)
                return one.time, np.concatenate([[0.0], np.cumsum(steps)])
    return None


def match_positions(
    fixes: GnssFixes | None,
    posts: KilometrePosts | None,
    way: ChainageTable | None,
    moves: Sequence[PositionObservations],
) -> MatchedPositions:
    """Fixes and posts brought to the way, or, without one, to the line that the fixes themselves make.

    Against the way, or against the kilometrage where there is none, distances count with a minus.

    Parameters
    ----------
    moves : what else says how far the train ran

    Raises
    ------
    DataError : the fixes are far from the way, or the train turns.
    """
    run, found = run_of(moves), MatchedPositions()
    if run is not None:
        _check_speed(*run)
    if fixes is not None:
        kept = fresh_fixes(fixes)
        if way is not None and way.has_coordinates:
            found = _on_the_way(fixes, kept, way)
        else:
            found = _on_their_own(fixes, kept, run)
    if posts is not None and len(posts.time):
        found = _with_posts(found, posts, way or ChainageTable(), run)
    return found


def _on_the_way(fixes: GnssFixes, kept: NDArray[np.intp], way: ChainageTable) -> MatchedPositions:
    along, beside = line_of(way).placed(cartesian(fixes.latitude[kept], fixes.longitude[kept]))
    near = np.isfinite(along)
    usual = float(np.median(beside[near])) if np.count_nonzero(near) > 1 else np.inf
    if usual > FAR_OFF:
        where = (
            f"{usual / 1000:.3g} km beside the way"
            if np.isfinite(usual)
            else "beyond the ends of the way"
        )
        raise DataError(
            f"The satellite positions lie {where}; expected them on it: give the way that this train took, or none."
        )
    near &= beside <= max(NARROW, BESIDE * usual)
    along, kept = along[near], kept[near]
    sign = _sign(along)
    _check_one_way(sign * along, fixes.time[kept])
    return MatchedPositions(
        (gnss_observations(fixes, kept, sign * along),),
        sign=sign,
        direction=_direction(way, sign) if np.size(way.kilometre) else "",
        notes=_against("its way", sign),
    )


def _on_their_own(fixes: GnssFixes, kept: NDArray[np.intp], run: Run | None) -> MatchedPositions:
    time = fixes.time[kept]
    points = cartesian(fixes.latitude[kept], fixes.longitude[kept])
    rough = None if run is None else np.interp(time, *run)
    _check_speed(time, np.linalg.norm(points - points[0], axis=1))
    along, beside = align_to_own_line(time, points, rough)
    near = beside <= max(NARROW, BESIDE * float(np.median(beside)))
    return MatchedPositions((gnss_observations(fixes, kept[near], along[near]),), own_line=True)


def _with_posts(
    found: MatchedPositions, posts: KilometrePosts, way: ChainageTable, run: Run | None
) -> MatchedPositions:
    distance = way.distances(posts.kilometre)
    once = np.isfinite(distance)
    distance, time = distance[once], posts.time[once]
    notes = found.notes
    if not once.all():
        said = ", ".join(f"{one:g}" for one in posts.kilometre[~once][:3])
        notes += (f"the kilometrage says {said} twice or never: such posts are not used",)
    if not len(distance):
        return replace(found, notes=notes)
    sign = found.sign or _sign(distance)
    if not found.sign:
        line = "its way" if np.size(way.kilometre) else "the kilometrage"
        notes += _against(line, sign) if len(distance) > 1 else _unsaid()
    speed = _speed_at(time, run, (time, sign * distance))
    reading = post_observations(replace(posts, time=time), sign * distance, speed)
    return replace(
        found,
        readings=(*found.readings, reading),
        sign=sign,
        direction=_direction(way, sign),
        notes=notes,
    )


def _speed_at(time: Array, run: Run | None, places: Run) -> Array:
    """How fast the train passed posts, m/s, by how far it ran, or by the posts themselves."""
    at, distance = run or places
    if len(at) < 2:
        return np.full(len(time), USUAL_SPEED)
    late, early = np.minimum(time + 1.0, at[-1]), np.maximum(time - 1.0, at[0])
    passed = np.interp(late, at, distance) - np.interp(early, at, distance)
    return np.abs(passed) / np.maximum(late - early, 1e-3)


def _sign(along: Array) -> float:
    """Of travel: 1 where distances rise, else -1."""
    half = max(len(along) // 2, 1)
    return -1.0 if np.median(along[-half:]) < np.median(along[:half]) else 1.0


def _check_speed(time: Array, run: Array) -> None:
    """Refuse a train that is faster than any."""
    took = max(float(time[-1] - time[0]), SHORTEST)
    mean = float(np.median(np.abs(run[-AROUND:] - run[0]))) / took
    if not mean < FASTEST:
        raise DataError(
            f"By what is recorded of where it was the train ran at {3.6 * mean:.3g} km/h; check the columns and their "
            "units."
        )


def _check_one_way(along: Array, time: Array) -> None:
    """Refuse a train that turns."""
    calm = median_filter(along, AROUND, mode="nearest")
    back = np.maximum.accumulate(calm) - calm
    if np.max(back) > BACK:
        turn = float(time[int(np.argmax(back > BACK))])
        raise DataError(
            f"By its satellite positions the train turns: at {turn:.0f} s it has run back {BACK:.0f} m; a recording "
            "runs one way: cut it there."
        )


def _direction(way: ChainageTable, sign: float) -> str:
    with_it = way.direction.startswith("with") == (sign > 0)
    return "with the kilometrage" if with_it else "against the kilometrage"


def _against(line: str, sign: float) -> tuple[str, ...]:
    if sign > 0:
        return ()
    return (f"the train runs against {line}: distances count with a minus, so that they increase",)


def _unsaid() -> tuple[str, ...]:
    return ("one post does not say which way the train runs: taken to be with the kilometrage",)

"""From all that a train recorded of where it was to the distance along the line, and how well that is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.errors import DataError
from trackprofile.positioning.map_matching import AROUND, MatchedPositions, match_positions, run_of
from trackprofile.positioning.position_model import COMMON, FAR, PositionPrior
from trackprofile.positioning.position_observations import (
    STILL,
    PositionObservations,
    Source,
    StandstillInterval,
    displayed_speed_observations,
    fresh_fixes,
    gnss_speed_observations,
    odometry_observations,
    odometry_standstills,
    ran,
    speed_standstills,
)
from trackprofile.positioning.position_smoother import BEYOND, PositionEstimate, smooth_position
from trackprofile.positioning.sources import Sources
from trackprofile.preprocessing.faults import ClockFault

Array = NDArray[np.float64]

FEWEST_FIXES = 3

LONG, FARTHER = 500.0, 1.4
"""m, over which the run by positions and by a wheel may not differ by more than this factor."""

WALKING = 1.0
"""m/s: below, positions alone do not tell a train from one that stands."""

BRAKING = 2.0
"""s in which a train comes to rest from there."""

TOLD = 0.3
"""Share of what was known of a wheel's scale before, below which positions have told it."""


@dataclass(frozen=True)
class Whereabouts:
    """Of a train, at some times (n,).

    Parameters
    ----------
    distance, speed : m along the line in the direction of travel, m/s
    deviation : standard deviation of the distance, m
    doubted : sums of `ClockFault`: where a position was weighted down, where the wheel slipped
    direction : of travel, in words; "" where nothing tells
    scale : of the wheel, true over nominal diameter; 1 where nothing tells
    notes : what was found, in sentences
    """

    distance: Array
    speed: Array
    deviation: Array
    doubted: NDArray[np.int8]
    direction: str
    scale: float
    notes: tuple[str, ...]


def locate(sources: Sources, time: Array) -> Whereabouts:
    """Where a train was and how fast it went at some times, (n,) in s and rising.

    The distance is that of the way or of the posts, which against the way, or against the kilometrage where there is
    no way, counts with a minus so that it increases; without either it begins at 0.

    Raises
    ------
    DataError : there is too little to tell, or the train turns.
    """
    sources = _told(sources)
    moves = _moves(sources)
    places = match_positions(sources.fixes, sources.posts, sources.way, moves)
    _check_run(moves, places)
    stands, dead = _stands(sources, moves, places)
    readings = [*places.readings, *(_without(one, dead) for one in moves)]
    if not any(len(one.time) > 1 for one in readings):
        raise DataError(
            "Nothing says where the train was: of no source there are two readings; choose other columns."
        )
    assumed = _assumed(sources, places, readings)
    span = (float(time[0]), float(time[-1]))
    found = smooth_position(readings, stands, dead, assumed, span)
    if not moves:
        stands = _slow(found)
        found = smooth_position(readings, stands, dead, assumed, span) if stands else found
    distance, speed = _at(found, time, stands)
    if not assumed.begin_deviation or (assumed.own_line and assumed.anchored):
        distance = distance - distance[0]
    told = assumed.scale_deviation > 0 and found.scale_deviation < TOLD * assumed.scale_deviation
    return Whereabouts(
        distance,
        speed,
        np.interp(time, found.time, found.deviation),
        _doubted(found, time),
        places.direction,
        found.scale if told else 1.0,
        (*places.notes, *_said(found, dead, told=told)),
    )


def _told(sources: Sources) -> Sources:
    """The sources that say anything."""
    fixes, rolled, shown, posts = sources.fixes, sources.rolled, sources.shown, sources.posts
    return replace(
        sources,
        fixes=None if fixes is None or len(fresh_fixes(fixes)) < FEWEST_FIXES else fixes,
        rolled=None if rolled is None or len(rolled.time) < 2 else rolled,
        shown=None if shown is None or len(shown.time) < 2 else shown,
        posts=None if posts is None or not len(posts.time) else posts,
    )


def _check_run(moves: Sequence[PositionObservations], places: MatchedPositions) -> None:
    """Refuse a wheel that rolls much farther than positions go, or less."""
    run = run_of(moves)
    if run is None:
        return
    for one in places.readings:
        went, rolled = _from_end_to_end(one.value), _from_end_to_end(np.interp(one.time, *run))
        if max(went, rolled) > LONG and not rolled / FARTHER < went < FARTHER * rolled:
            raise DataError(
                f"By {one.source} the train ran {went / 1000:.3g} km, by what else counts it {rolled / 1000:.3g} km; "
                "check the columns, the units, and the odometer's per_revolution and wheel_diameter."
            )


def _from_end_to_end(places: Array) -> float:
    """m from the middle of the first third of some places to that of the last."""
    third = max(len(places) // 3, 1)
    return abs(float(np.median(places[-third:]) - np.median(places[:third])))


def _moves(sources: Sources) -> list[PositionObservations]:
    """What says how far the train ran, or how fast."""
    found = []
    if sources.rolled is not None:
        found.append(odometry_observations(sources.rolled))
    if sources.shown is not None:
        found.append(displayed_speed_observations(sources.shown))
    if sources.fixes is not None and sources.fixes.speed is not None:
        found.append(gnss_speed_observations(sources.fixes))
    return [one for one in found if len(one.time)]


def _stands(
    sources: Sources, moves: Sequence[PositionObservations], places: MatchedPositions
) -> tuple[list[StandstillInterval], list[StandstillInterval]]:
    """When the train stood, and when only its wheel did, by the first of what can say."""
    fixes = next((one for one in places.readings if one.source is Source.FIX), None)
    doppler = next((one for one in moves if one.source is Source.FIX_SPEED), None)
    if sources.rolled is not None:
        found = odometry_standstills(sources.rolled)
    elif sources.shown is not None:
        found = speed_standstills(sources.shown.time, sources.shown.speed)
    elif doppler is not None:
        return speed_standstills(doppler.time, doppler.value), []
    else:
        return [], []
    dead = [one for one in found if ran(one, fixes)]
    return [one for one in found if one not in dead], dead


def _without(
    readings: PositionObservations, dead: Sequence[StandstillInterval]
) -> PositionObservations:
    """A wheel's readings but those of a time in which it stood and the train ran."""
    if readings.source not in {Source.ROLLED, Source.SHOWN}:
        return readings
    kept = np.ones(len(readings.time), bool)
    for begin, end in dead:
        kept &= (readings.time < begin) | (readings.time > end)
    return replace(
        readings,
        time=readings.time[kept],
        value=readings.value[kept],
        variance=readings.variance[kept],
    )


def _assumed(
    sources: Sources, places: MatchedPositions, readings: Sequence[PositionObservations]
) -> PositionPrior:
    wheels = [one.deviation for one in (sources.rolled, sources.shown) if one is not None]
    posted = any(one.source is Source.POST for one in places.readings)
    anchor = next((one for one in reversed(places.readings) if len(one.time)), None)
    stated = None if sources.fixes is None else sources.fixes.wander
    begin = 0.0
    if anchor is not None:
        run = run_of(readings)
        since = np.interp(anchor.time, *run) if run else anchor.value - anchor.value[0]
        begin = float(np.median((anchor.value - since)[:AROUND]))
    return PositionPrior(
        scale_deviation=min(wheels, default=0.0),
        begin=begin,
        begin_deviation=0.0 if anchor is None else FAR,
        own_line=places.own_line,
        anchored=not posted,
        wander=COMMON if stated is None else stated,
        wander_stated=stated is not None,
    )


def _slow(found: PositionEstimate) -> list[StandstillInterval]:
    """When a train stood of which only positions are known, s: slow, for longer than it would take to get anywhere."""
    stands = []
    for run in runs(found.speed < WALKING):
        begin, end = found.time[run.start] + BRAKING, found.time[run.stop - 1] - BRAKING
        went = np.ptp(found.distance[run])
        if end - begin > STILL and went < BEYOND * float(np.median(found.deviation[run])):
            stands.append((float(begin), float(end)))
    return stands


def _at(
    found: PositionEstimate, time: Array, stands: Sequence[StandstillInterval]
) -> tuple[Array, Array]:
    """Distance and speed at some times.

    Between two nodes runs the quintic through both states, the mean of a walk of the acceleration between its ends.
    """
    k = np.clip(np.searchsorted(found.time, time, side="right") - 1, 0, len(found.time) - 2)
    dt = found.time[k + 1] - found.time[k]
    u = (time - found.time[k]) / dt
    s, v, a = found.distance, found.speed, found.acceleration
    rest = s[k + 1] - s[k] - v[k] * dt - 0.5 * a[k] * dt**2
    faster = (v[k + 1] - v[k] - a[k] * dt) * dt
    harder = (a[k + 1] - a[k]) * dt**2
    c3 = 10 * rest - 4 * faster + 0.5 * harder
    c4 = -15 * rest + 7 * faster - harder
    c5 = 6 * rest - 3 * faster + 0.5 * harder
    distance = s[k] + v[k] * u * dt + 0.5 * a[k] * (u * dt) ** 2 + u**3 * (c3 + u * (c4 + u * c5))
    speed = v[k] + a[k] * u * dt + u**2 * (3 * c3 + u * (4 * c4 + u * 5 * c5)) / dt
    for begin, end in stands:
        inside = (time >= begin) & (time <= end)
        if inside.any():
            distance[inside], speed[inside] = np.median(distance[inside]), 0.0
    return np.maximum.accumulate(distance), np.maximum(speed, 0.0)


def _doubted(found: PositionEstimate, time: Array) -> NDArray[np.int8]:
    """Flags of the samples at which positions were weighted down, and at which the wheel slipped."""
    flags = np.zeros(len(time), np.int8)
    rows = found.rows
    positions = (found.weights.own > 0.0) & (rows.of(Source.FIX) | rows.of(Source.POST))
    at = np.searchsorted(time, found.time[rows.node[positions]])
    flags[np.clip(at, 0, len(time) - 1)] |= ClockFault.POSITION
    for run in runs(found.weights.slip > 0.0):
        begin, end = found.time[run.start], found.time[run.stop]
        flags[(time >= begin) & (time <= end)] |= ClockFault.SLIP
    return flags


def _said(
    found: PositionEstimate, dead: Sequence[StandstillInterval], *, told: bool
) -> Iterator[str]:
    """What was found, in sentences."""
    rows = found.rows
    used = [one for one in Source if one is not Source.STANDING and rows.of(one).any()]
    yield f"places come from {_listed([str(one) for one in used])}"
    if rows.of(Source.FIX).any():
        here = rows.of(Source.FIX)
        level = found.weights.level[Source.FIX] * float(np.median(rows.variance[here]))
        yield (
            f"satellite positions scatter by {np.sqrt(level):.2g} m along the line about a common error of "
            f"{found.wander:.2g} m"
        )
    if told:
        error = found.scale * found.scale_deviation
        yield f"the wheel's diameter is {found.scale:.5f} ± {error:.5f} of the nominal one"
    for run in runs(found.weights.slip > 0.0):
        by = found.slipped[run.stop] - found.slipped[run.start]
        yield f"the wheel slips by {by:.1f} m at {found.time[run.start]:.0f} s"
    for begin, end in dead:
        yield f"the wheel says nothing from {begin:.0f} to {end:.0f} s, in which the train ran: not used there"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

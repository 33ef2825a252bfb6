"""Distance along the line and speed of a train, with their uncertainty, from the position sources of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.arrays import runs
from trackprofile.errors import DataError
from trackprofile.kalman.reweighting import OUTLIER_THRESHOLD
from trackprofile.positioning.map_matching import (
    MEDIAN_LENGTH,
    MatchedPositions,
    TravelledDistance,
    match_positions,
    travelled_distance,
)
from trackprofile.positioning.position_model import (
    GNSS_BIAS_STD,
    POSITION_STD,
    PositionPrior,
    WheelIntervals,
)
from trackprofile.positioning.position_observations import (
    MIN_STANDSTILL,
    PositionObservations,
    Source,
    StandstillInterval,
    displayed_speed_observations,
    gnss_speed_observations,
    moved_by_gnss,
    odometry_observations,
    odometry_standstills,
    speed_standstills,
    valid_fixes,
)
from trackprofile.positioning.position_smoother import PositionEstimate, smooth_position
from trackprofile.positioning.sources import Sources
from trackprofile.preprocessing.faults import ClockFault

Array = NDArray[np.float64]

MIN_FIXES = 3
"""Smallest number of GNSS fixes that are used."""

MIN_COMPARED_DISTANCE = 500.0
"""m, shortest distance over which positions and travelled distance are compared."""

MAX_DISTANCE_RATIO = 1.4
"""Largest ratio of the distance by positions to the travelled distance, or its inverse."""

WALKING_SPEED = 1.0
"""m/s, speed below which GNSS fixes alone do not distinguish movement from standstill."""

STOPPING_TIME = 2.0
"""s in which a train stops from walking speed."""

MAX_SCALE_STD_RATIO = 0.3
"""Largest posterior over prior standard deviation of a wheel scale that the positions determine."""


@dataclass(frozen=True)
class LocatedRun:
    """Position of a train at the times of a recording.

    Parameters
    ----------
    distance, speed : (n,), along the line in the direction of travel, m; m/s
    standard_deviation : (n,), of the distance, m
    clock_fault : (n,), sums of `ClockFault`: outliers among the positions, wheel slips
    direction : of travel relative to the kilometrage; "" if not determined
    wheel_scale : true over nominal wheel diameter; 1 if not determined
    notes : sentences about sources and results
    """

    distance: Array
    speed: Array
    standard_deviation: Array
    clock_fault: NDArray[np.int8]
    direction: str
    wheel_scale: float
    notes: tuple[str, ...]


def locate(sources: Sources, time: Array) -> LocatedRun:
    """Estimate the position and speed of a train by smoothing all sources together.

    The distance is that of the chainage table, else 1000 m times the kilometre of the posts, else counted from 0. It is
    negated for a run against the table's line, or against the kilometrage without a table, so that it increases.

    Parameters
    ----------
    sources : GNSS fixes, odometry, posts, displayed speed and chainage table, as far as there are any
    time : (n,), s, increasing

    Raises
    ------
    DataError : the sources do not determine a position, contradict each other, or the train turns.
    """
    sources = _usable(sources)
    motion = _motion_observations(sources)
    matched = match_positions(sources.gnss, sources.posts, sources.chainage, motion)
    _check_distance(travelled_distance(motion), matched)
    intervals = _wheel_intervals(sources, motion, matched)
    observations = [*matched.observations, *(_without_failures(one, intervals) for one in motion)]
    if not any(len(one.time) > 1 for one in observations):
        raise DataError(
            "No position source has two values, expected at least one that has; choose other columns."
        )
    prior = _prior(sources, matched, observations)
    span = (float(time[0]), float(time[-1]))
    estimate = smooth_position(observations, intervals, prior, span)
    if not motion:
        intervals = replace(intervals, standstills=_position_standstills(estimate))
        if intervals.standstills:
            estimate = smooth_position(observations, intervals, prior, span)
    distance, speed = _interpolated(estimate, time, intervals.standstills)
    if not prior.start_std or (prior.own_line and prior.anchored):
        distance = distance - distance[0]
    determined = prior.scale_std > 0 and estimate.scale_std < MAX_SCALE_STD_RATIO * prior.scale_std
    return LocatedRun(
        distance,
        speed,
        np.interp(time, estimate.time, estimate.standard_deviation),
        _clock_faults(estimate, time),
        matched.direction,
        estimate.scale if determined else 1.0,
        (*matched.notes, *_notes(estimate, intervals.failures, determined)),
    )


def _usable(sources: Sources) -> Sources:
    """Sources with enough values."""
    gnss, odometry = sources.gnss, sources.odometry
    displayed, posts = sources.displayed_speed, sources.posts
    return replace(
        sources,
        gnss=None if gnss is None or len(valid_fixes(gnss)) < MIN_FIXES else gnss,
        odometry=None if odometry is None or len(odometry.time) < 2 else odometry,
        displayed_speed=None if displayed is None or len(displayed.time) < 2 else displayed,
        posts=None if posts is None or not len(posts.time) else posts,
    )


def _check_distance(travelled: TravelledDistance | None, matched: MatchedPositions) -> None:
    """Refuse positions that contradict the travelled distance."""
    if travelled is None:
        return
    for one in matched.observations:
        by_position = _extent(one.value)
        by_wheel = _extent(travelled.at(one.time))
        ratio_holds = by_wheel / MAX_DISTANCE_RATIO < by_position < MAX_DISTANCE_RATIO * by_wheel
        if max(by_position, by_wheel) > MIN_COMPARED_DISTANCE and not ratio_holds:
            raise DataError(
                f"The train ran {by_position / 1000:.3g} km by the {one.source} but {by_wheel / 1000:.3g} km by its "
                "odometer or speed, expected about the same; check the columns, their units, and the odometer's pulses "
                "per revolution and wheel diameter."
            )


def _extent(positions: Array) -> float:
    """Distance between the medians of the first and the last third of some positions, m."""
    third = max(len(positions) // 3, 1)
    return abs(float(np.median(positions[-third:]) - np.median(positions[:third])))


def _motion_observations(sources: Sources) -> list[PositionObservations]:
    """Observations of odometer and speeds."""
    observations = []
    if sources.odometry is not None:
        observations.append(odometry_observations(sources.odometry))
    if sources.displayed_speed is not None:
        observations.append(displayed_speed_observations(sources.displayed_speed))
    if sources.gnss is not None and sources.gnss.speed is not None:
        observations.append(gnss_speed_observations(sources.gnss))
    return [one for one in observations if len(one.time)]


def _wheel_intervals(
    sources: Sources, motion: Sequence[PositionObservations], matched: MatchedPositions
) -> WheelIntervals:
    """Standstills by the first of odometer, displayed speed and GNSS speed; failures of the first two by GNSS fixes."""
    gnss_speed = next((one for one in motion if one.source is Source.GNSS_SPEED), None)
    if sources.odometry is not None:
        intervals = odometry_standstills(sources.odometry)
    elif sources.displayed_speed is not None:
        displayed = sources.displayed_speed
        intervals = speed_standstills(displayed.time, displayed.speed)
    elif gnss_speed is not None:
        return WheelIntervals(speed_standstills(gnss_speed.time, gnss_speed.value))
    else:
        return WheelIntervals()
    fixes = next((one for one in matched.observations if one.source is Source.GNSS_POSITION), None)
    failures = [one for one in intervals if moved_by_gnss(one, fixes)]
    return WheelIntervals([one for one in intervals if one not in failures], failures)


def _without_failures(
    observations: PositionObservations, intervals: WheelIntervals
) -> PositionObservations:
    """A wheel's observations without those in failures of the odometer."""
    if observations.source not in {Source.ODOMETRY, Source.DISPLAYED_SPEED}:
        return observations
    used = np.ones(len(observations.time), bool)
    for start, end in intervals.failures:
        used &= (observations.time < start) | (observations.time > end)
    return replace(
        observations,
        time=observations.time[used],
        value=observations.value[used],
        variance=observations.variance[used],
    )


def _prior(
    sources: Sources, matched: MatchedPositions, observations: Sequence[PositionObservations]
) -> PositionPrior:
    wheels = [
        one.scale_std for one in (sources.odometry, sources.displayed_speed) if one is not None
    ]
    has_posts = any(one.source is Source.POST for one in matched.observations)
    anchor = next((one for one in reversed(matched.observations) if len(one.time)), None)
    bias_std = None if sources.gnss is None else sources.gnss.bias_std
    start = 0.0
    if anchor is not None:
        travelled = travelled_distance(observations)
        since = anchor.value - anchor.value[0] if travelled is None else travelled.at(anchor.time)
        start = float(np.median((anchor.value - since)[:MEDIAN_LENGTH]))
    return PositionPrior(
        scale_std=min(wheels, default=0.0),
        start=start,
        start_std=0.0 if anchor is None else POSITION_STD,
        own_line=matched.own_line,
        anchored=not has_posts,
        bias_std=GNSS_BIAS_STD if bias_std is None else bias_std,
        bias_stated=bias_std is not None,
    )


def _position_standstills(estimate: PositionEstimate) -> list[StandstillInterval]:
    """Intervals at walking speed whose distance is not significant, for a train without odometer and speed."""
    intervals = []
    for run in runs(estimate.speed < WALKING_SPEED):
        start = estimate.time[run.start] + STOPPING_TIME
        end = estimate.time[run.stop - 1] - STOPPING_TIME
        significant = OUTLIER_THRESHOLD * float(np.median(estimate.standard_deviation[run]))
        if end - start > MIN_STANDSTILL and np.ptp(estimate.distance[run]) < significant:
            intervals.append((float(start), float(end)))
    return intervals


def _interpolated(
    estimate: PositionEstimate, time: Array, standstills: Sequence[StandstillInterval]
) -> tuple[Array, Array]:
    """Distance and speed at times between the nodes, (n,) m and m/s.

    The quintic through position, speed and acceleration at both nodes is the conditional mean of a random walk of the
    acceleration between them.
    """
    node = np.searchsorted(estimate.time, time, side="right") - 1
    k = np.clip(node, 0, len(estimate.time) - 2)
    dt = estimate.time[k + 1] - estimate.time[k]
    u = (time - estimate.time[k]) / dt
    s, v, a = estimate.distance, estimate.speed, estimate.acceleration
    ds = s[k + 1] - s[k] - v[k] * dt - 0.5 * a[k] * dt**2
    dv = (v[k + 1] - v[k] - a[k] * dt) * dt
    da = (a[k + 1] - a[k]) * dt**2
    c3 = 10 * ds - 4 * dv + 0.5 * da
    c4 = -15 * ds + 7 * dv - da
    c5 = 6 * ds - 3 * dv + 0.5 * da
    distance = s[k] + v[k] * u * dt + 0.5 * a[k] * (u * dt) ** 2 + u**3 * (c3 + u * (c4 + u * c5))
    speed = v[k] + a[k] * u * dt + u**2 * (3 * c3 + u * (4 * c4 + u * 5 * c5)) / dt
    for start, end in standstills:
        inside = (time >= start) & (time <= end)
        if inside.any():
            distance[inside], speed[inside] = np.median(distance[inside]), 0.0
    return np.maximum.accumulate(distance), np.maximum(speed, 0.0)


def _clock_faults(estimate: PositionEstimate, time: Array) -> NDArray[np.int8]:
    """Flags of the samples with a position outlier or a wheel slip, (n,)."""
    flags = np.zeros(len(time), np.int8)
    rows = estimate.rows
    positions = rows.measured_by(Source.GNSS_POSITION) | rows.measured_by(Source.POST)
    outliers = (estimate.weights.outlier_variance > 0.0) & positions
    at = np.searchsorted(time, estimate.time[rows.node[outliers]])
    flags[np.clip(at, 0, len(time) - 1)] |= ClockFault.POSITION
    for run in runs(estimate.weights.slip_variance > 0.0):
        start, end = estimate.time[run.start], estimate.time[run.stop]
        flags[(time >= start) & (time <= end)] |= ClockFault.SLIP
    return flags


def _notes(
    estimate: PositionEstimate, failures: Sequence[StandstillInterval], determined: bool
) -> Iterator[str]:
    """Sentences about the sources, their noise and the wheel; ``determined``: whether its scale is."""
    rows = estimate.rows
    used = [one for one in Source if one is not Source.STANDSTILL and rows.measured_by(one).any()]
    yield f"sources are {_joined([str(one) for one in used])}"
    fixes = rows.measured_by(Source.GNSS_POSITION)
    if fixes.any():
        ratio = estimate.weights.noise_ratio[Source.GNSS_POSITION]
        noise = np.sqrt(ratio * float(np.median(rows.variance[fixes])))
        yield (
            f"standard deviation of the GNSS fixes {noise:.2g} m along the line, and of their bias "
            f"{estimate.bias_std:.2g} m"
        )
    if determined:
        error = estimate.scale * estimate.scale_std
        yield f"wheel diameter {estimate.scale:.5f} ± {error:.5f} of the nominal one"
    for run in runs(estimate.weights.slip_variance > 0.0):
        slip = estimate.slip[run.stop] - estimate.slip[run.start]
        yield f"the wheel slips by {slip:.1f} m at {estimate.time[run.start]:.0f} s"
    for start, end in failures:
        yield f"the odometer fails from {start:.0f} to {end:.0f} s: not used, as the GNSS fixes show a movement"


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

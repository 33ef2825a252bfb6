"""Simulated runs with known positions: a train on a curved line, and its GNSS fixes, odometer, speed and posts.

The line is integrated on the ellipsoid by its radii of curvature, independently of the package's projection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.sources import (
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    Sources,
    WheelOdometry,
)

Array = np.ndarray

STEP = 0.02
"""s, sampling interval."""

DIAMETER, PULSES = 0.92, 80
"""Wheel diameter, m, and pulses per revolution."""

PULSE = np.pi * DIAMETER / PULSES
"""m, distance between pulses."""

START = 1000.0
"""m, distance along the line at the start of each run."""

SEMI_MAJOR, ECCENTRICITY_SQUARED = 6378137.0, 0.00669437999014
"""WGS 84: semi-major axis, m, and squared first eccentricity."""


@dataclass(frozen=True)
class Line:
    """Points of a line at distances, m, with coordinates, °."""

    distance: Array
    latitude: Array
    longitude: Array


@dataclass(frozen=True)
class TrueRun:
    """True motion of a train: s, m along its line, m/s."""

    time: Array
    distance: Array
    speed: Array
    line: Line


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the position sources.

    Parameters
    ----------
    fix_std, bias_std : standard deviations of the noise and of the bias of GNSS fixes in each direction, m; the bias
        has a correlation time of 100 s
    outlier_share : share of fixes with an additional error of 50 m
    tunnel : interval without fixes, s
    wheel_scale : true over nominal diameter
    scale_variation : standard deviation of the rolling radius, with a correlation length of 500 m
    slip : distance, m, by which the wheel rolls too far within 2 s from 200 s on
    """

    fix_std: float = 3.0
    bias_std: float = 1.5
    outlier_share: float = 0.05
    tunnel: tuple[float, float] = (500.0, 560.0)
    wheel_scale: float = 0.99
    scale_variation: float = 3e-4
    slip: float = 0.0


SMALL_ERRORS = SensorErrors(
    fix_std=1.0, bias_std=0.0, outlier_share=0.0, tunnel=(0.0, 0.0), scale_variation=0.0
)


@lru_cache(maxsize=64)
def train_run(seed: int, seconds: float = 900.0, stop: float = 300.0) -> TrueRun:
    """A train that changes its speed and stands from ``stop`` on for a while, with bounded jerk."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP)
    wanted = np.full(len(time), 30.0)
    for at in np.sort(generator.uniform(30.0, seconds, int(seconds / 60))):
        wanted[time > at] = 30.0 * generator.uniform(0.5, 1.0)
    wanted[(time > stop) & (time < stop + 100.0)] = 0.0
    speed, present, acceleration = np.zeros(len(time)), 15.0, 0.0
    for k, target in enumerate(wanted):
        speed[k] = present
        demand = min(max(0.3 * (target - present), -0.8), 0.5)
        acceleration += min(max(demand - acceleration, -0.4 * STEP), 0.4 * STEP)
        present += acceleration * STEP
        if present <= 0.0 or (target == 0.0 and present < 0.05):
            present, acceleration = 0.0, max(acceleration, 0.0)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (speed[1:] + speed[:-1]))])
    return TrueRun(time, START + distance, speed, random_line(seed, START + distance[-1] + 500.0))


def random_line(seed: int, length: float) -> Line:
    """A line of straights, transitions and curves of 400 to 3000 m radius."""
    generator = np.random.default_rng(1000 + seed)
    spacing = 5.0
    count = int(length / spacing) + 1
    curvature, at = np.zeros(count), 0
    while at < count:
        at += int(generator.uniform(300.0, 1500.0) / spacing)
        circular = np.ones(int(generator.uniform(100.0, 600.0) / spacing))
        transition = np.linspace(0.0, 1.0, int(80.0 / spacing))
        curve = np.concatenate([transition, circular, transition[::-1]])
        curve /= generator.choice([400, 800, 1500, 3000]) * generator.choice([-1, 1])
        covered = curvature[at : at + len(curve)]
        covered[:] = curve[: len(covered)]
        at += len(curve)
    heading = 0.7 + spacing * np.cumsum(curvature)
    latitude, longitude = np.empty(count), np.empty(count)
    north, east = np.radians(52.0), np.radians(10.0)
    for k in range(count):
        latitude[k], longitude[k] = np.degrees(north), np.degrees(east)
        root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(north) ** 2)
        meridian = SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED)
        north += spacing * np.cos(heading[k]) * root**3 / meridian
        east += spacing * np.sin(heading[k]) * root / (SEMI_MAJOR * np.cos(north))
    return Line(spacing * np.arange(count), latitude, longitude)


def chainage_table(run: TrueRun) -> ChainageTable:
    """Coordinates of the line every 20 m."""
    thinned = slice(None, None, 4)
    return ChainageTable(
        point_distance=run.line.distance[thinned],
        latitude=run.line.latitude[thinned],
        longitude=run.line.longitude[thinned],
    )


def sources(run: TrueRun, kinds: str, errors: SensorErrors | None = None, seed: int = 0) -> Sources:
    """Recorded position sources.

    ``kinds`` consists of letters: g GNSS fixes, d their Doppler speeds, o odometer, s displayed speed in whole km/h,
    p kilometre posts, c chainage table.
    """
    errors = errors or SensorErrors()
    rolled = _rolled(run, errors, np.random.default_rng([seed, 1]))
    recorded = Sources()
    if "g" in kinds:
        fixes = _fixes(run, errors, np.random.default_rng([seed, 2]))
        recorded = replace(recorded, gnss=fixes if "d" in kinds else replace(fixes, speed=None))
    if "o" in kinds:
        counted = PULSE * np.floor(rolled / PULSE + 0.5 * seed % 1.0)
        recorded = replace(recorded, odometry=WheelOdometry(run.time, counted, PULSE, 0.03))
    if "s" in kinds:
        step = 1.0 / 3.6
        displayed = step * np.round(np.gradient(rolled, run.time) / step)
        recorded = replace(
            recorded, displayed_speed=DisplayedSpeed(run.time, displayed, step, 0.03)
        )
    if "p" in kinds:
        recorded = replace(recorded, posts=_posts(run, np.random.default_rng([seed, 3])))
    if "c" in kinds:
        recorded = replace(recorded, chainage=chainage_table(run))
    return recorded


def _rolled(run: TrueRun, errors: SensorErrors, generator: np.random.Generator) -> Array:
    """Distance that the wheel rolls by its nominal diameter, m."""
    steps = np.diff(run.distance, prepend=run.distance[0])
    variation, present = np.empty(len(steps)), 0.0
    noise = generator.standard_normal(len(steps))
    for k, (step, sample) in enumerate(zip(steps, noise, strict=True)):
        decay = np.exp(-step / 500.0)
        present = decay * present + errors.scale_variation * np.sqrt(1.0 - decay**2) * sample
        variation[k] = present
    slipped = errors.slip * np.clip((run.time - 200.0) / 2.0, 0.0, 1.0)
    return np.cumsum(steps * (1.0 + variation)) / errors.wheel_scale + slipped


def _fixes(run: TrueRun, errors: SensorErrors, generator: np.random.Generator) -> GnssFixes:
    """One fix per second, in one row; NaN in the other rows."""
    rows = np.arange(0, len(run.time), round(1.0 / STEP))
    offset = errors.fix_std * generator.standard_normal((len(rows), 2))
    outlier = generator.random(len(rows)) < errors.outlier_share
    offset[outlier] += 50.0 * generator.standard_normal((np.count_nonzero(outlier), 2))
    bias, decay = errors.bias_std * generator.standard_normal(2), np.exp(-1.0 / 100.0)
    for k in range(len(rows)):
        offset[k] += bias
        noise = errors.bias_std * np.sqrt(1.0 - decay**2) * generator.standard_normal(2)
        bias = decay * bias + noise
    at, line = run.distance[rows], run.line
    north = np.interp(at, line.distance, line.latitude)
    east = np.interp(at, line.distance, line.longitude)
    root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(np.radians(north)) ** 2)
    meridian = SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED) / root**3
    parallel = SEMI_MAJOR / root * np.cos(np.radians(north))
    latitude, longitude, speed = (np.full(len(run.time), np.nan) for _ in range(3))
    received = (run.time[rows] < errors.tunnel[0]) | (run.time[rows] > errors.tunnel[1])
    received_rows = rows[received]
    latitude[received_rows] = (north + np.degrees(offset[:, 1] / meridian))[received]
    longitude[received_rows] = (east + np.degrees(offset[:, 0] / parallel))[received]
    doppler = run.speed[rows] + 0.1 * generator.standard_normal(len(rows))
    speed[received_rows] = np.maximum(doppler, 0.0)[received]
    return GnssFixes(run.time, latitude, longitude, speed)


def _posts(run: TrueRun, generator: np.random.Generator) -> KilometrePosts:
    """A post each kilometre with errors of 2 m in its location and 0.2 s in its time."""
    first, last = np.ceil(run.distance[1] / 1000.0 + 0.01), run.distance[-1] / 1000.0
    kilometre = np.arange(first, last)
    location = 1000.0 * kilometre + 2.0 * generator.standard_normal(len(kilometre))
    moving = np.concatenate([[True], np.diff(run.distance) > 0])
    passed = np.interp(location, run.distance[moving], run.time[moving])
    error = 0.2 * generator.standard_normal(len(kilometre))
    return KilometrePosts(passed + error, kilometre, std=2.0, time_std=0.2)

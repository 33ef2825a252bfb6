"""Rides whose place is known: a train on a curved line, and what its receiver, wheel and posts make of that.

The line is integrated on the ellipsoid by its radii of curvature, another way than the package's.
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
"""s between samples."""

DIAMETER, PULSES = 0.92, 80
PULSE = np.pi * DIAMETER / PULSES
BEGIN = 1000.0
"""m along the line, where each ride begins."""

EQUATOR, SQUARED = 6378137.0, 0.00669437999014
"""Of WGS 84: semi-major axis in m, first eccentricity squared."""


@dataclass(frozen=True)
class Line:
    """Points every ``distance`` m, rising, in °."""

    distance: Array
    latitude: Array
    longitude: Array


@dataclass(frozen=True)
class Ride:
    """Where a train really was: s, m along its line and m/s."""

    time: Array
    distance: Array
    speed: Array
    line: Line


@dataclass(frozen=True)
class World:
    """What is wrong with the sources.

    Parameters
    ----------
    scatter, wander : standard deviations of satellite positions, each direction, m; the second stays for 100 s
    outlying : share of them that are 50 m off
    tunnel : from when to when there are none, s
    worn : true over nominal diameter
    creep : standard deviation of the rolling radius over 500 m
    slip : m that the wheel rolls too far, from 200 s on, in 2 s
    """

    scatter: float = 3.0
    wander: float = 1.5
    outlying: float = 0.05
    tunnel: tuple[float, float] = (500.0, 560.0)
    worn: float = 0.99
    creep: float = 3e-4
    slip: float = 0.0


@lru_cache(maxsize=64)
def ride(seed: int, seconds: float = 900.0, stop: float = 300.0) -> Ride:
    """A train that changes its speed and stops for a while, with bounded jerk."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP)
    aim = np.full(len(time), 30.0)
    for at in np.sort(generator.uniform(30.0, seconds, int(seconds / 60))):
        aim[time > at] = 30.0 * generator.uniform(0.5, 1.0)
    aim[(time > stop) & (time < stop + 100.0)] = 0.0
    speed, now, gain = np.zeros(len(time)), 15.0, 0.0
    for k, wanted in enumerate(aim):
        speed[k] = now
        asked = min(max(0.3 * (wanted - now), -0.8), 0.5)
        gain += min(max(asked - gain, -0.4 * STEP), 0.4 * STEP)
        now += gain * STEP
        if now <= 0.0 or (wanted == 0.0 and now < 0.05):
            now, gain = 0.0, max(gain, 0.0)
    run = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (speed[1:] + speed[:-1]))])
    return Ride(time, BEGIN + run, speed, line(seed, BEGIN + run[-1] + 500.0))


def line(seed: int, length: float) -> Line:
    """A line of straights, transitions and curves of 400 to 3000 m."""
    generator = np.random.default_rng(1000 + seed)
    spacing = 5.0
    count = int(length / spacing) + 1
    curvature, at = np.zeros(count), 0
    while at < count:
        at += int(generator.uniform(300.0, 1500.0) / spacing)
        round_ = np.ones(int(generator.uniform(100.0, 600.0) / spacing))
        into = np.linspace(0.0, 1.0, int(80.0 / spacing))
        curve = np.concatenate([into, round_, into[::-1]])
        curve /= generator.choice([400, 800, 1500, 3000]) * generator.choice([-1, 1])
        here = curvature[at : at + len(curve)]
        here[:] = curve[: len(here)]
        at += len(curve)
    heading = 0.7 + spacing * np.cumsum(curvature)
    latitude, longitude = np.empty(count), np.empty(count)
    north, east = np.radians(52.0), np.radians(10.0)
    for k in range(count):
        latitude[k], longitude[k] = np.degrees(north), np.degrees(east)
        root = np.sqrt(1.0 - SQUARED * np.sin(north) ** 2)
        north += spacing * np.cos(heading[k]) * root**3 / (EQUATOR * (1.0 - SQUARED))
        east += spacing * np.sin(heading[k]) * root / (EQUATOR * np.cos(north))
    return Line(spacing * np.arange(count), latitude, longitude)


def way(one: Ride, posts: bool = False) -> ChainageTable:
    """The line as a table, every 20 m, with posts every kilometre if wanted."""
    kilometres = np.arange(0.0, one.line.distance[-1], 1000.0)
    stands = {"post_distance": kilometres, "kilometre": kilometres / 1000.0} if posts else {}
    thin = slice(None, None, 4)
    return ChainageTable(
        **stands,
        point_distance=one.line.distance[thin],
        latitude=one.line.latitude[thin],
        longitude=one.line.longitude[thin],
    )


def sources(one: Ride, what: str, world: World | None = None, seed: int = 0) -> Sources:
    """What is recorded.

    ``what`` holds letters: g satellite positions, d their speeds, o an odometer, s a speed in whole km/h, p posts,
    w the way.
    """
    world = world or World()
    rolled = _rolled(one, world, np.random.default_rng([seed, 1]))
    found = Sources()
    if "g" in what:
        fixes = _fixes(one, world, np.random.default_rng([seed, 2]))
        found = replace(found, fixes=fixes if "d" in what else replace(fixes, speed=None))
    if "o" in what:
        counted = PULSE * np.floor(rolled / PULSE + 0.5 * seed % 1.0)
        found = replace(found, rolled=WheelOdometry(one.time, counted, PULSE, 0.03))
    if "s" in what:
        step = 1.0 / 3.6
        shown = step * np.round(np.gradient(rolled, one.time) / step)
        found = replace(found, shown=DisplayedSpeed(one.time, shown, step, 0.03))
    if "p" in what:
        found = replace(found, posts=_posts(one, np.random.default_rng([seed, 3])))
    if "w" in what:
        found = replace(found, way=way(one))
    return found


def _rolled(one: Ride, world: World, generator: np.random.Generator) -> Array:
    step = np.diff(one.distance, prepend=one.distance[0])
    creep, now = np.empty(len(step)), 0.0
    for k, (run, chance) in enumerate(zip(step, generator.standard_normal(len(step)), strict=True)):
        kept = np.exp(-run / 500.0)
        now = kept * now + world.creep * np.sqrt(1.0 - kept**2) * chance
        creep[k] = now
    slipped = world.slip * np.clip((one.time - 200.0) / 2.0, 0.0, 1.0)
    return np.cumsum(step * (1.0 + creep)) / world.worn + slipped


def _fixes(one: Ride, world: World, generator: np.random.Generator) -> GnssFixes:
    """One a second, written once; no fix is an empty cell."""
    rows = np.arange(0, len(one.time), round(1.0 / STEP))
    off = world.scatter * generator.standard_normal((len(rows), 2))
    bad = generator.random(len(rows)) < world.outlying
    off[bad] += 50.0 * generator.standard_normal((np.count_nonzero(bad), 2))
    common, kept = world.wander * generator.standard_normal(2), np.exp(-1.0 / 100.0)
    for k in range(len(rows)):
        off[k] += common
        chance = world.wander * np.sqrt(1.0 - kept**2) * generator.standard_normal(2)
        common = kept * common + chance
    at, line_ = one.distance[rows], one.line
    north = np.interp(at, line_.distance, line_.latitude)
    east = np.interp(at, line_.distance, line_.longitude)
    root = np.sqrt(1.0 - SQUARED * np.sin(np.radians(north)) ** 2)
    radius = EQUATOR * (1.0 - SQUARED) / root**3
    latitude, longitude, speed = (np.full(len(one.time), np.nan) for _ in range(3))
    lit = (one.time[rows] < world.tunnel[0]) | (one.time[rows] > world.tunnel[1])
    lit_rows = rows[lit]
    latitude[lit_rows] = (north + np.degrees(off[:, 1] / radius))[lit]
    across = EQUATOR / root * np.cos(np.radians(north))
    longitude[lit_rows] = (east + np.degrees(off[:, 0] / across))[lit]
    doppler = one.speed[rows] + 0.1 * generator.standard_normal(len(rows))
    speed[lit_rows] = np.maximum(doppler, 0.0)[lit]
    return GnssFixes(one.time, latitude, longitude, speed)


def _posts(one: Ride, generator: np.random.Generator) -> KilometrePosts:
    """A post each kilometre, 2 m from where it should be, marked 0.2 s early or late."""
    first, last = np.ceil(one.distance[1] / 1000.0 + 0.01), one.distance[-1] / 1000.0
    kilometre = np.arange(first, last)
    stands = 1000.0 * kilometre + 2.0 * generator.standard_normal(len(kilometre))
    moving = np.concatenate([[True], np.diff(one.distance) > 0])
    passed = np.interp(stands, one.distance[moving], one.time[moving])
    late = 0.2 * generator.standard_normal(len(kilometre))
    return KilometrePosts(passed + late, kilometre, deviation=2.0, timing=0.2)

"""Where a train was, from all that it recorded of that."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.locate import Whereabouts, locate
from trackprofile.positioning.sources import (
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    Sources,
    WheelOdometry,
    unwrapped,
)
from trackprofile.preprocessing.faults import ClockFault
from train_rides import BEGIN, Ride, World, ride, sources

Array = np.ndarray

WITH, AGAINST = "with the kilometrage", "against the kilometrage"
CALM = World(scatter=1.0, wander=0.0, outlying=0.0, tunnel=(0.0, 0.0), creep=0.0)


@dataclass(frozen=True)
class Judged:
    """How far a found ride is from the true one."""

    rms: float
    most: float
    covered: float
    found: Whereabouts


def judged(one: Ride, given: Sources) -> Judged:
    found = locate(given, one.time)
    absolute = given.way is not None or given.posts is not None
    error = found.distance - (one.distance if absolute else one.distance - BEGIN)
    return Judged(
        float(np.sqrt(np.mean(error**2))),
        float(np.max(np.abs(error))),
        float(np.mean(np.abs(error) <= 1.96 * found.deviation)),
        found,
    )


def test_ride_with_a_stop_a_tunnel_outliers_and_a_worn_wheel_is_known_to_a_metre_or_two() -> None:
    one = ride(1, 600.0)
    seen = judged(one, sources(one, "gdow", World(tunnel=(450.0, 510.0))))
    assert seen.rms < 1.0
    assert seen.covered > 0.9
    assert seen.found.scale == pytest.approx(0.99, abs=1e-3)
    assert np.all(np.diff(seen.found.distance) >= 0.0)
    error = seen.found.speed - one.speed
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_train_that_stands_adds_no_distance_and_has_no_speed() -> None:
    one = ride(1, 600.0)
    standing = (one.time > 345.0) & (one.time < 398.0)
    assert not one.speed[standing].any()
    for what in ("g", "gd", "gs", "o", "s", "gow"):
        found = locate(sources(one, what, replace(World(), tunnel=(0.0, 0.0))), one.time)
        assert np.ptp(found.distance[standing]) == 0.0, what
        assert not found.speed[standing].any(), what


def test_wheel_that_slips_is_found_and_costs_nothing() -> None:
    one = ride(1, 600.0)
    calm, slipping = (judged(one, sources(one, "gow", World(slip=slip))) for slip in (0.0, 5.0))
    assert slipping.rms < 1.1 * calm.rms
    assert not any("slips" in note for note in calm.found.notes)
    (said,) = (note for note in slipping.found.notes if "slips" in note)
    assert float(said.split("slips by ")[1].split(" m")[0]) == pytest.approx(5.0, abs=0.3)
    marked = one.time[(slipping.found.doubted & ClockFault.SLIP) != 0]
    assert 197.0 < marked[0] < 200.0
    assert 202.0 < marked[-1] < 205.0


def test_positions_far_off_are_marked_and_cost_nothing() -> None:
    one = ride(1, 300.0)
    clean = sources(one, "gow", replace(World(), outlying=0.0))
    rows = np.flatnonzero(np.isfinite(clean.fixes.latitude))
    bad = rows[20:120:10]
    latitude = clean.fixes.latitude.copy()
    latitude[bad] += 60.0 / 111e3
    harmed = replace(clean, fixes=replace(clean.fixes, latitude=latitude))
    before, after = judged(one, clean), judged(one, harmed)
    assert after.rms < 1.1 * before.rms + 0.05
    # Those beside the line say nothing of it anyway; those along it are marked.
    marked = np.flatnonzero(after.found.doubted & ClockFault.POSITION)
    assert set(marked) <= set(bad)


def test_distance_does_not_grow_with_the_noise_of_positions() -> None:
    one = ride(2, 600.0)
    for scatter in (1.0, 3.0, 6.0):
        world = World(scatter=scatter, wander=0.0, outlying=0.0, tunnel=(0.0, 0.0))
        found = locate(sources(one, "g", world), one.time)
        run = one.distance[-1] - one.distance[0]
        assert found.distance[-1] == pytest.approx(run, abs=3 * scatter + 2e-4 * run)


def test_odometer_alone_counts_from_0_and_knows_how_little_it_knows() -> None:
    one = ride(1, 300.0)
    found = locate(sources(one, "o", World(worn=1.02)), one.time)
    assert found.distance[0] == 0.0
    assert found.deviation[0] < 0.1
    run = one.distance - BEGIN
    assert found.deviation[-1] == pytest.approx(0.03 * run[-1], rel=0.1)
    assert np.all(np.abs(found.distance - run) <= 1.96 * found.deviation + 0.05)
    assert found.scale == 1.0


def test_wheel_that_says_nothing_while_the_train_runs_is_not_believed() -> None:
    one = ride(1, 300.0)
    given = sources(one, "gow", World(tunnel=(0.0, 0.0)))
    held = given.rolled.distance.copy()
    dead = (one.time > 100.0) & (one.time < 140.0)
    lost = held[dead][-1] - held[dead][0]
    held[dead] = held[dead][0]
    held[one.time >= 140.0] -= lost
    seen = judged(one, replace(given, rolled=replace(given.rolled, distance=held)))
    assert seen.rms < 1.5
    assert seen.covered > 0.85
    assert any("the wheel says nothing from" in note for note in seen.found.notes)


def test_direction_is_told_by_the_way_whichever_end_it_is_described_from() -> None:
    one = ride(1, 300.0)
    given, length = sources(one, "gow", CALM), one.line.distance[-1]
    at, north, east = points(given.way)
    there = ChainageTable([0.0, length], [0.0, length / 1e3], at, north, east)
    back = ChainageTable(
        [0.0, length], [length / 1e3, 0.0], (length - at)[::-1], north[::-1], east[::-1]
    )
    falling = ChainageTable([0.0, length], [50.0, 50.0 - length / 1e3], at, north, east)
    found = [locate(replace(given, way=way), one.time) for way in (there, back, falling)]
    assert [where.direction for where in found] == [WITH, WITH, AGAINST]
    assert "runs against its way: distances count with a minus" in found[1].notes[0]
    np.testing.assert_allclose(found[1].distance + length, found[0].distance, atol=0.02)


def test_direction_is_told_by_posts() -> None:
    one = ride(1, 300.0)
    rising = sources(one, "op", CALM)
    kilometre = 50.0 - rising.posts.kilometre
    falling = replace(rising, posts=replace(rising.posts, kilometre=kilometre))
    found = [locate(given, one.time) for given in (rising, falling)]
    assert [where.direction for where in found] == [WITH, AGAINST]
    np.testing.assert_allclose(found[1].distance + 50e3, found[0].distance, atol=1e-3)


def points(way: ChainageTable | None) -> tuple[Array, Array, Array]:
    assert way is not None
    return np.asarray(way.point_distance), np.asarray(way.latitude), np.asarray(way.longitude)


@settings(max_examples=5)
@given(st.floats(-1e5, 1e5), st.floats(-1e4, 1e9))
def test_whereabouts_do_not_depend_on_where_distance_and_time_count_from(
    along: float, later: float
) -> None:
    one = ride(3, 120.0, stop=1e9)
    given = sources(one, "gow", CALM)
    at, north, east = points(given.way)
    moved = Sources(
        replace(given.fixes, time=one.time + later),
        replace(given.rolled, time=one.time + later),
        way=ChainageTable(point_distance=at + along, latitude=north, longitude=east),
    )
    here, there = locate(given, one.time), locate(moved, one.time + later)
    np.testing.assert_allclose(there.distance - along, here.distance, atol=0.02)
    np.testing.assert_allclose(there.deviation, here.deviation, rtol=0.05)


def test_train_that_turns_is_refused() -> None:
    one = ride(1, 300.0)
    given = sources(one, "gow", CALM)
    north, east = given.fixes.latitude, given.fixes.longitude
    half = len(north) // 2
    turning = replace(
        given.fixes,
        latitude=np.concatenate([north[:half], north[:half][::-1]]),
        longitude=np.concatenate([east[:half], east[:half][::-1]]),
    )
    with pytest.raises(DataError, match=r"the train turns: at 1\d\d s it has run back 100 m"):
        locate(replace(given, fixes=turning, rolled=None), one.time)


def test_positions_beside_the_way_are_refused() -> None:
    one = ride(1, 120.0)
    given = sources(one, "gw", CALM)
    at, north, east = points(given.way)
    other = ChainageTable(point_distance=at, latitude=north + 0.01, longitude=east - 0.01)
    with pytest.raises(DataError, match="km beside the way; expected them on it"):
        locate(replace(given, way=other), one.time)
    elsewhere = ChainageTable(point_distance=at, latitude=north - 30.0, longitude=east)
    with pytest.raises(DataError, match="lie beyond the ends of the way"):
        locate(replace(given, way=elsewhere), one.time)


def test_nothing_that_says_where_is_refused() -> None:
    one = ride(1, 120.0)
    nowhere = GnssFixes(one.time, np.full(len(one.time), np.nan), np.full(len(one.time), np.nan))
    with pytest.raises(DataError, match="Nothing says where the train was"):
        locate(Sources(nowhere), one.time)


def test_post_that_the_kilometrage_says_twice_is_not_used() -> None:
    one = ride(1, 300.0)
    given = sources(one, "op", CALM)
    stands = [0.0, 3000.0, 3000.0, 20000.0]
    twice = ChainageTable(stands, [0.0, 3.0, 2.0, 19.0])
    found = locate(replace(given, way=twice), one.time)
    assert any("twice or never" in note for note in found.notes)


def test_posts_of_which_one_is_wrong_are_told_by_the_others() -> None:
    one = ride(1, 600.0)
    given = sources(one, "op", replace(World(), creep=1e-4))
    kilometre = given.posts.kilometre.copy()
    kilometre[3] += 0.3
    wrong = replace(given, posts=replace(given.posts, kilometre=kilometre))
    right, mended = judged(one, given), judged(one, wrong)
    assert mended.rms < right.rms + 1.0
    assert np.count_nonzero(mended.found.doubted & ClockFault.POSITION) == 1


def odd(generator: np.random.Generator, count: int, size: float) -> Array:
    """What a broken logger may write in a column."""
    at = np.arange(count)
    columns = (
        np.full(count, np.nan),
        np.zeros(count),
        np.full(count, size),
        size * generator.standard_normal(count),
        np.linspace(0.0, size, count),
        np.linspace(size, 0.0, count),
        np.where(generator.random(count) < 0.9, np.nan, size * generator.random(count)),
        size * np.sin(at / 9.0),
        np.round(np.cumsum(size * generator.random(count)) / count),
    )
    column = columns[generator.integers(len(columns))].copy()
    column[generator.integers(count)] *= generator.choice([1.0, 1.0, 1e6, np.nan])
    return column


def odd_sources(generator: np.random.Generator) -> tuple[Sources, Array]:
    count = int(generator.choice([2, 3, 5, 20, 300]))
    time = np.unique(generator.random(count)) * float(generator.choice([1e-3, 1.0, 60.0, 3e3]))
    count, given = len(time), Sources()
    north, east = (
        np.clip(odd(generator, count, 50.0), -90, 90),
        np.clip(odd(generator, count, 10.0), -180, 180),
    )
    counter, shown, posts = (
        odd(generator, count, 1e3),
        odd(generator, count, 30.0),
        odd(generator, count, 12.0),
    )
    if generator.random() < 0.6:
        given = replace(given, fixes=GnssFixes(time, north, east, odd(generator, count, 30.0)))
    if generator.random() < 0.5 and np.count_nonzero(np.isfinite(counter)) > 1:
        rolled, _ = unwrapped(counter)
        known = np.isfinite(rolled)
        given = replace(
            given,
            rolled=WheelOdometry(
                time[known], rolled[known], float(generator.choice([0.0, 0.03, 3.0])), 0.03
            ),
        )
    if generator.random() < 0.4:
        known = np.isfinite(shown)
        given = replace(given, shown=DisplayedSpeed(time[known], np.abs(shown[known]), 0.28, 0.03))
    if generator.random() < 0.4:
        known = np.isfinite(posts)
        given = replace(given, posts=KilometrePosts(time[known], posts[known], 5.0, 0.5))
    if generator.random() < 0.3:
        given = replace(
            given,
            way=ChainageTable([0.0, 5e3], [10.0, 15.0], [0.0, 5e3], [50.0, 50.045], [8.0, 8.0]),
        )
    return given, time


def check_odd(seeds: range) -> None:
    refused = 0
    for seed in seeds:
        given, time = odd_sources(np.random.default_rng(seed))
        try:
            found = locate(given, time)
        except DataError:
            refused += 1
            continue
        for values in (found.distance, found.speed, found.deviation):
            assert np.all(np.isfinite(values)), seed
        assert np.all(np.diff(found.distance) >= 0.0), seed
        assert np.all(found.speed >= 0.0), seed
    assert 0 < refused < len(seeds)


def test_broken_columns_are_refused_or_read_without_a_crash() -> None:
    check_odd(range(30))


@pytest.mark.acceptance
def test_many_broken_columns_are_refused_or_read_without_a_crash() -> None:
    check_odd(range(30, 400))


def test_wheel_and_positions_that_contradict_each_other_are_refused() -> None:
    one = ride(1, 120.0, stop=1e9)
    given = sources(one, "go", CALM)
    in_feet = replace(given.rolled, distance=given.rolled.distance / 0.3048)
    with pytest.raises(
        DataError,
        match=r"the train ran 2\.\d+ km, by what else counts it [67]\.\d+ km; check the columns",
    ):
        locate(replace(given, rolled=in_feet), one.time)


COMBINATIONS = (
    "g",
    "gd",
    "gw",
    "gdw",
    "o",
    "s",
    "go",
    "gs",
    "op",
    "sp",
    "gop",
    "gow",
    "gsw",
    "gdow",
    "gdowps",
)
"""Of sources; letters as of `train_rides.sources`."""


@pytest.mark.acceptance
def test_errors_and_coverage_of_every_combination_of_sources() -> None:
    lines = [
        "\n| sources | rms, m | most, m | within 95 % | scale, standard errors off |",
        "|---|---|---|---|---|",
    ]
    for what in COMBINATIONS:
        rides = [judged(ride(seed), sources(ride(seed), what, seed=seed)) for seed in range(12)]
        rms = np.sqrt(np.mean([one.rms**2 for one in rides]))
        covered = float(np.mean([one.covered for one in rides]))
        lines.append(
            f"| {what} | {rms:.2f} | {max(one.most for one in rides):.1f} | {100 * covered:.0f} % | {told(rides)} |"
        )
        assert covered > 0.88, what
    sys.stdout.write("\n".join(lines) + "\n")


def told(rides: list[Judged]) -> str:
    """How many standard errors the wheel's scale is off, as a root mean square."""
    off = []
    for one in rides:
        for note in one.found.notes:
            if note.startswith("the wheel's diameter is "):
                scale, error = (
                    float(part.split()[0])
                    for part in note.removeprefix("the wheel's diameter is ").split(" ± ")
                )
                off.append((scale - 0.99) / error)
    return f"{np.sqrt(np.mean(np.square(off))):.1f}" if off else ""

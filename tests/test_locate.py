"""Position of a train estimated from all its position sources."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from narrowing import not_none
from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.locate import LocatedRun, locate
from trackprofile.positioning.sources import (
    DisplayedSpeed,
    GnssFixes,
    KilometrePosts,
    Sources,
    WheelOdometry,
    unwrap_counter,
)
from trackprofile.preprocessing.faults import ClockFault
from train_runs import SMALL_ERRORS, START, SensorErrors, TrueRun, sources, train_run

Array = np.ndarray

WITH, AGAINST = "with the kilometrage", "against the kilometrage"
NO_STOP = 1e9


@dataclass(frozen=True)
class Evaluation:
    """Errors of an estimated run: RMS and largest error, m, and share of errors within the 95 % interval."""

    rms: float
    largest: float
    coverage: float
    located: LocatedRun


def evaluate(run: TrueRun, recorded: Sources) -> Evaluation:
    located = locate(recorded, run.time)
    absolute = recorded.chainage is not None or recorded.posts is not None
    error = located.distance - (run.distance if absolute else run.distance - START)
    return Evaluation(
        float(np.sqrt(np.mean(error**2))),
        float(np.max(np.abs(error))),
        float(np.mean(np.abs(error) <= 1.96 * located.standard_deviation)),
        located,
    )


def test_run_with_a_stop_a_tunnel_outliers_and_a_worn_wheel_is_located_within_a_metre() -> None:
    run = train_run(1, 600.0)
    result = evaluate(run, sources(run, "gdoc", SensorErrors(tunnel=(450.0, 510.0))))
    assert result.rms < 1.0
    assert result.coverage > 0.9
    assert result.located.wheel_scale == pytest.approx(0.99, abs=1e-3)
    assert np.all(np.diff(result.located.distance) >= 0.0)
    error = result.located.speed - run.speed
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_train_at_standstill_travels_no_distance_and_has_no_speed() -> None:
    run = train_run(1, 600.0)
    standing = (run.time > 345.0) & (run.time < 398.0)
    assert not run.speed[standing].any()
    for kinds in ("g", "gd", "gs", "o", "s", "goc"):
        located = locate(sources(run, kinds, SensorErrors(tunnel=(0.0, 0.0))), run.time)
        assert np.ptp(located.distance[standing]) == 0.0, kinds
        assert not located.speed[standing].any(), kinds


def test_wheel_slip_is_detected_and_does_not_increase_the_error() -> None:
    run = train_run(1, 600.0)
    rolling, slipping = (
        evaluate(run, sources(run, "goc", SensorErrors(slip=slip))) for slip in (0.0, 5.0)
    )
    assert slipping.rms < 1.1 * rolling.rms
    assert not any("slips" in note for note in rolling.located.notes)
    (note,) = (note for note in slipping.located.notes if "slips" in note)
    assert float(note.split("slips by ")[1].split(" m")[0]) == pytest.approx(5.0, abs=0.3)
    marked = run.time[(slipping.located.clock_fault & ClockFault.SLIP) != 0]
    assert 197.0 < marked[0] < 200.0
    assert 202.0 < marked[-1] < 205.0


def test_outliers_of_fixes_are_marked_and_do_not_increase_the_error() -> None:
    run = train_run(1, 300.0)
    clean = sources(run, "goc", SensorErrors(outlier_share=0.0))
    rows = np.flatnonzero(np.isfinite(not_none(clean.gnss).latitude))
    shifted = rows[20:120:10]
    latitude = not_none(clean.gnss).latitude.copy()
    latitude[shifted] += 60.0 / 111e3
    faulty = replace(clean, gnss=replace(not_none(clean.gnss), latitude=latitude))
    before, after = evaluate(run, clean), evaluate(run, faulty)
    assert after.rms < 1.1 * before.rms + 0.05
    # Fixes with a large lateral offset are not used; those that are shifted along the line are marked.
    marked = np.flatnonzero(after.located.clock_fault & ClockFault.POSITION)
    assert set(marked) <= set(shifted)


def test_noise_of_fixes_does_not_lengthen_the_distance() -> None:
    run = train_run(2, 600.0)
    for fix_std in (1.0, 3.0, 6.0):
        errors = SensorErrors(fix_std=fix_std, bias_std=0.0, outlier_share=0.0, tunnel=(0.0, 0.0))
        located = locate(sources(run, "g", errors), run.time)
        length = run.distance[-1] - run.distance[0]
        assert located.distance[-1] == pytest.approx(length, abs=3 * fix_std + 2e-4 * length)


def test_odometer_alone_counts_from_0_and_states_the_error_of_its_diameter() -> None:
    run = train_run(1, 300.0)
    located = locate(sources(run, "o", SensorErrors(wheel_scale=1.02)), run.time)
    assert located.distance[0] == 0.0
    assert located.standard_deviation[0] < 0.1
    distance = run.distance - START
    assert located.standard_deviation[-1] == pytest.approx(0.03 * distance[-1], rel=0.1)
    error = np.abs(located.distance - distance)
    assert np.all(error <= 1.96 * located.standard_deviation + 0.05)
    assert located.wheel_scale == 1.0


def test_odometer_that_fails_while_the_train_runs_is_not_used() -> None:
    run = train_run(1, 300.0)
    recorded = sources(run, "goc", SensorErrors(tunnel=(0.0, 0.0)))
    counted = not_none(recorded.odometry).distance.copy()
    failure = (run.time > 100.0) & (run.time < 140.0)
    lost = counted[failure][-1] - counted[failure][0]
    counted[failure] = counted[failure][0]
    counted[run.time >= 140.0] -= lost
    odometry = replace(not_none(recorded.odometry), distance=counted)
    result = evaluate(run, replace(recorded, odometry=odometry))
    assert result.rms < 1.5
    assert result.coverage > 0.85
    assert any("the odometer fails from" in note for note in result.located.notes)


def test_chainage_table_determines_the_direction_from_whichever_end_it_counts() -> None:
    run = train_run(1, 300.0)
    recorded, length = sources(run, "goc", SMALL_ERRORS), run.line.distance[-1]
    at, north, east = points(recorded.chainage)
    increasing = ChainageTable([0.0, length], [0.0, length / 1e3], at, north, east)
    reversed_ = ChainageTable(
        [0.0, length], [length / 1e3, 0.0], (length - at)[::-1], north[::-1], east[::-1]
    )
    decreasing = ChainageTable([0.0, length], [50.0, 50.0 - length / 1e3], at, north, east)
    located = [
        locate(replace(recorded, chainage=table), run.time)
        for table in (increasing, reversed_, decreasing)
    ]
    assert [one.direction for one in located] == [WITH, WITH, AGAINST]
    assert "runs against the line of the chainage table: distances are neg" in located[1].notes[0]
    np.testing.assert_allclose(located[1].distance + length, located[0].distance, atol=0.02)


def test_posts_determine_the_direction() -> None:
    run = train_run(1, 300.0)
    increasing = sources(run, "op", SMALL_ERRORS)
    kilometre = 50.0 - not_none(increasing.posts).kilometre
    decreasing = replace(increasing, posts=replace(not_none(increasing.posts), kilometre=kilometre))
    located = [locate(recorded, run.time) for recorded in (increasing, decreasing)]
    assert [one.direction for one in located] == [WITH, AGAINST]
    np.testing.assert_allclose(located[1].distance + 50e3, located[0].distance, atol=1e-3)


def points(table: ChainageTable | None) -> tuple[Array, Array, Array]:
    assert table is not None
    return np.asarray(table.point_distance), np.asarray(table.latitude), np.asarray(table.longitude)


@settings(max_examples=5)
@given(st.floats(-1e5, 1e5), st.floats(-1e4, 1e9))
def test_positions_do_not_depend_on_the_origins_of_distance_and_time(
    shift: float, delay: float
) -> None:
    run = train_run(3, 120.0, stop=NO_STOP)
    recorded = sources(run, "goc", SMALL_ERRORS)
    at, north, east = points(recorded.chainage)
    moved = Sources(
        replace(not_none(recorded.gnss), time=run.time + delay),
        replace(not_none(recorded.odometry), time=run.time + delay),
        chainage=ChainageTable(point_distance=at + shift, latitude=north, longitude=east),
    )
    original, shifted = locate(recorded, run.time), locate(moved, run.time + delay)
    np.testing.assert_allclose(shifted.distance - shift, original.distance, atol=0.02)
    np.testing.assert_allclose(shifted.standard_deviation, original.standard_deviation, rtol=0.05)


def test_train_that_turns_is_refused() -> None:
    run = train_run(1, 300.0)
    recorded = sources(run, "goc", SMALL_ERRORS)
    north, east = not_none(recorded.gnss).latitude, not_none(recorded.gnss).longitude
    half = len(north) // 2
    turning = replace(
        not_none(recorded.gnss),
        latitude=np.concatenate([north[:half], north[:half][::-1]]),
        longitude=np.concatenate([east[:half], east[:half][::-1]]),
    )
    with pytest.raises(DataError, match=r"go back by 100 m before 1\d\d s: the train turns"):
        locate(replace(recorded, gnss=turning, odometry=None), run.time)


def test_fixes_far_from_the_line_are_refused() -> None:
    run = train_run(1, 120.0)
    recorded = sources(run, "gc", SMALL_ERRORS)
    at, north, east = points(recorded.chainage)
    parallel = ChainageTable(point_distance=at, latitude=north + 0.01, longitude=east - 0.01)
    with pytest.raises(DataError, match="km from the line of the chainage table, expected them on"):
        locate(replace(recorded, chainage=parallel), run.time)
    elsewhere = ChainageTable(point_distance=at, latitude=north - 30.0, longitude=east)
    with pytest.raises(DataError, match="lie beyond the ends of the chainage table"):
        locate(replace(recorded, chainage=elsewhere), run.time)


def test_sources_without_positions_are_refused() -> None:
    run = train_run(1, 120.0)
    missing = np.full(len(run.time), np.nan)
    with pytest.raises(DataError, match="No position source has two values"):
        locate(Sources(GnssFixes(run.time, missing, missing)), run.time)


def test_post_whose_kilometre_occurs_twice_is_ignored() -> None:
    run = train_run(1, 300.0)
    recorded = sources(run, "op", SMALL_ERRORS)
    twice = ChainageTable([0.0, 3000.0, 3000.0, 20000.0], [0.0, 3.0, 2.0, 19.0])
    located = locate(replace(recorded, chainage=twice), run.time)
    assert any("not exactly once in the kilometrage" in note for note in located.notes)


def test_wrong_post_is_detected_by_the_others() -> None:
    run = train_run(1, 600.0)
    recorded = sources(run, "op", SensorErrors(scale_variation=1e-4))
    kilometre = not_none(recorded.posts).kilometre.copy()
    kilometre[3] += 0.3
    wrong = replace(recorded, posts=replace(not_none(recorded.posts), kilometre=kilometre))
    correct, faulty = evaluate(run, recorded), evaluate(run, wrong)
    assert faulty.rms < correct.rms + 1.0
    assert np.count_nonzero(faulty.located.clock_fault & ClockFault.POSITION) == 1


def random_column(generator: np.random.Generator, count: int, size: float) -> Array:
    """A column as a defective logger may write it."""
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


def random_sources(generator: np.random.Generator) -> tuple[Sources, Array]:
    count = int(generator.choice([2, 3, 5, 20, 300]))
    time = np.unique(generator.random(count)) * float(generator.choice([1e-3, 1.0, 60.0, 3e3]))
    count, recorded = len(time), Sources()
    north, east = (
        np.clip(random_column(generator, count, 50.0), -90, 90),
        np.clip(random_column(generator, count, 10.0), -180, 180),
    )
    counter, displayed, posts = (
        random_column(generator, count, 1e3),
        random_column(generator, count, 30.0),
        random_column(generator, count, 12.0),
    )
    if generator.random() < 0.6:
        doppler = random_column(generator, count, 30.0)
        recorded = replace(recorded, gnss=GnssFixes(time, north, east, doppler))
    if generator.random() < 0.5 and np.count_nonzero(np.isfinite(counter)) > 1:
        total, _ = unwrap_counter(counter)
        known = np.isfinite(total)
        step = float(generator.choice([0.0, 0.03, 3.0]))
        odometry = WheelOdometry(time[known], total[known], step, 0.03)
        recorded = replace(recorded, odometry=odometry)
    if generator.random() < 0.4:
        known = np.isfinite(displayed)
        speed = DisplayedSpeed(time[known], np.abs(displayed[known]), 0.28, 0.03)
        recorded = replace(recorded, displayed_speed=speed)
    if generator.random() < 0.4:
        known = np.isfinite(posts)
        recorded = replace(recorded, posts=KilometrePosts(time[known], posts[known], 5.0, 0.5))
    if generator.random() < 0.3:
        table = ChainageTable([0.0, 5e3], [10.0, 15.0], [0.0, 5e3], [50.0, 50.045], [8.0, 8.0])
        recorded = replace(recorded, chainage=table)
    return recorded, time


def check_random_sources(seeds: range) -> None:
    refused = 0
    for seed in seeds:
        recorded, time = random_sources(np.random.default_rng(seed))
        try:
            located = locate(recorded, time)
        except DataError:
            refused += 1
            continue
        for values in (located.distance, located.speed, located.standard_deviation):
            assert np.all(np.isfinite(values)), seed
        assert np.all(np.diff(located.distance) >= 0.0), seed
        assert np.all(located.speed >= 0.0), seed
    assert 0 < refused < len(seeds)


def test_defective_columns_are_refused_or_located_without_a_crash() -> None:
    check_random_sources(range(30))


@pytest.mark.acceptance
def test_many_defective_columns_are_refused_or_located_without_a_crash() -> None:
    check_random_sources(range(30, 400))


def test_odometer_that_contradicts_the_fixes_is_refused() -> None:
    run = train_run(1, 120.0, stop=NO_STOP)
    recorded = sources(run, "go", SMALL_ERRORS)
    in_feet = replace(
        not_none(recorded.odometry), distance=not_none(recorded.odometry).distance / 0.3048
    )
    with pytest.raises(
        DataError,
        match=r"ran 2\.\d+ km by the GNSS fixes but [67]\.\d+ km by its odometer or speed",
    ):
        locate(replace(recorded, odometry=in_feet), run.time)


COMBINATIONS = (
    "g",
    "gd",
    "gc",
    "gdc",
    "o",
    "s",
    "go",
    "gs",
    "op",
    "sp",
    "gop",
    "goc",
    "gsc",
    "gdoc",
    "gdocps",
)
"""Sources, with the letters of `train_runs.sources`."""

DIAMETER_NOTE = "wheel diameter "


@pytest.mark.acceptance
def test_errors_and_coverage_of_every_combination_of_sources() -> None:
    lines = [
        "\n| sources | rms, m | largest, m | within 95 % | scale error, standard errors |",
        "|---|---|---|---|---|",
    ]
    for kinds in COMBINATIONS:
        results = [
            evaluate(train_run(seed), sources(train_run(seed), kinds, seed=seed))
            for seed in range(12)
        ]
        rms = np.sqrt(np.mean([one.rms**2 for one in results]))
        largest = max(one.largest for one in results)
        coverage = float(np.mean([one.coverage for one in results]))
        lines.append(
            f"| {kinds} | {rms:.2f} | {largest:.1f} | {100 * coverage:.0f} % | {scale_error(results)} |"
        )
        assert coverage > 0.88, kinds
    sys.stdout.write("\n".join(lines) + "\n")


def scale_error(results: list[Evaluation]) -> str:
    """RMS error of the wheel scale in standard errors."""
    errors = []
    for one in results:
        for note in one.located.notes:
            if note.startswith(DIAMETER_NOTE):
                scale, std = (
                    float(part.split()[0]) for part in note.removeprefix(DIAMETER_NOTE).split(" ± ")
                )
                errors.append((scale - 0.99) / std)
    return f"{np.sqrt(np.mean(np.square(errors))):.1f}" if errors else ""

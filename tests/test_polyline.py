"""Positions brought to a line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.gnss_alignment import align_to_own_line
from trackprofile.positioning.polyline import cartesian, line_of
from trackprofile.positioning.sources import unwrapped
from train_rides import EQUATOR, SQUARED, Line, line

Array = np.ndarray


def beside(one: Line, at: Array, off: float) -> tuple[Array, Array]:
    """Latitude and longitude of places ``off`` m to the right of the line, by its heading."""
    north, east = (np.interp(at, one.distance, values) for values in (one.latitude, one.longitude))
    root = np.sqrt(1.0 - SQUARED * np.sin(np.radians(north)) ** 2)
    up, across = EQUATOR * (1.0 - SQUARED) / root**3, EQUATOR / root * np.cos(np.radians(north))
    later_north = np.interp(at + 1.0, one.distance, one.latitude)
    later_east = np.interp(at + 1.0, one.distance, one.longitude)
    forth = np.stack([np.radians(later_east - east) * across, np.radians(later_north - north) * up])
    forth /= np.linalg.norm(forth, axis=0)
    right = np.stack([forth[1], -forth[0]])
    return north + np.degrees(off * right[1] / up), east + np.degrees(off * right[0] / across)


@given(st.floats(-80.0, 80.0), st.floats(-179.0, 179.0), st.floats(0.0, 360.0))
def test_metres_are_metres_anywhere_on_earth(north: float, east: float, heading: float) -> None:
    root = np.sqrt(1.0 - SQUARED * np.sin(np.radians(north)) ** 2)
    step = 10.0
    up = step * np.cos(np.radians(heading)) * root**3 / (EQUATOR * (1.0 - SQUARED))
    across = step * np.sin(np.radians(heading)) * root / (EQUATOR * np.cos(np.radians(north)))
    latitude = north + np.degrees([-0.5 * up, 0.5 * up])
    longitude = east + np.degrees([-0.5 * across, 0.5 * across])
    apart = np.linalg.norm(np.diff(cartesian(latitude, longitude), axis=0))
    assert apart == pytest.approx(step, rel=1e-5)


@pytest.mark.parametrize("off", [0.0, 3.0, -20.0])
def test_place_along_a_line_is_found_whatever_lies_beside_it(off: float) -> None:
    one = line(4, 8000.0)
    at = np.linspace(40.0, 7900.0, 300)
    way = ChainageTable(point_distance=one.distance, latitude=one.latitude, longitude=one.longitude)
    along, away = line_of(way).placed(cartesian(*beside(one, at, off)))
    # In a curve of 400 m a place 20 m beside moves by the chord's sagitta.
    np.testing.assert_allclose(along, at, atol=0.01 + 0.03 * abs(off))
    np.testing.assert_allclose(away, abs(off), atol=0.05)


def test_places_beyond_the_ends_of_a_line_are_not_on_it() -> None:
    one = line(4, 2000.0)
    some = slice(100, 300)
    way = ChainageTable(
        point_distance=one.distance[some],
        latitude=one.latitude[some],
        longitude=one.longitude[some],
    )
    along, _ = line_of(way).placed(cartesian(one.latitude, one.longitude))
    known = np.flatnonzero(np.isfinite(along))
    assert (known[0], known[-1]) == (100, 299)


def test_coarse_points_of_a_way_make_the_same_line() -> None:
    one = line(4, 4000.0)
    fine, coarse = (
        ChainageTable(
            point_distance=one.distance[n], latitude=one.latitude[n], longitude=one.longitude[n]
        )
        for n in (slice(None), slice(None, None, 10))
    )
    points = cartesian(*beside(one, np.linspace(50.0, 3900.0, 100), 1.0))
    along = [line_of(way).placed(points)[0] for way in (fine, coarse)]
    np.testing.assert_allclose(along[1], along[0], atol=0.1)


@pytest.mark.parametrize("known_run", [True, False])
def test_line_of_noisy_positions_is_as_long_as_the_true_one(known_run: bool) -> None:
    one, generator = line(5, 9000.0), np.random.default_rng(1)
    time = np.arange(0.0, 400.0)
    at = 200.0 + 20.0 * time
    points = cartesian(*beside(one, at, 0.0))
    # Noise in the plane: across the Earth's radius there is none.
    noise = 3.0 * generator.standard_normal(points.shape)
    up = points / np.linalg.norm(points, axis=1, keepdims=True)
    noisy = points + noise - np.sum(noise * up, axis=1, keepdims=True) * up
    along, away = align_to_own_line(time, noisy, at / 0.98 if known_run else None)
    length = np.polyval(np.polyfit(time, along, 1), [0.0, time[-1]])
    naive = np.sum(np.linalg.norm(np.diff(noisy, axis=0), axis=1))
    run = at[-1] - at[0]
    assert np.diff(length)[0] == pytest.approx(run, rel=4e-4)
    assert naive > 1.01 * run
    assert np.median(away) == pytest.approx(2.0, abs=0.4)


@given(st.lists(st.integers(0, 40), min_size=40, max_size=80), st.integers(0, 255))
def test_counter_of_a_byte_counts_on_when_it_begins_again(steps: list[int], start: int) -> None:
    true = np.concatenate([[0], np.cumsum(steps)]).astype(float)
    counter = (true + start) % 256
    assume(np.max(counter) > 0.9 * 256)  # else it never came to its end
    assume(np.median(np.diff(true)[np.diff(true) > 0]) < 128)
    found, resets = unwrapped(counter)
    assert resets == 0
    np.testing.assert_array_equal(found, true)


def test_counter_that_counts_down_counts_all_the_same() -> None:
    found, _ = unwrapped(np.array([1000.0, 990.0, np.nan, 970.0]))
    np.testing.assert_array_equal(found, [0.0, 10.0, np.nan, 30.0])


def test_counter_of_one_reading_is_refused() -> None:
    with pytest.raises(DataError, match="fewer than two readings"):
        unwrapped(np.array([np.nan, 3.0]))

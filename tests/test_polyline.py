"""Projection of GNSS fixes onto a line, and unwrapping of counters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trackprofile.errors import DataError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.positioning.gnss_alignment import align_to_own_line
from trackprofile.positioning.polyline import cartesian, chainage_polyline
from trackprofile.positioning.sources import unwrap_counter
from train_runs import ECCENTRICITY_SQUARED, SEMI_MAJOR, Line, random_line

Array = np.ndarray


def shifted(line: Line, at: Array, offset: float) -> tuple[Array, Array]:
    """Latitude and longitude of points with a lateral offset, m, to the right of the line, by its heading."""
    north, east = (
        np.interp(at, line.distance, values) for values in (line.latitude, line.longitude)
    )
    root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(np.radians(north)) ** 2)
    meridian = SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED) / root**3
    parallel = SEMI_MAJOR / root * np.cos(np.radians(north))
    later_north = np.interp(at + 1.0, line.distance, line.latitude)
    later_east = np.interp(at + 1.0, line.distance, line.longitude)
    ahead = np.stack(
        [np.radians(later_east - east) * parallel, np.radians(later_north - north) * meridian]
    )
    ahead /= np.linalg.norm(ahead, axis=0)
    right = np.stack([ahead[1], -ahead[0]])
    return (
        north + np.degrees(offset * right[1] / meridian),
        east + np.degrees(offset * right[0] / parallel),
    )


def table(line: Line, rows: slice = slice(None)) -> ChainageTable:
    return ChainageTable(
        point_distance=line.distance[rows],
        latitude=line.latitude[rows],
        longitude=line.longitude[rows],
    )


@given(st.floats(-80.0, 80.0), st.floats(-179.0, 179.0), st.floats(0.0, 360.0))
def test_cartesian_coordinates_keep_distances_everywhere_on_earth(
    north: float, east: float, heading: float
) -> None:
    root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(np.radians(north)) ** 2)
    step = 10.0
    meridian = SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED)
    up = step * np.cos(np.radians(heading)) * root**3 / meridian
    parallel = SEMI_MAJOR * np.cos(np.radians(north))
    across = step * np.sin(np.radians(heading)) * root / parallel
    latitude = north + np.degrees([-0.5 * up, 0.5 * up])
    longitude = east + np.degrees([-0.5 * across, 0.5 * across])
    distance = np.linalg.norm(np.diff(cartesian(latitude, longitude), axis=0))
    assert distance == pytest.approx(step, rel=1e-5)


@pytest.mark.parametrize("offset", [0.0, 3.0, -20.0])
def test_projection_gives_distance_and_lateral_offset(offset: float) -> None:
    line = random_line(4, 8000.0)
    at = np.linspace(40.0, 7900.0, 300)
    points = cartesian(*shifted(line, at, offset))
    distance, lateral = chainage_polyline(table(line)).project(points)
    # In a curve of 400 m radius a lateral offset of 20 m moves the projection by the chord's sagitta.
    np.testing.assert_allclose(distance, at, atol=0.01 + 0.03 * abs(offset))
    np.testing.assert_allclose(lateral, abs(offset), atol=0.05)


def test_points_beyond_the_ends_of_a_line_have_no_distance() -> None:
    line = random_line(4, 2000.0)
    polyline = chainage_polyline(table(line, slice(100, 300)))
    distance, _ = polyline.project(cartesian(line.latitude, line.longitude))
    inside = np.flatnonzero(np.isfinite(distance))
    assert (inside[0], inside[-1]) == (100, 299)


def test_projection_hardly_depends_on_the_spacing_of_the_table() -> None:
    line = random_line(4, 4000.0)
    points = cartesian(*shifted(line, np.linspace(50.0, 3900.0, 100), 1.0))
    fine, coarse = (
        chainage_polyline(table(line, rows)).project(points)[0]
        for rows in (slice(None), slice(None, None, 10))
    )
    np.testing.assert_allclose(coarse, fine, atol=0.1)


@pytest.mark.parametrize("known_run", [True, False])
def test_curve_through_noisy_fixes_has_the_true_length(known_run: bool) -> None:
    line, generator = random_line(5, 9000.0), np.random.default_rng(1)
    time = np.arange(0.0, 400.0)
    at = 200.0 + 20.0 * time
    points = cartesian(*shifted(line, at, 0.0))
    # Noise in the plane of the Earth's surface only.
    noise = 3.0 * generator.standard_normal(points.shape)
    up = points / np.linalg.norm(points, axis=1, keepdims=True)
    noisy = points + noise - np.sum(noise * up, axis=1, keepdims=True) * up
    distance, lateral = align_to_own_line(time, noisy, at / 0.98 if known_run else None)
    length = np.polyval(np.polyfit(time, distance, 1), [0.0, time[-1]])
    sum_of_chords = np.sum(np.linalg.norm(np.diff(noisy, axis=0), axis=1))
    run = at[-1] - at[0]
    assert np.diff(length)[0] == pytest.approx(run, rel=4e-4)
    assert sum_of_chords > 1.01 * run
    assert np.median(lateral) == pytest.approx(2.0, abs=0.4)


@given(st.lists(st.integers(0, 40), min_size=40, max_size=80), st.integers(0, 255))
def test_counter_of_8_bits_is_unwrapped(steps: list[int], start: int) -> None:
    true = np.concatenate([[0], np.cumsum(steps)]).astype(float)
    counter = (true + start) % 256
    assume(np.max(counter) > 0.9 * 256)  # otherwise it never wrapped
    assume(np.median(np.diff(true)[np.diff(true) > 0]) < 128)
    total, resets = unwrap_counter(counter)
    assert resets == 0
    np.testing.assert_array_equal(total, true)


def test_counter_that_counts_downwards_is_unwrapped() -> None:
    total, _ = unwrap_counter(np.array([1000.0, 990.0, np.nan, 970.0]))
    np.testing.assert_array_equal(total, [0.0, 10.0, np.nan, 30.0])


def test_counter_with_one_value_is_refused() -> None:
    with pytest.raises(DataError, match="fewer than two known values"):
        unwrap_counter(np.array([np.nan, 3.0]))

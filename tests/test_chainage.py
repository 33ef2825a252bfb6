"""Kilometre posts and coordinates along a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.errors import DataError, FileError
from trackprofile.io.chainage_table import read_chainage
from trackprofile.positioning.chainage import ChainageTable


def test_kilometre_has_1000_m_without_posts() -> None:
    assert ChainageTable().name(1234.0) == "km 1.234"
    assert not ChainageTable().has_coordinates


def test_kilometrage_is_linear_between_posts_and_continues_by_1_km_per_1000_m_beyond() -> None:
    table = ChainageTable([100.0, 1108.0, 2100.0], [12.0, 13.0, 14.0])
    assert table.kilometres([100.0, 604.0, 1108.0, 2100.0, 2600.0, 0.0]) == pytest.approx(
        [12.0, 12.5, 13.0, 14.0, 14.5, 11.9]
    )


def test_kilometrage_jumps_at_two_posts_of_the_same_distance() -> None:
    table = ChainageTable([0.0, 1000.0, 1000.0, 3000.0], [5.0, 6.0, 6.3, 8.3])
    assert table.kilometres([999.0, 1000.0, 1001.0]) == pytest.approx([5.999, 6.3, 6.301])


def test_kilometrage_may_decrease_with_distance() -> None:
    table = ChainageTable([0.0, 1000.0], [6.0, 5.0])
    assert table.direction == "against the kilometrage"
    assert table.kilometres([-100.0, 250.0, 1100.0]) == pytest.approx([6.1, 5.75, 4.9])


@given(st.floats(-1e4, 2e4))
def test_kilometrage_deviates_by_at_most_as_much_as_the_posts(distance: float) -> None:
    posts = np.array([0.0, 990.0, 2010.0, 3000.0])
    table = ChainageTable(posts, [7.0, 8.0, 9.0, 10.0])
    assert abs(float(table.kilometres(distance)) - 7.0 - distance / 1000) <= 0.0101


def test_coordinates_cross_the_date_line_and_are_undefined_outside_the_table() -> None:
    table = ChainageTable((), (), [0.0, 1000.0], [60.0, 60.2], [179.99, -179.99])
    latitude, longitude = table.coordinates([250.0, 500.0, 750.0, 1200.0])
    assert latitude[:3] == pytest.approx([60.05, 60.1, 60.15])
    assert longitude[:3] == pytest.approx([179.995, -180.0, -179.995])
    assert np.isnan(latitude[3])
    assert np.isnan(longitude[3])


def test_table_with_posts_and_points_is_read(tmp_path: Path) -> None:
    file = tmp_path / "way.csv"
    file.write_text(
        "distance_m,kilometre,latitude_deg,longitude_deg\n0,12,,\n500,,47.1,8.2\n1000,13,47.2,8.3\n"
    )
    table = read_chainage(file)
    assert table.name(500.0) == "km 12.500"
    assert table.coordinates(500.0)[0] == pytest.approx(47.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "distance_m,kilometre\n0,12\n900,13.5\n",
            "row 2: its kilometre differs by more than 10 %",
        ),
        (
            "distance_m,kilometre\n0,12\n1000,13\n2000,12\n",
            "row 3: the kilometrage changes its direction",
        ),
        ("distance_m,kilometre\n1000,12\n0,13\n", "row 2: the post lies before"),
        ("distance_m,kilometre\n0,12\n", "expected two posts or more, got one"),
        ("distance_m,post\n0,12\n", "expected a column 'kilometre'"),
        ("distance_m,latitude_deg,longitude_deg\n0,91,0\n1,2,3\n", "expected -90 to 90, got 91"),
        ("distance_m,kilometre\n0,12\n500,\n1000,13.9\n", "row 3: its kilometre differs"),
        ("distance_m,kilometre\n,12\n1,13\n", "row 1: expected a number"),
    ],
)
def test_contradictory_table_is_refused_with_its_row(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "way.csv"
    file.write_text(text)
    with pytest.raises(DataError, match=message):
        read_chainage(file)


def test_missing_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="expected a chainage table"):
        read_chainage(tmp_path / "none.csv")

"""What is drawn of a pass is what all its points say, bin by bin."""

from __future__ import annotations

from datetime import date

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from network import Network
from trackprofile import store as stores
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.contracts import Quality, build_profile, content_digest
from trackprofile.errors import DataError
from trackprofile.store import Entry, Origin, PassKey, Store
from trackprofile.store.envelopes import BIN, STEP, bin_size

START, LENGTH = -137.3, 3000.0


@pytest.fixture(scope="module")
def kept() -> tuple[Store, Entry]:
    """A pass with gaps, some without rows at all, that begins before the line's zero, off the bins."""
    whole = Network(1, LENGTH, 1).passed(0, 0)
    there = np.ones(whole.sizes["distance"], bool)
    there[2000:2600] = False
    there[5001:5003] = False
    piece = whole.isel(distance=there)
    flags = piece["quality"].to_numpy().copy()
    flags[3000:3400] |= Quality.GAP
    flags[4000:4010] |= Quality.SLOW
    named = {name: piece[f"standard_deviation_{name}"].to_numpy() for name in ("D1", "D2")}
    profile = build_profile(
        piece["distance"].to_numpy() + START,
        np.where(flags & Quality.GAP, np.nan, piece["elevation"]),
        kind="posterior",
        standard_deviation=piece["standard_deviation"],
        band_standard_deviations=named,
        quality=flags,
    )
    store = stores.create("memory://strips")
    found = assess(profile, read_limits("en-13848"), 40.0)
    origin = Origin(content_digest(profile))
    return store, stores.add(
        store, PassKey("Main", "up", date(2026, 5, 1)), profile, found, origin
    ).entry


@given(
    ends=st.tuples(st.floats(-500, 3500), st.floats(-500, 3500))
    .map(sorted)
    .filter(lambda two: two[0] < two[1]),
    width=st.integers(2, 3000),
    column=st.sampled_from(["elevation", "D1", "D2", "D3"]),
)
@settings(max_examples=60, deadline=None)
def test_a_bin_holds_what_its_points_hold(
    kept: tuple[Store, Entry], ends: list[float], width: int, column: str
) -> None:
    store, entry = kept
    found = stores.envelope(store, entry, column, *ends, width)
    assert found.low.size <= width
    value = "elevation_m" if column == "elevation" else f"level_{column}_m"
    spread = "standard_deviation_m" if column == "elevation" else f"standard_deviation_{column}_m"
    rows = stores.read_columns(store, entry, [value, spread, "quality"], optional=[spread])
    distance, values = rows["distance_m"], rows[value]
    spreads = rows.get(spread, np.full(distance.size, np.nan))
    begins = found.distance - (found.bin - STEP) / 2
    touched = (begins + found.bin > distance[0]) & (begins <= distance[-1])
    assert touched.all()
    drawn = (distance >= ends[0]) & (distance <= ends[1])
    covered = np.zeros(distance.size, bool)
    for i, begin in enumerate(begins):
        inside = (distance >= begin) & (distance < begin + found.bin)
        covered |= inside
        known = inside & np.isfinite(values)
        assert _same(found.low[i], values[known].min() if known.any() else np.nan)
        assert _same(found.high[i], values[known].max() if known.any() else np.nan)
        stated = spreads[inside & np.isfinite(spreads)]
        assert _same(found.deviation[i], stated.max() if stated.size else np.nan)
        flags = np.bitwise_or.reduce(rows["quality"][inside]) if inside.any() else Quality.GAP
        assert found.quality[i] == flags
    assert covered[drawn].all()


def _same(one: float, other: float) -> bool:
    return one == other or (np.isnan(one) and np.isnan(other))


@given(
    start=st.floats(-1e6, 1e6),
    length=st.floats(0.01, 1e6),
    width=st.integers(2, 5000),
    moved=st.integers(-9, 9),
)
def test_bins_stay_where_they_are_when_a_picture_moves(
    start: float, length: float, width: int, moved: int
) -> None:
    size = bin_size(start, start + length, width)
    assert np.log2(size / STEP) % 1 == 0
    assert np.floor((start + length) / size) - np.floor(start / size) + 1 <= width
    assert size == STEP or (length + size) / (size / 2) + 1 > width  # the shortest that will do
    other = bin_size(start + moved * size, start + length + moved * size, width)
    assert other == size


def test_two_passes_have_the_same_bins(kept: tuple[Store, Entry]) -> None:
    store, entry = kept
    other = Network(1, LENGTH, 1, seed=2).passed(0, 0)
    found = assess(other, read_limits("en-13848"), 40.0)
    second = stores.add(
        store, PassKey("Main", "up", date(2026, 5, 2)), other, found, Origin(content_digest(other))
    ).entry
    one, two = (stores.envelope(store, each, "D1", 0.0, 2500.0, 300) for each in (entry, second))
    assert one.bin == two.bin == 16.0 >= BIN
    np.testing.assert_array_equal(one.distance, two.distance)


def test_a_narrow_view_shows_the_points_themselves(kept: tuple[Store, Entry]) -> None:
    store, _ = kept
    even = Network(1, 600.0, 1).passed(0, 0)
    found = assess(even, read_limits("en-13848"), 40.0)
    entry = stores.add(
        store, PassKey("Other", "up", date(2026, 5, 2)), even, found, Origin(content_digest(even))
    ).entry
    drawn = stores.envelope(store, entry, "elevation", 100.0, 200.0, 1000)
    piece = stores.read_profile(store, entry, 100.0, 200.0)
    np.testing.assert_array_equal(drawn.distance, piece["distance"])
    np.testing.assert_array_equal(drawn.low, piece["elevation"])
    np.testing.assert_array_equal(drawn.high, piece["elevation"])
    np.testing.assert_array_equal(drawn.deviation, piece["standard_deviation"])


def test_beside_a_pass_there_is_nothing(kept: tuple[Store, Entry]) -> None:
    for ends in ((-9000.0, -8000.0), (8000.0, 9000.0)):
        for width in (50, 5000):
            assert stores.envelope(*kept, "D1", *ends, width).low.size == 0


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("D9", 0.0, 100.0, 100), "has no level_D9_m; it has"),
        (("D1", 100.0, 100.0, 100), "a start before its end, got 100 m and 100 m"),
        (("D1", 0.0, float("nan"), 100), "a start before its end"),
        (("D1", 0.0, float("inf"), 100), "a start before its end"),
        (("D1", 0.0, 100.0, 1), "2 to 100000 bins wide, got 1"),
        (("D1", 0.0, 100.0, 10**9), "2 to 100000 bins wide"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    kept: tuple[Store, Entry], asked: tuple, said: str
) -> None:
    with pytest.raises(DataError, match=said):
        stores.envelope(*kept, *asked)

"""Envelopes: minimum, maximum, standard deviation and flags of all points in each bin."""

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
from trackprofile.store.envelopes import MIN_BIN_WIDTH, OVERVIEW_BIN_WIDTH, bin_width

START, LENGTH = -137.3, 3000.0


@pytest.fixture(scope="module")
def stored() -> tuple[Store, Entry]:
    """A pass with flagged gaps and missing rows, that starts at a negative chainage between bin edges."""
    whole = Network(1, LENGTH, 1).passed(0, 0)
    present = np.ones(whole.sizes["distance"], bool)
    present[2000:2600] = False
    present[5001:5003] = False
    piece = whole.isel(distance=present)
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
    store = stores.create("memory://envelopes")
    assessment = assess(profile, read_limits("en-13848"), 40.0)
    origin = Origin(content_digest(profile))
    return store, stores.add(
        store, PassKey("Main", "up", date(2026, 5, 1)), profile, assessment, origin
    ).entry


@given(
    ends=st.tuples(st.floats(-500, 3500), st.floats(-500, 3500))
    .map(sorted)
    .filter(lambda two: two[0] < two[1]),
    width=st.integers(2, 3000),
    column=st.sampled_from(["elevation", "D1", "D2", "D3"]),
)
@settings(max_examples=60, deadline=None)
def test_an_envelope_reduces_all_points_of_each_bin(
    stored: tuple[Store, Entry], ends: list[float], width: int, column: str
) -> None:
    store, entry = stored
    envelope = stores.envelope(store, entry, column, ends[0], ends[1], width)
    assert envelope.low.size <= width
    value = "elevation_m" if column == "elevation" else f"level_{column}_m"
    deviation = (
        "standard_deviation_m" if column == "elevation" else f"standard_deviation_{column}_m"
    )
    rows = stores.read_columns(store, entry, [value, deviation, "quality"], optional=[deviation])
    distance, values = rows["distance_m"], rows[value]
    deviations = rows.get(deviation, np.full(distance.size, np.nan))
    starts = envelope.distance - (envelope.bin_width - MIN_BIN_WIDTH) / 2
    overlapping = (starts + envelope.bin_width > distance[0]) & (starts <= distance[-1])
    assert overlapping.all()
    requested = (distance >= ends[0]) & (distance <= ends[1])
    covered = np.zeros(distance.size, bool)
    for i, bin_start in enumerate(starts):
        inside = (distance >= bin_start) & (distance < bin_start + envelope.bin_width)
        covered |= inside
        known = inside & np.isfinite(values)
        assert _same(envelope.low[i], values[known].min() if known.any() else np.nan)
        assert _same(envelope.high[i], values[known].max() if known.any() else np.nan)
        stated = deviations[inside & np.isfinite(deviations)]
        assert _same(envelope.deviation[i], stated.max() if stated.size else np.nan)
        flags = np.bitwise_or.reduce(rows["quality"][inside]) if inside.any() else Quality.GAP
        assert envelope.quality[i] == flags
    assert covered[requested].all()


def _same(one: float, other: float) -> bool:
    return one == other or (np.isnan(one) and np.isnan(other))


def exact(number: int) -> float:
    """A multiple of 2⁻¹⁰ m, so that sums of positions have no rounding error."""
    return number / 1024


@given(
    start=st.integers(-(2**30), 2**30).map(exact),
    length=st.integers(1, 2**30).map(exact),
    width=st.integers(2, 5000),
    moved=st.integers(-9, 9),
)
def test_bins_do_not_move_when_a_figure_is_moved(
    start: float, length: float, width: int, moved: int
) -> None:
    size = bin_width(start, start + length, width)
    assert np.log2(size / MIN_BIN_WIDTH) % 1 == 0
    assert np.floor((start + length) / size) - np.floor(start / size) + 1 <= width
    smallest_possible = (length + size) / (size / 2) + 1 > width
    assert size == MIN_BIN_WIDTH or smallest_possible
    other = bin_width(start + moved * size, start + length + moved * size, width)
    assert other == size


def test_two_passes_have_the_same_bins(stored: tuple[Store, Entry]) -> None:
    store, entry = stored
    other = Network(1, LENGTH, 1, seed=2).passed(0, 0)
    assessment = assess(other, read_limits("en-13848"), 40.0)
    second = stores.add(
        store,
        PassKey("Main", "up", date(2026, 5, 2)),
        other,
        assessment,
        Origin(content_digest(other)),
    ).entry
    one, two = (stores.envelope(store, each, "D1", 0.0, 2500.0, 300) for each in (entry, second))
    assert one.bin_width == two.bin_width == 16.0 >= OVERVIEW_BIN_WIDTH
    np.testing.assert_array_equal(one.distance, two.distance)


def test_the_envelope_of_a_short_stretch_has_one_point_per_bin(stored: tuple[Store, Entry]) -> None:
    store, _ = stored
    even = Network(1, 600.0, 1).passed(0, 0)
    assessment = assess(even, read_limits("en-13848"), 40.0)
    entry = stores.add(
        store,
        PassKey("Other", "up", date(2026, 5, 2)),
        even,
        assessment,
        Origin(content_digest(even)),
    ).entry
    envelope = stores.envelope(store, entry, "elevation", 100.0, 200.0, 1000)
    piece = stores.read_profile(store, entry, 100.0, 200.0)
    np.testing.assert_array_equal(envelope.distance, piece["distance"])
    np.testing.assert_array_equal(envelope.low, piece["elevation"])
    np.testing.assert_array_equal(envelope.high, piece["elevation"])
    np.testing.assert_array_equal(envelope.deviation, piece["standard_deviation"])


def test_the_envelope_is_empty_outside_the_pass(stored: tuple[Store, Entry]) -> None:
    for ends in ((-9000.0, -8000.0), (8000.0, 9000.0)):
        for width in (50, 5000):
            assert stores.envelope(*stored, "D1", *ends, width).low.size == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("D9", 0.0, 100.0, 100), "has no column level_D9_m; choose from"),
        (("D1", 100.0, 100.0, 100), "a start before its end, got 100 m and 100 m"),
        (("D1", 0.0, float("nan"), 100), "a start before its end"),
        (("D1", 0.0, float("inf"), 100), "a start before its end"),
        (("D1", 0.0, 100.0, 1), "2 to 100000 bins, got 1"),
        (("D1", 0.0, 100.0, 10**9), "2 to 100000 bins"),
    ],
)
def test_invalid_columns_stretches_and_widths_are_refused(
    stored: tuple[Store, Entry], arguments: tuple, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        stores.envelope(*stored, *arguments)

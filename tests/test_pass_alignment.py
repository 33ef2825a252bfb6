"""Passes laid on one line's distance, whatever their odometers count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passing_trains import SPACING, Line, Train, fleet, passing
from trackprofile.assessment.trend import DatedProfile
from trackprofile.contracts import build_profile
from trackprofile.errors import DataError
from trackprofile.fusion.pass_alignment import (
    FARTHEST,
    FINE,
    AlignedPass,
    align_passes,
    realign_passes,
)

LINE = Line(length=1500.0)


def true_place(one: AlignedPass, train: Train, as_counted: np.ndarray, middle: Train) -> np.ndarray:
    """Where the points of a pass stand, as the middle one's odometer counts."""
    true = (as_counted - train.ahead) / (1.0 + train.scale)
    return middle.ahead + (1.0 + middle.scale) * true


def test_lags_and_scales_of_odometers_are_found_to_a_millimetre() -> None:
    trains = fleet(5, seed=4)
    passes = [passing(LINE, one) for one in trains]
    found, elsewhere = align_passes(passes)
    assert not elsewhere
    middle = trains[[one.lag for one in found].index(0.0)]
    for one, train, as_run in zip(found, trains, passes, strict=True):
        expected = true_place(one, train, as_run.profile["distance"].to_numpy(), middle)
        off = one.of.profile["distance"].to_numpy() - expected
        assert np.abs(off).max() < 0.005
        assert np.abs(off).mean() < 4 * max(one.deviation.max(), 3e-4)


def test_an_odometer_that_drifts_by_many_metres_is_followed() -> None:
    """One straight line would be two metres off. Beyond the last window's middle its lag is only guessed."""
    one = passing(LINE, Train(name="one"))
    distance = one.profile["distance"].to_numpy()
    bent = distance + 4.0 * np.sin(np.pi * distance / LINE.length) ** 2
    drifting = passing(LINE, Train(name="drifting", seed=1))
    moved = drifting.profile.assign_coords(
        distance=("distance", bent, drifting.profile["distance"].attrs)
    )
    found, elsewhere = align_passes([one, DatedProfile(moved, drifting.day, "drifting")])
    assert not elsewhere
    apart = found[1].of.profile["distance"].to_numpy() - found[0].of.profile["distance"].to_numpy()
    off = np.abs(apart - np.median(apart))
    ends = int(FINE / SPACING)
    assert off[ends:-ends].max() < 0.3
    assert off.max() < 0.4


def test_the_line_counts_as_the_pass_in_the_middle_does() -> None:
    trains = [Train(name=f"{ahead}", seed=int(ahead), ahead=ahead) for ahead in (3.0, 50.0, 0.0)]
    found, _ = align_passes([passing(LINE, one) for one in trains])
    assert [round(one.lag) for one in found] == [0, 47, -3]


def test_a_pass_that_knows_next_to_nothing_does_not_move_the_middle() -> None:
    trains = [Train(name=f"{ahead}", seed=int(ahead), ahead=ahead) for ahead in (0.0, 3.0, 5.0)]
    passes = [passing(LINE, one) for one in trains]
    vague = passing(LINE, Train(name="vague", seed=9, ahead=20.0))
    spreads = {
        str(name): ("distance", 1e3 * values.to_numpy(), values.attrs)
        for name, values in vague.profile.data_vars.items() if "deviation" in str(name)
    }  # fmt: skip
    found, _ = align_passes(
        [*passes, DatedProfile(vague.profile.assign(spreads), vague.day, "vague")]
    )
    assert found[1].lag == 0.0


def test_other_track_and_the_other_way_are_told_apart() -> None:
    good = [passing(LINE, Train(name=f"{seed}", seed=seed)) for seed in range(3)]
    other = passing(replace(LINE, seed=99), Train(name="other", seed=5))
    turned = passing(LINE, Train(name="turned", seed=6))
    level = turned.profile["elevation"]
    back = turned.profile.assign(elevation=("distance", level.to_numpy()[::-1].copy(), level.attrs))
    found, elsewhere = align_passes([*good, other, DatedProfile(back, turned.day, "turned")])
    assert [one.of.name for one in found] == ["0", "1", "2"]
    assert [(one.of.name, one.turned) for one in elsewhere] == [("other", False), ("turned", True)]


def test_passes_of_which_no_more_than_half_look_alike_are_refused() -> None:
    passes = [passing(replace(LINE, seed=seed), Train(name=f"{seed}")) for seed in (1, 2, 3)]
    with pytest.raises(
        DataError, match=f"no more than half look like one another within {FARTHEST:g} m"
    ):
        align_passes(passes)


def test_a_pass_moves_by_its_lag_to_the_line_of_which_it_is_a_part() -> None:
    """What all others say is as far from the mean as the pass is, to the other side, by their weights."""
    ahead, line = passing(LINE, Train(ahead=0.5, name="ahead")), passing(LINE, Train(seed=1))
    ends = ahead.profile["distance"].to_numpy()[[0, -1]]
    others = build_profile(line.profile["distance"], line.profile["elevation"], kind="point")
    for share in (0.0, 0.25):
        moved = realign_passes(AlignedPass(ahead, 0.0, ends, np.zeros(2)), others, share)
        assert isinstance(moved, AlignedPass)
        assert moved.lag == pytest.approx((1 - share) * 0.5, abs=SPACING / 100)

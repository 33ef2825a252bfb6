"""Alignment of passes to the chainage of one line, for odometers with offsets, scale errors and drift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from passing_trains import SPACING, Line, Train, fleet, passing
from trackprofile.assessment.trend import DatedProfile
from trackprofile.contracts import build_profile
from trackprofile.errors import DataError
from trackprofile.fusion.pass_alignment import (
    ALIGNMENT_WINDOW,
    MAX_LAG,
    AlignedPass,
    align_passes,
    realign_pass,
)

LINE = Line(length=1500.0)


def true_chainage(train: Train, counted: np.ndarray, median: Train) -> np.ndarray:
    """True chainage of the points of a pass: what the median train's odometer reads at them."""
    position = (counted - train.ahead) / (1.0 + train.scale)
    return median.ahead + (1.0 + median.scale) * position


def test_offsets_and_scales_of_odometers_are_estimated_to_millimetres() -> None:
    trains = fleet(5, seed=4)
    passes = [passing(LINE, one) for one in trains]
    results, rejected = align_passes(passes)
    assert not rejected
    median = trains[[one.lag for one in results].index(0.0)]
    for one, train, given in zip(results, trains, passes, strict=True):
        expected = true_chainage(train, given.profile["distance"].to_numpy(), median)
        error = one.dated.profile["distance"].to_numpy() - expected
        assert np.abs(error).max() < 0.005
        assert np.abs(error).mean() < 4 * max(one.deviation.max(), 3e-4)


def test_the_lag_of_an_odometer_that_drifts_by_metres_is_tracked() -> None:
    """A single straight line would be two metres off. Beyond the last window's centre the lag is extrapolated."""
    one = passing(LINE, Train(name="one"))
    distance = one.profile["distance"].to_numpy()
    bent = distance + 4.0 * np.sin(np.pi * distance / LINE.length) ** 2
    drifting = passing(LINE, Train(name="drifting", seed=1))
    shifted = drifting.profile.assign_coords(
        distance=("distance", bent, drifting.profile["distance"].attrs)
    )
    results, rejected = align_passes([one, DatedProfile(shifted, drifting.day, "drifting")])
    assert not rejected
    first, second = (one.dated.profile["distance"].to_numpy() for one in results)
    error = np.abs(second - first - np.median(second - first))
    ends = int(ALIGNMENT_WINDOW / SPACING)
    assert error[ends:-ends].max() < 0.3
    assert error.max() < 0.4


def test_the_chainage_is_that_of_the_pass_with_the_median_lag() -> None:
    trains = [Train(name=f"{ahead}", seed=int(ahead), ahead=ahead) for ahead in (3.0, 50.0, 0.0)]
    results, _ = align_passes([passing(LINE, one) for one in trains])
    assert [round(one.lag) for one in results] == [0, 47, -3]


def test_a_pass_with_a_very_large_error_does_not_shift_the_median() -> None:
    trains = [Train(name=f"{ahead}", seed=int(ahead), ahead=ahead) for ahead in (0.0, 3.0, 5.0)]
    passes = [passing(LINE, one) for one in trains]
    imprecise = passing(LINE, Train(name="imprecise", seed=9, ahead=20.0))
    deviations = {
        str(name): ("distance", 1e3 * values.to_numpy(), values.attrs)
        for name, values in imprecise.profile.data_vars.items() if "deviation" in str(name)
    }  # fmt: skip
    results, _ = align_passes(
        [*passes, DatedProfile(imprecise.profile.assign(deviations), imprecise.day, "imprecise")]
    )
    assert results[1].lag == 0.0


def test_passes_over_other_track_and_in_the_opposite_direction_are_distinguished() -> None:
    good = [passing(LINE, Train(name=f"{seed}", seed=seed)) for seed in range(3)]
    other = passing(replace(LINE, seed=99), Train(name="other", seed=5))
    opposite = passing(LINE, Train(name="opposite", seed=6))
    level = opposite.profile["elevation"]
    back = opposite.profile.assign(
        elevation=("distance", level.to_numpy()[::-1].copy(), level.attrs)
    )
    results, rejected = align_passes([*good, other, DatedProfile(back, opposite.day, "opposite")])
    assert [one.dated.name for one in results] == ["0", "1", "2"]
    assert [(one.dated.name, one.reversed) for one in rejected] == [
        ("other", False),
        ("opposite", True),
    ]


def test_passes_of_which_at_most_half_correlate_are_refused() -> None:
    passes = [passing(replace(LINE, seed=seed), Train(name=f"{seed}")) for seed in (1, 2, 3)]
    with pytest.raises(
        DataError, match=f"At most half of the 3 passes correlate .* a lag of {MAX_LAG:g} m"
    ):
        align_passes(passes)


def test_a_pass_is_shifted_by_its_lag_to_the_line_of_which_it_is_a_part() -> None:
    """The lag to the others, times their weight, is the lag to the mean of all."""
    ahead, line = passing(LINE, Train(ahead=0.5, name="ahead")), passing(LINE, Train(seed=1))
    ends = ahead.profile["distance"].to_numpy()[[0, -1]]
    others = build_profile(line.profile["distance"], line.profile["elevation"], kind="point")
    for weight in (0.0, 0.25):
        shifted = realign_pass(AlignedPass(ahead, 0.0, ends, np.zeros(2)), others, weight)
        assert isinstance(shifted, AlignedPass)
        assert shifted.lag == pytest.approx((1 - weight) * 0.5, abs=SPACING / 100)

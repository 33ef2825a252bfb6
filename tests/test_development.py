"""A place through time: its rate against the truth, when a limit is reached, and passes that do not tell it."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from narrowing import floats
from test_trend import AT, COUNT, FIRST, SPACING, passing
from trackprofile.assessment.development import development
from trackprofile.assessment.limits import Action
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, D3, band_pass
from trackprofile.contracts import Quality, build_profile
from trackprofile.errors import DataError
from trackprofile.models.irregularity import Dip

PLACE = int(1000.0 / SPACING)
DIP = Dip(1.0, 6.0, 1000.0).at(floats(AT))[0]
SHAPE = {band.name: band_pass(DIP, SPACING, band)[PLACE] for band in BANDS}


def with_flag(one: DatedProfile, flag: Quality, start: float, end: float) -> DatedProfile:
    """The pass with a stretch flagged; nothing is known in a gap."""
    inside = (start <= AT) & (end >= AT)
    profile = one.profile
    elevation = profile["elevation"].to_numpy()
    changed = build_profile(
        AT,
        np.where(inside & (flag == Quality.GAP), np.nan, elevation),
        kind="posterior",
        standard_deviation=profile["standard_deviation"].to_numpy(),
        band_standard_deviations={
            band.name: profile[f"standard_deviation_{band.name}"].to_numpy() for band in BANDS
        },
        quality=np.where(inside, flag, 0).astype(np.int16),
    )
    return replace(one, profile=changed)


def test_rate_of_a_settling_place_is_the_true_one_within_what_it_states() -> None:
    misses = []
    for case in range(6):
        passes = [passing(30 * k, 0.001 * k, seed=100 * case + k) for k in range(5)]
        found = development(passes, D1, 1000.0)
        assert found.rate is not None
        true = 0.001 / 30 * SHAPE["D1"]
        misses.append((found.rate.per_day - true) / found.rate.deviation)
        assert found.is_linear
        assert [day for _, day in found.passes] == [
            FIRST + timedelta(days=30 * k) for k in range(5)
        ]
    # beside its own error, each pass is unsure by the alignment; both are stated
    assert np.sqrt(np.mean(np.square(misses))) < 2.0


def test_order_of_the_passes_is_of_no_matter() -> None:
    passes = [passing(30 * k, 0.001 * k, seed=k) for k in range(4)]
    one, other = development(passes, D1, 1000.0), development(passes[::-1], D1, 1000.0)
    assert one.passes == other.passes
    assert one.level == pytest.approx(other.level)


def test_work_on_the_track_is_no_straight_line_and_the_passes_since_are() -> None:
    depths = [0.002, 0.004, 0.006, 0.0, 0.002, 0.004]  # tamped after the third
    passes = [passing(30 * k, depth, seed=k, error=2e-5) for k, depth in enumerate(depths)]
    assert not development(passes, D1, 1000.0).is_linear
    since = development(passes[3:], D1, 1000.0)
    assert since.is_linear
    assert since.rate is not None
    assert since.rate.per_day == pytest.approx(0.002 / 30 * SHAPE["D1"], rel=0.05)


def test_a_limit_is_reached_when_the_line_reaches_it() -> None:
    passes = [passing(30 * k, 0.002 * k, seed=20 + k, error=1e-5) for k in range(5)]
    found = development(passes, D1, 1000.0, {Action.ALERT: 0.008, Action.INTERVENTION: 0.010})
    assert found.rate is not None
    for one in found.limit_crossings:
        days = (one.limit - abs(found.rate.level)) / abs(found.rate.per_day)
        assert one.median is not None
        assert (one.median - passes[-1].day).days == pytest.approx(days, abs=1.01)
    level, deviation = found.rate.predict(np.array([-60.0, 0.0, 60.0]))
    assert np.diff(level) == pytest.approx(60 * found.rate.per_day)
    assert deviation[1] < deviation[2]


@pytest.mark.parametrize(
    ("flag", "reason"), [(Quality.GAP, "gap"), (Quality.SLOW, "slow"), (Quality.SATURATED, "saturated")]
)  # fmt: skip
def test_a_pass_that_may_not_be_judged_there_is_left_out_by_name(
    flag: Quality, reason: str
) -> None:
    passes = [passing(30 * k, 0.001 * k, seed=k) for k in range(3)]
    passes[1] = with_flag(passes[1], flag, 995.0, 1005.0)
    found = development(passes, D1, 1000.0)
    assert list(found.excluded) == [passes[1].name]
    assert reason in found.excluded[passes[1].name]
    assert len(found.passes) == 2
    # 60 m on, it tells as well as the others
    assert len(development(passes, D1, 1060.0).passes) == 3


def test_the_first_pass_may_be_the_one_that_does_not_tell() -> None:
    passes = [passing(30 * k, seed=k) for k in range(3)]
    passes[0] = with_flag(passes[0], Quality.GAP, 990.0, 1010.0)
    assert [name for name, _ in development(passes, D1, 1000.0).passes] == [
        one.name for one in passes[1:]
    ]


def test_one_pass_has_a_level_as_it_states_and_no_rate() -> None:
    one = passing(0, 0.001, seed=3)
    found = development([one], D1, 1000.0)
    assert (found.rate, found.linearity_p_value, found.limit_crossings) == (None, None, ())
    assert found.deviation[0] == pytest.approx(one.profile["standard_deviation_D1"][PLACE])
    expected = band_pass(one.profile["elevation"].to_numpy(), SPACING, D1)[PLACE]
    assert found.level[0] == pytest.approx(expected)


def test_a_place_that_nobody_tells_is_refused_with_the_reasons() -> None:
    passes = [passing(30 * k, seed=k) for k in range(2)]
    with pytest.raises(DataError, match="the level in D3 is not known: edge"):
        development(passes, D3, SPACING * COUNT - 100.0)
    with pytest.raises(DataError, match="there is no pass"):
        development([], D1, 1000.0)

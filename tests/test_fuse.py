"""Many passes in one profile: how sure it is, what moves, and which pass contradicts the others."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from functools import lru_cache

import numpy as np
import pytest
import xarray as xr

from passing_trains import FIRST, VEHICLES, Line, Train, errors, fleet, passing
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, band_pass
from trackprofile.contracts import Quality, build_profile, known_elevation, validate_profile
from trackprofile.errors import DataError
from trackprofile.fusion.fuse import Fused, fuse
from trackprofile.fusion.fusion_summary import summary
from trackprofile.fusion.rejection import RejectionReason
from trackprofile.models.irregularity import Dip

LINE = Line(length=1250.0, seed=5, settled=0.002, at=700.0)
LAST = FIRST + timedelta(days=30)


@lru_cache
def good(count: int = 6, seed: int = 5) -> tuple[Train, ...]:
    return tuple(fleet(count, seed=seed))


@lru_cache
def ran(train: Train, line: Line = LINE) -> DatedProfile:
    return passing(line, train)


def passes(trains: Sequence[Train], line: Line = LINE) -> list[DatedProfile]:
    return [ran(one, line) for one in trains]


@lru_cache
def fused() -> Fused:
    return fuse(passes(good()), LAST)


def stating(one: DatedProfile, factor: float) -> DatedProfile:
    """The same pass, so many times as unsure."""
    spreads = {
        str(name): ("distance", factor * values.to_numpy(), values.attrs)
        for name, values in one.profile.data_vars.items() if "deviation" in str(name)
    }  # fmt: skip
    return DatedProfile(one.profile.assign(spreads), one.day, one.name)


def with_level(
    one: DatedProfile, level: np.ndarray, quality: np.ndarray | None = None
) -> DatedProfile:
    profile = one.profile.assign(elevation=("distance", level, one.profile["elevation"].attrs))
    if quality is not None:
        profile["quality"].values[:] = quality
    return DatedProfile(profile, one.day, one.name)


def apart(one: Fused, other: Fused) -> dict[str, float]:
    """Root mean square of the difference in each band over what the first states."""
    grid = one.profile["distance"].to_numpy()
    first, second = known_elevation(one.profile), known_elevation(other.profile)
    second = np.interp(grid, other.profile["distance"], second)
    return {
        band.name: float(
            np.std(band_pass(first - second, 0.25, band)[400:-400])
            / one.profile[f"standard_deviation_{band.name}"].median()
        )
        for band in BANDS
    }


def test_good_passes_make_a_better_profile_and_none_is_accused() -> None:
    found = fused()
    assert not found.contradictions
    validate_profile(found.profile)
    assert found.profile.attrs["method"] == "fusion of 6 passes"
    assert found.profile.attrs["kind"] == "posterior"
    for band, (error, spread) in errors(found, LINE, good(), 30.0).items():
        best = min(
            float(one.profile[f"standard_deviation_{band}"].median()) for one in passes(good())
        )
        assert np.median(spread) < 0.8 * best, band
        assert error.std() < 1.4 * np.sqrt(np.mean(spread**2)), band


def test_what_settles_is_found_with_its_rate() -> None:
    found = fused()
    depth = band_pass(Dip(1.0, 6.0, 700.0).at(np.arange(0.0, 1400.0, 0.25))[0], 0.25, D1).min()
    (place,) = [one for one in found.moving if one.band == "D1"]
    assert place.per_day == pytest.approx(0.002 / 30 * depth, abs=4 * place.deviation)
    assert place.deviation < 0.1 * abs(place.per_day)
    assert place.start < place.peak < place.end
    rate = band_pass(found.profile["rate"].to_numpy(), 0.25, D1)
    still = np.abs(found.profile["distance"].to_numpy() - place.peak) > 120.0
    assert np.abs(rate[still]).max() < 0.1 * abs(place.per_day)
    assert found.profile["rate"].attrs["units"] == "m/day"


@pytest.mark.acceptance
def test_the_level_is_that_of_the_day_asked_for() -> None:
    early = fuse(passes(good()), FIRST)
    change = fused().profile["elevation"] - early.profile["elevation"]
    expected = 30 * fused().profile["rate"]
    assert np.abs(change - expected).max() < 1e-6


@pytest.mark.acceptance
def test_track_that_stands_is_known_on_the_last_day_by_the_passes_of_all_days() -> None:
    still = replace(LINE, settled=0.0)
    found = fuse(passes(good(), still), LAST)
    assert not found.moving
    of_one_day = [replace(one, day=30) for one in good()]
    at_once = fuse(passes(of_one_day, still), LAST)
    for band in BANDS:
        name = f"standard_deviation_{band.name}"
        ratio = found.profile[name].median() / at_once.profile[name].median()
        assert ratio < 1.15, band.name


@pytest.mark.acceptance
def test_passes_of_one_day_have_no_rate_and_it_is_said() -> None:
    found = fuse(passes([replace(one, day=3) for one in good(3)]))
    assert (found.profile["rate"] == 0).all()
    assert f"All passes are of {FIRST + timedelta(days=3)}: there is no rate" in found.notes


@pytest.mark.acceptance
def test_a_day_beyond_the_passes_rests_on_the_rate_and_it_is_said() -> None:
    later = fuse(passes(good()), LAST + timedelta(days=60))
    assert any("the level there rests on the rate" in one for one in later.notes)
    at = int(np.argmin(later.profile["rate"].to_numpy()))
    assert (
        later.profile["standard_deviation_D1"][at]
        > 2 * fused().profile["standard_deviation_D1"][at]
    )


def test_one_pass_alone_comes_back_as_itself() -> None:
    one = ran(good()[0])
    found = fuse([one])
    for name in one.profile.data_vars:
        assert (found.profile[name] == one.profile[name]).all(), name
    assert (found.profile["rate"] == 0).all()


@pytest.mark.acceptance
def test_the_order_of_the_passes_makes_no_difference() -> None:
    every = passes(good(3))
    first, other = fuse(every), fuse([every[number] for number in (2, 0, 1)])
    xr.testing.assert_identical(first.profile, other.profile)
    assert first.members == other.members


@pytest.mark.acceptance
def test_a_unit_of_a_third_of_a_metre_makes_no_difference() -> None:
    def threefold(one: DatedProfile) -> DatedProfile:
        return stating(with_level(one, 3 * one.profile["elevation"].to_numpy()), 3.0)

    first, other = fuse(passes(good(4))), fuse([threefold(one) for one in passes(good(4))])
    for name in ("elevation", "standard_deviation_D1", "standard_deviation_D3", "rate"):
        expected, got = 3 * first.profile[name].to_numpy(), other.profile[name].to_numpy()
        assert np.abs(got - expected).max() < 1e-3 * np.abs(expected).max(), name


@pytest.mark.acceptance
def test_a_pass_that_knows_next_to_nothing_changes_nothing() -> None:
    useless = stating(ran(replace(good()[1], name="useless", seed=999)), 1000.0)
    found = fuse([*passes(good()), useless], LAST)
    assert not found.contradictions
    for band, ratio in apart(fused(), found).items():
        assert ratio < 0.2, band
    spread = [one.profile["standard_deviation_D1"].median() for one in (fused(), found)]
    assert spread[1] == pytest.approx(float(spread[0]), rel=0.03)
    assert next(one for one in found.members if one.name == "useless").share["D1"] < 1e-3


# Which pass contradicts the others


def accused(number: int, **fault: object) -> Fused:
    trains = [replace(one, **fault) if i == number else one for i, one in enumerate(good())]
    return fuse(passes(trains), LAST)


FAULTS: list[tuple[dict[str, object], RejectionReason, bool]] = [
    ({"gain": 1.05}, RejectionReason.GAIN, False),
    ({"gain": 0.95}, RejectionReason.GAIN, False),
    ({"distortion": (0.1, -0.05)}, RejectionReason.VEHICLE, False),
    ({"louder": 4.0}, RejectionReason.NOISE, True),
    ({"ahead": 43.0}, RejectionReason.LAG, True),
]


@pytest.mark.parametrize(
    ("fault", "reason", "used"),
    [FAULTS[0], *(pytest.param(*one, marks=pytest.mark.acceptance) for one in FAULTS[1:])],
)
def test_a_pass_that_contradicts_the_others_is_named_with_its_reason(
    fault: dict[str, object], reason: RejectionReason, used: bool
) -> None:
    found = accused(2, **fault)
    (one,) = found.contradictions
    assert (one.name, one.reason, one.used) == ("pass 2", reason, used)
    if reason is RejectionReason.GAIN:
        assert one.size == pytest.approx(fault["gain"], abs=0.002)
    if reason is RejectionReason.LAG:
        assert one.size == pytest.approx(43.0, abs=8.0)
    assert any(sentence.startswith("pass 2 contradicts the others") for sentence in summary(found))
    # The others are as good as five of six are.
    six = fused().profile["standard_deviation_D1"].median()
    assert found.profile["standard_deviation_D1"].median() < 1.1 * np.sqrt(6 / 5) * six


@pytest.mark.acceptance
def test_other_track_is_left_out() -> None:
    every = passes(good())
    every[2] = ran(good()[2], replace(LINE, seed=77))
    found = fuse(every, LAST)
    (one,) = found.contradictions
    assert (one.name, one.reason, one.used) == ("pass 2", RejectionReason.ELSEWHERE, False)
    assert "left out: pass 2" in found.profile.attrs["provenance"]
    assert next(each for each in found.members if each.name == "pass 2").lag is None


def test_a_fault_of_a_stretch_costs_the_pass_that_stretch_only() -> None:
    every = passes(good())
    level = every[0].profile["elevation"].to_numpy().copy()
    at = every[0].profile["distance"].to_numpy()
    here = (at > 350) & (at < 420)
    level[here] += 5e-4 * np.sin(2 * np.pi * at[here] / 9) * np.hanning(np.count_nonzero(here))
    found = fuse([with_level(every[0], level), *every[1:]], LAST)
    (one,) = found.contradictions
    assert one.name == "pass 0"
    assert one.used
    assert one.start < 385 < one.end
    assert one.end - one.start < 600
    assert apart(fused(), found)["D1"] < 0.6


@pytest.mark.acceptance
def test_a_vehicle_that_is_wrong_in_all_its_passes_is_named() -> None:
    trains = [
        replace(one, distortion=(0.05, -0.03)) if one.vehicle == "velaro" else one
        for one in good(9)
    ]
    found = fuse(passes(trains), LAST)
    assert any("passes of 'velaro' share an error" in note for note in found.notes)
    assert not any("of 'multiple-unit' share" in note for note in found.notes)
    for band, (error, spread) in errors(found, LINE, trains, 30.0).items():
        assert error.std() < 2 * np.sqrt(np.mean(spread**2)), band


@pytest.mark.acceptance
def test_of_two_vehicles_none_is_accused_and_the_line_is_no_surer_than_they_agree() -> None:
    trains = [
        replace(one, vehicle=VEHICLES[i % 2], distortion=(0.05, -0.03) if i % 2 else (0.0, 0.0))
        for i, one in enumerate(good())
    ]
    found = fuse(passes(trains), LAST)
    assert not found.contradictions
    assert any("which of them is right cannot be told" in note for note in found.notes)
    error, spread = errors(found, LINE, trains, 30.0)["D1"]
    assert error.std() < 1.5 * np.sqrt(np.mean(spread**2))
    assert spread.mean() > 5 * fused().profile["standard_deviation_D1"].mean()


@pytest.mark.acceptance
def test_one_vehicle_alone_is_said_to_show_nothing_of_what_it_has_wrong() -> None:
    found = fuse(passes([replace(one, vehicle="velaro") for one in good(3)]), LAST)
    assert any("of one vehicle, 'velaro'" in note for note in found.notes)


@pytest.mark.acceptance
def test_what_passes_of_one_vehicle_state_but_do_not_show_is_shared() -> None:
    """A calibrated vehicle's uncertainty is in each profile, and the same in all."""
    trains = [replace(one, vehicle="velaro") for one in good()]
    found = fuse([stating(one, 3.0) for one in passes(trains)], LAST)
    assert any("scatter less than they state" in note for note in found.notes)
    least = min(float(one.profile["standard_deviation_D1"].median()) for one in passes(trains))
    assert found.profile["standard_deviation_D1"].median() > 0.8 * 3 * np.sqrt(8 / 9) * least


@pytest.mark.acceptance
def test_passes_that_understate_their_error_are_taken_at_their_scatter() -> None:
    found = fuse([stating(one, 1 / 3) for one in passes(good())], LAST)
    assert any("scatter" in note and note.startswith("D1") for note in found.notes)
    for band in BANDS:
        name = f"standard_deviation_{band.name}"
        ratio = float(found.profile[name].median() / fused().profile[name].median())
        assert 0.75 < ratio < 1.3, band.name


def test_gaps_and_ends_of_passes_leave_no_step() -> None:
    """A pass begins, another ends, a third has a gap: the line runs on."""
    trains = list(good())
    trains[1], trains[4] = replace(trains[1], start=400.0), replace(trains[4], end=800.0)
    every = passes(trains)
    at = every[2].profile["distance"].to_numpy()
    gap = (at > 550) & (at < 590)
    level = np.where(gap, np.nan, every[2].profile["elevation"].to_numpy())
    every[2] = with_level(every[2], level, np.where(gap, Quality.GAP, 0).astype(np.int16))
    found = fuse(every, LAST)
    assert not found.contradictions
    for band, (error, spread) in errors(found, LINE, trains, 30.0).items():
        assert np.abs(error).max() < 5 * spread.max(), band


def test_where_no_pass_says_anything_there_is_a_gap() -> None:
    every = []
    for one in passes(good(3)):
        at = one.profile["distance"].to_numpy()
        gap = (at > 540) & (at < 620)
        level = np.where(gap, np.nan, one.profile["elevation"].to_numpy())
        every.append(with_level(one, level, np.where(gap, Quality.GAP, 0).astype(np.int16)))
    found = fuse(every)
    inside = np.abs(found.profile["distance"].to_numpy() - 580.0) < 20.0
    assert np.isnan(found.profile["elevation"].to_numpy()[inside]).all()
    assert (found.profile["quality"].to_numpy()[inside] & Quality.GAP).all()


def test_passes_that_cannot_be_fused_are_refused() -> None:
    one = ran(good()[0])
    with pytest.raises(DataError, match="no pass to fuse"):
        fuse([])
    with pytest.raises(DataError, match="Two passes are called 'pass 0'"):
        fuse([one, one])
    loaded = DatedProfile(one.profile.assign_attrs(loading="loaded"), one.day, "loaded")
    with pytest.raises(DataError, match="infer all of them with the same track"):
        fuse([one, loaded])
    point = build_profile(one.profile["distance"], one.profile["elevation"], kind="point")
    with pytest.raises(DataError, match="vague: it does not state its standard deviation"):
        fuse([one, DatedProfile(point, one.day, "vague")])


# Over many lines


@pytest.mark.acceptance
def test_error_and_stated_deviation_fall_together_with_the_number_of_passes() -> None:
    """The manual's table: lines of 3 km that settle by 2 mm in a month, ideal passes of three vehicles."""
    for count in (5, 10, 20):
        every: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {band.name: [] for band in BANDS}
        for seed in range(10):
            line, trains = Line(length=3000.0, seed=seed, settled=0.002), good(count, seed)
            found = fuse([passing(line, one) for one in trains], LAST)
            assert not found.contradictions, (count, seed, found.contradictions)
            for band, one in errors(found, line, trains, 30.0).items():
                every[band].append(one)
        for band, ones in every.items():
            error, spread = (np.concatenate(each) for each in zip(*ones, strict=True))
            inside = float(np.mean(np.abs(error) < 1.96 * spread))
            size, stated = (1e3 * np.sqrt(np.mean(each**2)) for each in (error, spread))
            sys.stdout.write(
                f"{count:2} passes, {band}: error {size:.4f} mm, stated {stated:.4f} mm, inside {inside:.1%}\n"
            )
            assert 0.90 <= inside <= 0.98, (count, band)
            assert 0.8 < size / stated < 1.2, (count, band)


@pytest.mark.acceptance
@pytest.mark.parametrize("count", [5, 10, 20])
def test_a_pass_that_contradicts_the_others_is_found_among_few_and_many(count: int) -> None:
    """And no other is accused with it."""
    said = []
    for seed in range(3):
        line = Line(length=1250.0, seed=300 + seed, settled=0.002)
        for number, (fault, reason, _) in enumerate(FAULTS):
            bad = (number + seed) % count
            trains = [
                replace(one, **fault) if i == bad else one
                for i, one in enumerate(good(count, 300 + seed))
            ]
            found = fuse([passing(line, one) for one in trains], LAST).contradictions
            assert {one.name for one in found} == {f"pass {bad}"}, (seed, fault, found)
            said.append(any(one.reason is reason for one in found))
    sys.stdout.write(
        f"{count} passes: each of {len(said)} faults found, {sum(said)} for what they are\n"
    )
    assert np.mean(said) >= 0.8


@pytest.mark.acceptance
def test_good_passes_are_not_accused() -> None:
    for seed in range(20):
        line = Line(length=2000.0, seed=100 + seed, settled=0.002)
        found = fuse([passing(line, one) for one in good(6, 100 + seed)], LAST)
        assert not found.contradictions, (seed, found.contradictions)


@pytest.mark.acceptance
def test_track_that_stands_is_not_said_to_move() -> None:
    said = []
    for seed in range(20):
        line = Line(length=2000.0, seed=200 + seed)
        found = fuse([passing(line, one) for one in good(6, 200 + seed)], LAST)
        said.append(bool(found.moving))
    assert np.mean(said) <= 0.1

"""Fusion of passes: error and stated standard deviation, changing track, and passes that contradict the others."""

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
from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, band_pass
from trackprofile.contracts import Quality, build_profile, known_elevation, validate_profile
from trackprofile.errors import DataError
from trackprofile.fusion.fuse import FusionResult, fuse
from trackprofile.fusion.fusion_summary import fusion_summary
from trackprofile.fusion.rejection import RejectionReason
from trackprofile.models.irregularity import Dip

LINE = Line(length=1250.0, seed=5, settled=0.002, at=700.0)
LAST = FIRST + timedelta(days=30)


@lru_cache
def good_trains(count: int = 6, seed: int = 5) -> tuple[Train, ...]:
    return tuple(fleet(count, seed=seed))


@lru_cache
def pass_of(train: Train, line: Line = LINE) -> DatedProfile:
    return passing(line, train)


def passes_of(trains: Sequence[Train], line: Line = LINE) -> list[DatedProfile]:
    return [pass_of(one, line) for one in trains]


@lru_cache
def good_fusion() -> FusionResult:
    return fuse(passes_of(good_trains()), LAST)


def with_deviations_times(one: DatedProfile, factor: float) -> DatedProfile:
    """The pass with its stated standard deviations multiplied by a factor."""
    deviations = {
        str(name): ("distance", factor * values.to_numpy(), values.attrs)
        for name, values in one.profile.data_vars.items() if "deviation" in str(name)
    }  # fmt: skip
    return DatedProfile(one.profile.assign(deviations), one.day, one.name)


def with_level(
    one: DatedProfile, level: np.ndarray, quality: np.ndarray | None = None
) -> DatedProfile:
    profile = one.profile.assign(elevation=("distance", level, one.profile["elevation"].attrs))
    if quality is not None:
        profile["quality"].values[:] = quality
    return DatedProfile(profile, one.day, one.name)


def relative_difference(one: FusionResult, other: FusionResult) -> dict[str, float]:
    """RMS of the difference in each band over the standard deviation that the first states."""
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


def test_the_fusion_of_good_passes_has_a_smaller_error_and_reports_no_contradiction() -> None:
    result = good_fusion()
    assert not result.contradictions
    validate_profile(result.profile)
    assert result.profile.attrs["method"] == "fusion of 6 passes"
    assert result.profile.attrs["kind"] == "posterior"
    for band, (error, deviation) in errors(result, LINE, good_trains(), 30.0).items():
        best = min(
            float(one.profile[f"standard_deviation_{band}"].median())
            for one in passes_of(good_trains())
        )
        assert np.median(deviation) < 0.8 * best, band
        assert error.std() < 1.4 * np.sqrt(np.mean(deviation**2)), band


def test_settlement_is_detected_with_its_rate() -> None:
    result = good_fusion()
    depth = band_pass(Dip(1.0, 6.0, 700.0).at(np.arange(0.0, 1400.0, 0.25))[0], 0.25, D1).min()
    (location,) = [one for one in result.changing if one.band == "D1"]
    assert location.per_day == pytest.approx(0.002 / 30 * depth, abs=4 * location.deviation)
    assert location.deviation < 0.1 * abs(location.per_day)
    assert location.start < location.peak < location.end
    rate = band_pass(result.profile["rate"].to_numpy(), 0.25, D1)
    unchanged = np.abs(result.profile["distance"].to_numpy() - location.peak) > 120.0
    assert np.abs(rate[unchanged]).max() < 0.1 * abs(location.per_day)
    assert result.profile["rate"].attrs["units"] == "m/day"


@pytest.mark.acceptance
def test_the_level_is_that_of_the_requested_day() -> None:
    early = fuse(passes_of(good_trains()), FIRST)
    change = good_fusion().profile["elevation"] - early.profile["elevation"]
    expected = 30 * good_fusion().profile["rate"]
    assert np.abs(change - expected).max() < 1e-6


@pytest.mark.acceptance
def test_the_level_of_unchanged_track_uses_the_passes_of_all_days() -> None:
    unchanged = replace(LINE, settled=0.0)
    result = fuse(passes_of(good_trains(), unchanged), LAST)
    assert not result.changing
    of_one_day = [replace(one, day=30) for one in good_trains()]
    on_one_day = fuse(passes_of(of_one_day, unchanged), LAST)
    for band in BANDS:
        name = f"standard_deviation_{band.name}"
        ratio = result.profile[name].median() / on_one_day.profile[name].median()
        assert ratio < 1.15, band.name


@pytest.mark.acceptance
def test_passes_of_one_day_have_no_rate_and_a_note_reports_it() -> None:
    result = fuse(passes_of([replace(one, day=3) for one in good_trains(3)]))
    assert (result.profile["rate"] == 0).all()
    assert f"All passes are of {FIRST + timedelta(days=3)}: the profile has no rate" in result.notes


@pytest.mark.acceptance
def test_the_level_of_a_later_day_is_extrapolated_and_a_note_reports_it() -> None:
    later = fuse(passes_of(good_trains()), LAST + timedelta(days=60))
    assert any("its level is extrapolated by the rate" in one for one in later.notes)
    at = int(np.argmin(later.profile["rate"].to_numpy()))
    assert (
        later.profile["standard_deviation_D1"][at]
        > 2 * good_fusion().profile["standard_deviation_D1"][at]
    )


def test_a_single_pass_is_returned_unchanged() -> None:
    one = pass_of(good_trains()[0])
    result = fuse([one])
    for name in one.profile.data_vars:
        assert (result.profile[name] == one.profile[name]).all(), name
    assert (result.profile["rate"] == 0).all()


@pytest.mark.acceptance
def test_the_order_of_the_passes_makes_no_difference() -> None:
    given = passes_of(good_trains(3))
    first, other = fuse(given), fuse([given[number] for number in (2, 0, 1)])
    xr.testing.assert_identical(first.profile, other.profile)
    assert first.passes == other.passes


@pytest.mark.acceptance
def test_the_unit_of_the_elevation_makes_no_difference() -> None:
    def threefold(one: DatedProfile) -> DatedProfile:
        return with_deviations_times(with_level(one, 3 * one.profile["elevation"].to_numpy()), 3.0)

    first, other = (
        fuse(passes_of(good_trains(4))),
        fuse([threefold(one) for one in passes_of(good_trains(4))]),
    )
    for name in ("elevation", "standard_deviation_D1", "standard_deviation_D3", "rate"):
        expected, got = 3 * first.profile[name].to_numpy(), other.profile[name].to_numpy()
        assert np.abs(got - expected).max() < 1e-3 * np.abs(expected).max(), name


@pytest.mark.acceptance
def test_a_pass_with_a_very_large_error_changes_nothing() -> None:
    useless = with_deviations_times(
        pass_of(replace(good_trains()[1], name="useless", seed=999)), 1000.0
    )
    result = fuse([*passes_of(good_trains()), useless], LAST)
    assert not result.contradictions
    for band, ratio in relative_difference(good_fusion(), result).items():
        assert ratio < 0.2, band
    deviation = [one.profile["standard_deviation_D1"].median() for one in (good_fusion(), result)]
    assert deviation[1] == pytest.approx(float(deviation[0]), rel=0.03)
    assert next(one for one in result.passes if one.name == "useless").share["D1"] < 1e-3


# Passes that contradict the others


def fusion_with_fault(number: int, **fault: object) -> FusionResult:
    trains = [replace(one, **fault) if i == number else one for i, one in enumerate(good_trains())]
    return fuse(passes_of(trains), LAST)


FAULTS: list[tuple[dict[str, object], RejectionReason, bool]] = [
    ({"gain": 1.05}, RejectionReason.GAIN, False),
    ({"gain": 0.95}, RejectionReason.GAIN, False),
    ({"distortion": (0.1, -0.05)}, RejectionReason.VEHICLE, False),
    ({"noise_ratio": 4.0}, RejectionReason.NOISE, True),
    ({"ahead": 43.0}, RejectionReason.LAG, True),
]


@pytest.mark.parametrize(
    ("fault", "reason", "used"),
    [FAULTS[0], *(pytest.param(*one, marks=pytest.mark.acceptance) for one in FAULTS[1:])],
)
def test_a_contradicting_pass_is_reported_with_its_reason(
    fault: dict[str, object], reason: RejectionReason, used: bool
) -> None:
    result = fusion_with_fault(2, **fault)
    (one,) = result.contradictions
    assert (one.name, one.reason, one.used) == ("pass 2", reason, used)
    if reason is RejectionReason.GAIN:
        assert one.magnitude == pytest.approx(fault["gain"], abs=0.002)
    if reason is RejectionReason.LAG:
        assert one.magnitude == pytest.approx(43.0, abs=8.0)
    assert any(
        sentence.startswith("pass 2 contradicts the others") for sentence in fusion_summary(result)
    )
    # The others have the error of five out of six passes.
    six = good_fusion().profile["standard_deviation_D1"].median()
    assert result.profile["standard_deviation_D1"].median() < 1.1 * np.sqrt(6 / 5) * six


@pytest.mark.acceptance
def test_a_pass_over_other_track_is_left_out() -> None:
    given = passes_of(good_trains())
    given[2] = pass_of(good_trains()[2], replace(LINE, seed=77))
    result = fuse(given, LAST)
    (one,) = result.contradictions
    assert (one.name, one.reason, one.used) == ("pass 2", RejectionReason.OTHER_TRACK, False)
    assert "left out: pass 2" in result.profile.attrs["provenance"]
    assert next(each for each in result.passes if each.name == "pass 2").lag is None


def test_a_fault_on_a_stretch_down_weights_the_pass_on_that_stretch_only() -> None:
    given = passes_of(good_trains())
    level = given[0].profile["elevation"].to_numpy().copy()
    at = given[0].profile["distance"].to_numpy()
    faulty = (at > 350) & (at < 420)
    window = np.hanning(np.count_nonzero(faulty))
    level[faulty] += 5e-4 * np.sin(2 * np.pi * at[faulty] / 9) * window
    result = fuse([with_level(given[0], level), *given[1:]], LAST)
    (one,) = result.contradictions
    assert one.name == "pass 0"
    assert one.used
    assert one.start < 385 < one.end
    assert one.end - one.start < 600
    assert relative_difference(good_fusion(), result)["D1"] < 0.6


@pytest.mark.acceptance
def test_a_vehicle_with_an_error_common_to_all_its_passes_is_reported() -> None:
    trains = [
        replace(one, distortion=(0.05, -0.03)) if one.vehicle == "velaro" else one
        for one in good_trains(9)
    ]
    result = fuse(passes_of(trains), LAST)
    assert any("passes of 'velaro' have a common error" in note for note in result.notes)
    assert not any("of 'multiple-unit' have a common error" in note for note in result.notes)
    for band, (error, deviation) in errors(result, LINE, trains, 30.0).items():
        assert error.std() < 2 * np.sqrt(np.mean(deviation**2)), band


@pytest.mark.acceptance
def test_of_two_vehicles_none_is_rejected_and_the_stated_error_includes_their_difference() -> None:
    trains = [
        replace(one, vehicle=VEHICLES[i % 2], distortion=(0.05, -0.03) if i % 2 else (0.0, 0.0))
        for i, one in enumerate(good_trains())
    ]
    result = fuse(passes_of(trains), LAST)
    assert not result.contradictions
    assert any("do not determine which of the two is right" in note for note in result.notes)
    error, deviation = errors(result, LINE, trains, 30.0)["D1"]
    assert error.std() < 1.5 * np.sqrt(np.mean(deviation**2))
    assert deviation.mean() > 5 * good_fusion().profile["standard_deviation_D1"].mean()


@pytest.mark.acceptance
def test_a_note_reports_that_a_single_vehicle_does_not_reveal_its_common_error() -> None:
    result = fuse(passes_of([replace(one, vehicle="velaro") for one in good_trains(3)]), LAST)
    assert any("of one vehicle, 'velaro'" in note for note in result.notes)


@pytest.mark.acceptance
def test_a_single_vehicles_stated_variance_beyond_its_scatter_is_a_common_error() -> None:
    """The uncertainty of a calibrated vehicle is in each profile, and the error is equal in all."""
    trains = [replace(one, vehicle="velaro") for one in good_trains()]
    result = fuse([with_deviations_times(one, 3.0) for one in passes_of(trains)], LAST)
    assert any("scatter less than they state" in note for note in result.notes)
    smallest = min(
        float(one.profile["standard_deviation_D1"].median()) for one in passes_of(trains)
    )
    assert result.profile["standard_deviation_D1"].median() > 0.8 * 3 * np.sqrt(8 / 9) * smallest


@pytest.mark.acceptance
def test_understated_variances_are_increased_to_the_scatter_of_the_passes() -> None:
    result = fuse([with_deviations_times(one, 1 / 3) for one in passes_of(good_trains())], LAST)
    assert any("scatter" in note and note.startswith("D1") for note in result.notes)
    for band in BANDS:
        name = f"standard_deviation_{band.name}"
        ratio = float(result.profile[name].median() / good_fusion().profile[name].median())
        assert 0.75 < ratio < 1.3, band.name


def test_gaps_and_ends_of_passes_cause_no_step() -> None:
    """One pass starts late, another ends early, a third has a gap."""
    trains = list(good_trains())
    trains[1], trains[4] = replace(trains[1], start=400.0), replace(trains[4], end=800.0)
    given = passes_of(trains)
    at = given[2].profile["distance"].to_numpy()
    gap = (at > 550) & (at < 590)
    level = np.where(gap, np.nan, given[2].profile["elevation"].to_numpy())
    given[2] = with_level(given[2], level, np.where(gap, Quality.GAP, 0).astype(np.int16))
    result = fuse(given, LAST)
    assert not result.contradictions
    for band, (error, deviation) in errors(result, LINE, trains, 30.0).items():
        assert np.abs(error).max() < 5 * deviation.max(), band


def test_where_all_passes_have_a_gap_the_line_has_one() -> None:
    given = []
    for one in passes_of(good_trains(3)):
        at = one.profile["distance"].to_numpy()
        gap = (at > 540) & (at < 620)
        level = np.where(gap, np.nan, one.profile["elevation"].to_numpy())
        given.append(with_level(one, level, np.where(gap, Quality.GAP, 0).astype(np.int16)))
    result = fuse(given)
    inside = np.abs(result.profile["distance"].to_numpy() - 580.0) < 20.0
    assert np.isnan(result.profile["elevation"].to_numpy()[inside]).all()
    assert (result.profile["quality"].to_numpy()[inside] & Quality.GAP).all()


def test_passes_that_cannot_be_fused_are_refused() -> None:
    one = pass_of(good_trains()[0])
    with pytest.raises(DataError, match="no pass to fuse"):
        fuse([])
    with pytest.raises(DataError, match="Two passes have the name 'pass 0'"):
        fuse([one, one])
    loaded = DatedProfile(one.profile.assign_attrs(loading="loaded"), one.day, "loaded")
    with pytest.raises(DataError, match="infer all of them with the same track"):
        fuse([one, loaded])
    point = build_profile(one.profile["distance"], one.profile["elevation"], kind="point")
    with pytest.raises(
        DataError, match="imprecise: the profile does not state its standard deviation"
    ):
        fuse([one, DatedProfile(point, one.day, "imprecise")])


# Statistics over many lines


@pytest.mark.acceptance
def test_error_and_stated_deviation_fall_together_with_the_number_of_passes() -> None:
    """Table in the manual: lines of 3 km that settle by 2 mm in a month, ideal passes of three vehicles."""
    for count in (5, 10, 20):
        by_band: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {band.name: [] for band in BANDS}
        for seed in range(10):
            line, trains = Line(length=3000.0, seed=seed, settled=0.002), good_trains(count, seed)
            result = fuse([passing(line, one) for one in trains], LAST)
            assert not result.contradictions, (count, seed, result.contradictions)
            for band, one in errors(result, line, trains, 30.0).items():
                by_band[band].append(one)
        for band, ones in by_band.items():
            error, deviation = (np.concatenate(each) for each in zip(*ones, strict=True))
            inside = float(np.mean(np.abs(error) < NORMAL_95 * deviation))
            size, stated = (1e3 * np.sqrt(np.mean(each**2)) for each in (error, deviation))
            sys.stdout.write(
                f"{count:2} passes, {band}: error {size:.4f} mm, stated {stated:.4f} mm, inside {inside:.1%}\n"
            )
            assert 0.90 <= inside <= 0.98, (count, band)
            assert 0.8 < size / stated < 1.2, (count, band)


@pytest.mark.acceptance
@pytest.mark.parametrize("count", [5, 10, 20])
def test_a_contradicting_pass_is_detected_among_few_and_many(count: int) -> None:
    """No other pass is reported with it."""
    correct_reason = []
    for seed in range(3):
        line = Line(length=1250.0, seed=300 + seed, settled=0.002)
        for number, (fault, reason, _) in enumerate(FAULTS):
            bad = (number + seed) % count
            trains = [
                replace(one, **fault) if i == bad else one
                for i, one in enumerate(good_trains(count, 300 + seed))
            ]
            reported = fuse([passing(line, one) for one in trains], LAST).contradictions
            assert {one.name for one in reported} == {f"pass {bad}"}, (seed, fault, reported)
            correct_reason.append(any(one.reason is reason for one in reported))
    sys.stdout.write(
        f"{count} passes: each of {len(correct_reason)} faults detected, {sum(correct_reason)} with the right reason\n"
    )
    assert np.mean(correct_reason) >= 0.8


@pytest.mark.acceptance
def test_good_passes_are_not_reported_as_contradicting() -> None:
    for seed in range(20):
        line = Line(length=2000.0, seed=100 + seed, settled=0.002)
        result = fuse([passing(line, one) for one in good_trains(6, 100 + seed)], LAST)
        assert not result.contradictions, (seed, result.contradictions)


@pytest.mark.acceptance
def test_unchanged_track_is_not_reported_as_changing() -> None:
    reported = []
    for seed in range(20):
        line = Line(length=2000.0, seed=200 + seed)
        result = fuse([passing(line, one) for one in good_trains(6, 200 + seed)], LAST)
        reported.append(bool(result.changing))
    assert np.mean(reported) <= 0.1

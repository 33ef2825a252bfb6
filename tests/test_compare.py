"""Comparison: known lags, gains and errors come back as they were put in."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from narrowing import not_none
from trackprofile.assessment.compare import compare
from trackprofile.bands import D1, D2, D3, band_pass
from trackprofile.errors import DataError

GAP = 1
WAVELENGTHS = (5.3, 9.1, 17.0, 33.0, 48.0, 91.0, 140.0)


def elevation(distance, shift=0.0):
    """A track of seven waves, some millimetres each [m]."""
    place = np.asarray(distance)[:, np.newaxis] - shift
    omega = 2 * np.pi / np.array(WAVELENGTHS)
    return (1e-4 * np.array(WAVELENGTHS) ** 0.7 * np.sin(omega * place + omega * 100)).sum(axis=1)


def profile(distance, values, **variables):
    extra = {name: ("distance", each) for name, each in variables.items()}
    return xr.Dataset({"elevation": ("distance", values), **extra}, coords={"distance": distance})


DISTANCE = np.arange(1000.0, 3000.0, 0.25)
REFERENCE = profile(DISTANCE, elevation(DISTANCE))
NOISE = 1e-3 * np.random.default_rng(5).standard_normal((2, DISTANCE.size))


def test_a_profile_agrees_with_itself():
    result = compare(REFERENCE, REFERENCE)
    assert (result.from_m, result.to_m) == (1000.0, 2999.75)
    assert not result.notes
    for band in result.bands.values():
        assert not_none(band).correlation == pytest.approx(1, abs=1e-9)
        assert not_none(band).gain == pytest.approx(1, abs=1e-6)
        assert not_none(band).rms_error_mm == pytest.approx(0, abs=1e-6)
        assert not_none(band).lag_m == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("lag", [-4.9, -1.37, 0.1, 0.25, 3.0, 4.444])
def test_features_at_larger_distance_are_a_positive_lag(lag):
    result = compare(profile(DISTANCE, elevation(DISTANCE, lag)), REFERENCE)
    for band in result.bands.values():
        assert not_none(band).lag_m == pytest.approx(lag, abs=0.005)
        assert not_none(band).correlation > 0.9999


def test_rms_of_the_reference_and_of_the_error_are_those_of_the_band():
    """A wave in the middle of D1 that the profile alone has is D1's error and no other's."""
    wave = 2e-3 * np.sin(2 * np.pi * DISTANCE / 8.0)
    result = compare(profile(DISTANCE, elevation(DISTANCE) + wave), REFERENCE, max_lag=0)
    assert not_none(result.bands["D1"]).rms_error_mm == pytest.approx(2 / np.sqrt(2), rel=0.01)
    assert not_none(result.bands["D2"]).rms_error_mm < 0.02
    for band in (D1, D2, D3):
        expected = 1e3 * band_pass(elevation(DISTANCE), 0.25, band).std()
        assert not_none(result.bands[band.name]).reference_rms_mm == pytest.approx(
            expected, rel=0.01
        )


@settings(max_examples=20, deadline=None)
@given(st.floats(-4.5, 4.5))
def test_lag_changes_sign_when_profile_and_reference_change_places(lag):
    moved = profile(DISTANCE, elevation(DISTANCE, lag) + NOISE[0])
    there, back = compare(moved, REFERENCE), compare(REFERENCE, moved)
    assert not_none(there.bands["D1"]).lag_m == pytest.approx(
        -not_none(back.bands["D1"]).lag_m, abs=0.005
    )


@settings(max_examples=20, deadline=None)
@given(st.floats(0.05, 20), st.floats(-1, 1), st.floats(-1e-3, 1e-3))
def test_gain_is_that_of_a_scaled_profile_whatever_its_datum_and_slope(factor, datum, slope):
    scaled = profile(DISTANCE, factor * elevation(DISTANCE) + datum + slope * DISTANCE)
    for band in compare(scaled, REFERENCE).bands.values():
        assert not_none(band).gain == pytest.approx(factor, rel=1e-5)
        assert not_none(band).correlation == pytest.approx(1, abs=1e-6)


def test_other_samplings_of_one_track_agree():
    coarse = np.arange(1200.1, 2700.0, 0.4)
    uneven = np.cumsum(np.random.default_rng(8).uniform(0.15, 0.35, 8000)) + 900.0
    one = profile(coarse, elevation(coarse))
    result = compare(profile(uneven, elevation(uneven)), one)
    assert result.from_m == pytest.approx(1200.1)
    assert all(not_none(band).rms_error_mm < 0.005 for band in result.bands.values())


def test_stated_deviation_of_a_gaussian_error_covers_95_percent():
    stated = {
        f"standard_deviation_{band.name}": np.full(
            DISTANCE.size, band_pass(NOISE, 0.25, band).std()
        )
        for band in (D1, D2)
    }
    result = compare(profile(DISTANCE, elevation(DISTANCE) + NOISE[0], **stated), REFERENCE)
    assert not_none(result.bands["D1"]).coverage_95 == pytest.approx(0.95, abs=0.02)
    assert not_none(result.bands["D2"]).coverage_95 == pytest.approx(0.95, abs=0.08)
    assert not_none(result.bands["D1"]).stated_rms_mm == pytest.approx(
        1e3 * stated["standard_deviation_D1"][0]
    )
    assert not_none(result.bands["D3"]).coverage_95 is None


def test_points_without_a_stated_deviation_are_not_counted_as_missed():
    stated = np.where(DISTANCE < 2000, np.nan, 5e-3)
    noisy = profile(DISTANCE, elevation(DISTANCE) + NOISE[0], standard_deviation_D1=stated)
    d1 = compare(noisy, REFERENCE).bands["D1"]
    assert not_none(d1).coverage_95 == 1.0
    assert not_none(d1).stated_rms_mm == pytest.approx(5.0)


def test_layout_of_the_json():
    stated = profile(DISTANCE, elevation(DISTANCE), standard_deviation_D1=0 * DISTANCE + 1e-4)
    result = json.loads(json.dumps(compare(stated, REFERENCE).as_dict(), allow_nan=False))
    assert list(result) == ["bands", "from_m", "to_m"]
    assert list(result["bands"]) == ["D1", "D2", "D3"]
    always = ["correlation", "rms_error_mm", "reference_rms_mm", "gain", "lag_m"]
    assert list(result["bands"]["D2"]) == always
    assert list(result["bands"]["D1"]) == [*always, "coverage_95", "stated_rms_mm"]


def test_the_stretch_is_compared_and_the_rest_only_filtered():
    bad = elevation(DISTANCE)
    bad[DISTANCE < 1500] += NOISE[0, DISTANCE < 1500]
    result = compare(profile(DISTANCE, bad), REFERENCE, from_m=2000.0, to_m=2400.0)
    assert (result.from_m, result.to_m) == (2000.0, 2400.0)
    assert all(not_none(band).rms_error_mm < 1e-3 for band in result.bands.values())
    assert not_none(compare(profile(DISTANCE, bad), REFERENCE).bands["D1"]).rms_error_mm > 0.05


@pytest.mark.parametrize("kind", ["missing elevation", "flag", "missing rows"])
def test_gaps_split_the_profile_and_are_left_out(kind):
    inside = (DISTANCE >= 1800) & (DISTANCE < 1900)
    values = np.where(inside, np.nan if kind == "missing elevation" else 0.1, elevation(DISTANCE))
    gappy = profile(DISTANCE, values, quality=(inside * GAP).astype(np.int8))
    if kind == "missing rows":
        gappy = gappy.isel(distance=~inside)
    result = compare(gappy, REFERENCE)
    assert all(not_none(band).rms_error_mm < 1e-3 for band in result.bands.values())
    assert all(not_none(band).correlation > 0.999999 for band in result.bands.values())


def test_pieces_shorter_than_the_band_are_left_out_of_it_alone():
    """50 m before a gap carry D1 but not D2: an error there is seen in D1 only."""
    values = elevation(DISTANCE) + np.where(DISTANCE < 1050, NOISE[0], 0)
    values[(DISTANCE >= 1050) & (DISTANCE < 1060)] = np.nan
    result = compare(profile(DISTANCE, values), REFERENCE, max_lag=0)
    assert not_none(result.bands["D1"]).rms_error_mm > 0.01
    assert not_none(result.bands["D2"]).rms_error_mm < 1e-6


def test_a_band_longer_than_the_overlap_is_null_and_says_why():
    short = REFERENCE.isel(distance=slice(0, 400))
    result = compare(short, REFERENCE)
    assert not_none(result.bands["D1"]).correlation == pytest.approx(1)
    assert result.bands["D3"] is None
    assert result.as_dict()["bands"]["D3"] is None
    assert result.notes == ("Band D3 needs at least 200 m in one piece, got 99.75 m",)


def test_a_flat_profile_has_no_correlation_and_says_so():
    result = compare(profile(DISTANCE, 0.01 + 0 * DISTANCE), REFERENCE)
    assert result.bands == {"D1": None, "D2": None, "D3": None}
    assert "constant" in " ".join(result.notes)


def test_a_lag_at_the_end_of_the_range_is_said():
    result = compare(profile(DISTANCE, elevation(DISTANCE, 1.5)), REFERENCE, max_lag=1.0)
    assert not_none(result.bands["D1"]).lag_m == pytest.approx(1.0)
    assert "the true lag may be larger" in result.notes[0]


def test_the_stretch_stated_is_the_one_asked_for_whatever_the_lag():
    moved = profile(DISTANCE, elevation(DISTANCE, -1.37))
    result = compare(moved, REFERENCE, from_m=1500.0, to_m=9000.0)
    assert result.from_m == 1500.0
    assert result.to_m == pytest.approx(2999.75, abs=0.25)


def test_nothing_shared_is_refused():
    elsewhere = REFERENCE.assign_coords(distance=DISTANCE + 5000)
    with pytest.raises(DataError, match=r"6000 to 7999.75 m.*share no stretch"):
        compare(elsewhere, REFERENCE)
    with pytest.raises(DataError, match=r"share 1000 to 2999.75 m, got 4000 to inf m"):
        compare(REFERENCE, REFERENCE, from_m=4000.0)
    with pytest.raises(DataError, match="reference needs at least two points, got 1"):
        compare(REFERENCE, REFERENCE.isel(distance=[0]))

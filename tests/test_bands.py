"""Wavelength bands: the filter against its formula, and what it must never change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from narrowing import floats
from trackprofile.bands import (
    BANDS,
    D1,
    D2,
    D3,
    Band,
    band_pass,
    band_pass_pieces,
    edge_distance,
    gain,
    resample,
)
from trackprofile.errors import DataError

SPACING = 0.25


def butterworth(wavelength: float, band: Band) -> float:
    """The magnitude from the low-pass prototype, written with wavelengths instead of Ω."""
    centre = np.sqrt(band.shortest * band.longest)
    width = centre / band.shortest - centre / band.longest
    detuning = (centre / wavelength - wavelength / centre) / width
    return (1 + detuning**8) ** -0.5


def german_low(omega: Any) -> Any:
    amplitude, low, high = 4.032e-7, 0.0206, 0.8246
    return amplitude * high**2 / ((omega**2 + low**2) * (omega**2 + high**2))


def deviation(band: Band, response=lambda omega: 1.0, factor: float = 1.0) -> float:
    """Standard deviation of the German low spectrum behind a filter [m]."""
    low, high = 2 * np.pi / band.longest / factor, 2 * np.pi / band.shortest * factor
    return np.sqrt(quad(lambda o: german_low(o) * response(o) ** 2, low, high, limit=500)[0])


@pytest.mark.parametrize("band", BANDS)
def test_gain_is_3_db_down_at_the_limits_and_1_between(band):
    limits = 2 * np.pi / np.array([band.shortest, band.longest])
    assert gain(band, limits) == pytest.approx(np.sqrt(0.5), rel=1e-12)
    assert gain(band, np.sqrt(limits.prod())) == pytest.approx(1.0, abs=1e-12)
    assert gain(band, 0.0) == 0.0


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("wavelength", [0.5, 1.5, 2.9, 12.0, 40.0, 110.0, 400.0, 5000.0])
def test_gain_follows_the_butterworth_formula(band, wavelength):
    assert gain(band, 2 * np.pi / wavelength) == pytest.approx(butterworth(wavelength, band))


@pytest.mark.parametrize("band", BANDS)
def test_gain_falls_by_24_db_an_octave_far_from_the_band(band):
    for far in (2 * np.pi / band.longest / 100, 2 * np.pi / band.shortest * 100):
        beyond = far / 2 if far < 2 * np.pi / band.longest else far * 2
        ratio = float(gain(band, beyond) / gain(band, far))
        assert 20 * np.log10(ratio) == pytest.approx(-24.08, abs=0.01)


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("wavelength", [2.0, 3.0, 10.0, 25.0, 40.0, 70.0, 120.0, 200.0, 300.0])
def test_a_sine_keeps_its_phase_and_has_the_analytic_gain(band, wavelength):
    distance = np.arange(0.0, 4000.0, SPACING)
    wave = np.sin(2 * np.pi * distance / wavelength + 0.7)
    middle = slice(6000, 10000)
    got = band_pass(wave, SPACING, band)[middle]
    assert got == pytest.approx(butterworth(wavelength, band) * wave[middle], abs=2e-3)


@pytest.mark.parametrize("band", BANDS)
def test_constants_and_slopes_vanish(band):
    distance = np.arange(0.0, 600.0, SPACING)
    assert np.abs(band_pass(3.0 - 0.02 * distance, SPACING, band)).max() < 1e-12


@settings(max_examples=30, deadline=None)
@given(st.floats(-50, 50), st.floats(-50, 50), st.sampled_from(BANDS), st.integers(0, 99))
def test_filter_is_linear(one, other, band, seed):
    draws = np.random.default_rng(seed).standard_normal((2, 1200))
    filtered = band_pass(draws, SPACING, band)
    whole = band_pass(one * draws[0] + other * draws[1], SPACING, band)
    assert whole == pytest.approx(one * filtered[0] + other * filtered[1], abs=1e-10)


def test_samples_are_filtered_separately_and_not_modified():
    draws = np.random.default_rng(1).standard_normal((2, 3, 1000))
    before = draws.copy()
    together = band_pass(draws, SPACING, D2)
    assert (draws == before).all()
    assert together[1, 2] == pytest.approx(band_pass(draws[1, 2], SPACING, D2), abs=1e-14)


def test_reversing_the_track_reverses_the_result():
    values = np.random.default_rng(2).standard_normal(2000)
    assert band_pass(values[::-1], SPACING, D1)[::-1] == pytest.approx(
        band_pass(values, SPACING, D1), abs=1e-12
    )


def test_d1_of_the_german_low_spectrum():
    """facts.md: 0.984 mm in an ideal band, 1.9 % more behind this filter."""
    ideal = deviation(D1)
    assert ideal == pytest.approx(0.984e-3, abs=0.0005e-3)
    behind = deviation(D1, lambda omega: float(gain(D1, omega)), factor=30.0)
    assert behind / ideal == pytest.approx(1.019, abs=0.003)


def sampled_spectrum(length: int, count: int) -> np.ndarray:
    """Profiles with the German low spectrum, periodic (count, length) [m]."""
    omega = 2 * np.pi * np.fft.rfftfreq(length, SPACING)
    amplitude = np.sqrt(german_low(floats(omega)) * omega[1] / 4) * length
    noise = np.random.default_rng(3).standard_normal((2, count, omega.size))
    return np.fft.irfft((noise[0] + 1j * noise[1]) * amplitude, n=length)


def test_d1_of_sampled_profiles_is_that_of_the_spectrum():
    profiles = sampled_spectrum(2**16, 8)
    expected = deviation(D1, lambda omega: float(gain(D1, omega)), factor=30.0)
    assert band_pass(profiles, SPACING, D1).std() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("band", BANDS)
def test_values_beyond_the_edge_distance_hardly_depend_on_the_end(band):
    whole = sampled_spectrum(2**15, 100)
    part = slice(10000, 16000)
    truth = band_pass(whole, SPACING, band)[:, part]
    error = band_pass(whole[:, part], SPACING, band) - truth
    trusted = int(np.ceil(edge_distance(band) / SPACING))
    relative = error.std(axis=0) / truth.std()
    assert relative[trusted:-trusted].max() < 0.08
    assert relative[0] > 0.5
    assert edge_distance(band) < 1.5 * band.longest


def test_spline_interpolates_a_short_wave():
    distance = np.arange(0.0, 60.0, 0.5)
    places = np.arange(10.0, 50.0, 0.21)
    got = resample(distance, np.sin(2 * np.pi * distance / 3.0), places)
    assert got == pytest.approx(np.sin(2 * np.pi * places / 3.0), abs=5e-3)


def test_spline_does_not_interpolate_in_gaps_or_beyond_the_ends():
    distance = np.delete(np.arange(0.0, 60.0, 0.5), slice(40, 50))  # no rows from 20 to 24.5 m
    values = np.where((distance > 39) & (distance < 41), np.nan, 1.0)
    places = np.arange(-1.0, 62.0, 0.25)
    unknown = (places < 0) | (places > 59.5)
    unknown |= (places > 19.5) & (places < 25.0) | (places > 39.0) & (places < 41.0)
    assert (np.isnan(resample(distance, values, places)) == unknown).all()


def test_pieces_between_gaps_are_filtered_separately():
    values = np.random.default_rng(4).standard_normal(1000)
    values[300:310] = np.nan
    got = band_pass_pieces(values, SPACING, D1)
    assert got[:300] == pytest.approx(band_pass(values[:300], SPACING, D1))
    assert got[310:] == pytest.approx(band_pass(values[310:], SPACING, D1))
    assert np.isnan(got[300:310]).all()
    assert np.isnan(band_pass_pieces(values, SPACING, D3)).all()


def test_too_short_too_coarse_or_not_finite_is_refused():
    with pytest.raises(DataError, match="D3 needs at least 200 m in one piece, got 150 m"):
        band_pass(np.zeros(601), SPACING, D3)
    with pytest.raises(DataError, match=r"a value every 1.5 m or closer, got one every 2 m"):
        band_pass(np.zeros(601), 2.0, D1)
    values = np.zeros((2, 600))
    values[1, 77] = np.nan
    with pytest.raises(DataError, match="value 77 is not"):
        band_pass(values, SPACING, D1)
    with pytest.raises(DataError, match="0 < shortest < longest"):
        Band("wrong", 25.0, 3.0)


def test_resampling_refuses_distances_that_do_not_increase():
    with pytest.raises(DataError, match="strictly increasing"):
        resample([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.5])

"""Subbands that add up to a profile, and the error spectrum that follows from its stated standard deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passing_trains import Line, Train, noise, passing, prior
from trackprofile.bands import BANDS
from trackprofile.contracts import build_profile
from trackprofile.errors import DataError
from trackprofile.fusion.spectral_bands import (
    ALL_WAVELENGTHS,
    BAND_RANGES,
    CENTRE_FREQUENCIES,
    CENTRE_WAVELENGTHS,
    RANGES,
    decompose_spectrum,
    standard_deviations,
    subband_gains,
)
from trackprofile.fusion.stated_spectra import spectra_from_standard_deviations

LINE = Line(length=3000.0)
AT = np.arange(0.0, 400.0, 0.25)


def test_the_gains_of_the_subbands_add_up_to_one_at_every_wavelength() -> None:
    assert subband_gains(np.geomspace(1e-5, 50.0, 1000)).sum(axis=0) == pytest.approx(1.0)


def test_each_subband_is_in_one_range_and_those_of_a_band_in_that_of_the_band() -> None:
    assert [one for part in RANGES for one in part.indices] == list(range(CENTRE_WAVELENGTHS.size))
    for part, band in zip(BAND_RANGES, BANDS, strict=True):
        inside = CENTRE_WAVELENGTHS[part.subbands]
        assert part.name == band.name
        assert ((band.shortest <= inside) & (inside < band.longest)).all()


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 1000), count=st.integers(2, 700), gap=st.integers(0, 699),
    spacing=st.sampled_from([0.1, 0.25, 1.0]),
)  # fmt: skip
def test_the_subbands_add_up_to_the_profile_between_its_gaps(
    seed: int, count: int, gap: int, spacing: float
) -> None:
    level = np.cumsum(np.random.default_rng(seed).standard_normal(count))
    level[gap : gap + 5] = np.nan
    known = np.isfinite(level)
    decomposition = decompose_spectrum(level, spacing)
    total = np.sum(
        [decomposition.subband(index) for index in range(CENTRE_WAVELENGTHS.size)], axis=0
    )
    assert total[known] == pytest.approx(level[known], abs=1e-9)
    assert (total[~known] == 0).all()


def test_a_sine_lies_in_the_subband_of_its_wavelength() -> None:
    decomposition = decompose_spectrum(np.sin(2 * np.pi * AT / 8.0), 0.25)
    power = [
        float(np.mean(decomposition.subband(index)[400:-400] ** 2))
        for index in range(CENTRE_WAVELENGTHS.size)
    ]
    assert CENTRE_WAVELENGTHS[int(np.argmax(power))] == 8.0
    assert power[6] > 0.99 * 0.5


@pytest.mark.parametrize("sensors", ["bogie-25ug", "bogie-100ug", "bogie-1mg"])
@pytest.mark.parametrize("speed", [15.0, 40.0])
def test_the_error_spectrum_from_standard_deviations_is_that_of_the_ideal_smoother(
    sensors: str, speed: float
) -> None:
    """The standard deviations in three bands and of the whole determine the posterior spectrum closely."""
    train = Train(sensors=sensors, speed=speed)
    profile = passing(LINE, train).profile
    spectra = spectra_from_standard_deviations(profile, np.array([200.0, 700.0]), "one")
    S, N = prior(LINE), noise("velaro", sensors, speed, LINE)
    posterior = np.where(S > 0, 1.0 / (1.0 / np.where(S > 0, S, 1.0) + 1.0 / N), 0.0)
    exact = np.interp(CENTRE_FREQUENCIES, LINE.omega(), posterior)
    octaves = np.abs(np.log2(spectra.error[:, 0] / exact))
    # At twice the wheelbase, 5 m, a bogie responds little; a line between the bands does not reproduce that.
    assert np.delete(octaves[BAND_RANGES[0].subbands], 1).max() < 1.6
    assert octaves[BAND_RANGES[1].subbands.start : 20].max() < 0.8


def test_the_error_spectrum_has_the_stated_variances() -> None:
    profile = passing(LINE, Train()).profile
    spectra = spectra_from_standard_deviations(profile, np.array([200.0]), "one")
    deviations = standard_deviations(spectra.error)
    for band in BANDS:
        stated = float(profile[f"standard_deviation_{band.name}"][0])
        assert deviations[band.name][0] == pytest.approx(stated, rel=1e-4)
    assert deviations[ALL_WAVELENGTHS][0] == pytest.approx(
        float(profile["standard_deviation"][0]), rel=1e-3
    )


def test_a_profile_without_standard_deviations_is_refused() -> None:
    for profile in (
        build_profile(AT, np.sin(AT), kind="point"),
        build_profile(AT, np.sin(AT), kind="posterior", standard_deviation=np.ones(AT.size)),
    ):
        with pytest.raises(
            DataError, match=r"may\.nc: the profile does not state its standard deviation"
        ):
            spectra_from_standard_deviations(profile, AT[::100], "may.nc")


def test_near_the_ends_large_errors_at_long_wavelengths_do_not_enlarge_those_at_short_ones() -> (
    None
):
    """Near the ends the part of D2's error that leaks into D1 exceeds the stated error in D1."""
    ones = np.ones(AT.size)
    profile = build_profile(
        AT, np.sin(AT), kind="posterior", standard_deviation=15e-3 * ones,
        band_standard_deviations={"D1": 0.027e-3 * ones, "D2": 0.85e-3 * ones, "D3": 3.8e-3 * ones},
    )  # fmt: skip
    density = spectra_from_standard_deviations(profile, np.array([100.0]), "one").error[:, 0]
    assert (np.diff(np.log(density)) > 0).all()
    constant = 0.027e-3**2 / (2 * np.pi / 3)
    middle = density[np.argmin(np.abs(CENTRE_WAVELENGTHS - 8.0))]
    assert constant / 50 < middle < constant


def test_noisier_sensors_give_a_larger_error_in_every_subband() -> None:
    quiet = Train(sensors="bogie-25ug")
    densities = [
        spectra_from_standard_deviations(passing(LINE, one).profile, np.array([200.0]), "one").error
        for one in (quiet, replace(quiet, sensors="bogie-100ug"))
    ]
    assert (densities[1] >= densities[0]).all()

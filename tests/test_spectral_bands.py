"""Waves that add up to a profile, and the spectrum behind the standard deviations that it states."""

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
    ALL,
    JUDGED,
    LENGTHS,
    OMEGA,
    RANGES,
    decompose_spectrum,
    deviations,
    shares,
    stated_by,
)

LINE = Line(length=3000.0)
AT = np.arange(0.0, 400.0, 0.25)


def test_every_wavelength_belongs_to_its_waves_as_a_whole() -> None:
    assert shares(np.geomspace(1e-5, 50.0, 1000)).sum(axis=0) == pytest.approx(1.0)


def test_ranges_hold_all_waves_once_and_those_of_the_bands_their_own() -> None:
    assert [one for part in RANGES for one in part.numbers] == list(range(LENGTHS.size))
    for part, band in zip(JUDGED, BANDS, strict=True):
        inside = LENGTHS[part.waves]
        assert part.name == band.name
        assert ((band.shortest <= inside) & (inside < band.longest)).all()


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 1000), count=st.integers(2, 700), gap=st.integers(0, 699),
    spacing=st.sampled_from([0.1, 0.25, 1.0]),
)  # fmt: skip
def test_waves_add_up_to_the_profile_between_its_gaps(
    seed: int, count: int, gap: int, spacing: float
) -> None:
    level = np.cumsum(np.random.default_rng(seed).standard_normal(count))
    level[gap : gap + 5] = np.nan
    known = np.isfinite(level)
    cut = decompose_spectrum(level, spacing)
    total = np.sum([cut.wave(number) for number in range(LENGTHS.size)], axis=0)
    assert total[known] == pytest.approx(level[known], abs=1e-9)
    assert (total[~known] == 0).all()


def test_a_wave_lies_where_its_length_says() -> None:
    cut = decompose_spectrum(np.sin(2 * np.pi * AT / 8.0), 0.25)
    power = [float(np.mean(cut.wave(number)[400:-400] ** 2)) for number in range(LENGTHS.size)]
    assert LENGTHS[int(np.argmax(power))] == 8.0
    assert power[6] > 0.99 * 0.5


@pytest.mark.parametrize("sensors", ["bogie-25ug", "bogie-100ug", "bogie-1mg"])
@pytest.mark.parametrize("speed", [15.0, 40.0])
def test_the_spectrum_behind_what_a_profile_states_is_that_of_the_ideal_smoother(
    sensors: str, speed: float
) -> None:
    """The standard deviations of three bands and of the whole stand for the theory's posterior spectrum."""
    train = Train(sensors=sensors, speed=speed)
    found = stated_by(passing(LINE, train).profile, np.array([200.0, 700.0]), "one")
    S, N = prior(LINE), noise("velaro", sensors, speed, LINE)
    posterior = np.where(S > 0, 1.0 / (1.0 / np.where(S > 0, S, 1.0) + 1.0 / N), 0.0)
    exact = np.interp(OMEGA, LINE.omega(), posterior)
    off = np.abs(np.log2(found.error[:, 0] / exact))
    # About twice the wheelbase, 5 m, a bogie feels little, which no line between the bands can know.
    assert np.delete(off[JUDGED[0].waves], 1).max() < 1.6
    assert off[JUDGED[1].waves.start : 20].max() < 0.8


def test_the_spectrum_holds_the_variances_that_are_stated() -> None:
    profile = passing(LINE, Train()).profile
    found = deviations(stated_by(profile, np.array([200.0]), "one").error)
    for band in BANDS:
        stated = float(profile[f"standard_deviation_{band.name}"][0])
        assert found[band.name][0] == pytest.approx(stated, rel=1e-4)
    assert found[ALL][0] == pytest.approx(float(profile["standard_deviation"][0]), rel=1e-3)


def test_a_pass_that_does_not_say_how_sure_it_is_cannot_be_weighed() -> None:
    for profile in (
        build_profile(AT, np.sin(AT), kind="point"),
        build_profile(AT, np.sin(AT), kind="posterior", standard_deviation=np.ones(AT.size)),
    ):
        with pytest.raises(DataError, match=r"may\.nc: it does not state its standard deviation"):
            stated_by(profile, AT[::100], "may.nc")


def test_near_its_ends_a_pass_is_sure_of_its_short_waves_however_little_of_its_long_ones() -> None:
    """There D2's error, which leaks into D1, is larger than all of D1's."""
    one = np.ones(AT.size)
    profile = build_profile(
        AT, np.sin(AT), kind="posterior", standard_deviation=15e-3 * one,
        band_standard_deviations={"D1": 0.027e-3 * one, "D2": 0.85e-3 * one, "D3": 3.8e-3 * one},
    )  # fmt: skip
    found = stated_by(profile, np.array([100.0]), "one").error[:, 0]
    assert (np.diff(np.log(found)) > 0).all()
    even = 0.027e-3**2 / (2 * np.pi / 3)
    middle = found[np.argmin(np.abs(LENGTHS - 8.0))]
    assert even / 50 < middle < even


def test_louder_sensors_are_stated_louder_in_every_wave() -> None:
    quiet = Train(sensors="bogie-25ug")
    every = [
        stated_by(passing(LINE, one).profile, np.array([200.0]), "one").error
        for one in (quiet, replace(quiet, sensors="bogie-100ug"))
    ]
    assert (every[1] >= every[0]).all()

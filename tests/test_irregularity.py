"""Profiles as functions: their derivatives, their spectra, and an independent program's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import welch

from trackprofile.bands import BANDS, D1, Band, band_pass, gain
from trackprofile.errors import DataError, ModelError
from trackprofile.io.model_toml import presets, read_roughness
from trackprofile.models.irregularity import (
    Bell,
    Cosines,
    Dip,
    Flat,
    Irregularity,
    Sampled,
    Sum,
    random_irregularity,
)
from trackprofile.models.spectrum import Spectrum

Array = NDArray[np.float64]

FRA4 = Spectrum("FRA 4", 2.39e-5, 0.0206, 0.825)
FRA6 = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)
WAVES = random_irregularity(FRA6, 3, shortest=1.5, longest=100.0, start=60.0, taper=10.0)
GRID = np.arange(0.0, 200.0, 0.5)
EVERY = {
    "flat": Flat(),
    "bell": Bell(0.002, 0.5, 100.0),
    "settlement": Bell(0.04, 10.0, 120.0),
    "dip": Dip(0.004, 0.5, 60.0, count=4, spacing=25.0),
    "cosines": random_irregularity(FRA6, 3, shortest=1.5, longest=100.0),
    "cosines faded in": WAVES,
    "sampled": Sampled(GRID, 1e-3 * np.sin(0.6 * GRID)),
    "sum": Sum((Bell(0.04, 10.0, 120.0), WAVES)),
}


@pytest.mark.parametrize("name", EVERY)
def test_slope_and_curvature_are_the_derivatives(name: str) -> None:
    x = np.linspace(55.0, 140.0, 4321)
    x = x[np.abs(np.abs((x - 60.0 + 12.5) % 25.0 - 12.5) - 0.5) > 0.01]  # ends of the dips
    h = 1e-4
    exact, before, after = (EVERY[name].at(x + shift) for shift in (0.0, -h, h))
    differences = (after[:2] - before[:2]) / (2 * h)
    # The dip's waves of 1 m bend most, (2π h)²/6 = 7e-8; rounding of x is worth ε |x| / h = 3e-10.
    largest = np.abs(exact[1:]).max(axis=1, keepdims=True)
    assert (np.abs(differences - exact[1:]) <= 2e-7 * largest).all()


# --- against an independent program ---------------------------------------------------------------

SPEED = 150 / 3.6
ORACLE: dict[str, Irregularity] = {"bell": EVERY["bell"], "settlement": EVERY["settlement"]}
RATES = ("profile_at_wheel_m", "profile_rate_at_wheel_m_s", "profile_acceleration_at_wheel_m_s2")


def check_oracle(path: Path, profile: Irregularity, speed: float) -> None:
    with np.load(path) as oracle:
        at_wheels = profile.at(oracle["wheel_position_m"].ravel())
        for order, name in enumerate(RATES):
            expected = oracle[name].ravel()
            largest = np.abs(expected).max()
            # 1000 waves, each turned from the one before with an error ε.
            np.testing.assert_allclose(
                speed**order * at_wheels[order], expected, rtol=0, atol=1e-12 * largest
            )


@pytest.mark.parametrize("name", ORACLE)
def test_the_papers_bell_and_settlement_are_those_of_the_oracle(
    shared: Callable[[str], Path], name: str
) -> None:
    check_oracle(shared(f"oracle/{name}.npz"), ORACLE[name], SPEED)


@pytest.mark.parametrize(
    ("name", "start", "speed"),
    [("fra4", 60.0, SPEED), ("fra6", 60.0, SPEED), ("manchester", 62.0, 120 / 3.6)],
)
def test_the_faded_in_cosines_are_those_of_the_oracle(
    shared: Callable[[str], Path], name: str, start: float, speed: float
) -> None:
    with np.load(shared(f"oracle/cosines_{name}.npz")) as waves:
        omega, amplitude = waves["angular_wavenumber_rad_m"], waves["amplitude_m"]
        profile = Cosines(amplitude, omega, waves["phase_rad"], start, taper=10.0)
    check_oracle(shared(f"oracle/{name}.npz"), profile, speed)
    drawn = random_irregularity(FRA6 if name == "fra6" else FRA4, 0, shortest=1.5, longest=100.0)
    np.testing.assert_allclose(drawn.spatial_frequency, omega, rtol=1e-12)
    np.testing.assert_allclose(drawn.amplitude, amplitude, rtol=1e-12)


# --- random profiles ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", presets("spectrum"))
@pytest.mark.parametrize("band", [D1, Band("5 m to 15 m", 5.0, 15.0)], ids=lambda band: band.name)
def test_the_waves_of_a_band_have_the_variance_of_the_spectrum(name: str, band: Band) -> None:
    spectrum = read_roughness(name)
    profile = random_irregularity(spectrum, 0, shortest=2.5, longest=30.0)
    omega, amplitude = profile.spatial_frequency, profile.amplitude
    step = omega[1] - omega[0]
    inside = (omega > 2 * np.pi / band.longest) & (omega < 2 * np.pi / band.shortest)
    # Half a cell at each end of the band belongs to it or not; by far the densest is at the long end.
    edge = step * spectrum.density(np.array([2 * np.pi / band.longest]))[0]
    expected = spectrum.standard_deviation(band.shortest, band.longest) ** 2
    assert np.sum(amplitude[inside] ** 2) / 2 == pytest.approx(expected, abs=edge)
    assert edge < 0.025 * expected


def test_the_filtered_profile_has_the_bands_standard_deviation() -> None:
    length, spacing = 20_000.0, 0.5
    profile = random_irregularity(FRA6, 11, shortest=1.5, longest=400.0, length=length)
    elevation = profile.at(np.arange(0.0, length, spacing))[0]
    omega = np.linspace(2 * np.pi / 400.0, 2 * np.pi / 1.5, 100_000)
    for band in BANDS:
        density = FRA6.density(omega) * gain(band, omega) ** 2
        variance = np.trapezoid(density, omega)
        # Variance of a variance over a length, Gaussian: 2π/length ∫ S² dΩ; four standard errors.
        error = np.sqrt(2 * np.pi / length * np.trapezoid(density**2, omega)) / variance
        found = np.var(band_pass(elevation, spacing, band))
        assert found == pytest.approx(variance, rel=4 * float(error)), band.name


def test_welchs_density_of_a_random_profile_is_its_spectrum() -> None:
    length, spacing, segment = 20_000.0, 0.5, 800
    profile = random_irregularity(FRA4, 5, shortest=1.2, longest=400.0, length=length)
    elevation = profile.at(np.arange(0.0, length, spacing))[0]
    per_metre, density = welch(elevation, 1 / spacing, nperseg=segment)
    omega, density = 2 * np.pi * per_metre, density / (2 * np.pi)
    for longest in (50.0, 25.0, 12.5, 6.25, 3.125):
        octave = (omega > 2 * np.pi / longest) & (omega < 4 * np.pi / longest)
        # Each octave averages this many squares of two normal deviates; overlap and window halve them.
        # The waves' heights are not left to chance, so one standard error of a Gaussian profile is ample.
        squares = np.count_nonzero(octave) * length / (segment * spacing)
        ratio = np.mean(density[octave] / FRA4.density(omega[octave]))
        # Hann's window smooths over two bins, which raises S ∝ Ω⁻⁴ at bin n by some 10/(3 n²).
        smoothing = 10 / 3 * (longest / (segment * spacing)) ** 2
        assert ratio == pytest.approx(1.0, abs=1 / np.sqrt(squares / 2) + smoothing), longest


def test_a_seed_reproduces_its_profile_and_another_does_not() -> None:
    first, again, other = (
        random_irregularity(FRA6, seed, 1.5, 100.0).at(GRID) for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    drawn = random_irregularity(FRA6, np.random.default_rng(7), 1.5, 100.0).at(GRID)
    np.testing.assert_array_equal(first, drawn)
    assert np.corrcoef(first[0], other[0])[0, 1] < 0.9


def test_a_long_profile_does_not_repeat_over_its_length() -> None:
    length = 5_000.0
    omega = random_irregularity(FRA6, 0, 1.5, 100.0, length=length).spatial_frequency
    assert 2 * np.pi / (omega[1] - omega[0]) >= length


def test_a_spectrum_is_not_drawn_from_beyond_where_it_is_known() -> None:
    with pytest.raises(ModelError, match=r"SNCF.*2 m to 40 m"):
        random_irregularity(read_roughness("sncf-good"), 0, shortest=2.0, longest=100.0)
    with pytest.raises(ModelError, match="0 < shortest < longest"):
        random_irregularity(FRA6, 0, shortest=25.0, longest=3.0)


# --- laws -----------------------------------------------------------------------------------------

metres = st.floats(-500.0, 500.0)


@given(metres, st.floats(0.1, 20.0), st.floats(-0.05, 0.05))
def test_a_profile_moved_along_the_track_is_the_same_profile(
    shift: float, width: float, depth: float
) -> None:
    x = np.linspace(-60.0, 60.0, 241)
    omega = np.array([0.1, 0.23, 0.9])
    waves = Cosines(np.full(3, depth), omega, np.arange(3.0), start=-20.0, taper=10.0)
    moved = replace(waves, phase=waves.phase - omega * shift, start=-20.0 + shift)
    pairs = [
        (Bell(depth, width, 0.0), Bell(depth, width, shift)),
        (Dip(depth, width, 0.0, 3, 45.0), Dip(depth, width, shift, 3, 45.0)),
        (waves, moved),
    ]
    steepest = np.abs(depth) * (np.pi / min(width, 1.0)) ** np.arange(1, 4)
    # x + shift is off by ε 560 m, which times the next derivative is what the values may be off by.
    for here, there in pairs:
        off = np.abs(here.at(x) - there.at(x + shift))
        if isinstance(here, Dip):  # its curvature jumps where a dip ends
            off[2, np.isclose(np.abs((x + 22.5) % 45.0 - 22.5), width, rtol=0, atol=1e-9)] = 0
        assert (off <= (1e-12 * steepest + 1e-300)[:, None]).all()


@given(st.integers(0, 2**32), st.integers(2, 40), st.floats(0.0, 3000.0))
def test_evenly_spaced_waves_sum_as_any_others_do(seed: int, count: int, place: float) -> None:
    generator = np.random.default_rng(seed)
    omega = np.linspace(0.06, 4.0, count)
    amplitude, phase = generator.normal(size=count), generator.uniform(0, 6, count)
    x = place + np.arange(300.0)  # more than a block
    even = Cosines(amplitude, omega, phase).at(x)
    # One wave more, of no height, and the spacing is no longer even.
    odd = Cosines(np.append(amplitude, 0.0), np.append(omega, 9.9), np.append(phase, 0.0)).at(x)
    # Phases are rounded at ε Ω x = 3e-12 rad.
    scale = np.sum(np.abs(amplitude)) * 4.0 ** np.arange(3)[:, None]
    assert (np.abs(even - odd) <= 1e-11 * scale).all()


def test_a_sum_is_the_sum_of_its_parts() -> None:
    bell, dip = EVERY["bell"], EVERY["dip"]
    np.testing.assert_array_equal(Sum((bell, dip)).at(GRID), bell.at(GRID) + dip.at(GRID))
    np.testing.assert_array_equal(Sum(()).at(GRID), np.zeros((3, len(GRID))))
    np.testing.assert_array_equal(Sum((bell, Flat())).at(GRID), bell.at(GRID))


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_sampled_wave_is_recovered_with_the_splines_order(order: int) -> None:
    def worst(spacing: float) -> float:
        grid = np.arange(0.0, 60.0, spacing)
        sampled = Sampled(grid, np.cos(grid))
        x = np.linspace(20.0, 40.0, 777)
        return float(
            np.abs(sampled.at(x)[order] - [np.cos(x), -np.sin(x), -np.cos(x)][order]).max()
        )

    # A quintic errs by h^(6 - order): halving the step divides it by 2 to that power.
    assert worst(0.5) / worst(0.25) == pytest.approx(2.0 ** (6 - order), rel=0.15)


def test_a_profile_shorter_than_the_run_is_refused() -> None:
    with pytest.raises(DataError, match=r"0 m to 199.5 m.*-1 m to 0 m; shorten the run"):
        EVERY["sampled"].at(np.array([-1.0, 0.0]))


def test_a_profile_may_end_a_rounding_before_the_run() -> None:
    last = float(np.nextafter(199.5, 200.0))
    np.testing.assert_allclose(
        EVERY["sampled"].at(np.array([last])), EVERY["sampled"].at(np.array([199.5]))
    )


@pytest.mark.parametrize(
    ("distance", "elevation", "words"),
    [
        (GRID[:5], GRID[:5], "six or more"),
        (GRID, GRID[:-1], "as many elevations"),
        (GRID[::-1], GRID, "strictly increasing"),
        (GRID, np.where(GRID == 3.0, np.nan, 0.0), "finite"),
    ],
)
def test_samples_that_are_no_profile_are_refused(
    distance: Array, elevation: Array, words: str
) -> None:
    with pytest.raises(DataError, match=words):
        Sampled(distance, elevation)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Bell(0.002, 0.0, 5.0), "Bell: expected a width above 0 m, got 0.0 m"),
        (lambda: Dip(0.002, -1.0, 5.0), "Dip: expected a half_length above 0"),
        (lambda: Dip(0.002, 1.0, 5.0, count=0), "count of at least 1"),
        (lambda: Dip(0.002, 1.0, 5.0, count=2, spacing=1.5), "at least 2 m apart"),
        (lambda: replace(WAVES, taper=0.0), "expected a taper above 0"),
        (lambda: replace(WAVES, phase=np.zeros(3)), r"\(1000,\), \(1000,\), \(3,\)"),
    ],
)
def test_an_irregularity_that_cannot_be_is_refused(
    make: Callable[[], Irregularity], words: str
) -> None:
    with pytest.raises(ModelError, match=words):
        make()

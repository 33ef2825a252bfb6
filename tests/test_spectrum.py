"""Spectra against quadrature and the literature's band values."""

from __future__ import annotations

import numpy as np
import pytest

from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_spectrum
from trackprofile.spectrum import Spectrum, draw, markov

FRA6 = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)


def test_variance_is_the_integral_of_the_density() -> None:
    omega = np.geomspace(1e-6, 1e4, 400_000)
    assert np.trapezoid(FRA6.density(omega), omega) == pytest.approx(FRA6.variance, rel=1e-4)


# Literature: standard deviations in mm over 3-25, 25-70 and 70-150 m, one-sided, by an independent prototype.
LITERATURE = {
    "fra-4": (7.58, 12.7, 16.3),
    "fra-5": (4.74, 7.95, 10.2),
    "fra-6": (1.90, 3.18, 4.09),
    "german-low": (0.984, 1.65, 2.12),
    "german-high": (1.61, 2.70, 3.47),
}


@pytest.mark.parametrize("name", LITERATURE)
def test_band_standard_deviations_are_those_of_the_literature(name: str) -> None:
    spectrum = read_spectrum(name)
    found = [
        1e3 * spectrum.standard_deviation(*limits) for limits in ((3, 25), (25, 70), (70, 150))
    ]
    np.testing.assert_allclose(found, LITERATURE[name], rtol=0.006)


def test_markov_process_keeps_its_stationary_covariance() -> None:
    process = markov(FRA6, 0.25)
    covariance = process.covariance(60)
    assert process.variance == pytest.approx(FRA6.variance)
    for lag in range(2, 59):
        follows = process.a1 * covariance[0, lag - 1] + process.a2 * covariance[0, lag - 2]
        assert covariance[0, lag] == pytest.approx(follows, rel=1e-12)
    grown = process.variance - process.a1 * covariance[0, 1] - process.a2 * covariance[0, 2]
    # The innovation is what remains of four nearly equal numbers.
    assert grown == pytest.approx(process.innovation, abs=1e-12 * process.variance)


def test_markov_process_has_the_spectrum_of_waves_longer_than_its_spacing() -> None:
    h, omega = 0.25, 2 * np.pi / np.array([200.0, 70.0, 25.0, 10.0, 5.0])
    process = markov(FRA6, h)
    turn = np.exp(-1j * omega * h)
    density = (
        process.innovation / np.abs(1 - process.a1 * turn - process.a2 * turn**2) ** 2 * h / np.pi
    )
    np.testing.assert_allclose(density, FRA6.density(omega), rtol=0.02)


def test_drawn_profile_has_the_standard_deviation_of_its_spectrum() -> None:
    distance = np.arange(0.0, 4000.0, 1.0)
    drawn = [draw(FRA6, distance, np.random.default_rng(seed), 3.0) for seed in range(4)]
    # Some thirty independent waves of 300 m in all: 15 % sampling error.
    assert np.std(drawn) == pytest.approx(np.sqrt(FRA6.variance), rel=0.3)


def test_spectrum_without_a_band_is_refused() -> None:
    with pytest.raises(ModelError, match="upper > lower > 0"):
        Spectrum("flat", 1e-6, 0.5, 0.5)

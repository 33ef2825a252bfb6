"""Spectra against quadrature and the literature's band values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackprofile.errors import ModelError
from trackprofile.io.model_toml import presets, read_roughness, read_spectrum
from trackprofile.models.spectrum import (
    PowerLaw,
    Spectrum,
    SpectrumSegment,
    markov_process,
    random_profile,
    require_rational,
)

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
    process = markov_process(FRA6, 0.25)
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
    process = markov_process(FRA6, h)
    turn = np.exp(-1j * omega * h)
    density = (
        process.innovation / np.abs(1 - process.a1 * turn - process.a2 * turn**2) ** 2 * h / np.pi
    )
    np.testing.assert_allclose(density, FRA6.density(omega), rtol=0.02)


def test_drawn_profile_has_the_standard_deviation_of_its_spectrum() -> None:
    distance = np.arange(0.0, 4000.0, 1.0)
    drawn = [random_profile(FRA6, distance, np.random.default_rng(seed), 3.0) for seed in range(4)]
    # Some thirty independent waves of 300 m in all: 15 % sampling error.
    assert np.std(drawn) == pytest.approx(np.sqrt(FRA6.variance), rel=0.3)


def test_spectrum_without_a_band_is_refused() -> None:
    with pytest.raises(ModelError, match="corner_high > corner_low > 0"):
        Spectrum("flat", 1e-6, 0.5, 0.5)


# --- power laws -----------------------------------------------------------------------------------

BANDS = ((3, 25), (25, 70), (70, 150))

# Literature: as above. SNCF is known up to 40 m only; its formula goes on to where they took it.
POWER_LAWS = {
    "fra-4-usual": (5.69, 9.65, 13.0),
    "fra-5-usual": (3.55, 6.03, 8.1),
    "fra-6-usual": (1.43, 2.42, 3.3),
    "sncf-good": (1.05, 1.07, 0.82),
    "sncf-poor": (1.96, 2.00, 1.54),
    "china-ballastless": (0.286, 0.362, 0.765),
}


def power_law(name: str) -> PowerLaw:
    read = read_roughness(name)
    assert isinstance(read, PowerLaw)
    return read


@pytest.mark.parametrize("name", POWER_LAWS)
def test_band_standard_deviations_of_power_laws_are_those_of_the_literature(name: str) -> None:
    spectrum = replace(power_law(name), longest=305.0)
    found = [1e3 * spectrum.standard_deviation(*limits) for limits in BANDS]
    # Three digits, and two where the table has two.
    np.testing.assert_allclose(found, POWER_LAWS[name], atol=0.05, rtol=0.006)


@pytest.mark.parametrize("name", [n for n in presets("spectrum") if "german" not in n])
def test_the_standard_deviation_is_the_integral_of_the_density(name: str) -> None:
    spectrum = read_roughness(name)
    omega = np.geomspace(2 * np.pi / 35, 2 * np.pi / 2.5, 200_001)
    expected = np.sqrt(np.trapezoid(spectrum.density(omega), omega))
    # Trapezia across a jump of 0.5 % miss less than one step of it.
    assert spectrum.standard_deviation(2.5, 35) == pytest.approx(expected, rel=1e-7)


def test_the_usual_fra_spectrum_has_its_closed_formula() -> None:
    omega = np.geomspace(0.03, 4.0, 50)
    for number, amplitude in enumerate((1.2107, 1.0181, 0.6816, 0.5376, 0.2095, 0.0339), start=1):
        expected = 0.25e-4 * amplitude * 0.8245**2 / (omega**2 * (omega**2 + 0.8245**2))
        found = read_roughness(f"fra-{number}-usual").density(omega)
        np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("number", range(1, 7))
def test_the_papers_fra_amplitude_is_four_ninths_of_the_usual(number: int) -> None:
    usual = read_roughness(f"fra-{number}-usual").density(np.array([0.5]))[0]
    paper = read_spectrum(f"fra-{number}")
    assert ("not verified" in paper.source) == (number < 4)
    without_lower = paper.density(np.array([0.5]))[0] * (1 + (paper.corner_low / 0.5) ** 2)
    # k = 1/4, so 16/9 of the density; Table 4 has two or three digits. The upper corners differ by 0.06 %.
    assert without_lower / usual == pytest.approx(16 / 9, rel=0.006)


def test_the_chinese_pieces_meet() -> None:
    spectrum = power_law("china-ballastless")
    for before, after in zip(spectrum.segments[:-1], spectrum.segments[1:], strict=True):
        at = np.array([before.end])
        assert before.density_at(at) == pytest.approx(after.density_at(at), rel=0.005)
        # Up to and including its upper end a piece is the one that counts.
        assert spectrum.density(at) == before.density_at(at)


def test_a_power_law_is_not_continued_beyond_its_band() -> None:
    sncf = power_law("sncf-good")
    with pytest.raises(
        ModelError, match=r"'SNCF.*2 m to 40 m, got 25 m to 70 m; choose wavelengths"
    ):
        sncf.standard_deviation(25, 70)
    with pytest.raises(ModelError, match="2 m to 40 m"):
        sncf.density(np.array([0.1]))
    assert sncf.density(np.array([])).shape == (0,)
    assert sncf.standard_deviation(2, 40) > 0


def test_a_power_law_can_be_no_prior() -> None:
    with pytest.raises(ModelError, match=r"'SNCF.*cannot be a prior; choose.*german-low"):
        require_rational(read_roughness("sncf-good"))
    assert require_rational(FRA6) is FRA6


@pytest.mark.parametrize(
    ("pieces", "limits", "words"),
    [
        ((), (1.0, 10.0), "segments with increasing ends"),
        (
            (SpectrumSegment(1.0, 1.0, 2.0, end=3.0),),
            (1.0, 10.0),
            "the last at least 6.28319 rad/m",
        ),
        (
            (SpectrumSegment(1.0, 1.0, 2.0), SpectrumSegment(1.0, 1.0, 2.0)),
            (1.0, 10.0),
            "segments with increasing ends",
        ),
        ((SpectrumSegment(0.0, 1.0, 2.0),), (1.0, 10.0), "above 0"),
        ((SpectrumSegment(1.0, 1.0, 2.0, corner_frequency=0.0),), (1.0, 10.0), "above 0"),
        ((SpectrumSegment(1.0, 1.0, 2.0),), (10.0, 1.0), "0 < shortest < longest"),
    ],
)
def test_a_power_law_that_contradicts_itself_is_refused(
    pieces: tuple[SpectrumSegment, ...], limits: tuple[float, float], words: str
) -> None:
    with pytest.raises(ModelError, match=words):
        PowerLaw("odd", pieces, *limits)

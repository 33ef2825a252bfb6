"""Discrimination of changing track from unchanged track."""

from __future__ import annotations

import numpy as np

from trackprofile.fusion.change_detection import detect_changes

COUNT = 1200


def band_limited_noise(seed: int) -> np.ndarray:
    """Noise of unit variance, with wavelengths of four to sixteen points."""
    omega = 2 * np.pi * np.fft.rfftfreq(COUNT)
    inside = (omega > 2 * np.pi / 16) & (omega < 2 * np.pi / 4)
    noise = np.random.default_rng(seed).standard_normal((2, omega.size))
    values = np.fft.irfft(np.where(inside, noise[0] + 1j * noise[1], 0.0), n=COUNT)
    return values / values.std()


EVERYWHERE = np.ones(COUNT, bool)
INDEPENDENT = 2 * COUNT * (1 / 4 - 1 / 16)


def test_noise_alone_is_no_change() -> None:
    changes = [
        detect_changes(band_limited_noise(seed), np.ones(COUNT), EVERYWHERE, INDEPENDENT)
        for seed in range(40)
    ]
    assert np.mean([one.probability.max() > 0.5 for one in changes]) <= 0.05


def test_a_changing_location_is_detected_at_its_position() -> None:
    for seed in range(5):
        rate = band_limited_noise(seed)
        rate[600:620] += 12 * np.sin(2 * np.pi * np.arange(20) / 8)
        change = detect_changes(rate, np.ones(COUNT), EVERYWHERE, INDEPENDENT)
        assert change.probability[605:615].min() > 0.9
        assert change.probability[:500].mean() < 0.01
        assert change.shrinkage[610] > 0.8


def test_the_rate_of_track_that_changes_everywhere_is_shrunk_by_the_gain_of_a_wiener_filter() -> (
    None
):
    rate = band_limited_noise(1) + 3 * band_limited_noise(2)
    change = detect_changes(rate, np.ones(COUNT), EVERYWHERE, INDEPENDENT)
    mean_factor = np.mean(change.probability * change.shrinkage)
    assert abs(mean_factor - 9 / 10) < 0.05


def test_unknown_track_does_not_change() -> None:
    known = EVERYWHERE.copy()
    known[300:500] = False
    rate = band_limited_noise(3) + 5 * band_limited_noise(4)
    assert (
        detect_changes(rate, np.ones(COUNT), known, INDEPENDENT).probability[300:500] == 0
    ).all()

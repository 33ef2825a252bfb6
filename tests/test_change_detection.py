"""Track that moves, told from track that stands."""

from __future__ import annotations

import numpy as np

from trackprofile.fusion.change_detection import detect_changes

COUNT = 1200


def coloured(seed: int) -> np.ndarray:
    """Noise of unit variance, of waves four to sixteen points long."""
    omega = 2 * np.pi * np.fft.rfftfreq(COUNT)
    inside = (omega > 2 * np.pi / 16) & (omega < 2 * np.pi / 4)
    noise = np.random.default_rng(seed).standard_normal((2, omega.size))
    values = np.fft.irfft(np.where(inside, noise[0] + 1j * noise[1], 0.0), n=COUNT)
    return values / values.std()


EVERYWHERE = np.ones(COUNT, bool)
INDEPENDENT = 2 * COUNT * (1 / 4 - 1 / 16)


def test_noise_moves_nothing() -> None:
    found = [
        detect_changes(coloured(seed), np.ones(COUNT), EVERYWHERE, INDEPENDENT)
        for seed in range(40)
    ]
    assert np.mean([one.probability.max() > 0.5 for one in found]) <= 0.05


def test_a_place_that_moves_is_found_where_it_does() -> None:
    for seed in range(5):
        rate = coloured(seed)
        rate[600:620] += 12 * np.sin(2 * np.pi * np.arange(20) / 8)
        found = detect_changes(rate, np.ones(COUNT), EVERYWHERE, INDEPENDENT)
        assert found.probability[605:615].min() > 0.9
        assert found.probability[:500].mean() < 0.01
        assert found.kept[610] > 0.8


def test_track_that_moves_all_along_is_believed_by_as_much_as_it_exceeds_the_noise() -> None:
    rate = coloured(1) + 3 * coloured(2)
    found = detect_changes(rate, np.ones(COUNT), EVERYWHERE, INDEPENDENT)
    believed = np.mean(found.probability * found.kept)
    assert abs(believed - 9 / 10) < 0.05  # Wiener's gain


def test_where_nothing_is_known_nothing_moves() -> None:
    known = EVERYWHERE.copy()
    known[300:500] = False
    rate = coloured(3) + 5 * coloured(4)
    assert (
        detect_changes(rate, np.ones(COUNT), known, INDEPENDENT).probability[300:500] == 0
    ).all()

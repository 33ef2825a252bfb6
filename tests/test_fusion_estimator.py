"""Passes weighed together, against dense Gaussian algebra that knows nothing of waves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import date

import numpy as np
import pytest
from scipy.linalg import toeplitz

from passing_trains import FIRST, Line, fleet, passing
from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D2, D3, Band, band_pass, edge_distance
from trackprofile.contracts import build_profile
from trackprofile.fusion.combine import combine, without_each
from trackprofile.fusion.estimator import Trust, weights
from trackprofile.fusion.pass_alignment import AlignedPass
from trackprofile.fusion.spectral_bands import LENGTHS, RANGES, deviations
from trackprofile.fusion.stack import PassStack, stack_passes

Array = np.ndarray
SPACING, COUNT = 1.0, 1100
AT = SPACING * np.arange(COUNT)
DAY = date(2026, 5, 4)


def trusting(laid: PassStack, vehicle: Array | None = None) -> Trust:
    """Every pass at its word, and no two of one vehicle."""
    n = len(laid.passes)
    vehicle = np.arange(n) if vehicle is None else vehicle
    return Trust(
        louder=np.ones((n, LENGTHS.size)),
        local=np.ones((n, len(RANGES), laid.places.size)),
        used=np.ones(n, bool),
        shared=np.zeros((int(vehicle.max()) + 1, len(RANGES))),
        hidden=np.zeros(len(RANGES)),
        vehicle=vehicle,
    )


def in_place(one: DatedProfile) -> AlignedPass:
    ends = one.profile["distance"].to_numpy()[[0, -1]]
    return AlignedPass(one, 0.0, ends, np.zeros(2))


def covariance(density: Array, omega: Array) -> Array:
    """Of COUNT neighbouring points of a process with that spectrum, by Wiener and Khinchin."""
    weight = density * np.gradient(omega)
    return toeplitz(np.cos(np.outer(AT, omega)) @ weight)


@dataclass(frozen=True)
class Measured:
    """What a dense Gaussian posterior makes of passes, one by one and all at once."""

    truth: Array
    passes: tuple[DatedProfile, ...]
    joint: Array
    spread: dict[str, Array]


@pytest.fixture(scope="module")
def measured() -> Measured:
    """Five passes that hardly know their long waves: each holds 60 to 90 % of D3, the prior the rest."""
    omega = np.linspace(1e-4, np.pi, 2500)
    prior = covariance(2e-6 / (omega**2 + 0.0206**2), omega)
    generator = np.random.default_rng(4)
    truth = np.linalg.cholesky(prior + 1e-15 * np.eye(COUNT)) @ generator.standard_normal(COUNT)
    filters = {band: band_pass(np.eye(COUNT), SPACING, band).T for band in BANDS}
    precision, information = np.linalg.inv(prior), np.zeros(COUNT)
    usual = covariance(6e-10 / (omega**2 + 0.002**2) ** 2 + 6e-10 / 0.6**4, omega)
    root, inverse = np.linalg.cholesky(usual), np.linalg.inv(usual)
    passes = []
    for number, size in enumerate((1.0, 1.5, 2.0, 0.8, 1.2)):
        of_pass = truth + size * root @ generator.standard_normal(COUNT)
        gain = np.linalg.solve(prior + size**2 * usual, prior).T
        posterior = prior - gain @ prior
        told = inverse / size**2
        precision, information = precision + told, information + told @ of_pass
        passes.append(
            DatedProfile(
                build_profile(
                    AT, gain @ of_pass, kind="posterior", standard_deviation=np.sqrt(np.diag(posterior)),
                    band_standard_deviations={
                        band.name: spread_in(one, posterior) for band, one in filters.items()
                    },
                ),
                DAY,
                f"pass {number}",
            )
        )  # fmt: skip
    joint = np.linalg.inv(precision)
    spread = {band.name: spread_in(one, joint) for band, one in filters.items()}
    return Measured(truth, tuple(passes), joint @ information, spread)


def spread_in(filtering: Array, covariance: Array) -> Array:
    """Standard deviation at each point of what passes a filter."""
    return np.sqrt(np.einsum("ij,ij->i", filtering @ covariance, filtering))


def inner(band: Band) -> slice:
    edge = int(edge_distance(band) / SPACING)
    return slice(edge, -edge)


def test_passes_fused_are_the_posterior_of_all_recordings(measured: Measured) -> None:
    laid = stack_passes([in_place(one) for one in measured.passes])
    found = combine(laid, np.zeros(5), trusting(laid), 0.0)
    spread = deviations(found.error)
    for band in BANDS:
        here = inner(band)
        apart = band_pass(found.level - measured.joint, SPACING, band)[here]
        least = measured.spread[band.name][here]
        assert np.sqrt(np.mean(apart**2)) < 0.15 * least.mean(), band.name
        stated = np.interp(AT, laid.places, spread[band.name])[here]
        assert stated.mean() == pytest.approx(least.mean(), rel=0.02), band.name


def test_posteriors_averaged_as_measurements_would_count_the_prior_five_times(
    measured: Measured,
) -> None:
    levels = np.stack([one.profile["elevation"].to_numpy() for one in measured.passes])
    spreads = [one.profile["standard_deviation_D3"].to_numpy() for one in measured.passes]
    naive = np.average(levels, axis=0, weights=np.median(spreads, axis=1) ** -2)
    here = inner(D3)
    apart = band_pass(naive - measured.joint, SPACING, D3)[here]
    assert np.sqrt(np.mean(apart**2)) > 0.6 * measured.spread["D3"][here].mean()


def test_one_pass_alone_comes_back_through_all_waves(measured: Measured) -> None:
    one = measured.passes[1]
    laid = stack_passes([in_place(one)])
    found = combine(laid, np.zeros(1), trusting(laid), 0.0)
    assert np.abs(found.level - one.profile["elevation"].to_numpy()).max() < 1e-12
    for band in BANDS:
        here = inner(band)
        stated = one.profile[f"standard_deviation_{band.name}"].to_numpy()[here]
        again = np.interp(AT, laid.places, deviations(found.error)[band.name])[here]
        assert again == pytest.approx(stated, rel=0.03)


def test_what_all_others_say_is_the_fusion_without_the_pass(measured: Measured) -> None:
    laid = stack_passes([in_place(one) for one in measured.passes])
    rest = stack_passes([in_place(one) for one in measured.passes[1:]])
    others = without_each(laid, trusting(laid))[0]
    found = combine(rest, np.zeros(4), trusting(rest), 0.0).level
    here = inner(D2)
    apart = band_pass(others - found, SPACING, D2)[here]
    # But for the prior, which comes in when all is put together.
    assert np.sqrt(np.mean(apart**2)) < 0.2 * measured.spread["D2"][here].mean()


# One wave at one place: generalised least squares, written out


@pytest.fixture(scope="module")
def laid() -> PassStack:
    line = Line(length=400.0)
    trains = [replace(one, ahead=0.0, scale=0.0) for one in fleet(7)]
    return stack_passes([in_place(passing(line, one)) for one in trains])


@pytest.mark.parametrize("wave", [6, 11, 14])
@pytest.mark.parametrize("day", [0.0, 15.0, 40.0])
def test_weights_are_those_of_generalised_least_squares(
    laid: PassStack, wave: int, day: float
) -> None:
    generator = np.random.default_rng(wave)
    days = np.array([(one.of.day - FIRST).days for one in laid.passes], float)
    days -= days.mean()
    vehicle = np.array([0, 1, 2, 0, 1, 2, 0])
    number = next(i for i, one in enumerate(RANGES) if wave in one.numbers)
    trust = trusting(laid, vehicle)
    trust.louder[:] = generator.uniform(0.5, 3.0, trust.louder.shape)
    trust.shared[:, number] = [1e-6, 0.0, 1e-4]
    found = weights(laid, wave, days, trust, day)
    k = laid.places.size // 2
    P, G = laid.stated[:, wave, k], laid.gain(wave)[:, k]
    own = trust.louder[:, wave] * P / G
    U = trust.shared[vehicle, number] * laid.strength(wave)[k]
    noise = np.diag(own) + np.where(vehicle[:, None] == vehicle, U[:, None], 0.0)
    design = np.stack([np.ones(7), days], axis=1)
    widest = (np.ptp(days) / 10.0) ** 2 / laid.prior[:, wave].max()
    precision = np.diag([1 / laid.before(wave), widest])
    covariance = np.linalg.inv(precision + design.T @ np.linalg.solve(noise, design))
    gains = covariance @ np.linalg.solve(noise, design).T / G
    row = np.array([1.0, day])
    assert found.level[:, k] == pytest.approx(row @ gains, rel=1e-6, abs=1e-9)
    assert found.rate[:, k] == pytest.approx(gains[1], rel=1e-6, abs=1e-12)
    expected = (row @ covariance @ row, covariance[1] @ row, covariance[1, 1])
    assert found.variance[:, k] == pytest.approx(expected, rel=1e-6)
    known = np.linalg.inv(
        precision + design.T @ np.linalg.solve(noise, design) + np.diag([0, 1e12])
    )
    assert found.standing[k] == pytest.approx(known[0, 0], rel=1e-3)


def test_passes_of_one_vehicle_never_know_the_line_better_than_what_they_share(
    laid: PassStack,
) -> None:
    trust = trusting(laid, np.zeros(7, int))
    trust.shared[:] = 1e-4
    variance = weights(laid, 8, np.zeros(7), trust, 0.0).variance[0]
    shared = 1e-4 * laid.strength(8)
    assert (variance > 0.99 * shared).all()
    assert (variance < 1.1 * (shared + laid.stated[:, 8].min(axis=0))).all()


def test_a_pass_that_is_left_out_counts_nothing(laid: PassStack) -> None:
    trust = trusting(laid)
    trust.used[3] = False
    found = weights(laid, 8, np.zeros(7), trust, 0.0)
    assert (found.level[3] == 0).all()
    assert found.level.sum(axis=0) == pytest.approx(1.0, abs=1e-4)

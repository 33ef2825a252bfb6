"""Combination of passes, compared with dense Gaussian algebra that uses no subbands."""

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
from trackprofile.fusion.combine import combine, combine_others
from trackprofile.fusion.generalised_least_squares import PassErrorModel, least_squares_weights
from trackprofile.fusion.pass_alignment import AlignedPass
from trackprofile.fusion.spectral_bands import CENTRE_WAVELENGTHS, RANGES, standard_deviations
from trackprofile.fusion.stack import PassStack, stack_passes

Array = np.ndarray
SPACING, COUNT = 1.0, 1100
AT = SPACING * np.arange(COUNT)
DAY = date(2026, 5, 4)


def stated_errors(stack: PassStack, vehicle: Array | None = None) -> PassErrorModel:
    """Error model in which every pass has its stated error, and each its own vehicle."""
    n = len(stack.passes)
    vehicle = np.arange(n) if vehicle is None else vehicle
    return PassErrorModel(
        variance_ratio=np.ones((n, CENTRE_WAVELENGTHS.size)),
        local_ratio=np.ones((n, len(RANGES), stack.nodes.size)),
        used=np.ones(n, bool),
        vehicle_variance=np.zeros((int(vehicle.max()) + 1, len(RANGES))),
        hidden_share=np.zeros(len(RANGES)),
        vehicle=vehicle,
    )


def aligned(one: DatedProfile) -> AlignedPass:
    ends = one.profile["distance"].to_numpy()[[0, -1]]
    return AlignedPass(one, 0.0, ends, np.zeros(2))


def covariance(density: Array, omega: Array) -> Array:
    """Covariance of COUNT neighbouring points of a process with a spectrum (Wiener-Khinchin theorem)."""
    weight = density * np.gradient(omega)
    return toeplitz(np.cos(np.outer(AT, omega)) @ weight)


@dataclass(frozen=True)
class DensePosteriors:
    """Dense Gaussian posteriors of passes, one by one and jointly, with the joint standard deviation by band."""

    truth: Array
    passes: tuple[DatedProfile, ...]
    joint: Array
    deviation: dict[str, Array]


@pytest.fixture(scope="module")
def dense() -> DensePosteriors:
    """Five passes with large errors at long wavelengths: each has a gain of 60 to 90 % in D3."""
    omega = np.linspace(1e-4, np.pi, 2500)
    prior = covariance(2e-6 / (omega**2 + 0.0206**2), omega)
    generator = np.random.default_rng(4)
    truth = np.linalg.cholesky(prior + 1e-15 * np.eye(COUNT)) @ generator.standard_normal(COUNT)
    filters = {band: band_pass(np.eye(COUNT), SPACING, band).T for band in BANDS}
    precision, information = np.linalg.inv(prior), np.zeros(COUNT)
    noise = covariance(6e-10 / (omega**2 + 0.002**2) ** 2 + 6e-10 / 0.6**4, omega)
    root, inverse = np.linalg.cholesky(noise), np.linalg.inv(noise)
    passes = []
    for number, size in enumerate((1.0, 1.5, 2.0, 0.8, 1.2)):
        observed = truth + size * root @ generator.standard_normal(COUNT)
        gain = np.linalg.solve(prior + size**2 * noise, prior).T
        posterior = prior - gain @ prior
        added = inverse / size**2
        precision, information = precision + added, information + added @ observed
        passes.append(
            DatedProfile(
                build_profile(
                    AT, gain @ observed, kind="posterior", standard_deviation=np.sqrt(np.diag(posterior)),
                    band_standard_deviations={
                        band.name: deviation_in(one, posterior) for band, one in filters.items()
                    },
                ),
                DAY,
                f"pass {number}",
            )
        )  # fmt: skip
    joint = np.linalg.inv(precision)
    deviation = {band.name: deviation_in(one, joint) for band, one in filters.items()}
    return DensePosteriors(truth, tuple(passes), joint @ information, deviation)


def deviation_in(filtering: Array, covariance: Array) -> Array:
    """Standard deviation of a filtered process at each point."""
    return np.sqrt(np.einsum("ij,ij->i", filtering @ covariance, filtering))


def inner(band: Band) -> slice:
    edge = int(edge_distance(band) / SPACING)
    return slice(edge, -edge)


def test_combined_passes_equal_the_joint_posterior_of_all_recordings(
    dense: DensePosteriors,
) -> None:
    stack = stack_passes([aligned(one) for one in dense.passes])
    line = combine(stack, np.zeros(5), stated_errors(stack), 0.0)
    deviation = standard_deviations(line.error_density)
    for band in BANDS:
        inside = inner(band)
        difference = band_pass(line.level - dense.joint, SPACING, band)[inside]
        joint = dense.deviation[band.name][inside]
        assert np.sqrt(np.mean(difference**2)) < 0.15 * joint.mean(), band.name
        stated = np.interp(AT, stack.nodes, deviation[band.name])[inside]
        assert stated.mean() == pytest.approx(joint.mean(), rel=0.02), band.name


def test_an_average_of_the_posteriors_would_count_the_prior_five_times(
    dense: DensePosteriors,
) -> None:
    levels = np.stack([one.profile["elevation"].to_numpy() for one in dense.passes])
    deviations = [one.profile["standard_deviation_D3"].to_numpy() for one in dense.passes]
    naive = np.average(levels, axis=0, weights=np.median(deviations, axis=1) ** -2)
    inside = inner(D3)
    difference = band_pass(naive - dense.joint, SPACING, D3)[inside]
    assert np.sqrt(np.mean(difference**2)) > 0.6 * dense.deviation["D3"][inside].mean()


def test_a_single_pass_is_reproduced_by_the_sum_of_its_subbands(dense: DensePosteriors) -> None:
    one = dense.passes[1]
    stack = stack_passes([aligned(one)])
    line = combine(stack, np.zeros(1), stated_errors(stack), 0.0)
    deviation = standard_deviations(line.error_density)
    assert np.abs(line.level - one.profile["elevation"].to_numpy()).max() < 1e-12
    for band in BANDS:
        inside = inner(band)
        stated = one.profile[f"standard_deviation_{band.name}"].to_numpy()[inside]
        combined = np.interp(AT, stack.nodes, deviation[band.name])[inside]
        assert combined == pytest.approx(stated, rel=0.03)


def test_the_line_of_all_others_is_the_combination_without_the_pass(dense: DensePosteriors) -> None:
    stack = stack_passes([aligned(one) for one in dense.passes])
    rest = stack_passes([aligned(one) for one in dense.passes[1:]])
    others = combine_others(stack, stated_errors(stack))[0]
    expected = combine(rest, np.zeros(4), stated_errors(rest), 0.0).level
    inside = inner(D2)
    difference = band_pass(others - expected, SPACING, D2)[inside]
    # The two differ by the prior, which only the combination includes.
    assert np.sqrt(np.mean(difference**2)) < 0.2 * dense.deviation["D2"][inside].mean()


# One subband at one node, compared with generalised least squares in matrix form


@pytest.fixture(scope="module")
def stack() -> PassStack:
    line = Line(length=400.0)
    trains = [replace(one, ahead=0.0, scale=0.0) for one in fleet(7)]
    return stack_passes([aligned(passing(line, one)) for one in trains])


@pytest.mark.parametrize("subband", [6, 11, 14])
@pytest.mark.parametrize("day", [0.0, 15.0, 40.0])
def test_weights_are_those_of_generalised_least_squares(
    stack: PassStack, subband: int, day: float
) -> None:
    generator = np.random.default_rng(subband)
    days = np.array([(one.dated.day - FIRST).days for one in stack.passes], float)
    days -= days.mean()
    vehicle = np.array([0, 1, 2, 0, 1, 2, 0])
    number = next(i for i, one in enumerate(RANGES) if subband in one.indices)
    errors = stated_errors(stack, vehicle)
    errors.variance_ratio[:] = generator.uniform(0.5, 3.0, errors.variance_ratio.shape)
    errors.vehicle_variance[:, number] = [1e-6, 0.0, 1e-4]
    weights = least_squares_weights(stack, subband, days, errors, day)
    k = stack.nodes.size // 2
    P, G = stack.error_density[:, subband, k], stack.gain(subband)[:, k]
    own = errors.variance_ratio[:, subband] * P / G
    U = errors.vehicle_variance[vehicle, number] * stack.track_density(subband)[k]
    noise = np.diag(own) + np.where(vehicle[:, None] == vehicle, U[:, None], 0.0)
    design = np.stack([np.ones(7), days], axis=1)
    rate_precision = (np.ptp(days) / 10.0) ** 2 / stack.pass_prior[:, subband].max()
    precision = np.diag([1 / stack.prior(subband), rate_precision])
    covariance = np.linalg.inv(precision + design.T @ np.linalg.solve(noise, design))
    gains = covariance @ np.linalg.solve(noise, design).T / G
    row = np.array([1.0, day])
    assert weights.level[:, k] == pytest.approx(row @ gains, rel=1e-6, abs=1e-9)
    assert weights.rate[:, k] == pytest.approx(gains[1], rel=1e-6, abs=1e-12)
    expected = (row @ covariance @ row, covariance[1] @ row, covariance[1, 1])
    assert weights.variance[:, k] == pytest.approx(expected, rel=1e-6)
    without_rate = np.linalg.inv(
        precision + design.T @ np.linalg.solve(noise, design) + np.diag([0, 1e12])
    )
    assert weights.variance_without_rate[k] == pytest.approx(without_rate[0, 0], rel=1e-3)


def test_the_error_of_one_vehicles_passes_never_falls_below_their_common_error(
    stack: PassStack,
) -> None:
    errors = stated_errors(stack, np.zeros(7, int))
    errors.vehicle_variance[:] = 1e-4
    variance = least_squares_weights(stack, 8, np.zeros(7), errors, 0.0).variance[0]
    common = 1e-4 * stack.track_density(8)
    assert (variance > 0.99 * common).all()
    assert (variance < 1.1 * (common + stack.error_density[:, 8].min(axis=0))).all()


def test_a_rejected_pass_has_no_weight(stack: PassStack) -> None:
    errors = stated_errors(stack)
    errors.used[3] = False
    weights = least_squares_weights(stack, 8, np.zeros(7), errors, 0.0)
    assert (weights.level[3] == 0).all()
    assert weights.level.sum(axis=0) == pytest.approx(1.0, abs=1e-4)

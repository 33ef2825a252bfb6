"""The variances of passes and vehicles, against a likelihood written out and drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from trackprofile.fusion.variance_components import BELIEF, CovarianceCells, factors

Array = np.ndarray
N = 6
DAYS = np.arange(N) - 2.5
VEHICLE = np.array([0, 1, 2, 0, 1, 2])
OWN = np.arange(3)
TRUE_LOUDER = np.array([1.0, 1.0, 4.0, 1.0, 0.5, 1.0])


def drawn(
    seed: int, *, louder: Array = TRUE_LOUDER, shared: tuple[float, ...] = (0.0, 3.0, 0.0),
    change: float = 0.0, count: int = 60, stretches: int = 30, days: Array = DAYS,
    vehicle: Array = VEHICLE,
) -> CovarianceCells:  # fmt: skip
    """Cells of one wave whose passes differ as Σ says, about a level far greater than they do."""
    generator = np.random.default_rng(seed)
    n = days.size
    told = generator.uniform(0.5, 2.0, (stretches, n))
    root = np.sqrt(told)
    products = np.empty((stretches, n, n))
    for row in range(stretches):
        level, rate = 50 * generator.standard_normal((2, count))
        of_vehicle = np.sqrt(shared)[:, None] * generator.standard_normal((len(shared), count))
        own = np.sqrt(louder)[:, None] * generator.standard_normal((n, count))
        moving = rate * np.sqrt(change) / 50 * days[:, None] * (row == 3)
        t = root[row][:, None] * (level + of_vehicle[vehicle] + moving) + own
        products[row] = t @ t.T / count
    start = 250.0 * np.arange(stretches)
    return CovarianceCells(
        products, told, np.ones(stretches), np.full(stretches, float(count)), start, start + 250.0,
        np.zeros(stretches, int),
    )  # fmt: skip


def loss(of: CovarianceCells, louder: Array, shared: Array) -> float:
    """-2 log of the likelihood of the passes' differences, and of the belief in a common loudness of 1."""
    total = BELIEF * float(np.sum(np.log(louder) + 1 / louder))
    for C, told, count in zip(of.product, of.told, of.count, strict=True):
        level = np.sqrt(told)
        together = np.where(VEHICLE[:, None] == VEHICLE, shared[VEHICLE], 0.0)
        S = np.diag(louder) + level[:, None] * together * level
        inverse = np.linalg.inv(S)
        weight = float(level @ inverse @ level)
        Q = inverse - np.outer(inverse @ level, level @ inverse) / weight
        total += count * (np.linalg.slogdet(S)[1] + np.log(weight) + float(np.trace(Q @ C)))
    return total


def test_variances_of_passes_and_vehicles_are_found() -> None:
    found = factors(drawn(1), DAYS, VEHICLE, OWN)
    # Of 1800 waves a variance is known to 3 %, and a little worse for what is shared.
    assert found.louder[:, 0] == pytest.approx(TRUE_LOUDER, rel=0.15)
    assert found.shared[1] == pytest.approx(3.0, rel=0.2)
    assert found.shared[[0, 2]].max() < 0.1
    assert found.counts[:, 0] == pytest.approx(1800.0)


def test_no_other_variances_make_the_passes_differences_more_probable() -> None:
    of = drawn(2)
    louder = np.exp(
        minimize(
            lambda at: loss(of, np.exp(at[:N]), np.exp(at[N:])), np.full(N + 3, -0.5),
            method="L-BFGS-B", bounds=[(-12, 6)] * (N + 3),
        ).x
    )  # fmt: skip
    found = factors(of, np.zeros(N), VEHICLE, OWN)
    # The usual loudness, here 1 but for what is drawn, is the one that the belief is about.
    assert loss(of, found.louder[:, 0], found.shared) < loss(of, louder[:N], louder[N:]) + 0.1


def test_a_place_that_moves_makes_no_pass_louder() -> None:
    found = factors(drawn(3, change=400.0), DAYS, VEHICLE, OWN)
    assert found.louder[:, 0] == pytest.approx(TRUE_LOUDER, rel=0.2)
    assert found.change[3] > 100 * np.delete(found.change, 3).max()


def test_vehicles_that_are_tied_have_one_variance() -> None:
    found = factors(drawn(4), DAYS, VEHICLE, np.zeros(3, int))
    assert found.shared == pytest.approx(np.full(3, found.shared[0]))
    assert 0.3 < found.shared[0] < 3.0


def test_one_vehicle_alone_shows_nothing_of_what_it_has_wrong() -> None:
    found = factors(
        drawn(5, shared=(0.0,), vehicle=np.zeros(N, int)), DAYS, np.zeros(N, int), np.zeros(0, int)
    )
    assert found.shared.size == 0
    assert found.louder[:, 0] == pytest.approx(TRUE_LOUDER, rel=0.15)


def test_passes_that_all_understate_their_error_are_taken_at_it_on_a_short_line_too() -> None:
    found = factors(
        drawn(6, louder=np.full(N, 9.0), shared=(0.0,) * 3, count=8, stretches=1),
        DAYS,
        VEHICLE,
        OWN,
    )
    assert 3.0 < np.median(found.louder) < 20.0


def test_a_pass_that_is_not_there_is_as_loud_as_is_usual() -> None:
    of = drawn(7)
    told = of.told.copy()
    told[:, 2] = 0.0
    found = factors(replace(of, told=told), DAYS, VEHICLE, OWN)
    assert found.counts[2, 0] == 0
    assert found.louder[2, 0] == pytest.approx(1.0, rel=0.2)
    others = np.delete(found.louder[:, 0], 2)
    assert others == pytest.approx(np.delete(TRUE_LOUDER, 2), rel=0.25)

"""The smoother against a dense batch solution of the same linear-Gaussian problem."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline
from scipy.linalg import expm

from trackprofile.kalman.smoother import (
    KalmanGains,
    error_samples,
    initial_state,
    kalman_gains,
    posterior_variances,
    smooth,
)
from trackprofile.kalman.time_steps import DiscretisedRun, TimeSteps, discretise_run, time_steps
from trackprofile.models.discretisation import generator_matrix
from trackprofile.models.kinematics import Motion
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.spectrum import Spectrum, markov_process
from trackprofile.models.statespace import StateSpace, state_space
from trackprofile.models.track import ElasticTrack, RigidTrack, Track
from trackprofile.models.vehicle import Body, Link, Vehicle, Wheel

Array = np.ndarray
SPACING = 0.25
PRIOR = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)
SENSORS = (
    Sensor("acceleration", VERTICAL_ACCELERATION, "body", 0.3, noise_density=1e-3),
    Sensor("gyro", PITCH_RATE, "body", noise_density=1e-4),
)
FLICKERING = tuple(replace(one, flicker=30.0 * (one.noise_density or 0.0)) for one in SENSORS)


def cart() -> Vehicle:
    """Two wheels, not a whole number of knots apart."""
    wheels = (Wheel("front", 500.0, 0.0), Wheel("rear", 500.0, 1.13))
    links = tuple(Link(f"{w.name} spring", "body", w.name, w.position, 8e5, 2e4) for w in wheels)
    return Vehicle("cart", (Body("body", 20000.0, 8e3, 0.6),), links, wheels)


@dataclass(frozen=True)
class Problem:
    """A short ride with long steps, varying speed and gaps."""

    system: StateSpace
    motion: Motion
    steps: TimeSteps
    ride: DiscretisedRun
    filter: KalmanGains
    signals: Array


def problem(
    track: Track, unmodelled: float, sensors: int, shift: float = 0.0, *, flicker: bool = False
) -> Problem:
    generator_ = np.random.default_rng(1)
    system = state_space(
        cart(), point_track(track), (FLICKERING if flicker else SENSORS)[:sensors], unmodelled
    )
    interval = generator_.uniform(0.004, 0.03, 50)
    interval[20] = 0.12
    time = np.cumsum(interval)
    speed = 8 + 2 * np.sin(3 * time)
    run = np.cumsum(np.diff(time) * 0.5 * (speed[1:] + speed[:-1]))
    moved = Motion(time, shift + 3.1 + np.r_[0.0, run], speed, np.gradient(speed, time))
    valid = np.ones((50, sensors), bool)
    valid[5:9, 0] = valid[30:33] = False
    ride = discretise_run(system, moved, valid, SPACING)
    variance = np.array([1e-4, 1e-6])[ride.sensors] * generator_.uniform(0.5, 2, len(ride.rows))
    shaken = np.full(2 * system.disturbance.shape[1], 0.1)
    others = np.r_[shaken, np.sqrt(system.flicker), [0.1, 0.01][:sensors]]
    prepared = kalman_gains(ride, PRIOR, variance, initial_state(system, PRIOR, ride, others))
    signals = 0.1 * generator_.standard_normal((len(ride.rows), 1))
    return Problem(system, moved, time_steps(moved, SPACING), ride, prepared, signals)


@dataclass(frozen=True)
class Dense:
    """Signals = A u + noise, u = [first state, all coefficients, noise of each bay], u ~ N(0, P)."""

    A: Array
    P: Array
    knots: Array


def dense(one: Problem) -> Dense:
    """The problem without any recursion: matrix exponentials and SciPy's B-splines."""
    system, steps, ride = one.system, one.steps, one.ride
    n, bays = len(system.A), len(ride.F)
    coefficients = ride.ring + bays - 1
    random = system.disturbance.size > 0 or len(system.flicker) > 0
    size = n + coefficients + (bays * n if random else 0)
    state, G, rows, bay = np.eye(n, size), generator_matrix(system), [], 0

    def path(k: int) -> Array:
        s, v, a = steps.position[k], steps.speed[k], steps.acceleration[k]
        out = np.zeros((3, len(system.wheel_positions), size))
        for i, behind in enumerate(system.wheel_positions):
            j = int(np.floor((s - behind) / SPACING))
            basis = BSpline(SPACING * np.arange(j - 3, j + 5), np.eye(4), 3)
            r, r1, r2 = (
                basis.derivative(d)(s - behind) if d else basis(s - behind) for d in range(3)
            )
            here = slice(n + j - ride.first_knot, n + j - ride.first_knot + 4)
            out[0, i, here], out[1, i, here], out[2, i, here] = r, v * r1, v**2 * r2 + a * r1
        return out

    for k, T in enumerate(steps.interval):
        if k in steps.first_step[1:-1]:
            if random:
                duration = steps.interval[steps.first_step[bay] : steps.first_step[bay + 1]].sum()
                at = n + coefficients + bay * n
                state[:, at : at + n] += noise_root(system, duration)
            bay += 1
        if T > 0:
            a, b = path(k), path(k + 1)
            move, w = expm(G * T)[:n], len(system.wheel_positions)
            cubic = (
                a[0], a[1], 6 * (b[0] - a[0]) / T**2 - (4 * a[1] + 2 * b[1]) / T,
                12 * (a[0] - b[0]) / T**3 + 6 * (a[1] + b[1]) / T**2,
            )  # fmt: skip
            state = move[:, :n] @ state + sum(
                move[:, n + j * w : n + (j + 1) * w] @ cubic[j] for j in range(4)
            )
        sample = steps.sample[k]
        for sensor in ride.sensors[ride.samples == sample] if sample >= 0 else ():
            direct = np.einsum("dw,dwu->u", system.D[sensor], path(k + 1))
            rows.append(system.C[sensor] @ state + direct)
    start = one.filter.start
    stance = np.zeros((n, coefficients))
    first = np.arange(ride.first_knot, ride.first_knot + ride.ring)
    stance[:, : ride.ring] = start.quasi_static_gain[:, first % ride.ring]
    P = np.eye(size)
    track = markov_process(PRIOR, SPACING).covariance(coefficients)
    inner = slice(n, n + coefficients)
    P[inner, inner] = track
    P[:n, inner] = stance @ track
    P[inner, :n] = P[:n, inner].T
    P[:n, :n] = stance @ track @ stance.T + np.diag(start.standard_deviation**2)
    knots = np.zeros((ride.knots, size))
    for i in range(ride.knots):
        knots[i, n + i : n + i + 3] = np.array([1, 4, 1]) / 6
    return Dense(np.array(rows), P, knots)


def noise_root(system: StateSpace, duration: float) -> Array:
    """A root of the noise that a bay adds, by integrating Q' = A Q + Q Aᵀ + d dᵀ; flicker has d² = 2 ω σ²."""
    A, intensity = system.A, system.disturbance @ system.disturbance.T
    flicker = len(A) - len(system.C) - len(system.flicker) + np.arange(len(system.flicker))
    intensity[flicker, flicker] = -2 * A[flicker, flicker] * system.flicker

    def slope(_: float, flat: Array) -> Array:
        Q = flat.reshape(A.shape)
        return (A @ Q + Q @ A.T + intensity).ravel()

    found = solve_ivp(
        slope, (0, duration), np.zeros(A.size), rtol=1e-12, atol=1e-20, method="DOP853"
    )
    Q = found.y[:, -1].reshape(A.shape)
    values, vectors = np.linalg.eigh((Q + Q.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))


TRACKS = (RigidTrack(), ElasticTrack(8e7, 3e4))


@pytest.mark.parametrize("track", TRACKS, ids=["rigid", "elastic"])
@pytest.mark.parametrize("unmodelled", [0.0, 0.05])
@pytest.mark.parametrize("sensors", [1, 2])
@pytest.mark.parametrize("flicker", [False, True])
def test_smoother_is_the_dense_batch_solution(
    track: Track, unmodelled: float, sensors: int, flicker: bool
) -> None:
    one = problem(track, unmodelled, sensors, flicker=flicker)
    assert len(one.system.flicker) == (4 * sensors if flicker else 0)
    whole, y = dense(one), one.signals
    S = whole.A @ whole.P @ whole.A.T + np.diag(one.filter.variance)
    K = np.linalg.solve(S, whole.A @ whole.P).T
    mean, posterior = K @ y, whole.P - K @ whole.A @ whole.P
    found = smooth(one.filter, y)
    elevation = whole.knots @ mean
    np.testing.assert_allclose(
        found.elevation, elevation, rtol=0, atol=1e-8 * np.max(np.abs(elevation))
    )
    spread = np.einsum("ki,ij,kj->k", whole.knots, posterior, whole.knots)
    np.testing.assert_allclose(posterior_variances(one.filter).elevation, spread, rtol=1e-8)
    likelihood = -0.5 * (
        np.linalg.slogdet(2 * np.pi * S)[1] + y[:, 0] @ np.linalg.solve(S, y[:, 0])
    )
    assert found.log_likelihood[0] == pytest.approx(likelihood, rel=1e-8)
    left = y - whole.A @ mean
    np.testing.assert_allclose(found.residual, left, rtol=0, atol=1e-8 * np.max(np.abs(left)))


@pytest.mark.parametrize("unmodelled", [0.0, 0.05])
@pytest.mark.parametrize("flicker", [False, True])
def test_samples_and_offsets_are_judged_by_the_likelihood_without_them(
    unmodelled: float, flicker: bool
) -> None:
    one = problem(ElasticTrack(8e7, 3e4), unmodelled, 2, flicker=flicker)
    whole, y, ride = dense(one), one.signals, one.ride
    S = whole.A @ whole.P @ whole.A.T + np.diag(one.filter.variance)
    found, judged = smooth(one.filter, y), posterior_variances(one.filter)
    np.testing.assert_allclose(judged.precision, np.diag(np.linalg.inv(S)), rtol=1e-7)
    for bay in (0, 7, len(ride.F) - 2):
        for sensor in range(2):
            later = np.arange(len(ride.rows)) >= ride.first_row[bay + 1]
            jump = np.where(later & (ride.sensors == sensor), 1.0, 0.0)
            slope = jump @ np.linalg.solve(S, y[:, 0])
            assert found.offset_score[bay, sensor] == pytest.approx(slope, rel=1e-6)
            expected = jump @ np.linalg.solve(S, jump)
            assert judged.offset_precision[bay, sensor] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("flicker", [False, True])
def test_draws_of_the_error_have_the_posteriors_variance(flicker: bool) -> None:
    one = problem(RigidTrack(), 0.05, 2, flicker=flicker)
    draws = error_samples(one.filter, 20_000, np.random.default_rng(3))
    # Relative error of a variance from m draws is √(2/m) = 1 %; four of them.
    np.testing.assert_allclose(
        np.var(draws, axis=1), posterior_variances(one.filter).elevation, rtol=0.04
    )


@settings(max_examples=20)
@given(st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 1000))
def test_smoother_is_linear_in_the_signals(a: float, b: float, seed: int) -> None:
    one = problem(RigidTrack(), 0.0, 2)
    x, y = np.random.default_rng(seed).standard_normal((2, len(one.ride.rows), 1))
    together = smooth(one.filter, a * x + b * y).elevation
    apart = a * smooth(one.filter, x).elevation + b * smooth(one.filter, y).elevation
    np.testing.assert_allclose(together, apart, atol=1e-9 * (1 + np.max(np.abs(apart))))


@settings(max_examples=10)
@given(st.integers(-400, 400))
def test_ride_shifted_by_whole_knots_shifts_the_profile(knots: int) -> None:
    here, there = (problem(RigidTrack(), 0.05, 2, shift) for shift in (0.0, knots * SPACING))
    assert there.ride.first_knot - here.ride.first_knot == knots
    np.testing.assert_allclose(
        smooth(there.filter, here.signals).elevation,
        smooth(here.filter, here.signals).elevation,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        posterior_variances(there.filter).elevation,
        posterior_variances(here.filter).elevation,
        rtol=1e-7,
    )


def test_signals_pass_side_by_side_as_they_do_alone() -> None:
    one = problem(ElasticTrack(8e7, 3e4), 0.0, 2)
    several = np.random.default_rng(5).standard_normal((len(one.ride.rows), 3))
    together = smooth(one.filter, several).elevation
    for i in range(3):
        alone = smooth(one.filter, several[:, i : i + 1]).elevation[:, 0]
        np.testing.assert_allclose(together[:, i], alone, rtol=0, atol=1e-12)


def test_units_of_a_signal_do_not_matter_if_its_noise_has_them_too() -> None:
    one = problem(RigidTrack(), 0.0, 1)
    scaled = replace(
        one.ride, rows=1e3 * one.ride.rows
    )  # millimetres per second squared, and the model reads them so
    again = kalman_gains(scaled, PRIOR, 1e6 * one.filter.variance, one.filter.start)
    np.testing.assert_allclose(
        smooth(again, 1e3 * one.signals).elevation,
        smooth(one.filter, one.signals).elevation,
        rtol=0,
        atol=1e-10,
    )

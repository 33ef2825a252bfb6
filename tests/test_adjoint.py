"""The dot-test, and the smoother's forward and adjoint recursions by it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.kalman import kernels
from trackprofile.kalman.smoother import KalmanGains, initial_state, innovations, kalman_gains
from trackprofile.kalman.time_steps import discretise_run
from trackprofile.models.adjoint import dot_test
from trackprofile.models.kinematics import Motion
from trackprofile.models.receptance import point_track
from trackprofile.models.statespace import state_space

Array = NDArray[np.float64]

A = np.random.default_rng(1).standard_normal((5, 3))


def forward(u: Array) -> Array:
    return A @ u


def test_adjoint_of_a_matrix_is_its_transpose() -> None:
    assert dot_test(forward, lambda v: A.T @ v, 3, 5) < 1e-14


def test_wrong_adjoint_is_rejected() -> None:
    wrong = A.copy()
    wrong[2, 1] *= 1 + 1e-6
    with pytest.raises(ModelError, match="the adjoint is not that of the forward map"):
        dot_test(forward, lambda v: wrong.T @ v, 3, 5)


def test_wrong_shapes_and_a_map_to_zero_are_rejected() -> None:
    with pytest.raises(ModelError, match=r"adjoint must return the shape \(3,\), got \(5,\)"):
        dot_test(forward, lambda v: v, 3, 5)
    with pytest.raises(ModelError, match="maps a random vector to 0"):
        dot_test(lambda u: np.zeros(5), lambda v: A.T @ v, 3, 5)


def run_over(length: float) -> KalmanGains:
    """Gains of a car on elastic track with two sensors at 500 Hz and varying speed."""
    sensors, spectrum = read_sensors("bogie-25ug"), read_spectrum("fra-5")
    system = state_space(read_vehicle("velaro")[0], point_track(read_track("zhai")), sensors)
    time = np.arange(round(length / 30.0 * 500.0)) / 500.0
    speed = 30.0 + 3.0 * np.sin(2.0 * time)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / 500.0)])
    motion = Motion(time, distance, speed, np.gradient(speed, time))
    valid = np.ones((len(time), len(sensors)), bool)
    valid[100:120, 0] = False
    run = discretise_run(system, motion, valid, 0.25)
    offsets = np.array([one.offset_standard_deviation for one in sensors])
    density = np.array([one.noise_density for one in sensors], np.float64)
    variance = (density**2 * 250.0)[run.sensors]
    return kalman_gains(run, spectrum, variance, initial_state(system, spectrum, run, offsets))


def innovations_adjoint(gains: KalmanGains, weights: Array) -> Array:
    """Adjoint of the map from signals to innovations: the backward recursion with u = w + Kᵀ λ in place of e/S."""
    run, process, bays = gains.run, gains.process, len(gains.run.F)
    signals = (gains.innovation_variance * weights)[:, None]
    kernels.smoothed(
        process.a1, process.a2, run.F, run.G, run.slots, run.rows, run.first_row, run.newest,
        gains.gains, gains.innovation_variance, np.ones(len(run.rows)), gains.knot_covariance,
        signals, np.zeros((bays, 1)), np.empty((bays, run.offsets)),
    )  # fmt: skip
    return signals[:, 0]


def test_backward_recursion_of_the_smoother_is_the_adjoint_of_its_filter() -> None:
    gains = run_over(40.0)
    rows = len(gains.run.rows)
    for seed in range(3):
        mismatch = dot_test(
            lambda signal: innovations(gains, signal[:, None])[:, 0],
            lambda weights: innovations_adjoint(gains, weights),
            rows,
            rows,
            seed,
        )
        assert mismatch < 1e-12

"""The linear system against analytical and dense solutions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import butter, freqs

from narrowing import not_none
from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.kalman.transition_kernels import _evaluate
from trackprofile.models.discretisation import generator_matrix, step_table
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.statespace import (
    StateSpace,
    state_space,
    transfer_function,
)
from trackprofile.models.track import ElasticTrack, RigidTrack
from trackprofile.models.vehicle import HEAVE, PITCH, assemble

OMEGA = 2 * np.pi / np.array([200.0, 70.0, 25.0, 11.0, 5.0, 3.0])
ON_BOGIE = (
    Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie", 0.4),
    Sensor("pitch rate", PITCH_RATE, "leading bogie"),
)


def test_quarter_car_follows_its_transfer_function() -> None:
    m1, m2, k1, k2, c1, c2, v = 7900.0, 512.5, 7.3e5, 5e5, 15e3, 5e3, 30.0
    s = 1j * OMEGA * v
    secondary, primary = k1 + c1 * s, k2 + c2 * s
    # m1 s² u1 = secondary (u2 - u1);  m2 s² u2 = primary (r - u2) - secondary (u2 - u1)
    body = secondary / (m1 * s**2 + secondary)
    bogie = primary / (m2 * s**2 + primary + secondary * (1 - body))
    quarter = read_vehicle("quarter-car")[0]
    sensors = [Sensor(name, VERTICAL_ACCELERATION, name) for name in ("body", "bogie")]
    found = transfer_function(state_space(quarter, RigidTrack(), sensors), OMEGA, v)
    np.testing.assert_allclose(found[:, 0], s**2 * bogie * body, rtol=1e-10)
    np.testing.assert_allclose(found[:, 1], s**2 * bogie, rtol=1e-10)


def test_car_on_springs_answers_as_its_dense_matrices_do() -> None:
    velaro, v = read_vehicle("velaro")[0], 41.7
    track = ElasticTrack(87.8e6, 36e3)
    found = transfer_function(state_space(velaro, track, ON_BOGIE), OMEGA, v)
    whole = assemble(velaro)
    wheels = [whole.index(wheel.name, HEAVE) for wheel in velaro.wheels]
    z, theta = whole.index("leading bogie", HEAVE), whole.index("leading bogie", PITCH)
    for omega, row in zip(OMEGA, found, strict=True):
        s = 1j * omega * v
        contact = track.stiffness + track.damping * s
        dynamic = whole.mass * s**2 + whole.damping * s + whole.stiffness
        dynamic[wheels, wheels] += contact
        load = np.zeros(len(dynamic), complex)
        load[wheels] = contact * np.exp(-1j * omega * np.array([w.position for w in velaro.wheels]))
        q = np.linalg.solve(dynamic, load)
        np.testing.assert_allclose(row, [s**2 * (q[z] + 0.4 * q[theta]), s * q[theta]], rtol=1e-9)


def test_elastic_track_tends_to_the_rigid_one() -> None:
    velaro = read_vehicle("velaro")[0]
    rigid = transfer_function(state_space(velaro, RigidTrack(), ON_BOGIE), OMEGA, 20.0)
    errors = []
    for stiffness in (1e9, 1e10, 1e11):
        soft = state_space(velaro, ElasticTrack(stiffness, 1e4), ON_BOGIE)
        errors.append(np.max(np.abs(transfer_function(soft, OMEGA, 20.0) / rigid - 1)))
    assert errors[2] < 1e-3
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 10.0, rtol=0.1)


def test_wheel_on_a_rigid_path_accelerates_as_its_path() -> None:
    velaro = read_vehicle("velaro")[0]
    axle_box = [Sensor("axle box", VERTICAL_ACCELERATION, "wheel 2")]
    found = transfer_function(state_space(velaro, RigidTrack(), axle_box), OMEGA, 25.0)
    np.testing.assert_allclose(
        found[:, 0], -((OMEGA * 25) ** 2) * np.exp(-2.5j * OMEGA), rtol=1e-12
    )


def system() -> StateSpace:
    return state_space(
        read_vehicle("velaro")[0], point_track(read_track("zhai")), ON_BOGIE, unmodelled=0.01
    )


@given(st.floats(1e-5, 0.05))
def test_tabulated_step_is_the_matrix_exponential(duration: float) -> None:
    one = system()
    table = step_table(one, 0.05)
    n = len(one.A)
    found = np.empty((n, n + 16))
    _evaluate(table.motion, table.spacing, duration, found)
    exact = expm(generator_matrix(one) * duration)[:n]
    scale = np.max(np.abs(exact), axis=1, keepdims=True)
    np.testing.assert_allclose(found / scale, exact / scale, atol=1e-11)


def test_tabulated_noise_is_the_integral_over_the_step() -> None:
    one = state_space(
        read_vehicle("quarter-car")[0],
        RigidTrack(),
        [Sensor("a", VERTICAL_ACCELERATION, "body")],
        0.02,
    )
    table = step_table(one, 0.05)
    n, duration = len(one.A) - 1, 0.0317  # all but the offset, which nothing disturbs
    found = np.empty((n + 1, n + 1))
    _evaluate(table.noise, table.spacing, duration, found)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    exact = np.zeros((n, n))
    for node, weight in zip(nodes, weights, strict=True):
        pushed = expm(one.A * 0.5 * duration * (node + 1)) @ one.disturbance
        exact += 0.5 * duration * weight * (pushed @ pushed.T)[:n, :n]
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    np.testing.assert_allclose(found[:n, :n] / scale, exact / scale, atol=1e-9)


def test_unmodelled_acceleration_has_the_stated_deviation_about_the_bounce() -> None:
    one = state_space(
        read_vehicle("quarter-car")[0],
        RigidTrack(),
        [Sensor("a", VERTICAL_ACCELERATION, "body")],
        0.02,
    )
    driven = 2 * len(one.freedoms) + 1
    inner = slice(2 * len(one.freedoms), driven + 1)
    A, pushed = one.A[inner, inner], one.disturbance[inner]
    stationary = solve_continuous_lyapunov(A, -pushed @ pushed.T)
    np.testing.assert_allclose(stationary, 0.02**2 * np.eye(2), atol=1e-18)
    bounce = np.abs(np.linalg.eigvals(one.A[: driven - 1, : driven - 1])).min()
    assert np.abs(np.linalg.eigvals(A))[0] == pytest.approx(bounce, rel=1e-9)


def test_sensor_with_a_bandwidth_reads_behind_a_butterworth_low_pass() -> None:
    velaro = read_vehicle("velaro")[0]
    on_wheel = Sensor("axle box", VERTICAL_ACCELERATION, "wheel 2")
    sensors, speed = [*ON_BOGIE, on_wheel], 25.0
    behind = [replace(one, bandwidth=10.0 + i) for i, one in enumerate(sensors)]
    exact, passed = (
        transfer_function(state_space(velaro, RigidTrack(), ones), OMEGA, speed)
        for ones in (sensors, behind)
    )
    for i, one in enumerate(behind):
        b, a = cast(Any, butter(2, 2 * np.pi * not_none(one.bandwidth), analog=True))
        _, low_pass = freqs(b, a, cast(Any, OMEGA * speed))
        np.testing.assert_allclose(passed[:, i], low_pass * exact[:, i], rtol=1e-9)


def test_sensors_that_the_vehicle_cannot_carry_are_refused() -> None:
    velaro, quarter = read_vehicle("velaro")[0], read_vehicle("quarter-car")[0]
    with pytest.raises(ModelError, match=r"'roof', which vehicle .* does not have; it has body"):
        state_space(velaro, RigidTrack(), [replace(ON_BOGIE[0], body="roof")])
    with pytest.raises(ModelError, match="'wheel 1' has no pitch"):
        state_space(velaro, RigidTrack(), [replace(ON_BOGIE[1], body="wheel 1")])
    with pytest.raises(ModelError, match="has no mass, which an elastic track needs"):
        state_space(quarter, ElasticTrack(1e8, 1e4), [Sensor("a", VERTICAL_ACCELERATION, "body")])

"""Fault detectors on signals with known faults."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.contracts import Channel, build_recording
from trackprofile.preprocessing.fault_detectors import resolution, stuck
from trackprofile.preprocessing.faults import FaultKind, find_faults


def random_walk(count: int, seed: int = 1) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).standard_normal(count)) * 0.05


def test_longer_sampling_intervals_of_a_slow_train_are_no_gaps() -> None:
    distance = 0.25 * np.arange(2000)
    speed = 5.0 + 15.0 * distance / distance[-1]
    time = np.concatenate([[0.0], np.cumsum(np.diff(distance) / speed[1:])])
    floor = Channel("floor", random_walk(2000), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=time, distance=distance, speed=speed)
    assert find_faults(recording) == ()
    incomplete = recording.isel(sample=np.r_[0:700, 703:2000])
    assert [(one.kind, one.first) for one in find_faults(incomplete)] == [(FaultKind.GAP, 699)]


@given(step=st.floats(0.04, 0.2), start=st.integers(512, 1000))
def test_coarse_quantisation_is_detected_in_a_signal_that_was_rounded_again(
    step: float, start: int
) -> None:
    signal = random_walk(2048)
    signal[start : start + 512] = step * np.round(signal[start : start + 512] / step)
    detected = resolution(np.asarray(np.round(signal, 2), np.float64))
    core = slice(start + 128, start + 384)
    np.testing.assert_allclose(detected[core], step, atol=0.1 * step)
    np.testing.assert_allclose(detected[: start - 128], 0.01)


@given(start=st.integers(1, 1900), count=st.integers(20, 1000), seed=st.integers(0, 99))
def test_stuck_sensor_is_detected_at_any_sample(start: int, count: int, seed: int) -> None:
    # Low-pass noise changes little at its extremes: a sensor that sticks there starts with a small step.
    signal = np.convolve(
        random_walk(3016, seed) - random_walk(3016, seed + 100), np.ones(17) / 17, "valid"
    )
    signal += np.random.default_rng(seed).standard_normal(3000) * 1e-2
    signal[start : start + count] = signal[start]
    detected = np.flatnonzero(stuck(signal))
    np.testing.assert_array_equal(detected, np.arange(start, start + count))


@given(start=st.integers(100, 400), end=st.integers(600, 900), step=st.sampled_from([0.0, 1e-3]))
def test_signal_that_comes_to_rest_gradually_is_not_stuck(
    start: int, end: int, step: float
) -> None:
    # Acceleration of a train that stops and starts gradually, without noise or quantised.
    at = np.arange(1000)
    moving = np.clip(np.maximum(start - at, at - end) / 100.0, 0.0, 1.0) ** 3
    signal = moving * np.sin(at / 3.0)
    assert not stuck(np.round(signal / step) * step if step else signal).any()

"""Rules of faults on signals whose faults are known."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.contracts import Channel, build_recording
from trackprofile.preprocessing.fault_detectors import resolution, stuck
from trackprofile.preprocessing.faults import FaultKind, find_faults


def rough(count: int, seed: int = 1) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).standard_normal(count)) * 0.05


def test_a_slow_train_sampled_at_equal_distances_has_no_gaps_in_time() -> None:
    distance = 0.25 * np.arange(2000)
    speed = 5.0 + 15.0 * distance / distance[-1]
    time = np.concatenate([[0.0], np.cumsum(np.diff(distance) / speed[1:])])
    floor = Channel("floor", rough(2000), "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=time, distance=distance, speed=speed)
    assert find_faults(recording) == ()
    torn = recording.isel(sample=np.r_[0:700, 703:2000])
    assert [(one.kind, one.first) for one in find_faults(torn)] == [(FaultKind.GAP, 699)]


@given(step=st.floats(0.04, 0.2), begin=st.integers(512, 1000))
def test_coarse_steps_are_told_where_they_were_rounded_after(step: float, begin: int) -> None:
    signal = rough(2048)
    signal[begin : begin + 512] = step * np.round(signal[begin : begin + 512] / step)
    found = resolution(np.round(signal, 2))
    core = slice(begin + 128, begin + 384)
    np.testing.assert_allclose(found[core], step, atol=0.1 * step)
    np.testing.assert_allclose(found[: begin - 128], 0.01)


@given(begin=st.integers(1, 1900), count=st.integers(20, 1000), seed=st.integers(0, 99))
def test_a_sensor_that_sticks_is_found_wherever_it_does(begin: int, count: int, seed: int) -> None:
    # A wave of noise, which at its crests hardly steps: where it sticks there it breaks off by little.
    signal = np.convolve(rough(3016, seed) - rough(3016, seed + 100), np.ones(17) / 17, "valid")
    signal += np.random.default_rng(seed).standard_normal(3000) * 1e-2
    signal[begin : begin + count] = signal[begin]
    found = np.flatnonzero(stuck(signal))
    np.testing.assert_array_equal(found, np.arange(begin, begin + count))


@given(begin=st.integers(100, 400), end=st.integers(600, 900), step=st.sampled_from([0.0, 1e-3]))
def test_a_train_that_comes_to_rest_is_not_stuck(begin: int, end: int, step: float) -> None:
    # The acceleration of a train that stops and sets out by degrees, noiseless or in steps.
    at = np.arange(1000)
    moving = np.clip(np.maximum(begin - at, at - end) / 100.0, 0.0, 1.0) ** 3
    signal = moving * np.sin(at / 3.0)
    assert not stuck(np.round(signal / step) * step if step else signal).any()

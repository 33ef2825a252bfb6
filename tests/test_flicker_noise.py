"""Flicker as states of the smoother: its density, the dense solution with it, and the least possible error with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from test_at_the_limit import Outcome, check_limit, outcome
from trackprofile.contracts import build_recording, channels
from trackprofile.demo import simulated
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.flicker_noise import HIGHEST_FREQUENCY, LOWEST_FREQUENCY, flicker_processes
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Sensor, sensor_noise_density

ALONE = Sensor("a", VERTICAL_ACCELERATION, "body", noise_density=1e-9, drift=0.0, flicker=1e-3)


def decibels(sensor: Sensor, frequency: np.ndarray) -> np.ndarray:
    """Density of white noise, walk and processes over that of white noise, walk and flicker."""
    true = sensor_noise_density(sensor, frequency)
    others = sensor_noise_density(replace(sensor, flicker=None), frequency)
    return 10 * np.log10((others + flicker_processes(sensor).density(frequency)) / true)


def test_processes_of_a_decade_each_add_up_to_one_over_f() -> None:
    inside = np.geomspace(3 * LOWEST_FREQUENCY, HIGHEST_FREQUENCY / 3, 500)
    off = decibels(ALONE, inside)
    assert np.max(np.abs(off)) < 0.27
    # The ripple of a sum of sech over even steps, by Poisson's formula.
    middle = decibels(ALONE, np.geomspace(0.03, 0.3, 500))
    ripple = 2 / np.cosh(np.pi**2 / np.log(10))
    assert np.max(middle) == pytest.approx(10 * np.log10(1 + ripple), abs=0.02)


@given(st.floats(1e-3, 3.0), st.floats(0.0, 1.0), st.floats(1e-6, 1e-2))
def test_noise_with_what_is_left_out_is_within_a_decibel(
    corner: float, walk: float, white: float
) -> None:
    sensor = Sensor(
        "a", VERTICAL_ACCELERATION, "body", noise_density=white, flicker=white * np.sqrt(corner),
        drift=walk * white,
    )  # fmt: skip
    off = decibels(sensor, np.geomspace(3 * LOWEST_FREQUENCY, 100 * HIGHEST_FREQUENCY, 300))
    assert np.min(off) > -0.6
    assert np.max(off) < 0.3


@given(st.sampled_from(["noise_density", "drift"]), st.floats(0.0, 1e-2), st.floats(0.0, 1e-2))
def test_no_more_than_a_process_to_a_decade_and_none_where_it_drowns(
    louder: str, flicker: float, size: float
) -> None:
    sensor = replace(ALONE, flicker=flicker, **{louder: max(size, 1e-12)})
    found = flicker_processes(sensor)
    assert len(found.rate) == len(found.variance) <= 4
    assert np.all(found.variance > 0)
    np.testing.assert_allclose(np.diff(np.log10(found.rate)), 1.0)  # no decade between is left out
    fewer = flicker_processes(replace(sensor, **{louder: 100 * max(size, 1e-12)}))
    assert len(fewer.rate) <= len(found.rate)
    assert not len(flicker_processes(replace(sensor, flicker=None)).rate)


def test_flicker_that_is_not_stated_or_drowns_changes_nothing_to_the_last_bit() -> None:
    vehicle, prior = read_vehicle("velaro")[0], read_spectrum("german-low")
    track = point_track(read_track("zhai"))
    recording, _ = simulated(vehicle, track, read_sensors("bogie-25ug"), prior, 60.0, 1)
    drowned = build_recording(
        [replace(one, flicker=1e-3 * (one.noise_density or 0.0)) for one in channels(recording)],
        time=recording["time"].to_numpy(),
        speed=recording["speed"].to_numpy(),
    )
    one, other = (
        estimate(each, vehicle, InferenceSettings(track=track, prior=prior, samples=4))
        for each in (recording, drowned)
    )
    for name in one.profile.data_vars:
        np.testing.assert_array_equal(one.profile[name], other.profile[name])
    assert one.log_likelihood == other.log_likelihood


def flickering(grade: str, corner: float) -> tuple[Sensor, ...]:
    """Sensors whose flicker is as strong as their white noise at ``corner`` Hz, with an offset that stays."""
    return tuple(
        replace(one, flicker=(one.noise_density or 0.0) * np.sqrt(corner), drift=0.0)
        for one in read_sensors(grade)
    )


def check_true(one: Outcome) -> None:
    for band in ("D1", "D2", "D3"):
        assert 0.9 < one.stated[band] / one.true[band] < 1.1, (band, "stated")


def test_with_flicker_the_error_is_the_least_possible_and_as_large_as_stated() -> None:
    one = outcome(flickering("bogie-25ug", 2.0), "fra-6", 3000.0, 48)
    check_limit(one)
    check_true(one)


@pytest.mark.acceptance
def test_with_flicker_at_the_limit_at_all_noise_levels_and_overconfident_without(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = [
        "",
        "reached/least possible, stated/true: flicker as states; the same, flicker not known of",
    ]
    for grade in ("bogie-25ug", "bogie-1mg"):
        for prior in ("fra-4", "fra-6"):
            for corner in (0.3, 2.0):
                sensors = flickering(grade, corner)
                known = outcome(sensors, prior, 4000.0, 64)
                blind = outcome(sensors, prior, 4000.0, 64, read_sensors(grade))
                parts = [
                    f"{b}: {one.reached[b] / one.least[b]:.3f} {one.stated[b] / one.true[b]:.3f}"
                    for one in (known, blind)
                    for b in one.least
                ]
                lines.append(f"{grade:12}{prior} corner {corner} Hz  " + "  ".join(parts))
                check_limit(known)
                check_true(known)
                assert blind.stated["D2"] < 0.9 * blind.true["D2"]
                assert blind.stated["D3"] < 0.85 * blind.true["D3"]
    with capsys.disabled():
        print("\n".join(lines))  # noqa: T201

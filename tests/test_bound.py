"""The limit against the table of an independent prototype, and the smoother against the limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import periodogram

from trackprofile.bands import BANDS, band_pass
from trackprofile.errors import ModelError
from trackprofile.inference.bound import limit
from trackprofile.inference.estimate import band_spreads
from trackprofile.inference.ride import build_ride
from trackprofile.inference.smoother import (
    Filter,
    error_draws,
    knot_variance,
    prepare,
    start_of_ride,
)
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.motion import Motion
from trackprofile.statespace import state_space

GRADES = ("bogie-1ug", "bogie-25ug", "bogie-100ug", "bogie-1mg")
SPEED = 150 / 3.6
RIGID = read_track("rigid")

# Literature: the theory's table for the paper's car, mm in D1, D2, D3 (rounded to its last digit there).
TABLE = {
    (SPEED, "bogie-1ug"): (0.0002, 0.0003, 0.001),
    (SPEED, "bogie-25ug"): (0.0023, 0.0072, 0.035),
    (SPEED, "bogie-100ug"): (0.0084, 0.029, 0.140),
    (SPEED, "bogie-1mg"): (0.084, 0.288, 1.39),
    (20.0, "bogie-25ug"): (0.0063, 0.022, 0.107),
    (8.0, "bogie-25ug"): (0.022, 0.086, 0.404),
}


@pytest.mark.parametrize(("speed", "grade"), TABLE)
def test_limit_is_that_of_the_independent_table(speed: float, grade: str) -> None:
    velaro, prior = read_vehicle("velaro")[0], read_spectrum("fra-5")
    found = limit(velaro, RIGID, read_sensors(grade), speed, prior)
    rounding = 0.5 * np.array([10.0 ** -decimals(value) for value in TABLE[speed, grade]])
    for one, value, half_digit in zip(BANDS, TABLE[speed, grade], rounding, strict=True):
        assert 1e3 * found[one.name] == pytest.approx(value, rel=0.05, abs=half_digit)


def decimals(value: float) -> int:
    return len(str(value).partition(".")[2])


def test_without_the_gyro_waves_of_twice_the_wheelbase_are_lost() -> None:
    velaro, prior = read_vehicle("velaro")[0], read_spectrum("fra-4")
    both = read_sensors("bogie-25ug")
    with_gyro, without = (
        limit(velaro, RIGID, sensors, SPEED, prior)["D1"] for sensors in (both, both[:1])
    )
    # Literature: 10 to 18 times worse; on rough track with good sensors the least of that.
    assert without / with_gyro == pytest.approx(10.0, rel=0.05)


def test_limit_needs_a_running_train_and_known_noise() -> None:
    velaro, prior = read_vehicle("velaro")[0], read_spectrum("fra-5")
    sensors = read_sensors("bogie-25ug")
    with pytest.raises(ModelError, match="above 0 m/s"):
        limit(velaro, RIGID, sensors, 0.0, prior)
    with pytest.raises(ModelError, match="noise_density of each"):
        limit(velaro, RIGID, [replace(sensors[0], noise_density=None)], SPEED, prior)


def smoother_of(grade: str, prior: str, length: float) -> Filter:
    """The paper's car at 150 km/h over ``length`` m, sampled at 500 Hz."""
    sensors, spectrum = read_sensors(grade), read_spectrum(prior)
    system = state_space(read_vehicle("velaro")[0], RIGID, sensors)
    time = np.arange(int(length / SPEED * 500)) / 500
    still = np.zeros(len(time))
    motion = Motion(time, SPEED * time, still + SPEED, still)
    ride = build_ride(system, motion, np.ones((len(time), len(sensors)), bool), 0.25)
    density = np.array([sensor.noise_density for sensor in sensors], dtype=np.float64)
    offsets = np.array([sensor.offset_standard_deviation for sensor in sensors])
    start = start_of_ride(system, spectrum, ride, offsets)
    return prepare(ride, spectrum, (density**2 * 250)[ride.sensors], start)


def reached(errors: np.ndarray) -> dict[str, float]:
    """RMS error within the sharp limits of each band, from the windowed spectra of draws (draws, knots)."""
    # The window's side lobes lie 92 dB down: unmeasured long waves are some 80 dB above the shortest errors.
    waves, power = periodogram(errors, fs=4.0, window="blackmanharris", detrend="linear")
    mean = power.mean(axis=0)
    found = {}
    for band in BANDS:
        inside = (waves >= 1 / band.longest) & (waves <= 1 / band.shortest)
        found[band.name] = float(np.sqrt(np.trapezoid(mean[inside], waves[inside])))
    return found


def check_at_the_limit(grade: str, prior: str) -> str:
    prepared = smoother_of(grade, prior, 3000.0)
    errors = error_draws(prepared, 32, np.random.default_rng(7)).T
    least = limit(
        read_vehicle("velaro")[0], RIGID, read_sensors(grade), SPEED, read_spectrum(prior)
    )
    found = reached(errors[:, 800:-800])
    for band, value in least.items():
        assert found[band] == pytest.approx(value, rel=0.10), (grade, prior, band)
    return "  ".join(f"{name} {1e3 * found[name]:.4f} ({1e3 * least[name]:.4f})" for name in least)


@pytest.mark.parametrize(("grade", "prior"), [("bogie-25ug", "fra-6"), ("bogie-1mg", "fra-4")])
def test_smoother_reaches_the_limit(grade: str, prior: str) -> None:
    check_at_the_limit(grade, prior)


@pytest.mark.acceptance
def test_smoother_reaches_the_limit_at_all_noise_levels(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [
        f"{grade:12} {prior}: {check_at_the_limit(grade, prior)}"
        for grade in GRADES
        for prior in ("fra-4", "fra-6")
    ]
    with capsys.disabled():
        print("\nRMS error reached (least possible), mm", *lines, sep="\n")  # noqa: T201


def test_stated_standard_deviations_are_those_of_the_errors() -> None:
    prepared = smoother_of("bogie-25ug", "fra-6", 3000.0)
    errors = error_draws(prepared, 200, np.random.default_rng(11))
    middle = slice(1700, -1700)  # where D3 is free of the ends
    stated = np.sqrt(knot_variance(prepared))[middle]
    ratio = np.sqrt(np.mean(errors[middle] ** 2, axis=1)) / stated
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    spreads, _ = band_spreads(error_draws(prepared, 64, np.random.default_rng(12)), 0.25)
    for band in BANDS:
        found = band_pass(errors.T, 0.25, band)[:, middle]
        rms = np.sqrt(np.mean(found**2))
        assert np.sqrt(np.mean(spreads[band.name][middle] ** 2)) == pytest.approx(rms, rel=0.05)

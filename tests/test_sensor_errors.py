"""Instruments against their own noise model, closed forms, and what their TOML says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lsim, welch

import trackprofile
from narrowing import not_none
from trackprofile.errors import DataError, FileError, ModelError, TrackprofileError, UnitError
from trackprofile.io.model_toml import presets, read_instruments, read_sensors, read_vehicle
from trackprofile.models.sensor import Sensor
from trackprofile.models.sensor_errors import (
    Instrument,
    instrument_noise,
    instrument_noise_density,
    measure,
    with_anti_alias_filter,
)

G = 9.80665
FLOOR = Sensor("floor", "vertical acceleration", "body")
RATE = Sensor("rate", "pitch rate", "body")


def reading(instrument: Instrument, exact: np.ndarray, seed: int = 1) -> np.ndarray:
    """Every step is a sample."""
    return measure(instrument, exact, 0.01, 0.01, np.random.default_rng(seed))[0]


# --- noise --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "instrument",
    [
        Instrument(replace(FLOOR, noise_density=1.0)),
        Instrument(replace(RATE, flicker=1.5)),
        Instrument(replace(FLOOR, noise_density=1.0, drift=5.0, flicker=1.5), resolution=10.0),
    ],
    ids=["white", "flicker", "white, flicker, drift, quantisation"],
)
def test_simulated_noise_has_the_density_of_its_model(instrument: Instrument) -> None:
    segments, length, interval = 400, 4096, 0.01
    found = reading(instrument, np.zeros(segments * length))
    frequency, density = welch(found, 1 / interval, "hann", length, noverlap=0)
    # From the eighth line on, so that the window smears 1/f² by less than 3 (1/3)/8² = 2 %, up to
    # an eighth of the sampling rate, beyond which a sampled random walk exceeds 1/f².
    for first in (8, 16, 32, 64, 128, 256):
        octave = slice(first, 2 * first)
        ratio = density[octave] / instrument_noise_density(instrument, frequency[octave], interval)
        # Var = 1/segments for each line; with Hann's window neighbours are correlated by (2/3)², (1/6)².
        deviation = math.sqrt((1 + 2 * (4 / 9 + 1 / 36)) / (segments * first))
        assert np.mean(ratio) == pytest.approx(1.0, abs=4 * deviation + 1 / first**2)


def test_white_noise_has_the_variance_that_the_inference_takes() -> None:
    found = reading(Instrument(replace(RATE, noise_density=0.3)), np.zeros(40_000))
    assert np.var(found) == pytest.approx(0.3**2 / (2 * 0.01), rel=4 * math.sqrt(2 / 40_000))


def test_drift_is_a_random_walk_from_the_offset() -> None:
    instrument, series, interval = Instrument(replace(FLOOR, offset=0.5, drift=2.0)), 3000, 0.01
    generator = np.random.default_rng(1)
    walks = np.array(
        [instrument_noise(instrument, 101, interval, generator) for _ in range(series)]
    )
    for sample in (0, 1, 10, 50, 100):
        expected = 0.5**2 + 2.0**2 * sample * interval
        assert np.var(walks[:, sample]) == pytest.approx(expected, rel=4 * math.sqrt(2 / series))


def test_flicker_does_not_end_where_it_began() -> None:
    generator = np.random.default_rng(1)
    series = np.array(
        [
            instrument_noise(Instrument(replace(RATE, flicker=1.0)), 256, 0.01, generator)
            for _ in range(500)
        ]
    )
    # One that is periodic has its last sample as near to its first as its second is.
    beside, across = (np.var(series[:, i] - series[:, 0]) for i in (1, -1))
    assert across > 2 * beside


@pytest.mark.parametrize("count", [1, 2, 3, 97])
def test_any_number_of_samples_can_be_drawn(count: int) -> None:
    instrument = Instrument(replace(RATE, noise_density=1.0, drift=1.0, flicker=1.0))
    assert np.all(np.isfinite(reading(instrument, np.zeros(count))))


def test_a_seed_reproduces_and_another_does_not() -> None:
    instrument = Instrument(replace(FLOOR, noise_density=1.0, drift=1.0, offset=1.0, flicker=1.0))
    exact = np.zeros(50)
    np.testing.assert_array_equal(reading(instrument, exact, 7), reading(instrument, exact, 7))
    assert not np.any(reading(instrument, exact, 7) == reading(instrument, exact, 8))


def test_one_seed_gives_the_same_noise_to_grades_that_differ_in_a_number() -> None:
    fine = Instrument(replace(FLOOR, noise_density=1.0, flicker=2.0))
    coarse = replace(fine, sensor=replace(fine.sensor, noise_density=3.0))
    flicker = reading(Instrument(replace(FLOOR, flicker=2.0)), np.zeros(50))
    white = reading(fine, np.zeros(50)) - flicker
    np.testing.assert_allclose(reading(coarse, np.zeros(50)), 3 * white + flicker, atol=1e-12)


# --- what is felt and what is read --------------------------------------------------------------


def test_without_faults_the_exact_quantity_comes_back() -> None:
    exact = np.random.default_rng(1).standard_normal(41)
    values, valid = measure(Instrument(FLOOR), exact, 0.001, 0.004, np.random.default_rng(2))
    np.testing.assert_array_equal(values, exact[::4])
    assert valid.all()


def test_quantisation_errs_evenly_over_a_step() -> None:
    smooth = Instrument(replace(FLOOR, noise_density=0.1))
    exact = np.zeros(20_000)
    error = reading(replace(smooth, resolution=0.05), exact) - reading(smooth, exact)
    assert np.max(np.abs(error)) <= 0.025 + 1e-12
    # The fourth moment of an even spread is 9/5 of its squared variance.
    assert np.var(error) == pytest.approx(0.05**2 / 12, rel=4 * math.sqrt(0.8 / len(exact)))


def test_what_exceeds_the_range_is_clipped_and_invalid() -> None:
    exact = np.array([0.0, 1.9, 2.0, 2.1, -5.0])
    values, valid = measure(
        Instrument(FLOOR, range=2.0), exact, 0.01, 0.01, np.random.default_rng(1)
    )
    np.testing.assert_array_equal(values, [0.0, 1.9, 2.0, 2.0, -2.0])
    np.testing.assert_array_equal(valid, [True, True, True, False, False])


def test_a_tilted_accelerometer_feels_less_of_gravity_and_a_gyroscope_does_not() -> None:
    exact, tilt = np.array([0.0, 1.0]), math.radians(3.0)
    felt = math.cos(tilt)
    np.testing.assert_allclose(
        reading(Instrument(FLOOR, misalignment=tilt), exact),
        [G * (felt - 1), felt + G * (felt - 1)],
        rtol=1e-12,
    )
    np.testing.assert_allclose(reading(Instrument(RATE, misalignment=tilt), exact), [0.0, felt])


def test_gain_scales_what_is_measured_and_leaves_the_noise() -> None:
    quiet = Instrument(replace(RATE, noise_density=0.1))
    exact = np.linspace(0.0, 1.0, 20)
    more = reading(replace(quiet, gain=1.02), exact) - reading(quiet, exact)
    np.testing.assert_allclose(more, 0.02 * exact, atol=1e-15)


# --- the low-pass -------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [5.0, 40.0, 80.0, 160.0])
def test_the_low_pass_follows_butterworth(frequency: float) -> None:
    bandwidth, interval = 80.0, 2e-5
    time = np.arange(0.0, 0.4, interval)
    instrument = Instrument(replace(FLOOR, bandwidth=bandwidth))
    found, _ = measure(
        instrument,
        np.cos(2 * np.pi * frequency * time),
        interval,
        50 * interval,
        np.random.default_rng(1),
    )
    sampled = time[::50]
    settled = sampled > 0.2  # e^(-0.2 · 2π · 80/√2) = 1e-31
    turn: NDArray[np.complex128] = np.exp(2j * np.pi * frequency * sampled[settled])
    in_phase, behind = np.linalg.lstsq(
        np.stack([turn.real, turn.imag], axis=1), found[settled], rcond=None
    )[0]
    s = 1j * frequency / bandwidth
    # Straight lines between the steps have (sin x / x)² of the cosine, x = π f h ≤ 0.01.
    assert in_phase - 1j * behind == pytest.approx(1 / (s**2 + math.sqrt(2) * s + 1), abs=1e-4)
    assert abs(in_phase - 1j * behind) == pytest.approx(
        1 / math.sqrt(1 + (frequency / bandwidth) ** 4), rel=1e-4
    )


@pytest.mark.parametrize("bandwidth", [2.0, 90.0, 4000.0])
def test_the_low_pass_is_that_of_the_state_space_for_any_step(bandwidth: float) -> None:
    rate = 2 * np.pi * bandwidth
    exact = np.concatenate([[0.0], np.random.default_rng(1).standard_normal(300)])
    A, B = [[-math.sqrt(2) * rate, -rate], [rate, 0.0]], [[rate], [0.0]]
    _, expected, _ = lsim((A, B, [[0.0, 1.0]], [[0.0]]), exact, 0.001 * np.arange(len(exact)))
    instrument = Instrument(replace(FLOOR, bandwidth=bandwidth))
    found, _ = measure(instrument, exact, 0.001, 0.001, np.random.default_rng(1))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_low_pass_starts_settled() -> None:
    constant = np.full(100, 3.0)
    found = reading(Instrument(replace(FLOOR, bandwidth=1.0)), constant)
    np.testing.assert_allclose(found, constant, rtol=1e-9)


def test_an_anti_alias_filter_only_narrows() -> None:
    assert with_anti_alias_filter(Instrument(FLOOR), 0.01).sensor.bandwidth == 25.0
    narrow = Instrument(replace(FLOOR, bandwidth=10.0))
    assert with_anti_alias_filter(narrow, 0.01) == narrow


# --- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interval", "sampling"),
    [(0.001, 0.0015), (0.002, 0.001), (0.0, 0.01), (0.001, math.inf), (math.nan, 0.01)],
)
def test_sampling_between_the_steps_is_refused(interval: float, sampling: float) -> None:
    with pytest.raises(DataError, match="whole multiple"):
        measure(Instrument(FLOOR), np.zeros(9), interval, sampling, np.random.default_rng(1))


def test_a_multiple_is_whole_within_round_off() -> None:
    time = np.linspace(0.0, 1.0, 1001)
    values, _ = measure(Instrument(FLOOR), time, time[1] - time[0], 0.1, np.random.default_rng(1))
    np.testing.assert_allclose(values, np.linspace(0.0, 1.0, 11))


@pytest.mark.parametrize("exact", [[], [0.0, math.nan], [[0.0], [1.0]]])
def test_a_quantity_that_is_no_row_of_numbers_is_refused(exact: list) -> None:
    with pytest.raises(DataError, match="row of finite numbers"):
        reading(Instrument(FLOOR), np.array(exact))


def test_a_density_at_zero_hertz_is_refused() -> None:
    with pytest.raises(DataError, match="above 0 Hz, got 0"):
        instrument_noise_density(Instrument(FLOOR), np.array([0.0, 1.0]), 0.01)


@pytest.mark.parametrize(
    "wrong",
    [
        {"resolution": math.nan},
        {"range": 0.0},
        {"misalignment": 2.0},
        {"gain": 0.0},
        {"gain": math.inf},
    ],
    ids=str,
)
def test_an_impossible_instrument_is_refused(wrong: dict[str, Any]) -> None:
    (name, value), *_ = wrong.items()
    with pytest.raises(ModelError, match=f"'floor' needs a.* {name}.*got {value}"):
        Instrument(FLOOR, **{name: value})


# --- TOML ---------------------------------------------------------------------------------------

SENSORS = """
source = "a data sheet"
verified = false
[[sensor]]
name = "floor"
quantity = "vertical acceleration"
body = "body"
unit = "mg"
noise_density = 0.1
bandwidth = 100
drift = 0.01
flicker = 0.2
resolution = 4
range = 2000
misalignment_deg = 1.5
gain = 0.99
[[sensor]]
name = "rate"
quantity = "pitch rate"
body = "body"
unit = "°/s"
"""


def test_numbers_are_in_the_unit_of_their_table(tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    path.write_text(SENSORS, encoding="utf-8")
    floor, rate = read_instruments(path)
    mg = 1e-3 * G
    assert (floor.sensor.flicker, floor.resolution, floor.range) == pytest.approx(
        (0.2 * mg, 4 * mg, 2000 * mg), rel=1e-12
    )
    assert (floor.misalignment, floor.gain) == (pytest.approx(math.pi / 120), 0.99)
    assert floor.source == "a data sheet (not verified)"
    assert rate == Instrument(Sensor("rate", "pitch rate", "body"), source=floor.source)
    assert read_sensors(path) == (floor.sensor, rate.sensor)
    assert floor.sensor.drift == pytest.approx(0.01 * mg)


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        (
            "flicker =",
            "fliker =",
            FileError,
            "unknown key 'fliker'.*keys of this table are.*flicker",
        ),
        ("flicker = 0.2", "flicker = -1", FileError, "flicker"),
        ("range = 2000", "range = 0", FileError, "range"),
        ("gain = 0.99", "gain = 0", ModelError, "'floor' needs a finite gain"),
        ("misalignment_deg = 1.5", "misalignment_deg = 90", ModelError, "misalignment"),
        ('"mg"', '"mm"', UnitError, "sensor 'floor'"),
    ],
)
def test_a_wrong_table_is_refused_by_name(
    tmp_path: Path, old: str, new: str, kind: type[TrackprofileError], message: str
) -> None:
    path = tmp_path / "sensors.toml"
    path.write_text(SENSORS.replace(old, new), encoding="utf-8")
    with pytest.raises(kind, match=message) as caught:
        read_instruments(path)
    assert str(path) in str(caught.value)


def test_a_calibrated_sensor_takes_no_numbers_that_would_be_lost(tmp_path: Path) -> None:
    vehicle = Path(trackprofile.__file__).parent / "presets" / "vehicle" / "velaro.toml"
    table = '\n[[installation.sensor]]\nname = "a"\nquantity = "pitch rate"\nbody = "body"\nunit = "°/s"\nrange = 1\n'
    path = tmp_path / "vehicle.toml"
    path.write_text(vehicle.read_text(encoding="utf-8") + table, encoding="utf-8")
    with pytest.raises(FileError, match="unknown key 'range'"):
        read_vehicle(path)


def test_every_preset_is_an_instrument_with_its_sensor_and_source() -> None:
    for name in presets("sensors"):
        instruments = read_instruments(name)
        assert tuple(one.sensor for one in instruments) == read_sensors(name)
        assert all(one.source and one.sensor.noise_density for one in instruments)


def test_flicker_of_the_parts_is_the_floor_of_their_allan_deviation() -> None:
    # In-run bias of the data sheets: µg, °/h.
    for name, bias, rate in (("bogie-ms1010-stim300", 15, 0.5), ("bogie-mti1", 30, 10)):
        acceleration, gyroscope = read_instruments(name)
        floor = math.sqrt(2 * math.log(2))
        assert not_none(acceleration.sensor.flicker) * floor == pytest.approx(
            bias * 1e-6 * G, rel=0.01
        )
        assert not_none(gyroscope.sensor.flicker) * floor == pytest.approx(
            math.radians(rate / 3600), rel=0.01
        )

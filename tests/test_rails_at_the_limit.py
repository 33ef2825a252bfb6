"""Each rail against the least possible error, for the paper's car at 150 km/h, and whether its interval holds it.

The data come from a car on two rails in which every spring stands by itself (`two_rails`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from narrowing import floats, not_none
from test_at_the_limit import spectral_rms
from trackprofile import infer
from trackprofile.assessment.compare import compare
from trackprofile.bands import BANDS, band_pass
from trackprofile.contracts import (
    Rail,
    RailLevel,
    build_profile,
    build_recording,
    select_rail,
    with_rails,
)
from trackprofile.inference.accuracy_bound import accuracy_bound_per_rail
from trackprofile.io.model_toml import read_spectrum, read_vehicle
from trackprofile.io.table import read_columns
from trackprofile.kalman.smoother import initial_state, kalman_gains, smooth
from trackprofile.kalman.time_steps import discretise_run
from trackprofile.models.kinematics import Motion
from trackprofile.models.roll import rail_modes, roll_vehicle, sensor_pairs
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.statespace import state_space
from trackprofile.models.track import RigidTrack
from trackprofile.models.vehicle import Vehicle
from trackprofile.units import STANDARD_GRAVITY
from two_rails import random_rails, recorded, response, ride

VELARO = read_vehicle("velaro")[0]
MEAN = read_spectrum("german-low")
CROSS_LEVEL = Spectrum("cross level", 4 * MEAN.amplitude, 0.438, MEAN.corner_high)
SPEED, SAMPLING, KNOTS, SHORTEST = 150 / 3.6, 500.0, 0.25, 2.0
BETWEEN = SPEED / SAMPLING
START, END = 1000.0, 300.0  # m, in which the body's roll forgets how it began, and before the end
MICRO_G = 1e-6 * STANDARD_GRAVITY


def beside(body: str, noise: float, position: float = 0.0) -> list[Sensor]:
    return [
        Sensor(
            name, "vertical acceleration", body, position, lateral=y, noise_density=noise * MICRO_G
        )
        for name, y in (("left", 1.0), ("right", -1.0))
    ]


def gyroscope(quantity: str) -> Sensor:
    return Sensor(quantity, quantity, "leading bogie", noise_density=np.radians(0.005))


PLACES = {
    "bogie": [*beside("leading bogie", 25.0), gyroscope("pitch rate")],
    "bogie, roll rate": [
        *beside("leading bogie", 25.0), gyroscope("pitch rate"), gyroscope("roll rate"),
    ],
    "axle boxes": beside("wheel 1", 1000.0),
    "body": beside("body", 25.0, 6.0),
}  # fmt: skip


# A bogie is blind to a cross level of twice its wheelbase: the error there hangs together over 15 km, so that a ride of
# 4 km does not reach the limit, which is that of an endless one.
WITHIN = {("bogie", "D1"): 1.35, ("bogie, roll rate", "D1"): 1.35}

# The body hardly feels a level of 48 m: there the mean forgets its ends over 700 m, and more than is cut off here.
TOLD = {"body": (Rail.DIFFERENCE,)}


def errors(
    car: Vehicle, sensors: Sequence[Sensor], prior: Spectrum, signals: np.ndarray, truth: np.ndarray
) -> np.ndarray:
    """Of the smoother, (draws, knots), given the true noise and prior; signals (samples, sensors, draws)."""
    samples = len(truth)
    system = state_space(car, RigidTrack(), sensors)
    time, still = np.arange(samples) / SAMPLING, np.zeros(samples)
    moved = Motion(time, SPEED * time, still + SPEED, still)
    run = discretise_run(system, moved, np.ones((samples, len(sensors)), bool), KNOTS)
    offsets = np.array([one.offset_standard_deviation for one in sensors])
    density = np.array([one.noise_density for one in sensors], dtype=np.float64)
    variance = (density**2 * SAMPLING / 2)[run.sensors]
    prepared = kalman_gains(run, prior, variance, initial_state(system, prior, run, offsets))
    found = smooth(prepared, signals[run.samples, run.sensors]).elevation
    under = np.rint((run.first_knot + np.arange(len(found))) * KNOTS / BETWEEN).astype(int)
    inside = (under >= START / BETWEEN) & (under < samples - END / BETWEEN)
    return (truth[under[inside]] - found[inside]).T


def reached(sensors: Sequence[Sensor], length: float, draws: int) -> dict[Rail, dict[str, float]]:
    """Root mean square error by rail and band, m."""
    generator = np.random.default_rng(7)
    samples = round(length / BETWEEN)
    waves = [
        random_rails(MEAN, CROSS_LEVEL, length, BETWEEN, generator, SHORTEST) for _ in range(draws)
    ]
    whole = 2 * (len(waves[0]) - 1)
    omega = 2 * np.pi * np.fft.rfftfreq(whole, BETWEEN)
    there = np.flatnonzero(np.any(waves[0] != 0.0, axis=1))
    H = np.zeros((len(omega), len(sensors), 2), complex)
    for some in np.array_split(there, max(1, len(there) // 2000)):
        H[some] = response(VELARO, RigidTrack(), sensors, floats(omega[some]), SPEED)
    rails, signals = np.empty((samples, 2, draws)), np.empty((samples, len(sensors), draws))
    for draw, one in enumerate(waves):
        rails[:, :, draw] = np.fft.irfft(one, whole, axis=0)[:samples]
        felt = np.einsum("wsr,wr->ws", H, one)
        signals[:, :, draw] = np.fft.irfft(felt, whole, axis=0)[:samples]
    for i, sensor in enumerate(sensors):
        assert sensor.noise_density is not None
        white = sensor.noise_density * np.sqrt(SAMPLING / 2)
        signals[:, i] += white * generator.standard_normal((samples, draws))
    mean, difference = rail_modes(sensors, sensor_pairs(sensors), VELARO.contact_spacing)
    left, right = rails[:, 0], rails[:, 1]
    parts = []
    for car, half, prior, truth in (
        (VELARO, mean, MEAN, 0.5 * (left + right)),
        (roll_vehicle(VELARO), difference, CROSS_LEVEL, left - right),
    ):
        read = np.einsum("nsd,sk->nkd", signals, half.weights)
        parts.append(errors(car, half.sensors, prior, read, truth))
    m, c = parts
    of = {Rail.MEAN: m, Rail.DIFFERENCE: c, Rail.LEFT: m + c / 2, Rail.RIGHT: m - c / 2}
    return {rail: spectral_rms(one) for rail, one in of.items()}


@pytest.mark.acceptance
@pytest.mark.parametrize("place", PLACES)
def test_error_of_each_rail_is_the_least_possible(
    place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = reached(PLACES[place], 4000.0, 24)
    least = accuracy_bound_per_rail(VELARO, RigidTrack(), PLACES[place], SPEED, MEAN)
    across = accuracy_bound_per_rail(VELARO, RigidTrack(), PLACES[place], SPEED, CROSS_LEVEL)
    least[Rail.DIFFERENCE] = across[Rail.DIFFERENCE]
    for rail in (Rail.LEFT, Rail.RIGHT):
        least[rail] = {
            band: float(np.hypot(least[Rail.MEAN][band], 0.5 * across[Rail.DIFFERENCE][band]))
            for band in least[rail]
        }
    with capsys.disabled():
        print(f"\n{place}: RMS error in mm, reached/least possible")  # noqa: T201
        for rail, one in found.items():
            columns = [
                f"{b}: {1e3 * one[b]:.4f} {one[b] / least[rail][b]:.3f}" for b in least[rail]
            ]
            print(f"  {rail:12}", "   ".join(columns))  # noqa: T201
    for rail in TOLD.get(place, Rail):
        for band in BANDS[:2]:
            within = WITHIN.get((place, band.name), 1.10)
            assert found[rail][band.name] < within * least[rail][band.name], (rail, band.name)


COVERED = {
    "axle boxes": PLACES["axle boxes"],
    "axle boxes, the left twice as noisy": [
        replace(PLACES["axle boxes"][0], noise_density=2000 * MICRO_G), PLACES["axle boxes"][1],
    ],
    "bogie": PLACES["bogie"],
}  # fmt: skip


# Where the bogie is blind only the prior says how large an error is: its short waves have to be there to tell its knee.
SHORTEST_COVERED = {"bogie": 0.7}


@pytest.mark.acceptance
@pytest.mark.parametrize("place", COVERED)
def test_the_interval_of_each_rail_holds_it(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    sensors, length, inside = COVERED[place], 1800.0, []
    for seed in range(6):
        generator = np.random.default_rng(seed)
        shortest = SHORTEST_COVERED.get(place, SHORTEST)
        waves = random_rails(MEAN, CROSS_LEVEL, length, BETWEEN, generator, shortest)
        run = ride(VELARO, RigidTrack(), sensors, SPEED, SAMPLING, waves, round(length / BETWEEN))
        parts = recorded(sensors, run.signals, SAMPLING, generator)
        still = np.zeros(len(run.distance))
        recording = build_recording(
            parts, time=run.distance / SPEED, distance=run.distance, speed=still + SPEED
        )
        found = infer(recording, VELARO)
        rails = {rail: RailLevel(run.rails[:, i]) for i, rail in enumerate((Rail.LEFT, Rail.RIGHT))}
        truth = build_profile(run.distance, run.rails.mean(axis=1), kind="truth")
        truth = with_rails(truth, rails)
        for rail in Rail:
            bands = compare(
                select_rail(found, rail), select_rail(truth, rail), from_m=200.0, to_m=length - 200.0, max_lag=0.0
            ).bands  # fmt: skip
            inside += [
                (rail, band, one.coverage_95, one.rms_error_mm, one.stated_rms_mm)
                for band, one in ((name, not_none(bands[name])) for name in ("D1", "D2"))
            ]  # fmt: skip
    with capsys.disabled():
        print(f"\n{place}: inside 95 %, RMS error and stated standard deviation in mm")  # noqa: T201
    for rail in Rail:
        for band in ("D1", "D2"):
            here = np.array([one[2:] for one in inside if one[:2] == (rail, band)])
            covered, error, stated = here.mean(axis=0)
            with capsys.disabled():
                print(f"  {rail:12} {band}: {100 * covered:.1f} %, {error:.4f}, {stated:.4f}")  # noqa: T201
            if (place, band) == ("bogie", "D1") and rail is not Rail.MEAN:
                # One wave that the bogie does not feel: each ride holds one draw, six tell the size to a third.
                assert error < 1.4 * stated, rail
            else:
                assert covered > 0.90, (rail, band)


@pytest.mark.acceptance
def test_real_rails_are_told_apart_under_a_simulated_car(
    shared: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    table = read_columns(
        shared("data/hokuriku/section_a.csv"), ["level_rail1_mm", "level_rail2_mm"]
    )
    rails = 1e-3 * np.stack([*map(np.asarray, table.values())], axis=1)
    rails = rails[: len(rails) // 2 * 2] - rails.mean(axis=0)
    # What the method rests on: mean and difference of real rails know nothing of each other.
    for band in BANDS[:2]:
        left, right = (band_pass(one, KNOTS, band) for one in rails.T)
        assert abs(np.corrcoef(left + right, left - right)[0, 1]) < 0.1
        assert np.corrcoef(left, right)[0, 1] > 0.8
    waves = np.fft.rfft(np.concatenate([rails, rails[::-1]]), axis=0)
    waves[0], speed, sampling, sensors = 0.0, 40.0, 160.0, PLACES["axle boxes"]
    run = ride(VELARO, RigidTrack(), sensors, speed, sampling, waves, len(rails))
    parts = recorded(sensors, run.signals, sampling, np.random.default_rng(5))
    still = np.zeros(len(rails))
    recording = build_recording(
        parts, time=run.distance / speed, distance=run.distance, speed=still + speed
    )
    found = infer(recording, VELARO)
    sides = {rail: RailLevel(run.rails[:, i]) for i, rail in enumerate((Rail.LEFT, Rail.RIGHT))}
    truth = with_rails(
        build_profile(run.distance, run.rails.mean(axis=1), kind="truth"), sides
    )  # fmt: skip
    for rail in Rail:
        bands = compare(
            select_rail(found, rail),
            select_rail(truth, rail),
            from_m=200.0,
            to_m=1970.0,
            max_lag=0.0,
        ).bands
        for band in ("D1", "D2"):
            one = bands[band]
            assert one is not None
            assert one.coverage_95 is not None
            with capsys.disabled():
                print(  # noqa: T201
                    f"  real rails, {rail} {band}: {100 * one.coverage_95:.1f} %, error {one.rms_error_mm:.3f} of "
                    f"{one.reference_rms_mm:.3f} mm"
                )
            assert one.coverage_95 > 0.90, (rail, band)

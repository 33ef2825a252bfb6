"""One profile per rail, from recordings of a car on two rails that shares nothing with the package's models."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from trackprofile import infer
from trackprofile.assessment.compare import compare
from trackprofile.cli import main
from trackprofile.contracts import (
    SEPARATE_RAILS,
    Channel,
    Quality,
    Rail,
    RailLevel,
    available_rails,
    build_profile,
    build_recording,
    channels,
    select_rail,
    with_rails,
)
from trackprofile.errors import DataError, RowError
from trackprofile.inference import blocks
from trackprofile.inference.accuracy_bound import accuracy_bound_per_rail
from trackprofile.inference.blocks import BlockResult
from trackprofile.inference.infer import Estimate, estimate
from trackprofile.inference.observations import observations
from trackprofile.inference.rail_decomposition import decompose_rails, rail_levels
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io import write
from trackprofile.io.model_toml import read_spectrum, write_vehicle
from trackprofile.models.sensor import Installation, Sensor, Uncertainty
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import RigidTrack
from trackprofile.models.vehicle import VehicleParameter
from trackprofile.reader import read
from two_rails import WAGON, Ridden, random_rails, recorded, ride

SPEED, SAMPLING, LENGTH = 30.0, 100.0, 300.0
MEAN = read_spectrum("german-low")
# Literature: the FRA spectrum of cross level in terms of the one of level, 4 Ω²/(Ω² + Ωs²) S, Ωs = 0.438 rad/m.
CROSS_LEVEL = Spectrum("cross level", 4 * MEAN.amplitude, 0.438, MEAN.corner_high)


def side(name: str, lateral: float, body: str = "wheel 1", noise: float = 5e-3) -> Sensor:
    return Sensor(name, "vertical acceleration", body, lateral=lateral, noise_density=noise)


BOXES = (side("left box", 0.9), side("right box", -0.9))


def ridden(sensors: Sequence[Sensor], seed: int = 1, shortest: float = 3.0) -> Ridden:
    generator = np.random.default_rng(seed)
    waves = random_rails(MEAN, CROSS_LEVEL, LENGTH, SPEED / SAMPLING, generator, shortest)
    return ride(WAGON, RigidTrack(), sensors, SPEED, SAMPLING, waves, round(LENGTH * SAMPLING / SPEED))  # fmt: skip


def recording_of(parts: Sequence[Channel], distance: np.ndarray) -> xr.Dataset:
    still = np.zeros(len(distance))
    return build_recording(
        parts, time=distance / SPEED, distance=distance, speed=still + SPEED
    )  # fmt: skip


def made(sensors: Sequence[Sensor], seed: int = 1) -> tuple[xr.Dataset, xr.Dataset]:
    """A recording, and the rails under it."""
    run = ridden(sensors, seed)
    parts = recorded(sensors, run.signals, SAMPLING, np.random.default_rng(seed + 100))
    rails = {rail: RailLevel(run.rails[:, i]) for i, rail in enumerate((Rail.LEFT, Rail.RIGHT))}
    truth = build_profile(run.distance, run.rails.mean(axis=1), kind="truth")
    return recording_of(parts, run.distance), with_rails(truth, rails)


@pytest.fixture(scope="module")
def boxes() -> tuple[xr.Dataset, xr.Dataset, Estimate]:
    recording, truth = made(BOXES)
    return recording, truth, estimate(recording, WAGON)


def test_each_rail_is_found_to_the_limit_and_its_interval_holds_it(boxes) -> None:
    _, truth, found = boxes
    least = accuracy_bound_per_rail(WAGON, RigidTrack(), BOXES, SPEED, MEAN)
    for rail in Rail:
        one = compare(select_rail(found.profile, rail), select_rail(truth, rail), max_lag=0.0)
        d1 = one.bands["D1"]
        assert d1 is not None
        assert d1.coverage_95 is not None
        assert d1.rms_error_mm < 1.35e3 * least[rail]["D1"], rail
        assert d1.coverage_95 > 0.85, rail


def test_what_is_reproduced_of_each_side_is_what_it_read(boxes) -> None:
    recording, _, found = boxes
    assert set(found.reproduced) == {"left box", "right box"}
    for one in channels(recording):
        left = one.values - found.reproduced[one.name]
        white = 5e-3 * np.sqrt(SAMPLING / 2)
        assert np.std(left) < 1.1 * white
        assert np.std(one.values) > 10 * white


def test_the_mean_is_that_of_the_mean_alone(boxes) -> None:
    recording, _, found = boxes
    left, right = channels(recording)
    alone = replace(
        left, name="mean", values=0.5 * (left.values + right.values), lateral=0.0,
        noise_density=5e-3 / np.sqrt(2),
    )  # fmt: skip
    distance = recording["distance"].to_numpy()
    plain = infer(recording_of([alone], distance), WAGON)
    difference = found.profile["elevation"] - plain["elevation"]
    assert np.abs(difference).max() < 1e-2 * float(plain["standard_deviation"].min())
    assert available_rails(plain) == (Rail.MEAN,)


def test_swapping_left_and_right_swaps_the_rails(boxes) -> None:
    recording, _, found = boxes
    distance = recording["distance"].to_numpy()
    turned = [replace(one, lateral=-one.lateral) for one in channels(recording)]
    swapped = infer(recording_of(turned, distance), WAGON)
    for rail, other in ((Rail.LEFT, Rail.RIGHT), (Rail.RIGHT, Rail.LEFT)):
        xr.testing.assert_allclose(
            select_rail(swapped, rail).drop_attrs(), select_rail(found.profile, other).drop_attrs(), atol=1e-9
        )  # fmt: skip
    np.testing.assert_allclose(
        swapped["elevation_difference"], -found.profile["elevation_difference"], atol=1e-9
    )


def test_rails_that_are_alike_differ_by_nothing(boxes) -> None:
    recording, _, _ = boxes
    left, right = channels(recording)
    alike = recording_of([left, replace(right, values=left.values)], recording["distance"].values)
    found = infer(alike, WAGON)
    assert np.abs(found["elevation_difference"]).max() < 1e-12
    np.testing.assert_array_equal(found["elevation_left"], found["elevation"])


@pytest.mark.parametrize("lateral", [0.0, 0.9])
def test_one_sensor_tells_what_it_told_before_sides_were_known(boxes, lateral: float) -> None:
    recording, _, _ = boxes
    left, _ = channels(recording)
    found, plain = (
        estimate(recording_of([replace(left, lateral=y)], recording["distance"].values), WAGON)
        for y in (lateral, 0.0)
    )
    assert available_rails(found.profile) == (Rail.MEAN,)
    xr.testing.assert_identical(found.profile.drop_attrs(), plain.profile.drop_attrs())
    assert any("has no partner" in note for note in found.notes) == (lateral != 0.0)


def test_a_gyroscope_tells_the_difference_without_a_pair() -> None:
    sensors = [side("box", 0.0), Sensor("roll", "roll rate", "wheel 1", noise_density=1e-5)]
    recording, truth = made(sensors)
    found = infer(recording, WAGON)
    least = accuracy_bound_per_rail(WAGON, RigidTrack(), sensors, SPEED, MEAN)
    for rail in Rail:
        d1 = compare(select_rail(found, rail), select_rail(truth, rail), max_lag=0.0).bands["D1"]
        assert d1 is not None
        assert d1.rms_error_mm < 1.35e3 * least[rail]["D1"], rail


@pytest.mark.parametrize("body", ["wheel 1", "body"])
def test_a_car_of_unknown_roll_tells_rails_apart_by_its_axle_boxes_alone(body: str) -> None:
    plain = replace(WAGON, bodies=tuple(replace(one, roll_inertia=None) for one in WAGON.bodies))
    recording, _ = made([side("a", 0.9, body), side("b", -0.9, body)])
    found = estimate(recording, plain, InferenceSettings(samples=4))
    assert (len(available_rails(found.profile)) > 1) == (body == "wheel 1")
    assert any("does not state roll_inertia of 'body'" in note for note in found.notes)


def test_samples_of_one_side_alone_are_left_out_and_said(boxes) -> None:
    recording, _, whole = boxes
    left, right = channels(recording)
    distance = recording["distance"].to_numpy()
    good = (distance < 150.0) | (distance > 170.0)
    found = estimate(recording_of([left, replace(right, valid=good)], distance), WAGON)
    assert any("only one of 'left box' and 'right box' is valid" in note for note in found.notes)
    place = found.profile["distance"].to_numpy()
    inside, outside = (place > 152) & (place < 160), (place < 110) | (place > 210)
    for rail in (Rail.MEAN, Rail.LEFT):
        one = select_rail(found.profile, rail)
        assert np.all(one["quality"].to_numpy()[inside] & Quality.GAP)
        before = select_rail(whole.profile, rail)
        np.testing.assert_allclose(
            one["standard_deviation_D1"].to_numpy()[outside],
            before["standard_deviation_D1"].to_numpy()[outside],
            rtol=0.15,
        )


def test_a_side_that_is_mostly_lost_leaves_the_other_as_it_would_be_alone(boxes) -> None:
    recording, _, _ = boxes
    left, right = channels(recording)
    distance = recording["distance"].to_numpy()
    found = estimate(recording_of([left, replace(right, valid=distance < 60.0)], distance), WAGON)
    assert available_rails(found.profile) == (Rail.MEAN,)
    assert not np.any(found.profile["quality"] & Quality.GAP)


@pytest.mark.parametrize("body", ["wheel 1", "body"])
def test_a_side_that_is_turned_round_is_refused(body: str, monkeypatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "LENGTH", 3000.0)
    recording, _ = made([side("a", 0.9, body), side("b", -0.9, body)])
    left, right = channels(recording)

    def apart(sign: float) -> object:
        parts = [left, replace(right, values=sign * right.values)]
        data = observations(recording_of(parts, recording["distance"].to_numpy()), Installation())
        return decompose_rails(data, WAGON, RigidTrack(), Installation()).difference

    assert apart(1.0) is not None
    with pytest.raises(DataError, match="'a' and 'b' contradict each other"):
        apart(-1.0)


def test_a_calibrated_gain_and_its_doubt_are_those_of_either_side(boxes) -> None:
    recording, _, found = boxes
    distance = recording["distance"].to_numpy()
    louder = [replace(one, values=1.25 * one.values) for one in channels(recording)]
    gained = replace(side("calibrated", 0.0), noise_density=1.25 * 5e-3 / np.sqrt(2), gain=1.25)
    sure = Uncertainty(("gain of calibrated", "body mass"), ((1e-4, 0.0), (0.0, 0.01)))
    car = replace(WAGON, parameters=(VehicleParameter("body mass", "kg", (("body", "mass"),)),))
    again = infer(
        recording_of(louder, distance),
        car,
        installation=Installation(sensors=(gained,), uncertainty=sure),
    )
    for rail in Rail:
        one, other = select_rail(again, rail), select_rail(found.profile, rail)
        np.testing.assert_allclose(one["elevation"], other["elevation"], atol=2e-5)
        # A gain that may be 1 % off makes each point as much less sure.
        more = np.sqrt(other["standard_deviation"] ** 2 + (0.01 * other["elevation"]) ** 2)
        np.testing.assert_allclose(one["standard_deviation"], more, rtol=0.05)


@pytest.mark.acceptance
def test_a_long_ride_is_taken_up_again_in_both_halves(monkeypatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "LENGTH", 1500.0)
    monkeypatch.setattr(blocks, "LENGTH", 700.0)
    recording, _ = made(BOXES)
    kept: dict[int, BlockResult] = {}
    whole = estimate(recording, WAGON, InferenceSettings(samples=4), checkpoint=kept)
    assert sorted(kept) == [0, 1, 2, 3]
    for lost in (1, 2):
        del kept[lost]
    again = estimate(recording, WAGON, InferenceSettings(samples=4), checkpoint=kept)
    xr.testing.assert_identical(again.profile, whole.profile)


def test_roll_alone_is_refused() -> None:
    recording, _ = made([Sensor("roll", "roll rate", "body", noise_density=1e-5)])
    with pytest.raises(DataError, match="Only roll was measured"):
        infer(recording, WAGON)


def piece(elevation: float, spread: float, flags: int = 0) -> BlockResult:
    one = np.full(3, 1.0)
    return BlockResult(
        np.arange(3.0), elevation * one, spread * one, {"D1": spread * one}, np.full(3, flags, np.int16),
        np.zeros((1, 1)), (), 0.0, (),
    )  # fmt: skip


@settings(deadline=None)
@given(st.floats(0.0, 1.0), st.floats(1e-6, 1e-2), st.floats(1e-6, 1e-2))
def test_uncertainty_of_a_rail_is_that_of_a_sum(shared: float, m: float, c: float) -> None:
    # Analytic: var(e_m ± e_c/2) = σ_m² + σ_c²/4 ± ρ σ_m σ_c, of which the greater is stated.
    found = rail_levels(piece(1.0, m), piece(0.5, c), shared)
    expected = np.sqrt(m**2 + c**2 / 4 + shared * m * c)
    for rail, elevation in ((Rail.LEFT, 1.25), (Rail.RIGHT, 0.75)):
        np.testing.assert_allclose(np.asarray(found[rail].elevation), elevation)
        np.testing.assert_allclose(np.asarray(found[rail].standard_deviation), expected)
        np.testing.assert_allclose(np.asarray(found[rail].band_standard_deviations["D1"]), expected)


def test_where_a_side_was_doubted_the_errors_may_be_those_of_one() -> None:
    found = rail_levels(piece(1.0, 1e-3, Quality.FAULTY), piece(0.5, 1e-3), 0.0)
    np.testing.assert_allclose(np.asarray(found[Rail.LEFT].standard_deviation), 1.5e-3)


def levels(points: int) -> st.SearchStrategy:
    metres = st.lists(st.floats(-0.1, 0.1), min_size=points, max_size=points)
    return st.tuples(metres, metres, metres)


@settings(max_examples=20, deadline=None)
@given(
    values=levels(4),
    uncertain=st.booleans(),
    flags=st.lists(st.sampled_from([0, 1, 2, 129]), min_size=4, max_size=4),
    suffix=st.sampled_from([".nc", ".csv", ".parquet"]),
)
def test_a_profile_per_rail_is_read_back_as_it_was_written(
    values: tuple[list[float], ...], uncertain: bool, flags: list[int], suffix: str, tmp_path_factory
) -> None:  # fmt: skip
    spread = np.abs(values[2]) if uncertain else None
    bands = {"D1": np.abs(values[1])} if uncertain else {}
    mean = build_profile(
        np.arange(4.0), values[0], kind="posterior" if uncertain else "point",
        standard_deviation=spread, band_standard_deviations=bands, quality=[0, 0, 4, 0],
    )  # fmt: skip
    sides = {
        rail: RailLevel(each, spread, bands)
        for rail, each in zip(SEPARATE_RAILS, values, strict=True)
    }
    written = with_rails(mean, sides, flags)
    path = tmp_path_factory.mktemp("rails") / f"profile{suffix}"
    write(written, path)
    again = read(path)
    for rail in Rail:
        xr.testing.assert_equal(select_rail(again, rail), select_rail(written, rail))


@pytest.mark.parametrize("suffix", [".nc", ".toml", ".h5"])
def test_a_lateral_position_is_read_back(suffix: str, tmp_path: Path) -> None:
    parts = [
        Channel(name, np.array([0.0, 1.0, 0.5]), quantity, "body", 0.0, lateral=y)
        for name, quantity, y in (
            ("a", "vertical acceleration", 1.25),
            ("b", "vertical acceleration", -1.25),
            ("c", "roll rate", 0.0),
        )
    ]
    write(recording_of(parts, np.array([0.0, 0.3, 0.6])), tmp_path / f"run{suffix}")
    again = channels(read(tmp_path / f"run{suffix}"))
    assert [(one.name, one.quantity, one.lateral) for one in again] == [
        (one.name, one.quantity, one.lateral) for one in parts
    ]


def test_half_a_profile_per_rail_is_refused() -> None:
    mean = build_profile([0.0, 1.0], [0.0, 0.0], kind="truth")
    with pytest.raises(DataError, match=r"add the missing elevation_right, elevation_difference"):
        with_rails(mean, {Rail.LEFT: RailLevel([0.0, 0.0])})
    sides = {rail: RailLevel([0.0, np.nan]) for rail in SEPARATE_RAILS}
    with pytest.raises(RowError, match="elevation_left, data row 2: expected a finite number"):
        with_rails(mean, sides)
    with_rails(mean, sides, [0, Quality.GAP])
    with pytest.raises(DataError, match="expected an elevation of the rail left, got the mean"):
        select_rail(mean, Rail.LEFT)


def run(*arguments: str | Path) -> None:
    main(list(map(str, arguments)))  # exits where the command fails


def test_the_commands_tell_rails_apart(boxes, tmp_path: Path, capsys) -> None:
    _, truth, found = boxes
    profile, reference, left = (tmp_path / f"{name}.csv" for name in ("profile", "truth", "left"))
    write(found.profile, profile)
    write(truth, reference)
    write(select_rail(truth, Rail.LEFT), left)
    run("compare", profile, reference, "--rail", "left", "--json")
    one = capsys.readouterr()
    run("compare", profile, left, "--rail", "left", "--json")
    other = capsys.readouterr()
    assert one.out == other.out
    assert "its elevation is used as that of the left" in other.err
    run("assess", profile, "--speed", "80 km/h", "-o", tmp_path / "tables.csv")
    said = capsys.readouterr().out
    assert all(f"\n{whose}: Assessed length: " in said for whose in ("Left", "Right", "Mean"))
    rows = (tmp_path / "tables-sections.csv").read_text().splitlines()
    assert {row.split(",")[0].strip('"') for row in rows} == {"rail", "left", "right", "mean"}
    run("assess", profile, "--speed", "80 km/h", "--rail", "right")
    assert "Left: " not in capsys.readouterr().out


def test_infer_says_what_it_knows_of_each_rail(boxes, tmp_path: Path, capsys) -> None:
    recording, _, _ = boxes
    write(recording, tmp_path / "run.nc")
    write_vehicle(WAGON, Installation(), tmp_path / "wagon.toml")
    run(
        "infer", tmp_path / "run.nc", "--vehicle", tmp_path / "wagon.toml", "-o", tmp_path / "p.nc",
        "--samples", "8", "--to", "120", "--json",
    )  # fmt: skip
    said = capsys.readouterr().out
    assert '"standard_deviation_per_rail_mm": {"left": {"D1": ' in said
    assert "left rail" in (tmp_path / "p.html").read_text()
    assert available_rails(read(tmp_path / "p.nc")) == (Rail.MEAN, *SEPARATE_RAILS)

"""The usable band, signals cut to it, and what is refused or said where data tell too little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from trackprofile.calibration.bandwidth import limit_bandwidth, spectral_fit
from trackprofile.calibration.calibrate import calibrate
from trackprofile.calibration.datasets import calibration_runs, most_informative, shortened
from trackprofile.calibration.identifiability import identifiable, marginal_information
from trackprofile.calibration.likelihood_profiles import likelihood_profiles
from trackprofile.contracts import Channel, build_recording, channels, select_stretch
from trackprofile.demo import simulated
from trackprofile.errors import DataError, UndeterminedError
from trackprofile.inference.observations import observations
from trackprofile.inference.parameters import vehicle_parameters
from trackprofile.inference.problem import Model
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation
from trackprofile.models.spectrum import scale_density
from trackprofile.models.vehicle import parameter_values, with_parameters

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
SENSORS, SPECTRUM = read_sensors("bogie-100ug"), read_spectrum("german-low")
TRUE = parameter_values(VELARO)


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    return simulated(VELARO, ZHAI, SENSORS, SPECTRUM, 1500.0, 2)[0]


def model(spectrum=SPECTRUM, vehicle=VELARO) -> Model:
    return Model(vehicle, ZHAI, tuple(SENSORS), 0.0, 0.0, spectrum)


def test_level_of_the_profile_is_told_by_the_spectra_of_the_signals(recording: xr.Dataset) -> None:
    data = [observations(recording, Installation())]
    _, found = spectral_fit(data, model(scale_density(SPECTRUM, 30.0)))
    ratio = found.density(np.array([1.0])) / SPECTRUM.density(np.array([1.0]))
    assert ratio == pytest.approx(1.0, rel=0.3)


def test_usable_band_ends_where_noise_drowns_the_track(recording: xr.Dataset) -> None:
    generator = np.random.default_rng(1)
    ends = []
    for density in (1e-4, 0.3):
        rate = 1 / float(np.median(np.diff(recording["time"])))
        noisy = [
            replace(one, values=one.values + density * np.sqrt(rate / 2) * generator.standard_normal(one.values.size))
            for one in channels(recording)[:1]
        ]  # fmt: skip
        loud = build_recording(
            noisy,
            time=recording["time"].to_numpy(),
            speed=recording["speed"].to_numpy(),
        )
        part = spectral_fit(
            [observations(loud, Installation())], replace(model(), sensors=tuple(SENSORS[:1]))
        )[0][0]
        assert np.sqrt(part.noise[0]) < 1.5 * max(density, 0.05)
        ends.append(part.highest)
    assert ends[1] < 0.5 * ends[0]


def test_what_lies_in_the_band_is_kept_and_what_lies_above_is_cut() -> None:
    time = np.arange(0.0, 40.0, 0.002)
    low, high = np.sin(2 * np.pi * 3.0 * time), np.sin(2 * np.pi * 40.0 * time)
    channel = Channel("a", low + high, "vertical acceleration", "leading bogie", 0.0)
    speed = np.full(time.size, 40.0)
    data = observations(
        build_recording([channel], time=time, distance=40.0 * time, speed=speed), Installation()
    )
    cut = limit_bandwidth(data, [10.0])
    at, valid = cut.motion.time, cut.valid[:, 0]
    assert at.size == pytest.approx(time.size * 25 / 500, rel=0.02)
    assert valid.mean() > 0.95
    kept = cut.signals[valid, 0] - np.sin(2 * np.pi * 3.0 * at[valid])
    assert np.abs(kept).max() < 3e-3
    assert limit_bandwidth(data, [200.0]).signals.shape == data.signals.shape


def test_a_run_too_short_or_too_slow_is_refused(recording: xr.Dataset) -> None:
    with pytest.raises(DataError, match="too short or too slow to determine the vehicle"):
        calibrate(select_stretch(recording, 100.0, 200.0), VELARO, track=ZHAI)
    slow = recording.copy()
    slow["time"] = slow["time"] * 30.0
    slow["speed"] = slow["speed"] / 30.0
    with pytest.raises(DataError, match="too short or too slow to determine the vehicle"):
        calibrate(slow, VELARO, track=ZHAI)


def test_weakly_determined_parameter_is_refused_unless_it_is_to_be_kept(
    recording: xr.Dataset,
) -> None:
    piece = select_stretch(recording, 0.0, 250.0)
    with pytest.raises(UndeterminedError, match="do not determine 'wheelset mass'"):
        calibrate(piece, VELARO, track=read_track("rigid"), parameters=["wheelset mass"])
    kept = calibrate(
        piece, VELARO, track=ZHAI, parameters=["wheelset mass"], keep_undetermined=True
    )
    assert [one.name for one in kept.estimates] == ["wheelset mass"]


@pytest.mark.acceptance
def test_start_far_from_the_vehicle_is_said(recording: xr.Dataset) -> None:
    tight = tuple(
        replace(one, spread=0.05) if one.name == "primary stiffness" else one
        for one in VELARO.parameters
    )
    start = with_parameters(
        replace(VELARO, parameters=tight), {"primary stiffness": 1.6 * TRUE["primary stiffness"]}
    )
    found = calibrate(
        select_stretch(recording, 0.0, 300.0), start, track=ZHAI, parameters=["primary stiffness"]
    )
    assert any("primary stiffness went to" in note for note in found.notes)
    assert any("far outside its prior" in note for note in found.notes)
    curve = likelihood_profiles(found.fit, found.start)[0]
    assert curve.loss == pytest.approx(curve.expected, abs=0.3)
    assert np.max(curve.prior) < -4


@pytest.mark.acceptance
def test_recordings_of_two_vehicles_under_one_name_are_told_apart() -> None:
    heavy = with_parameters(VELARO, {"primary stiffness": 1.7 * TRUE["primary stiffness"]})
    runs = [
        simulated(car, ZHAI, SENSORS, SPECTRUM, 200.0, seed)[0]
        for car, seed in ((VELARO, 1), (VELARO, 2), (heavy, 3))
    ]
    names = ["primary stiffness"]
    alike = calibrate(runs[:2], VELARO, track=ZHAI, parameters=names)
    assert not any("another vehicle" in note for note in alike.notes)
    mixed = calibrate(runs, VELARO, track=ZHAI, parameters=names)
    said = [note for note in mixed.notes if "another vehicle" in note]
    assert len(said) == 1
    assert "primary stiffness" in said[0]


def test_long_recordings_are_thinned_to_stretches_of_all_speeds(recording: xr.Dataset) -> None:
    passes, _ = calibration_runs([recording], None, VELARO, Installation())
    some, notes = most_informative(passes, max_length=1000.0)
    assert sum(one.length for one in some) == pytest.approx(1000.0, rel=0.05)
    assert "were used: the most informative stretches" in notes[0]
    assert most_informative(passes, max_length=5000.0) == (passes, [])
    assert sum(one.length for one in shortened(passes, 300.0)) == pytest.approx(300.0, rel=0.05)


def test_null_direction_is_named_by_its_parameters() -> None:
    mass, stiffness = vehicle_parameters(model())[:2]
    # Only the difference of the logarithms is determined: mass over stiffness.
    information = 1e4 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    left, notes = identifiable(information, [mass, stiffness], 1.0, requested=False)
    assert len(left) == 1
    assert mass.name in notes[0]
    assert stiffness.name in notes[0]
    with pytest.raises(UndeterminedError, match="only in combination"):
        identifiable(information, [mass, stiffness], 1.0, requested=True)


def test_marginal_information_is_the_inverse_of_the_joint_covariance() -> None:
    root = np.random.default_rng(1).standard_normal((5, 5))
    whole, precision = root @ root.T, np.array([0.0, 0.0, 1.0, 2.0, 3.0])
    joint = np.linalg.inv(whole + np.diag(precision))
    assert np.linalg.inv(marginal_information(whole, precision, 2)) == pytest.approx(joint[:2, :2])


def test_low_pass_of_the_fastest_band_is_that_of_the_model() -> None:
    """A pure tone through the thinning has the gain and phase of the model's own Butterworth."""
    time = np.arange(0.0, 20.0, 0.004)
    for frequency in (2.0, 15.0, 30.0):
        channel = Channel(
            "a", np.sin(2 * np.pi * frequency * time), "vertical acceleration", "leading bogie", 0.0
        )
        run = build_recording(
            [channel], time=time, distance=40.0 * time, speed=np.full(time.size, 40.0)
        )
        thin = limit_bandwidth(observations(run, Installation()), [30.0])
        assert thin.low_pass == (15.0,)
        assert thin.motion.time.size == pytest.approx(20.0 * 75.0, rel=0.12)
        s = 1j * frequency / 15.0
        gain = 1 / (s**2 + np.sqrt(2) * s + 1)
        expected = np.imag(gain * np.exp(2j * np.pi * frequency * thin.motion.time))
        valid = thin.valid[:, 0]
        assert valid.mean() > 0.98
        assert np.abs(thin.signals[valid, 0] - expected[valid]).max() < 3e-3

"""From a recording to a profile: what comes out, and what doubtful data do to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from trackprofile import infer
from trackprofile.assessment.compare import compare
from trackprofile.contracts import Quality, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.errors import DataError, ModelError
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation
from trackprofile.preprocessing.motion import motion

VELARO = read_vehicle("velaro")[0]
RIGID = read_track("rigid")


@pytest.fixture(scope="module")
def made() -> tuple[xr.Dataset, xr.Dataset]:
    """A recording of 600 m from an independent simulation, and the truth."""
    return simulated(
        VELARO,
        point_track(RIGID),
        read_sensors("bogie-25ug"),
        read_spectrum("german-low"),
        600.0,
        5,
    )


def rebuilt(recording: xr.Dataset, **changes: Any) -> xr.Dataset:
    """The recording with its channels or motion changed."""
    kept: dict[str, Any] = {
        name: recording[name].to_numpy()
        for name in ("time", "distance", "speed")
        if name in recording
    }
    kept |= {
        name: value for name, value in changes.items() if name in ("time", "distance", "speed")
    }
    kept = {name: value for name, value in kept.items() if value is not None}
    return build_recording(changes.get("channels", channels(recording)), **kept)


def test_profile_is_found_with_its_bands_and_true_intervals(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, truth = made
    found = estimate(recording, VELARO, InferenceSettings(prior=read_spectrum("german-low")))
    result = compare(found.profile, truth, from_m=100.0, to_m=500.0).bands
    for name, least in (("D1", 0.999), ("D2", 0.999)):
        band = result[name]
        assert band is not None
        assert band.correlation > least
        assert abs(band.lag_m) < 0.01
        assert band.gain == pytest.approx(1.0, abs=0.01)
        assert band.coverage_95 is not None
        assert band.coverage_95 > 0.85
    assert set(found.profile) >= {"standard_deviation", "standard_deviation_D1", "quality"}
    for channel in channels(recording):
        left = channel.values - found.reproduced[channel.name]
        assert channel.noise_density is not None
        noise = channel.noise_density * np.sqrt(0.5 / np.mean(np.diff(recording["time"])))
        # Waves as short as the knots take up some of the noise, none of it is left over.
        assert 0.6 * noise < np.nanstd(left) < 1.05 * noise


def test_prior_level_that_nobody_states_is_found_and_said(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    found = estimate(made[0], VELARO, InferenceSettings(samples=2))
    assert any("prior amplitude estimated by maximum likelihood" in note for note in found.notes)
    shape = found.model.spectrum
    level = shape.standard_deviation(3.0, 25.0) / read_spectrum("german-low").standard_deviation(
        3.0, 25.0
    )
    # 600 m hold some eighty waves of D1's middle: a level within a few tens of per cent.
    assert 0.6 < level < 1.6


def test_sensor_noise_that_nobody_states_is_found(made: tuple[xr.Dataset, xr.Dataset]) -> None:
    recording, _ = made
    silent = [replace(channel, noise_density=None) for channel in channels(recording)]
    found = estimate(rebuilt(recording, channels=silent), VELARO, InferenceSettings(samples=2))
    for sensor, stated in zip(found.model.sensors, channels(recording), strict=True):
        assert sensor.noise_density == pytest.approx(stated.noise_density, rel=0.3)


def test_invalid_samples_have_no_influence_and_leave_a_flagged_gap(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, _ = made
    distance = motion(recording).distance
    bad = (distance > 300.0) & (distance < 345.0)
    nonsense = np.random.default_rng(0).normal(size=len(distance))
    spoilt = []
    for wrong in (0.0, 100.0 * nonsense):
        changed = [
            replace(
                channel,
                values=np.where(bad, wrong, channel.values),
                valid=np.asarray(channel.valid, bool) & ~bad,
            )
            for channel in channels(recording)
        ]
        spoilt.append(
            infer(
                rebuilt(recording, channels=changed),
                VELARO,
                prior=read_spectrum("german-low"),
                samples=8,
            )
        )
    xr.testing.assert_equal(spoilt[0]["elevation"], spoilt[1]["elevation"])
    flagged = (spoilt[0]["quality"].to_numpy() & Quality.GAP) != 0
    place = spoilt[0]["distance"].to_numpy()[flagged]
    # All wheels must have missed it: 45 m less the car's length of 20 m.
    assert 300.0 < place.min() < place.max() < 345.0
    assert np.ptp(place) == pytest.approx(45.0 - 19.875 - 2.0, abs=1.0)
    spread = spoilt[0]["standard_deviation_D1"].to_numpy()
    assert spread[flagged].min() > 3 * np.median(spread)


def test_stop_in_the_middle_is_flagged_and_not_mistaken(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    time = np.arange(0.0, 90.0, 0.01)
    speed = np.clip(np.abs(time - 45.0) * 0.6 - 3.0, 0.0, 15.0)
    run = np.concatenate([[0.0], np.cumsum(0.01 * 0.5 * (speed[1:] + speed[:-1]))])
    flat = [
        replace(channel, values=np.zeros(len(time)), valid=None) for channel in channels(made[0])
    ]
    recording = build_recording(flat, time=time, speed=speed)
    profile = infer(recording, VELARO, prior=read_spectrum("german-low"), samples=8)
    slow = (profile["quality"].to_numpy() & Quality.SLOW) != 0
    stop = run[np.argmin(speed)]
    assert slow[np.argmin(np.abs(profile["distance"].to_numpy() - stop))]
    deviation = profile["standard_deviation_D1"].to_numpy()
    assert np.all(np.isfinite(profile["elevation"].to_numpy()))
    assert np.interp(stop, profile["distance"], deviation) > 2 * np.median(deviation[~slow])


def test_same_seed_gives_the_same_profile(made: tuple[xr.Dataset, xr.Dataset]) -> None:
    prior = read_spectrum("german-low")
    first, second = (infer(made[0], VELARO, prior=prior, samples=4, seed=9) for _ in range(2))
    xr.testing.assert_identical(first, second)


def test_recording_that_does_not_fit_the_vehicle_is_refused(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, _ = made
    with pytest.raises(DataError, match=r"covers .* m, but from the first to the last wheel"):
        infer(recording.isel(sample=slice(0, 60)), VELARO)
    roof = [replace(channels(recording)[0], body="roof")]
    with pytest.raises(ModelError, match="is mounted on 'roof'"):
        infer(rebuilt(recording, channels=roof), VELARO)


def test_drift_of_a_sensor_is_found_and_widens_the_intervals_of_long_waves(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, truth = made
    acceleration = channels(recording)[0]
    interval = np.diff(recording["time"].to_numpy(), prepend=recording["time"].to_numpy()[0])
    walk = 0.1 * np.sqrt(interval) * np.random.default_rng(3).standard_normal(len(interval))
    drifting = replace(acceleration, values=acceleration.values + np.cumsum(walk))
    disturbed = rebuilt(recording, channels=[drifting])
    results = []
    for drift in (None, 0.1):
        sensors = [replace(read_sensors("bogie-25ug")[0], drift=drift)]
        profile = infer(
            disturbed,
            VELARO,
            installation=Installation(sensors=tuple(sensors)),
            prior=read_spectrum("german-low"),
        )
        band = compare(profile, truth, from_m=100.0, to_m=500.0).bands["D2"]
        assert band is not None
        assert band.stated_rms_mm is not None
        results.append((band.rms_error_mm, band.stated_rms_mm))
    (error_found, stated_found), (error, stated) = results
    # A drift that nobody stated is found by itself, and costs as much.
    assert error_found < 1.2 * error
    assert stated_found == pytest.approx(stated, rel=0.3)
    assert 0.5 < error / stated < 2.0

"""What changes from train to train and day to day: mounting, wheels, load, and how sure the vehicle is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

from trackprofile.calibration.calibrate import calibrate
from trackprofile.demo import simulated
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import (
    read_sensors,
    read_spectrum,
    read_track,
    read_vehicle,
    write_vehicle,
)
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation, Residual, Uncertainty
from trackprofile.models.vehicle import parameter_values, with_parameters

VELARO, ZHAI = read_vehicle("velaro")[0], point_track(read_track("zhai"))
SENSORS, SPECTRUM = read_sensors("bogie-100ug"), read_spectrum("german-low")
TRUE = parameter_values(VELARO)
ACCELERATION = SENSORS[0].name


@pytest.fixture(scope="module")
def made() -> tuple[xr.Dataset, xr.Dataset]:
    return simulated(VELARO, ZHAI, SENSORS, SPECTRUM, 300.0, 5)


def changed(recording: xr.Dataset, name: str, values: np.ndarray) -> xr.Dataset:
    other = recording.copy(deep=True)
    other[name].values[:] = values
    return other


def found_of(recording: xr.Dataset, truth: xr.Dataset, name: str, **given) -> tuple[float, float]:
    one = calibrate(recording, VELARO, truth, track=ZHAI, parameters=[name], **given).estimates[0]
    return one.value, one.standard_error


@pytest.mark.acceptance
def test_gain_of_a_sensor_is_found_over_a_known_profile(made) -> None:
    recording, truth = made
    loud = changed(recording, ACCELERATION, 1.03 * recording[ACCELERATION].to_numpy())
    value, error = found_of(loud, truth, f"gain of {ACCELERATION}")
    # The reference is known every 0.25 m: its shortest waves are felt 0.2 % wrong.
    assert value == pytest.approx(1.03, abs=0.003)
    assert error < 0.003


@pytest.mark.acceptance
def test_wheel_that_has_worn_is_found_over_a_known_profile(made) -> None:
    recording, truth = made
    worn = changed(recording, "speed", 1.004 * recording["speed"].to_numpy())
    value, error = found_of(worn, truth, "distance scale")
    assert value == pytest.approx(1 / 1.004, abs=max(4 * error, 1e-4))


@pytest.mark.acceptance
def test_what_the_model_leaves_out_is_found_as_a_coloured_residual(made) -> None:
    recording, truth = made
    signal = recording[ACCELERATION].to_numpy()
    rate = 1 / float(np.median(np.diff(recording["time"])))
    frequency, damping, share = 12.0, 0.3, 0.2
    pole = np.exp(2 * np.pi * frequency / rate * (-damping + 1j * np.sqrt(1 - damping**2)))
    white = np.random.default_rng(1).standard_normal(signal.size + 500)
    # As the model has it: none at rest.
    hum = np.asarray(lfilter([1.0, -1.0], np.poly([pole, pole.conj()]).real, white))[500:]
    hum = hum * share * signal.std() / hum.std()
    start = replace(SENSORS[0], residual=Residual(0.05, 8.0))
    found = calibrate(
        changed(recording, ACCELERATION, signal + hum), VELARO, truth, track=ZHAI,
        installation=Installation(sensors=(start, SENSORS[1])), parameters=["primary stiffness"],
    )  # fmt: skip
    residual = found.installation.sensors[0].residual
    assert residual is not None
    assert residual.share == pytest.approx(share, rel=0.3)
    assert residual.frequency == pytest.approx(frequency, rel=0.2)


def test_load_of_the_day_is_found_by_infer_itself() -> None:
    body = VELARO.bodies[0]
    assert body.pitch_inertia is not None
    full = replace(body, mass=1.2 * body.mass, pitch_inertia=1.2 * body.pitch_inertia)
    loaded = replace(VELARO, bodies=(full, *VELARO.bodies[1:]), parameters=())
    recording, _ = simulated(loaded, ZHAI, SENSORS, SPECTRUM, 600.0, 6)
    found = estimate(
        recording,
        VELARO,
        InferenceSettings(track=ZHAI, prior=SPECTRUM, samples=2, estimate_load=True),
    )
    assert found.model.vehicle.bodies[0].mass / body.mass == pytest.approx(1.2, abs=0.05)
    assert any("load" in note for note in found.notes)


def test_uncertain_vehicle_widens_the_profile_by_what_it_moves_it(made) -> None:
    recording, _ = made
    spread = 0.1
    uncertain = Installation(uncertainty=Uncertainty(("primary stiffness",), ((spread**2,),)))
    sure, unsure = (
        estimate(
            recording,
            VELARO,
            InferenceSettings(track=ZHAI, prior=SPECTRUM, samples=64, installation=one),
        ).profile
        for one in (Installation(), uncertain)
    )
    stiffer = with_parameters(
        VELARO, {"primary stiffness": np.exp(spread) * TRUE["primary stiffness"]}
    )
    moved = estimate(
        recording, stiffer, InferenceSettings(track=ZHAI, prior=SPECTRUM, samples=2)
    ).profile
    slope = (moved["elevation"] - sure["elevation"]).to_numpy()
    expected = np.sqrt(sure["standard_deviation"].to_numpy() ** 2 + slope**2)
    # Either direction of the one step is as good; they differ by curvature.
    assert unsure["standard_deviation"].to_numpy() == pytest.approx(expected, rel=0.05)
    assert np.median(unsure["standard_deviation_D1"] / sure["standard_deviation_D1"]) > 1.5
    np.testing.assert_allclose(unsure["elevation"], sure["elevation"])


def test_all_that_a_calibration_knows_of_the_sensors_comes_back_from_its_file(
    tmp_path: Path,
) -> None:
    sensor = replace(SENSORS[0], gain=1.02, tilt=0.03, residual=Residual(0.1, 9.0, 0.4))
    installation = Installation(
        1.5, (sensor, SENSORS[1]), 0.08, 0.998,
        Uncertainty(("primary stiffness", "origin"), ((0.04, 0.001), (0.001, 0.02))),
    )  # fmt: skip
    write_vehicle(VELARO, installation, tmp_path / "vehicle.toml")
    vehicle, back = read_vehicle(str(tmp_path / "vehicle.toml"))
    assert back == installation
    assert [one.log_std for one in vehicle.parameters] == [one.log_std for one in VELARO.parameters]

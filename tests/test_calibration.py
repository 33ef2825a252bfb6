"""Vehicles found from a stretch whose profile is known: by simulation, from an independent route."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from trackprofile import infer
from trackprofile.assessment.compare import compare
from trackprofile.calibration.calibrate import calibrate
from trackprofile.contracts import build_profile, select_stretch
from trackprofile.demo import simulated
from trackprofile.errors import DataError, ModelError, UndeterminedError
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation
from trackprofile.models.vehicle import parameter_values, with_parameters

VELARO = read_vehicle("velaro")[0]
TRUE = parameter_values(VELARO)


@pytest.fixture(scope="module")
def made() -> tuple[xr.Dataset, xr.Dataset]:
    sensors = read_sensors("bogie-100ug")
    return simulated(
        VELARO, point_track(read_track("rigid")), sensors, read_spectrum("german-low"), 400.0, 4
    )


def test_wrong_suspension_and_origin_are_brought_back(made: tuple[xr.Dataset, xr.Dataset]) -> None:
    recording, truth = made
    moved = truth.assign_coords(distance=truth["distance"] + 3.2)
    wrong = {"primary stiffness": 0.75, "primary damping": 1.3}
    start = with_parameters(VELARO, {name: factor * TRUE[name] for name, factor in wrong.items()})
    found = calibrate(recording, start, moved, parameters=[*wrong, "origin"])
    estimates = {one.name: one for one in found.estimates}
    for name in wrong:
        one = estimates[name]
        assert one.value == pytest.approx(TRUE[name], rel=0.02)
        assert abs(one.value - TRUE[name]) < 5 * one.standard_error
    assert found.installation.origin == pytest.approx(3.2, abs=0.03)
    assert estimates["origin"].start == 0.0
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)


def test_rigid_path_determines_only_ratios_of_masses_and_stiffnesses(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    scale = ["body mass", "body pitch inertia", "bogie mass", "bogie pitch inertia"]
    springs = ["primary stiffness", "primary damping", "secondary stiffness", "secondary damping"]
    with pytest.raises(UndeterminedError, match=r"'body mass'.* only in combination"):
        calibrate(made[0], VELARO, made[1], parameters=[*scale, *springs])


@pytest.mark.acceptance
def test_several_recordings_are_fitted_at_once(made: tuple[xr.Dataset, xr.Dataset]) -> None:
    recording, truth = made
    halves = [select_stretch(recording, 0.0, 220.0), select_stretch(recording, 180.0, 400.0)]
    start = with_parameters(VELARO, {"primary stiffness": 2.0e6})
    found = calibrate(halves, start, truth, parameters=["primary stiffness"])
    assert found.estimates[0].value == pytest.approx(TRUE["primary stiffness"], rel=0.02)


def test_calibrated_vehicle_reads_the_track_better_than_the_wrong_one(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, truth = made
    wrong = with_parameters(VELARO, {"primary stiffness": 1.8e6})
    found = calibrate(recording, wrong, truth, parameters=["primary stiffness"])
    errors = []
    for vehicle, installation in ((wrong, Installation()), (found.vehicle, found.installation)):
        profile = infer(
            recording,
            vehicle,
            installation=installation,
            prior=read_spectrum("german-low"),
            samples=2,
        )
        band = compare(profile, truth, from_m=50.0, to_m=350.0).bands["D1"]
        assert band is not None
        errors.append(band.rms_error_mm)
    assert errors[1] < 0.3 * errors[0]


def test_what_cannot_be_fitted_is_refused(made: tuple[xr.Dataset, xr.Dataset]) -> None:
    recording, truth = made
    with pytest.raises(ModelError, match="no parameter 'colour'; known parameters are body mass"):
        calibrate(recording, VELARO, truth, parameters=["colour"])
    with pytest.raises(DataError, match="choose another stretch or reference"):
        calibrate(recording, VELARO, select_stretch(truth, 0.0, 60.0))
    gap = truth["elevation"].to_numpy().copy()
    gap[500:510] = np.nan
    quality = np.isnan(gap).astype(np.int8)
    broken = build_profile(truth["distance"], gap, kind="point", quality=quality)
    with pytest.raises(DataError, match="gaps in its elevation"):
        calibrate(recording, VELARO, broken)


def test_parameter_that_no_sensor_feels_is_held_and_said(
    made: tuple[xr.Dataset, xr.Dataset],
) -> None:
    recording, truth = made
    found = calibrate(recording, replace(VELARO, name="again"), truth)
    held = [note for note in found.notes if note.startswith("wheelset mass is held")]
    assert len(held) == 1
    assert parameter_values(found.vehicle)["wheelset mass"] == TRUE["wheelset mass"]

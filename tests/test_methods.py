"""The registry of methods and the verb that chooses one."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from trackprofile import infer
from trackprofile.demo import simulated
from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.methods import registry
from trackprofile.methods.method import load_method, method_settings
from trackprofile.methods.registry import METHODS, MethodEntry
from trackprofile.models.receptance import point_track

VELARO = read_vehicle("velaro")[0]
ZHAI = read_track("zhai")


@pytest.fixture(scope="module")
def recording() -> xr.Dataset:
    sensors, spectrum = read_sensors("bogie-25ug"), read_spectrum("german-low")
    return simulated(VELARO, point_track(ZHAI), sensors, spectrum, length=60.0, seed=1)[0]


@pytest.mark.parametrize("name", METHODS)
def test_every_method_can_be_loaded_with_its_settings(name: str) -> None:
    assert callable(load_method(name))
    assert {"installation", "track", "seed"} <= {
        one.name for one in fields(method_settings(name, {}))
    }


def test_registry_imports_no_method() -> None:
    code = "import sys, trackprofile.methods.registry; print('numpy' in sys.modules)"
    output = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert output.stdout.strip() == "False"


def test_default_method_is_the_smoother(recording: xr.Dataset) -> None:
    default = infer(recording, VELARO, track=ZHAI, samples=4)
    smoother = infer(recording, VELARO, method="smoother", track=ZHAI, samples=4)
    np.testing.assert_array_equal(default["elevation"], smoother["elevation"])


def test_cross_entropy_can_be_chosen_by_name(recording: xr.Dataset) -> None:
    short = recording.isel(sample=slice(0, 40))
    profile = infer(short, VELARO, method="cross-entropy", seed=1)
    assert profile.attrs["kind"] == "point"


def test_method_and_settings_that_do_not_exist_are_rejected(recording: xr.Dataset) -> None:
    with pytest.raises(ModelError, match="no method 'kalman'; use one of smoother, cross-entropy"):
        infer(recording, VELARO, method="kalman")
    with pytest.raises(ModelError, match="'cross-entropy' has no setting 'prior'"):
        infer(recording, VELARO, method="cross-entropy", prior=read_spectrum("fra-6"))


def test_a_method_is_added_by_one_entry(
    recording: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = MethodEntry(
        f"{__name__}:level_profile",
        "trackprofile.inference.settings:InferenceSettings",
        "level profile",
        "this test",
    )
    monkeypatch.setitem(sys.modules, __name__, sys.modules[__name__])
    monkeypatch.setitem(registry.METHODS, "level", entry)
    assert infer(recording, VELARO, method="level").attrs["seed"] == 7


def level_profile(
    recording: xr.Dataset, vehicle: object, settings: object = None, *, progress: object = None
) -> SimpleNamespace:
    """A method that returns a profile without any elevation."""
    return SimpleNamespace(profile=xr.Dataset(attrs={"seed": 7}))

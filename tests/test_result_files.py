"""Result files of `infer`: the HTML figure shows each signal with the one that the profile reproduces."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from trackprofile.contracts import Channel, build_recording, channels
from trackprofile.demo import simulated
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track
from trackprofile.reporting.result_files import write_estimate

VELARO = read_vehicle("velaro")[0]


@pytest.fixture(scope="module")
def recorded() -> xr.Dataset:
    """400 m of a bogie's acceleration and pitch rate."""
    return simulated(
        VELARO,
        point_track(read_track("rigid")),
        read_sensors("bogie-25ug"),
        read_spectrum("german-low"),
        400.0,
        5,
    )[0]


def unchanged(up: Channel, pitch: Channel) -> tuple[Channel, Channel]:
    return up, pitch


def upside_down(up: Channel, pitch: Channel) -> tuple[Channel, Channel]:
    return replace(up, values=-np.asarray(up.values) - 9.81), pitch


def reversed_vehicle(up: Channel, pitch: Channel) -> tuple[Channel, Channel]:
    # The acceleration shows gravity with the right sign, so it is the vehicle that is reversed.
    upright = replace(up, values=np.asarray(up.values) + 9.81)
    return upright, replace(pitch, values=-np.asarray(pitch.values))


def exchanged(up: Channel, pitch: Channel) -> tuple[Channel, Channel]:
    return replace(up, values=pitch.values), replace(pitch, values=up.values)


@pytest.mark.parametrize("mounted", [unchanged, upside_down, reversed_vehicle, exchanged])
def test_the_figure_shows_signals_as_they_were_used(recorded, mounted, tmp_path: Path) -> None:
    time, speed = (recorded[name].to_numpy() for name in ("time", "speed"))
    parts = mounted(*channels(recorded))
    recording = build_recording(parts, time=time, speed=speed)
    result = estimate(
        recording, VELARO, InferenceSettings(prior=read_spectrum("german-low"), samples=8)
    )
    text = write_estimate(result, recording, tmp_path / "p.nc")[1].read_text(encoding="utf-8")
    residuals = re.findall(r"RMS ([\d.]+) \S+, of ([\d.]+) \S+ measured", text)
    assert len(residuals) == 2
    for residual, measured in residuals:
        assert float(residual) < 0.3 * float(measured)

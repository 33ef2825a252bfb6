"""Probabilities of exceedance, from the simulated recording with its noise to the announced number."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from trackprofile import infer
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits import Action, DefectLimits, Limits
from trackprofile.bands import D1, band_pass, resample
from trackprofile.demo import simulated
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.receptance import point_track

VELARO, ZHAI, FRA_5 = (
    read_vehicle("velaro")[0], point_track(read_track("zhai")), read_spectrum("fra-5"),
)  # fmt: skip
SEEDS, LENGTH = 200, 400.0
HEIGHTS = tuple((low, low + 0.003, low + 0.006) for low in (0.003, 0.0037, 0.0044, 0.0051))  # m
WORSE = 30.0  # times the noise of a good sensor, so that much is unsure


@pytest.mark.acceptance
def test_exceedances_of_inferred_profiles_happen_as_often_as_announced() -> None:
    sensors = tuple(
        replace(one, noise_density=WORSE * (one.noise_density or 0.0))
        for one in read_sensors("bogie-100ug")
    )
    rules = [
        Limits(
            "ours",
            (
                DefectLimits(
                    "D1", 0.0, 90.0, "invented", True, dict(zip(Action, heights, strict=True))
                ),
            ),
        )
        for heights in HEIGHTS
    ]
    announced, happened = [], []
    for seed in range(1, SEEDS + 1):
        recording, truth = simulated(VELARO, ZHAI, sensors, FRA_5, LENGTH, seed)
        profile = infer(recording, VELARO, track=ZHAI, prior=FRA_5, samples=32, seed=seed)
        judged = [assess(profile, one, 40.0, bands=[D1], least_probability=0.01) for one in rules]
        level = judged[0].levels["D1"]
        exact = resample(truth["distance"], truth["elevation"], level.distance)
        true = band_pass(exact, level.spacing, D1)
        for one in (defect for found in judged for defect in found.defects):
            inside = (level.distance >= one.start) & (level.distance <= one.end)
            for action, probability in one.probabilities.items():
                announced.append(probability)
                highest = np.max(np.sign(one.height) * true[inside])
                happened.append(highest > one.limits.heights[action])
    announced, happened = np.array(announced), np.array(happened)
    off = []
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (announced > max(low, 0.005)) & (announced <= low + 0.1)
        off.append(happened[inside].mean() - announced[inside].mean())
        sys.stdout.write(
            f"announced {announced[inside].mean():.3f}, happened {happened[inside].mean():.3f}, {inside.sum()} times\n"
        )
    assert np.abs(off).max() <= 0.05

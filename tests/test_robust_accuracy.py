"""The whole main job against the least possible error: on clean recordings, and on recordings with faults all along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

from test_at_the_limit import (
    BETWEEN,
    KNOTS,
    SAMPLING,
    SPEED,
    VELARO,
    rms,
    simulated,
    smoother_of,
    spectral_rms,
)
from trackprofile import infer
from trackprofile.bands import BANDS, band_pass
from trackprofile.contracts import Channel, build_recording
from trackprofile.io.model_toml import read_sensors, read_spectrum
from trackprofile.kalman.smoother import smooth
from trackprofile.models.sensor import Sensor

Array = np.ndarray
LENGTH = 4000.0  # m
ENDS = 425.0  # m, within which D3 is not free of the ends
SHORTEST = 1.0  # m: shorter waves are no spline over knots of 0.25 m, and fine sensors feel that


def recording_of(signals: Array, sensors: Sequence[Sensor]) -> xr.Dataset:
    time = np.arange(len(signals)) / SAMPLING
    parts = [
        Channel(s.name, signals[:, i], s.quantity, s.body, s.position, s.noise_density)
        for i, s in enumerate(sensors)
    ]
    return build_recording(parts, time=time, distance=SPEED * time, speed=np.full(len(time), SPEED))


def spoiled(signals: Array, generator: np.random.Generator) -> Array:
    """Each sensor at an end of its range once a second, eight bursts, and an offset that jumps."""
    signals, count = signals.copy(), len(signals)
    for values, most, jump in zip(signals.T, (100.0, 4.0), (0.2, 0.005), strict=True):
        loud = 20 * np.std(values)
        at = np.arange(generator.integers(500), count, 500)
        values[at] = most * generator.choice([-1, 1], len(at))
        for first in generator.choice(count - 8, 8, replace=False):
            values[first : first + 8] += loud * generator.standard_normal(8)
        values[generator.integers(count // 4, 3 * count // 4) :] += jump
    return signals


@dataclass(frozen=True)
class Outcome:
    """By band: root mean square error in m, that of the optimal smoother on the clean signals, stated over true
    deviation, and the share of points within 1.96 stated deviations.
    """

    error: dict[str, float]
    least: dict[str, float]
    stated: dict[str, float]
    inside: dict[str, float]


def outcome(grade: str, prior: str, rides: int, *, spoil: bool) -> Outcome:
    generator = np.random.default_rng(30)
    sensors, samples = read_sensors(grade), round(LENGTH / BETWEEN)
    profile, signals = simulated(sensors, prior, samples, rides, generator, SHORTEST)
    prepared = smoother_of(sensors, prior, samples)
    ride = prepared.ride
    optimal = smooth(prepared, signals[ride.samples, ride.sensors]).elevation
    place = KNOTS * (ride.first_knot + np.arange(len(optimal)))
    errors, least, stated = [], [], []
    for number in range(rides):
        one = signals[:, :, number]
        one = spoiled(one, generator) if spoil else one
        found = infer(recording_of(one, sensors), VELARO, prior=read_spectrum(prior), samples=32)
        at = found["distance"].to_numpy()
        truth = profile[np.rint(at / BETWEEN).astype(int) % samples, number]
        errors.append(truth - found["elevation"].to_numpy())
        least.append(truth - np.interp(at, place, optimal[:, number]))
        stated.append([found[f"standard_deviation_{b.name}"].to_numpy() for b in BANDS])
    off, middle = np.array(errors), slice(round(ENDS / KNOTS), -round(ENDS / KNOTS))
    inner = slice(round(200 / KNOTS), -round(200 / KNOTS))
    spreads = np.array(stated)[:, :, middle]
    in_bands = [band_pass(off, KNOTS, band)[:, middle] for band in BANDS]
    ratio, inside = {}, {}
    for i, (band, true) in enumerate(zip(BANDS, in_bands, strict=True)):
        ratio[band.name] = rms(spreads[:, i]) / rms(true)
        inside[band.name] = float(np.mean(np.abs(true) < 1.96 * spreads[:, i]))
    return Outcome(
        spectral_rms(off[:, inner]), spectral_rms(np.array(least)[:, inner]), ratio, inside
    )


@pytest.mark.acceptance
@pytest.mark.parametrize(("grade", "prior"), [("bogie-25ug", "fra-6"), ("bogie-1mg", "fra-4")])
@pytest.mark.parametrize("spoil", [False, True], ids=["clean", "spoiled"])
def test_error_is_at_most_a_tenth_above_the_least_and_as_large_as_stated(
    grade: str, prior: str, spoil: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    one = outcome(grade, prior, 4, spoil=spoil)
    with capsys.disabled():
        columns = [
            f"{b}: {1e3 * one.error[b]:.4f} mm, over the least {one.error[b] / one.least[b]:.3f}, "
            f"stated over true {one.stated[b]:.3f}, inside {one.inside[b]:.3f}"
            for b in one.error
        ]
        print(f"\n{grade} {prior} {'spoiled' if spoil else 'clean'}  " + "   ".join(columns))  # noqa: T201
    for band in one.error:
        assert one.error[band] < 1.1 * one.least[band], (band, "least")
        # A jump that a coarse sensor just shows is placed some metres off, and the interval does not know that.
        assert one.inside[band] > (0.85 if spoil else 0.9), (band, "inside")
        assert spoil or 0.9 < one.stated[band] < 1.1, (band, "stated")

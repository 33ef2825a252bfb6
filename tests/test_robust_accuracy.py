"""Error of `infer` relative to that of the optimal smoother, on recordings without and with many sensor faults."""

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
ENDS = 425.0  # m at each end, excluded: the filter of D3 has transients there
SHORTEST = 1.0  # m: a spline over knots of 0.25 m does not represent shorter waves, which accurate sensors measure


def recording_of(signals: Array, sensors: Sequence[Sensor]) -> xr.Dataset:
    time = np.arange(len(signals)) / SAMPLING
    parts = [
        Channel(s.name, signals[:, i], s.quantity, s.body, s.position, s.noise_density)
        for i, s in enumerate(sensors)
    ]
    return build_recording(parts, time=time, distance=SPEED * time, speed=np.full(len(time), SPEED))


def with_faults(signals: Array, generator: np.random.Generator) -> Array:
    """Signals with a saturated sample of each sensor per second, eight bursts and an offset jump."""
    signals, count = signals.copy(), len(signals)
    for values, end, jump in zip(signals.T, (100.0, 4.0), (0.2, 0.005), strict=True):
        burst_std = 20 * np.std(values)
        at = np.arange(generator.integers(500), count, 500)
        values[at] = end * generator.choice([-1, 1], len(at))
        for first in generator.choice(count - 8, 8, replace=False):
            values[first : first + 8] += burst_std * generator.standard_normal(8)
        values[generator.integers(count // 4, 3 * count // 4) :] += jump
    return signals


@dataclass(frozen=True)
class BandResults:
    """Results by band.

    Parameters
    ----------
    error : RMS error, m
    optimal : RMS error of the optimal smoother on the signals without faults, m
    stated : stated over true standard deviation
    coverage : share of points within 1.96 stated standard deviations
    """

    error: dict[str, float]
    optimal: dict[str, float]
    stated: dict[str, float]
    coverage: dict[str, float]


def evaluate(grade: str, prior: str, runs: int, *, faulty: bool) -> BandResults:
    generator = np.random.default_rng(30)
    sensors, samples = read_sensors(grade), round(LENGTH / BETWEEN)
    profile, signals = simulated(sensors, prior, samples, runs, generator, SHORTEST)
    prepared = smoother_of(sensors, prior, samples)
    ride = prepared.run
    optimal = smooth(prepared, signals[ride.samples, ride.sensors]).elevation
    position = KNOTS * (ride.first_knot + np.arange(len(optimal)))
    errors, optimal_errors, stated = [], [], []
    for number in range(runs):
        one = signals[:, :, number]
        one = with_faults(one, generator) if faulty else one
        profile_estimate = infer(
            recording_of(one, sensors), VELARO, prior=read_spectrum(prior), samples=32
        )
        at = profile_estimate["distance"].to_numpy()
        truth = profile[np.rint(at / BETWEEN).astype(int) % samples, number]
        errors.append(truth - profile_estimate["elevation"].to_numpy())
        optimal_errors.append(truth - np.interp(at, position, optimal[:, number]))
        stated.append([profile_estimate[f"standard_deviation_{b.name}"].to_numpy() for b in BANDS])
    error, middle = np.array(errors), slice(round(ENDS / KNOTS), -round(ENDS / KNOTS))
    inner = slice(round(200 / KNOTS), -round(200 / KNOTS))
    stds = np.array(stated)[:, :, middle]
    in_bands = [band_pass(error, KNOTS, band)[:, middle] for band in BANDS]
    ratio, coverage = {}, {}
    for i, (band, true) in enumerate(zip(BANDS, in_bands, strict=True)):
        ratio[band.name] = rms(stds[:, i]) / rms(true)
        coverage[band.name] = float(np.mean(np.abs(true) < 1.96 * stds[:, i]))
    return BandResults(
        spectral_rms(error[:, inner]),
        spectral_rms(np.array(optimal_errors)[:, inner]),
        ratio,
        coverage,
    )


@pytest.mark.acceptance
@pytest.mark.parametrize(("grade", "prior"), [("bogie-25ug", "fra-6"), ("bogie-1mg", "fra-4")])
@pytest.mark.parametrize("faulty", [False, True], ids=["clean", "faulty"])
def test_error_is_at_most_10_percent_above_that_of_the_optimal_smoother_and_as_stated(
    grade: str, prior: str, faulty: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    one = evaluate(grade, prior, 4, faulty=faulty)
    with capsys.disabled():
        columns = [
            f"{b}: {1e3 * one.error[b]:.4f} mm, over the optimal one {one.error[b] / one.optimal[b]:.3f}, "
            f"stated over true {one.stated[b]:.3f}, coverage {one.coverage[b]:.3f}"
            for b in one.error
        ]
        print(f"\n{grade} {prior} {'faulty' if faulty else 'clean'}  " + "   ".join(columns))  # noqa: T201
    for band in one.error:
        assert one.error[band] < 1.1 * one.optimal[band], (band, "optimal")
        # A barely significant jump of a noisy sensor is located some metres off; the interval does not include that.
        assert one.coverage[band] > (0.85 if faulty else 0.9), (band, "coverage")
        assert faulty or 0.9 < one.stated[band] < 1.1, (band, "stated")

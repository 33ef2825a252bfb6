"""Benchmarks of computing time and memory, which the README quotes."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.contracts import build_profile
from trackprofile.inference.observations import KNOT_SPACING
from trackprofile.io.model_toml import (
    presets,
    read_roughness,
    read_sensors,
    read_spectrum,
    read_track,
    read_vehicle,
)
from trackprofile.kalman.smoother import initial_state, kalman_gains, posterior_variances, smooth
from trackprofile.kalman.time_steps import discretise_run
from trackprofile.machine import in_one_thread, machine, peak_memory
from trackprofile.methods.cross_entropy.estimator import cross_entropy
from trackprofile.methods.cross_entropy.search_settings import (
    TABLE_5,
    TABLE_6,
    CrossEntropySettings,
    Variant,
)
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import Flat, random_irregularity
from trackprofile.models.kinematics import Motion
from trackprofile.models.receptance import point_track
from trackprofile.models.statespace import state_space
from trackprofile.models.track import Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.reporting.report import report
from trackprofile.reproduction.cases import bell, case_recording, model_b, search_grid_signals
from trackprofile.simulation.simulate import RunSettings, simulate
from trackprofile.simulation.speed_schedule import constant_speed

SPEED = 150 / 3.6  # m/s
SAMPLING = 500.0  # Hz
REPETITIONS = 3
PAPER_STEP = 2e-3  # s
PAPER_RATE = "the paper, in MATLAB at 2.67 GHz: 45000 with Model A, 150000 with Model B"
PAPER_SEARCH = {"a": 45.0, "b": 100.0}  # s/m
TTB_2D = "TTB-2D in Octave, one core: 6500 µs with 542 degrees of freedom, 8200 µs with 1338"


@dataclass(frozen=True)
class Result:
    """One benchmark result; smaller is better.

    Parameters
    ----------
    name, value, unit : the result
    comparison : published values for comparison
    """

    name: str
    value: float
    unit: str
    comparison: str = ""


def measure() -> dict[str, Any]:
    """All results, as `bench --json` prints them, each the best of three runs.

    The smoother runs in a separate process on one thread: the paper's car on elastic track at 150 km/h with two sensors
    at 500 Hz. Memory is the increase of the peak from 1 km to 2 km. Assessing and reporting 50 km is one run, which
    includes loading its modules.
    """
    results = [
        *_in_one_thread("smoother_figures"),
        *_in_one_thread("report_figures"),
        Result("help_s", _best(_help), "s"),
    ]
    return {"results": [vars(result) for result in results], "machine": machine()}


def smoother_figures() -> list[Result]:
    """Results of the smoother, in this process."""
    _smooth(100.0, variance=True)  # compiles, or loads the compiled code
    without = _best(lambda: _smooth(1000.0, variance=False))
    with_variance = _best(lambda: _smooth(1000.0, variance=True))
    one = peak_memory()
    _smooth(2000.0, variance=True)
    return [
        *forward_figures(),
        *search_figures(),
        Result("smoother_ms_per_m", without, "ms/m", PAPER_RATE),  # s per 1000 m
        Result("smoother_with_variance_ms_per_m", with_variance, "ms/m"),
        Result("memory_mb_per_km", peak_memory() - one, "MB/km"),
    ]


def forward_figures() -> list[Result]:
    """Results of the forward models: one step of 2 ms, without generating a random profile."""
    car, quarter = read_vehicle("velaro")[0], read_vehicle("quarter-car")[0]
    track = read_track("zhai-layered")
    near, far = 100.0, 10_000.0
    _simulate(quarter, read_track("rigid"), near)
    _simulate(car, track, near)
    model_a = _best(lambda: _simulate(quarter, read_track("rigid"), far)) / _steps(far)
    short = _best(lambda: _simulate(car, track, near)) / _steps(near)
    long = _best(lambda: _simulate(car, track, far)) / _steps(far)
    return [
        Result("model_a_us_per_step", 1e6 * model_a, "µs"),
        Result("model_b_us_per_step", 1e6 * long, "µs", TTB_2D),
        Result("model_b_10_km_over_100_m", long / short, "ratio of the cost per step"),
    ]


def search_figures() -> list[Result]:
    """Results of cross-entropy: the paper's bell on Model A and FRA class 6 on Model B at 150 km/h, without noise."""
    results = []
    for name, case, settings, paper in (
        ("a", bell(), TABLE_5, PAPER_SEARCH["a"]),
        ("b", replace(model_b("fra-6"), length=60.0), TABLE_6, PAPER_SEARCH["b"]),
    ):
        recording, length = (
            case_recording(case, search_grid_signals(case)),
            float(case.position[-1]),
        )
        for variant in Variant:
            one = CrossEntropySettings(track=case.track, search=replace(settings, variant=variant))
            run = partial(cross_entropy, recording, case.vehicle, one)
            run()
            rate, running = _best(run) / length, 1 / case.speed
            comparison = (
                f"the paper {paper:g} ({paper / rate:.0f} times), "
                f"the train {running:.3f} ({running / rate:.2f} times)"
            )
            figure = f"cross_entropy_{name}_{variant.value}_s_per_m"
            results.append(Result(figure, rate, "s/m", comparison))
    return results


def report_figures() -> list[Result]:
    """Results of assessing and reporting a 50 km profile of the spectrum german-low, in this process."""
    profile = _long_profile()
    with TemporaryDirectory() as folder:
        start = time.perf_counter()
        spectra = {name: read_roughness(name) for name in presets("spectrum")}
        assessment = assess(profile, read_limits("en-13848"), 160 / 3.6, spectra=spectra)
        (page,) = report(assessment, Path(folder) / "report.html")
        seconds, size = time.perf_counter() - start, page.stat().st_size / 1e6
    return [
        Result("report_50_km_s", seconds, "s"),
        Result("report_50_km_peak_mb", peak_memory(), "MB"),
        Result("report_50_km_page_mb", size, "MB"),
    ]


def _long_profile() -> xr.Dataset:
    at = np.arange(0.0, 50_000.0, KNOT_SPACING)
    level = random_irregularity(read_spectrum("german-low"), 1, 2.0, 300.0, length=at[-1]).at(at)[0]
    deviations = {"D1": 1e-4, "D2": 3e-4, "D3": 1e-3}
    return build_profile(
        at,
        level,
        kind="posterior",
        standard_deviation=np.full(at.size, 5e-3),
        band_standard_deviations={
            name: np.full(at.size, deviation) for name, deviation in deviations.items()
        },
    )


def _simulate(vehicle: Vehicle, track: Track, length: float) -> None:
    run = RunSettings(0.0, length, constant_speed(SPEED), run_in=0.0, every=10)
    simulate(vehicle, track, Flat(), run, newmark(PAPER_STEP))


def _steps(length: float) -> float:
    return length / SPEED / PAPER_STEP


def _smooth(length: float, variance: bool) -> None:
    """Run the smoother over ``length`` m: from motion and signals to the profile and its variance."""
    sensors, spectrum = read_sensors("bogie-25ug"), read_spectrum("fra-6")
    system = state_space(read_vehicle("velaro")[0], point_track(read_track("zhai")), sensors)
    time_ = np.arange(round(length / SPEED * SAMPLING)) / SAMPLING
    zero = np.zeros(len(time_))
    motion = Motion(time_, SPEED * time_, zero + SPEED, zero)
    ride = discretise_run(system, motion, np.ones((len(time_), len(sensors)), bool), KNOT_SPACING)
    offsets = np.array([sensor.offset_standard_deviation for sensor in sensors])
    density = np.array([sensor.noise_density for sensor in sensors], dtype=np.float64)
    noise = (density**2 * SAMPLING / 2)[ride.sensors]
    prepared = kalman_gains(ride, spectrum, noise, initial_state(system, spectrum, ride, offsets))
    signals = np.random.default_rng(0).standard_normal((len(ride.rows), 1))
    smooth(prepared, signals)
    if variance:
        posterior_variances(prepared)


def _in_one_thread(figures: str) -> list[Result]:
    """Results of a function of this module in a separate process."""
    results = in_one_thread("trackprofile.bench", f"[vars(one) for one in of.{figures}()]")
    return [Result(**one) for one in results]


def _help() -> None:
    command = [sys.executable, "-m", "trackprofile", "--help"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _best(run: Callable[[], object]) -> float:
    """Duration of the fastest of three runs, s."""
    durations = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        run()
        durations.append(time.perf_counter() - start)
    return min(durations)

"""Effect of bias, drift, flicker and spikes of named sensors on the error in D1 and D2, on the bell and on FRA 4 to 6.

The simulations use the two vehicle models of the 2017 article on the track model of the smoother, so that the sensors
are the only cause of errors. Magnitudes are those of the data sheets; values marked K are from memory, without a sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from trackprofile.bands import D1, D2, Band, band_pass
from trackprofile.contracts import Channel, build_recording
from trackprofile.inference.infer import estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_spectrum
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.sensor_errors import Instrument, measure
from trackprofile.scenario import PRESETS, Scenario, read_scenario
from trackprofile.simulation.simulate import sensor_signal, simulate
from trackprofile.units import unit_factor

Array = np.ndarray
BANDS = (D1, D2)
LENGTH = 300.0  # m
WARMING, WARMED = 300.0, 10.0  # s, K: a sensor that is switched on at the start of the run
SPAN = 40.0  # K, range of ambient temperature
IN_RUN = 1 / np.sqrt(2 * np.log(2))  # flicker at 1 Hz over the floor of the Allan deviation
CORNER = np.sqrt(0.1)  # flicker over white noise of a sensor whose corner is at 0.1 Hz


@dataclass(frozen=True)
class Part:
    """Data sheet in ``unit``: noise per √Hz, flicker at 1 Hz, largest bias, drift per K, range, step; bandwidth in
    Hz."""

    unit: str
    noise: float
    flicker: float
    bias: float
    per_kelvin: float
    range: float
    step: float = 0.0
    bandwidth: float | None = None

    @property
    def quantity(self) -> str:
        return VERTICAL_ACCELERATION if self.unit == "mg" else PITCH_RATE

    @property
    def si(self) -> float:
        return unit_factor(self.unit, "acceleration" if self.unit == "mg" else "angular rate")


def accelerometer(noise: float, flicker: float, bias: float, *others: float) -> Part:
    return Part("mg", noise, flicker, bias, bias / SPAN, *others)


def gyroscope(noise: float, in_run: float, bias: float, range_: float, *others: float) -> Part:
    """Gyroscope with an in-run bias instability in °/h."""
    return Part("°/s", noise, IN_RUN * in_run / 3600, bias, bias / SPAN, range_, *others)


DEFAULT_OFFSET = 0.6  # °/s, zero-rate offset of parts without a sheet (K)
PARTS = {
    # 0.15 and 0.75 mg/K over 40 K; flicker as of ADXL1002, whose corner is at 0.1 Hz (K)
    "ADXL355": accelerometer(0.0225, 0.0225 * CORNER, 6.0, 8e3),
    "ADXL357": accelerometer(0.075, 0.075 * CORNER, 30.0, 10e3, 1e3 / 51_200),
    # 15 µg in run; 0.24 to 12 mg in the long run for 2 to 100 g
    "MS1010": accelerometer(0.034, 0.015 * IN_RUN, 1.2, 10e3),
    # 50 µg in run, 2 mg over temperature; 0.5 °/h in run, 250 °/h over temperature
    "STIM300 acceleration": accelerometer(0.102, 0.050 * IN_RUN, 2.0, 10e3, 0.0, 262.0),
    "STIM300": gyroscope(0.0025, 0.5, 250 / 3600, 400.0, 0.0, 262.0),
    # flicker as above; 40 mg of offset (K)
    "ASM330LHH acceleration": accelerometer(0.060, 0.060 * CORNER, 40.0, 16e3),
    "ASM330LHH": gyroscope(0.005, 3.0, 1.0, 125.0),
    # 100 mg of offset (K)
    "ADXL345": accelerometer(0.43, 0.43 * CORNER, 100.0, 16e3, 3.9),
    "LSM6DSV": gyroscope(0.0028, 3.0, 1.0, 125.0),
    "ADXRS646": gyroscope(0.010, 12.0, DEFAULT_OFFSET, 250.0),
    "MTi-1 acceleration": accelerometer(0.12, 0.030 * IN_RUN, 5.0, 16e3, 0.0, 262.0),
    "MTi-1": gyroscope(0.007, 10.0, DEFAULT_OFFSET, 2000.0, 0.0, 255.0),
}
SENSOR_PAIRS = (
    ("ADXL355", "LSM6DSV"),
    ("ADXL357", "ADXRS646"),
    ("MS1010", "STIM300"),
    ("STIM300 acceleration", "STIM300"),
    ("ASM330LHH acceleration", "ASM330LHH"),
    ("ADXL345", "LSM6DSV"),
    ("MTi-1 acceleration", "MTi-1"),
)


@dataclass(frozen=True)
class SensorErrorSet:
    """Sensor errors besides white noise; ``unstated``: the recording does not state their flicker."""

    bias: bool = False
    drift: bool = False
    flicker: bool = False
    spikes: bool = False
    unstated: bool = False


ERROR_SETS = {
    "clean": SensorErrorSet(),
    "bias": SensorErrorSet(bias=True),
    "drift": SensorErrorSet(drift=True),
    "flicker": SensorErrorSet(flicker=True),
    "unstated": SensorErrorSet(flicker=True, unstated=True),
    "spikes": SensorErrorSet(spikes=True),
    "all": SensorErrorSet(True, True, True, True),
}


@dataclass(frozen=True)
class SimulatedCase:
    """Simulated run of one case of the article; ``exact``: signals without sensor errors, by quantity."""

    scenario: Scenario
    prior: str
    time: Array
    position: Array
    speed: Array
    exact: dict[str, Array]

    @property
    def body(self) -> str:
        return "bogie" if self.scenario.vehicle.name == "quarter-car" else "leading bogie"


def simulate_case(name: str, folder: Path) -> SimulatedCase:
    """Simulated run over a preset of 300 m on a point track; ", slow": at 36 km/h."""
    name, _, slow = name.partition(", ")
    text = (PRESETS / f"{name}.toml").read_text(encoding="utf-8")
    (end,) = (line for line in text.splitlines() if line.startswith("end ="))
    text = text.replace(end, f'end = "{LENGTH} m"').replace("zhai-layered", "zhai")
    text = text.replace('centre = "5 m"', 'centre = "150 m"').replace(
        'centre = "20 m"', 'centre = "150 m"'
    )
    if slow:
        text = text.replace('speed = "150 km/h"', 'speed = "36 km/h"')
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    scenario = read_scenario(folder / f"{name}.toml")
    done = simulate(
        scenario.vehicle, scenario.track, scenario.irregularity, scenario.run, scenario.scheme
    )
    exact = {
        one.sensor.quantity: sensor_signal(done, scenario.vehicle, one.sensor)
        for one in scenario.instruments
    }
    prior = name[:5] if name.startswith("fra") else "fra-6"
    every = scenario.steps_per_sample
    return SimulatedCase(
        scenario, prior, done.time[::every], done.position[::every], done.speed[::every], exact
    )


def record(
    case: SimulatedCase, parts: Sequence[Part], errors: SensorErrorSet, seed: int
) -> xr.Dataset:
    generator, channels = np.random.default_rng(seed), []
    step, interval = case.scenario.scheme.step, case.scenario.sampling_interval
    for part in parts:
        noise, spikes = generator.spawn(2)
        if part.quantity not in case.exact:
            continue
        exact, scale = case.exact[part.quantity], part.si
        warm = WARMED * -np.expm1(-step * np.arange(len(exact)) / WARMING)
        offset = part.bias * errors.bias + part.per_kelvin * warm * errors.drift
        sensor = Sensor(
            part.unit, part.quantity, case.body, noise_density=scale * part.noise,
            bandwidth=part.bandwidth, flicker=scale * part.flicker,
        )  # fmt: skip
        real = replace(sensor, flicker=sensor.flicker if errors.flicker else None)
        instrument = Instrument(real, resolution=scale * part.step, range=scale * part.range)
        values, valid = measure(instrument, exact + scale * offset, step, interval, noise)
        if errors.spikes:
            values = spiked(values, instrument, interval, spikes)
        channels.append(
            Channel(
                part.unit.replace("/", " per "), values, part.quantity, case.body, 0.0, sensor.noise_density,
                valid, sensor.bandwidth, None if errors.unstated else sensor.flicker,
            )
        )  # fmt: skip
    return build_recording(channels, time=case.time, distance=case.position, speed=case.speed)


def spiked(
    values: Array, instrument: Instrument, interval: float, generator: np.random.Generator
) -> Array:
    """Signal with a saturated sample per second and a burst of eight samples every two seconds."""
    values, second, limit = values.copy(), round(1 / interval), instrument.range or np.inf
    for start in range(0, len(values) - second, second):
        values[start + generator.integers(second)] = limit * generator.choice([-1, 1])
    burst_std = 20 * np.std(values)
    for start in range(0, len(values) - 2 * second, 2 * second):
        first = start + generator.integers(2 * second - 8)
        values[first : first + 8] += burst_std * generator.standard_normal(8)
    values, step = np.clip(values, -limit, limit), instrument.resolution
    return step * np.round(values / step) if step else values


@dataclass(frozen=True)
class BandErrors:
    """By band: RMS error, m, and share of points within 1.96 stated standard deviations."""

    error: dict[str, float]
    inside: dict[str, float]
    kinds: frozenset[str]


def evaluate(case: SimulatedCase, recording: xr.Dataset) -> BandErrors:
    scenario = case.scenario
    result = estimate(
        recording,
        scenario.vehicle,
        InferenceSettings(track=scenario.track, prior=read_spectrum(case.prior), samples=48),
    )
    at = result.profile["distance"].to_numpy()
    error = result.profile["elevation"].to_numpy() - scenario.irregularity.at(at)[0]
    errors, inside = {}, {}
    for band in BANDS:
        used = inner_points(at, band)
        in_band = band_pass(error, 0.25, band)[used]
        stated = result.profile[f"standard_deviation_{band.name}"].to_numpy()[used]
        errors[band.name] = float(np.sqrt(np.mean(in_band**2)))
        inside[band.name] = float(np.mean(np.abs(in_band) < 1.96 * stated))
    return BandErrors(errors, inside, frozenset(str(one.kind) for one in result.faults))


def inner_points(at: Array, band: Band) -> Array:
    """Points at least the band's longest wavelength from both ends."""
    return (at > band.longest) & (at < LENGTH - band.longest)


CASES = tuple(
    f"{case}-model-{model}" for case in ("bell", "fra-4", "fra-5", "fra-6") for model in "ab"
)
SLOW = "fra-5-model-b, slow"


@pytest.mark.acceptance
def test_errors_of_named_sensors_hardly_increase_the_error_of_the_profile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outcomes = {}
    for case in (*CASES, SLOW):
        simulated = simulate_case(case, tmp_path)
        for number, pair in enumerate(SENSOR_PAIRS):
            parts = [PARTS[one] for one in pair]
            outcomes[case, pair] = {
                name: evaluate(simulated, record(simulated, parts, errors, number))
                for name, errors in ERROR_SETS.items()
            }
    lines = ["", "RMS error in mm (and share inside the stated 95 %) by sensors and case"]
    for (case, pair), by_error_set in outcomes.items():
        for band in BANDS:
            cells = [
                f"{name} {1e3 * one.error[band.name]:.4f} ({one.inside[band.name]:.2f})"
                for name, one in by_error_set.items()
            ]
            lines.append(f"{pair[0][:8]:9}{case:20}{band.name}  " + "  ".join(cells))
    lines.append("all cases: growth over clean, share inside")
    summary = {
        (pair, band.name, name): (
            growth([outcomes[case, pair] for case in (*CASES, SLOW)], name, band),
            float(np.mean([outcomes[case, pair][name].inside[band.name] for case in (*CASES, SLOW)])),
        )
        for pair in SENSOR_PAIRS
        for band in BANDS
        for name in ERROR_SETS
    }  # fmt: skip
    for pair in SENSOR_PAIRS:
        for band in BANDS:
            cells = [
                f"{name} {summary[pair, band.name, name][0]:.3f} ({summary[pair, band.name, name][1]:.2f})"
                for name in ERROR_SETS
            ]
            lines.append(f"{pair[0][:8]:9}{band.name}  " + "  ".join(cells))
    with capsys.disabled():
        print("\n".join(lines))  # noqa: T201
    for (pair, band, name), (grown, inside) in summary.items():
        if name in {"bias", "spikes"}:
            assert grown < 1.1, (pair, band, name)
        if name != "unstated":
            assert inside > 0.85, (pair, band, name)


def growth(outcomes: Sequence[dict[str, BandErrors]], name: str, band: Band) -> float:
    """RMS over all cases of the error relative to that without sensor errors."""
    ratios = [one[name].error[band.name] / one["clean"].error[band.name] for one in outcomes]
    return float(np.sqrt(np.mean(np.square(ratios))))

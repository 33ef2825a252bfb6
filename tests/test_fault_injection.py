"""Injected faults: reported, flagged, and their effect on the profile inside and outside the faulty stretch.

On a simulated recording, and on the real one if it is available.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline

import fault_injection
from fault_injection import FAULTS, InjectedFault, LoggerTable, SensorColumn
from trackprofile.bands import D1, D2, band_pass
from trackprofile.calibration.calibrate import calibrate
from trackprofile.contracts import Quality, build_profile, channels
from trackprofile.demo import simulated
from trackprofile.errors import DataError
from trackprofile.inference.infer import Estimate, estimate
from trackprofile.inference.settings import InferenceSettings
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.io.table import read_columns
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import PointTrack, RigidTrack
from trackprofile.models.vehicle import Vehicle
from trackprofile.preprocessing.motion import motion
from trackprofile.reader import read

Array = np.ndarray
BANDS = (D1, D2)
REACH = {"D1": 45.0, "D2": 160.0}
"""m around a faulty stretch that are affected: length of the vehicle and of the band's filter."""


@dataclass(frozen=True)
class Case:
    """A recording without faults as a table, the inputs of the inference, and the true profile.

    ``excluded_ends`` is the length at each end that is not compared, m.
    """

    table: LoggerTable
    vehicle: Vehicle
    installation: Installation
    track: PointTrack
    prior: Spectrum | None
    truth: xr.Dataset
    excluded_ends: float

    def estimate(self, recording: xr.Dataset) -> Estimate:
        return estimate(
            recording,
            self.vehicle,
            InferenceSettings(
                installation=self.installation, track=self.track, prior=self.prior, samples=32
            ),
        )


def logger_table(recording: xr.Dataset) -> LoggerTable:
    moved = motion(recording)
    sensors, columns = [], {}
    for one in channels(recording):
        unit = "m/s²" if one.quantity == "vertical acceleration" else "rad/s"
        name = one.name.replace("bogie_", "b_")[:20]
        sensors.append(
            SensorColumn(
                name, one.quantity, unit, one.body, one.position, one.noise_density, one.bandwidth
            )
        )
        columns[name] = one.values
    return LoggerTable(
        {"time_s": moved.time, "distance_m": moved.distance, "speed_km_h": 3.6 * moved.speed}
        | columns,
        tuple(sensors),
    )


@pytest.fixture(scope="module")
def simulation() -> Case:
    vehicle, track = read_vehicle("velaro")[0], point_track(read_track("zhai"))
    prior = read_spectrum("german-low")
    recording, truth = simulated(vehicle, track, read_sensors("bogie-25ug"), prior, 900.0, 1)
    return Case(logger_table(recording), vehicle, Installation(), track, prior, truth, 60.0)


@pytest.fixture(scope="module")
def reality(shared: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Case:
    example = Path(__file__).parent.parent / "examples" / "hokuriku"
    folder = tmp_path_factory.mktemp("hokuriku")
    data = shared("data/hokuriku/section_a.csv")
    (folder / "section_a.csv").symlink_to(data.resolve())
    (folder / "recording.toml").write_text((example / "recording.toml").read_text())
    columns = read_columns(data, ["distance_m", "level_rail1_mm", "level_rail2_mm"])
    level = 0.5e-3 * (columns["level_rail1_mm"] + columns["level_rail2_mm"])
    truth = build_profile(columns["distance_m"], level, kind="truth", loading="loaded")
    recording = read(folder / "recording.toml")

    def part(dataset: xr.Dataset, low: float, high: float) -> xr.Dataset:
        at = dataset["distance"].to_numpy()
        return dataset.isel({dataset["distance"].dims[0]: (at >= low) & (at <= high)})

    car, _ = read_vehicle(str(example / "vehicle.toml"))
    fit = calibrate(part(recording, 75.0, 1075.0), car, part(truth, 75.0, 1075.0))
    validation = logger_table(part(recording, 1080.0, 2170.0))
    return Case(validation, fit.vehicle, fit.installation, RigidTrack(), None, truth, 100.0)


@dataclass(frozen=True)
class Row:
    """Result for one fault: report, flagged share, and by band error growth outside, error and coverage inside."""

    name: str
    reported: str
    flagged: float
    growth: dict[str, float]
    inside: dict[str, float]
    coverage: dict[str, float]


def errors(case: Case, result: Estimate, at: Array) -> dict[str, Array]:
    """Errors of the profile by band, m, where its points have the true positions ``at``, m."""
    positions = case.truth["distance"].to_numpy()
    truth, ends = CubicSpline(positions, case.truth["elevation"]), positions[[0, -1]]
    error = result.profile["elevation"].to_numpy() - truth(np.clip(at, *ends))
    return {band.name: band_pass(error, 0.25, band) for band in BANDS}


def faulty_stretch(case: Case, one: InjectedFault) -> tuple[float, float] | None:
    if one.stretch is None:
        return None
    distance = (
        case.table.columns["distance_m"] * case.installation.distance_scale
        + case.installation.origin
    )
    last = len(distance) - 1
    return tuple(float(distance[round(share * last)]) for share in one.stretch)  # type: ignore[return-value]


def evaluate(case: Case, clean: Estimate, one: InjectedFault, folder: Path) -> Row:
    changed = one.change(case.table)
    path = fault_injection.write(changed, folder, one.writer)
    if one.writer is not None and one.name in {"MDF", "TDMS"}:
        path.write_text(
            path.read_text(encoding="utf-8").replace('"time_s"', '"time"'), encoding="utf-8"
        )
    if one.refused:
        with pytest.raises(DataError) as caught:
            case.estimate(read(path))
        assert one.refused in str(caught.value)
        return Row(one.name, "refused", 1.0, {}, {}, {})
    result = case.estimate(read(path))
    kinds = {fault.kind for fault in result.faults}
    if one.kinds:
        assert kinds & one.kinds, (one.name, kinds, result.notes)
    if one.note:
        assert any(one.note in note for note in result.notes), (one.name, result.notes)
    reported = ", ".join(sorted(kinds & one.kinds)) or ("note" if one.note else "as undamaged")
    return compare(case, clean, result, one, reported)


def compare(
    case: Case, clean: Estimate, result: Estimate, one: InjectedFault, reported: str
) -> Row:
    faulty = faulty_stretch(case, one)
    at = result.profile["distance"].to_numpy()
    positions = clean.profile["distance"].to_numpy()
    if one.estimated_distance:
        at = true_positions(case, result, at)
    before, after = errors(case, clean, positions), errors(case, result, at)
    growth, inside, coverage = {}, {}, {}
    for band in (b.name for b in BANDS):
        compared = (at > at[0] + case.excluded_ends) & (at < at[-1] - case.excluded_ends)
        affected = np.zeros(len(at), bool)
        if faulty is not None:
            affected = (at > faulty[0] - REACH[band]) & (at < faulty[1] + REACH[band])
        as_clean = np.interp(at, positions, np.square(before[band]))
        outside, part = (
            compared & ~affected,
            compared & (affected if faulty else np.ones_like(affected)),
        )
        growth[band] = (
            rms(after[band][outside]) / np.sqrt(np.mean(as_clean[outside]))
            if outside.any()
            else np.nan
        )
        inside[band] = 1e3 * rms(after[band][part])
        stated = result.profile[f"standard_deviation_{band}"].to_numpy()[part]
        coverage[band] = float(np.mean(np.abs(after[band][part]) < 1.96 * stated))
    core = np.ones(len(at), bool) if faulty is None else (at > faulty[0]) & (at < faulty[1])
    flags = result.profile["quality"].to_numpy() & (
        Quality.FAULTY | Quality.GAP | Quality.SATURATED
    )
    return Row(
        one.name,
        reported,
        float(np.mean(flags[core] != 0)) if core.any() else 0.0,
        growth,
        inside,
        coverage,
    )


def true_positions(case: Case, result: Estimate, at: Array) -> Array:
    """True positions of the points at estimated positions, m; checks the stated standard deviation of the distance."""
    true = (
        case.installation.distance_scale * case.table.columns["distance_m"]
        + case.installation.origin
    )
    error = result.sample_distance - true
    deviation = np.interp(
        result.sample_distance, at, result.profile["distance_deviation"].to_numpy()
    )
    error = error - error[0]  # without a chainage table the origin is arbitrary
    assert np.mean(np.abs(error) < 1.96 * deviation) > 0.85
    return np.interp(at, result.sample_distance, true)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def markdown_table(title: str, rows: list[Row]) -> str:
    lines = [
        f"\n{title}\n",
        "| damage | reported | flagged | D1 outside | D2 outside | D1 inside, mm | D2 inside, mm "
        "| D1 in 95 % | D2 in 95 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        numbers = [f"{row.growth[b]:.2f}" for b in row.growth] or ["-", "-"]
        numbers += [f"{row.inside[b]:.3f}" for b in row.inside] or ["-", "-"]
        numbers += [f"{100 * row.coverage[b]:.0f} %" for b in row.coverage] or ["-", "-"]
        lines.append(
            f"| {row.name} | {row.reported} | {100 * row.flagged:.0f} % | "
            + " | ".join(numbers)
            + " |"
        )
    return "\n".join(lines) + "\n"


def evaluate_all(case: Case, title: str, folder: Path, without: set[str]) -> list[Row]:
    clean = case.estimate(read(fault_injection.write(case.table, folder, None)))
    none = InjectedFault("none")
    rows = [compare(case, clean, clean, none, "")]
    for number, one in enumerate(FAULTS):
        if one.name in without:
            continue
        subfolder = folder / str(number)
        subfolder.mkdir()
        rows.append(evaluate(case, clean, one, subfolder))
        sys.stdout.write(f"{rows[-1]}\n")
    sys.stdout.write(markdown_table(title, rows))
    return rows


def check(rows: list[Row]) -> None:
    for row in rows:
        one = next((d for d in FAULTS if d.name == row.name), InjectedFault("none"))
        if one.refused:
            continue
        if one.stretch is not None:
            assert row.flagged > 0.1, (row.name, "flagged")
        for band in ("D1", "D2"):
            if not one.everywhere:
                assert row.growth[band] < 1.1, (row.name, band, "outside")
            assert row.coverage[band] > 0.85, (row.name, band, "coverage")


@pytest.mark.acceptance
def test_faults_in_a_simulated_recording(simulation: Case, tmp_path: Path) -> None:
    check(evaluate_all(simulation, "Simulated", tmp_path, set()))


@pytest.mark.acceptance
def test_faults_in_the_real_recording(reality: Case, tmp_path: Path) -> None:
    several = {
        "two rates and clocks",
        "two channels exchanged",
        "one sign reversed",
        "dead channel",
    }
    check(evaluate_all(reality, "Real", tmp_path, several))

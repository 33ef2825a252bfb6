"""A table of damage: found, marked, and what it costs inside and outside the damaged stretch.

On a simulated recording, and on the real one where that stands beside the project.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import damage
import numpy as np
import pytest
import xarray as xr
from damage import DAMAGES, Damage, Sensor, Table
from scipy.interpolate import CubicSpline

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
"""m about a damaged stretch that it harms: the vehicle's length, and that of the band's filter."""


@dataclass(frozen=True)
class Case:
    """An undamaged recording as a table, what it is inferred with, and the truth."""

    table: Table
    vehicle: Vehicle
    installation: Installation
    track: PointTrack
    prior: Spectrum | None
    truth: xr.Dataset
    ends: float
    """m at each end that are not judged."""

    def found(self, recording: xr.Dataset) -> Estimate:
        return estimate(
            recording,
            self.vehicle,
            InferenceSettings(
                installation=self.installation, track=self.track, prior=self.prior, samples=32
            ),
        )


def table_of(recording: xr.Dataset) -> Table:
    moved = motion(recording)
    sensors, columns = [], {}
    for one in channels(recording):
        unit = "m/s²" if one.quantity == "vertical acceleration" else "rad/s"
        name = one.name.replace("bogie_", "b_")[:20]
        sensors.append(
            Sensor(
                name, one.quantity, unit, one.body, one.position, one.noise_density, one.bandwidth
            )
        )
        columns[name] = one.values
    return Table(
        {"time_s": moved.time, "distance_m": moved.distance, "speed_km_h": 3.6 * moved.speed}
        | columns,
        tuple(sensors),
    )


@pytest.fixture(scope="module")
def simulation() -> Case:
    vehicle, track = read_vehicle("velaro")[0], point_track(read_track("zhai"))
    prior = read_spectrum("german-low")
    recording, truth = simulated(vehicle, track, read_sensors("bogie-25ug"), prior, 900.0, 1)
    return Case(table_of(recording), vehicle, Installation(), track, prior, truth, 60.0)


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
    beyond = table_of(part(recording, 1080.0, 2170.0))
    return Case(beyond, fit.vehicle, fit.installation, RigidTrack(), None, truth, 100.0)


@dataclass(frozen=True)
class Row:
    """What the table says of one kind of damage: by band, inside and outside."""

    name: str
    told: str
    marked: float
    growth: dict[str, float]
    inside: dict[str, float]
    coverage: dict[str, float]


def errors(case: Case, found: Estimate, at: Array) -> dict[str, Array]:
    """Of the profile, by band, at the places ``at`` where its points really are."""
    places = case.truth["distance"].to_numpy()
    truth, ends = CubicSpline(places, case.truth["elevation"]), places[[0, -1]]
    error = found.profile["elevation"].to_numpy() - truth(np.clip(at, *ends))
    return {band.name: band_pass(error, 0.25, band) for band in BANDS}


def stretch(case: Case, one: Damage) -> tuple[float, float] | None:
    if one.harmed is None:
        return None
    distance = (
        case.table.columns["distance_m"] * case.installation.distance_scale
        + case.installation.origin
    )
    last = len(distance) - 1
    return tuple(float(distance[round(share * last)]) for share in one.harmed)  # type: ignore[return-value]


def row_of(case: Case, clean: Estimate, one: Damage, folder: Path) -> Row:
    changed = one.change(case.table)
    path = damage.write(changed, folder, one.writer)
    if one.writer is not None and one.name in {"MDF", "TDMS"}:
        path.write_text(
            path.read_text(encoding="utf-8").replace('"time_s"', '"time"'), encoding="utf-8"
        )
    if one.refused:
        with pytest.raises(DataError) as caught:
            case.found(read(path))
        assert one.refused in str(caught.value)
        return Row(one.name, "refused", 1.0, {}, {}, {})
    found = case.found(read(path))
    kinds = {fault.kind for fault in found.faults}
    if one.kinds:
        assert kinds & one.kinds, (one.name, kinds, found.notes)
    if one.said:
        assert any(one.said in note for note in found.notes), (one.name, found.notes)
    told = ", ".join(sorted(kinds & one.kinds)) or ("said" if one.said else "as undamaged")
    return measured_row(case, clean, found, one, told)


def measured_row(case: Case, clean: Estimate, found: Estimate, one: Damage, told: str) -> Row:
    harmed = stretch(case, one)
    at = found.profile["distance"].to_numpy()
    places = clean.profile["distance"].to_numpy()
    if one.placed:
        at = really(case, found, at)
    before, after = errors(case, clean, places), errors(case, found, at)
    growth, inside, coverage = {}, {}, {}
    for band in (b.name for b in BANDS):
        judged = (at > at[0] + case.ends) & (at < at[-1] - case.ends)
        near = np.zeros(len(at), bool)
        if harmed is not None:
            near = (at > harmed[0] - REACH[band]) & (at < harmed[1] + REACH[band])
        as_clean = np.interp(at, places, np.square(before[band]))
        outside, part = judged & ~near, judged & (near if harmed else np.ones_like(near))
        growth[band] = (
            rms(after[band][outside]) / np.sqrt(np.mean(as_clean[outside]))
            if outside.any()
            else np.nan
        )
        inside[band] = 1e3 * rms(after[band][part])
        stated = found.profile[f"standard_deviation_{band}"].to_numpy()[part]
        coverage[band] = float(np.mean(np.abs(after[band][part]) < 1.96 * stated))
    core = np.ones(len(at), bool) if harmed is None else (at > harmed[0]) & (at < harmed[1])
    flags = found.profile["quality"].to_numpy() & (Quality.FAULTY | Quality.GAP | Quality.SATURATED)
    return Row(
        one.name,
        told,
        float(np.mean(flags[core] != 0)) if core.any() else 0.0,
        growth,
        inside,
        coverage,
    )


def really(case: Case, found: Estimate, at: Array) -> Array:
    """Where the train was when it thought that it was ``at``; the distance has to know how well it knows that."""
    true = (
        case.installation.distance_scale * case.table.columns["distance_m"]
        + case.installation.origin
    )
    off = found.sample_distance - true
    deviation = np.interp(found.sample_distance, at, found.profile["distance_deviation"].to_numpy())
    off = off - off[0]  # without a way it begins anywhere
    assert np.mean(np.abs(off) < 1.96 * deviation) > 0.85
    return np.interp(at, found.sample_distance, true)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def printed(title: str, rows: list[Row]) -> str:
    lines = [
        f"\n{title}\n",
        "| damage | found | flagged | D1 outside | D2 outside | D1 inside, mm | D2 inside, mm "
        "| D1 in 95 % | D2 in 95 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        numbers = [f"{row.growth[b]:.2f}" for b in row.growth] or ["-", "-"]
        numbers += [f"{row.inside[b]:.3f}" for b in row.inside] or ["-", "-"]
        numbers += [f"{100 * row.coverage[b]:.0f} %" for b in row.coverage] or ["-", "-"]
        lines.append(
            f"| {row.name} | {row.told} | {100 * row.marked:.0f} % | " + " | ".join(numbers) + " |"
        )
    return "\n".join(lines) + "\n"


def rows_of(case: Case, title: str, folder: Path, without: set[str]) -> list[Row]:
    clean = case.found(read(damage.write(case.table, folder, None)))
    none = Damage("none")
    rows = [measured_row(case, clean, clean, none, "")]
    for number, one in enumerate(DAMAGES):
        if one.name in without:
            continue
        place = folder / str(number)
        place.mkdir()
        rows.append(row_of(case, clean, one, place))
        sys.stdout.write(f"{rows[-1]}\n")
    sys.stdout.write(printed(title, rows))
    return rows


def check(rows: list[Row]) -> None:
    for row in rows:
        one = next((d for d in DAMAGES if d.name == row.name), Damage("none"))
        if one.refused:
            continue
        if one.harmed is not None:
            assert row.marked > 0.1, (row.name, "flagged")
        for band in ("D1", "D2"):
            if not one.everywhere:
                assert row.growth[band] < 1.1, (row.name, band, "outside")
            assert row.coverage[band] > 0.85, (row.name, band, "coverage")


@pytest.mark.acceptance
def test_damage_of_a_simulated_recording(simulation: Case, tmp_path: Path) -> None:
    check(rows_of(simulation, "Simulated", tmp_path, set()))


@pytest.mark.acceptance
def test_damage_of_the_real_recording(reality: Case, tmp_path: Path) -> None:
    several = {
        "two rates and clocks",
        "two channels exchanged",
        "one sign turned",
        "a dead channel",
    }
    check(rows_of(reality, "Real", tmp_path, several))

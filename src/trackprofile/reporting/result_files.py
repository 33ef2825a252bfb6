"""Result files of `infer` and `simulate`: data, HTML and PNG figures of the same name, and a summary for JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import (
    Quality,
    Rail,
    available_rails,
    legacy_fingerprint,
    recording_identity,
    select_rail,
)
from trackprofile.contracts.identity import RECORDING, RECORDING_FINGERPRINT
from trackprofile.errors import FileError, MissingExtraError, TrackprofileError
from trackprofile.io import format_to_write, write
from trackprofile.io.atomic import check_writable, whole_files
from trackprofile.methods.method import MethodResult
from trackprofile.reader import read
from trackprofile.reporting.figures import (
    interactive_figure,
    static_figure,
    write_html,
    write_png,
)
from trackprofile.reporting.figures.chart import Chart, profile_chart
from trackprofile.reporting.figures.simulation_figure import simulation_chart
from trackprofile.scenario import SOURCE, SimulatedRun

FIGURE_SUFFIXES = (".html", ".png")
NO_FIGURES = "No figures were drawn: they need pip install 'trackprofile[plot]'"


def estimate_files(profile: str | Path) -> tuple[Path, Path, Path]:
    """The files that `write_estimate` would write: the profile, its HTML figure, its PNG figure.

    Raises
    ------
    FileError : a file cannot be written, or it would replace a file that is not a profile.

    Examples
    --------
    >>> [path.name for path in estimate_files("run.nc")]
    ['run.nc', 'run.html', 'run.png']
    """
    profile = Path(profile)
    files = (profile, profile.with_suffix(".html"), profile.with_suffix(".png"))
    format_to_write("profile", profile)
    check_writable(*files)
    if profile.exists() and not _is_profile(profile):
        raise FileError(f"{profile}: the file exists and is not a profile; choose another name.")
    return files


def write_estimate(
    estimate: MethodResult, recording: xr.Dataset, profile: str | Path
) -> tuple[Path, ...]:
    """Write a profile and its HTML and PNG figures: all files, or none.

    Without the extra ``plot`` the profile is written alone: see `figure_notes`.

    Parameters
    ----------
    estimate : result of `infer`
    recording : recording from which it was inferred
    profile : path with a suffix of a profile format

    Returns
    -------
    paths of the files that were written

    Raises
    ------
    FileError : see `estimate_files`.
    """
    files = estimate_files(profile)
    profile_with_identity = estimate.profile.assign_attrs(
        {
            RECORDING: recording_identity(recording),
            RECORDING_FINGERPRINT: legacy_fingerprint(recording),
        }
    )
    chart = profile_chart(
        profile_with_identity,
        _with_used_signals(recording, estimate.used_signals),
        estimate.sample_distance,
        estimate.reproduced,
    )
    figures = _figure_writers(chart, *files[1:])
    with whole_files(files[0], *figures) as (profile_part, *figure_parts):
        write(profile_with_identity, profile_part)
        for part, write_figure in zip(figure_parts, figures.values(), strict=True):
            write_figure(part)
    return (files[0], *figures)


def figure_notes(files: Sequence[str | Path]) -> tuple[str, ...]:
    """The sentence to report when no figure is among the files that were written.

    Examples
    --------
    >>> figure_notes(["run.nc", "run.html", "run.png"])
    ()
    """
    has_figures = any(Path(file).suffix in FIGURE_SUFFIXES for file in files)
    return () if has_figures else (NO_FIGURES,)


def _figure_writers(chart: Chart, html: Path, png: Path) -> dict[Path, Callable[[Path], None]]:
    """Writers of the figures by path, without those whose library is not installed."""
    writers: dict[Path, Callable[[Path], None]] = {}
    with suppress(MissingExtraError):
        writers[html] = partial(write_html, interactive_figure(chart))
    with suppress(MissingExtraError):
        writers[png] = partial(write_png, static_figure(chart))
    return writers


def _with_used_signals(
    recording: xr.Dataset, signals: Mapping[str, NDArray[np.float64]]
) -> xr.Dataset:
    """The recording with corrected channels as `infer` used them; other channels keep all of their samples."""
    shown = recording.copy()
    for name, values in signals.items():
        used = np.isfinite(values)
        if not np.array_equal(values[used], recording[name].to_numpy()[used]):
            shown[name] = recording[name].copy(data=values)
            shown[f"{name}_valid"] = recording[f"{name}_valid"] & used
    return shown


def simulation_files(recording: str | Path, truth: str | Path) -> tuple[Path, Path, Path, Path]:
    """The files that `write_simulation` would write: recording, truth, and the HTML and PNG figures of the recording.

    Raises
    ------
    FileError : a file cannot be written, two of them have one name, or one would replace a file that was not simulated.

    Examples
    --------
    >>> [path.name for path in simulation_files("run.nc", "truth.csv")]
    ['run.nc', 'truth.csv', 'run.html', 'run.png']
    """
    recording, truth = Path(recording), Path(truth)
    format_to_write("recording", recording)
    format_to_write("profile", truth)
    files = (recording, truth, recording.with_suffix(".html"), recording.with_suffix(".png"))
    check_writable(*files)
    # A recording in TOML has its samples in a table of the same name.
    table = recording.with_suffix(".csv") if recording.suffix.lower() == ".toml" else recording
    if truth.absolute() in {recording.absolute(), table.absolute()}:
        raise FileError(
            f"{truth}: the recording has the same file name; choose another for the truth."
        )
    for file in {recording, table}:
        if file.exists() and not _is_simulated(recording):
            raise FileError(f"{file}: the file exists and was not simulated; choose another name.")
    if truth.exists() and not _is_profile(truth):
        raise FileError(f"{truth}: the file exists and is not a profile; choose another name.")
    return files


def write_simulation(
    run: SimulatedRun, recording: str | Path, truth: str | Path, title: str
) -> tuple[Path, ...]:
    """Write a simulation's recording, truth and figures: all files, or none.

    Without the extra ``plot`` the figures are omitted: see `figure_notes`.

    Raises
    ------
    FileError : see `simulation_files`.
    """
    files = simulation_files(recording, truth)
    chart = simulation_chart(run.truth, run.recording, run.simulation, title)
    figures = _figure_writers(chart, *files[2:])
    with whole_files(files[1], *figures) as (truth_part, *figure_parts):
        write(run.truth, truth_part)
        for part, write_figure in zip(figure_parts, figures.values(), strict=True):
            write_figure(part)
        # The writer of the recording writes its TOML and its table, or neither.
        write(run.recording, files[0])
    return (*files[:2], *figures)


def simulation_summary(run: SimulatedRun, changes: Mapping[str, float]) -> dict[str, Any]:
    """Main numbers of a simulation, for JSON; ``changes`` by sensor: relative change with half the time step."""
    simulation = run.simulation
    return {
        "from_m": float(simulation.position[0]),
        "to_m": float(simulation.position[-1]),
        "samples": run.recording.sizes["sample"],
        "minimum_contact_force_n": float(simulation.contact_force.min()),
        "maximum_contact_force_n": float(simulation.contact_force.max()),
        "change_at_half_step": dict(changes),
        "notes": list(simulation.notes),
    }


def summary(estimate: MethodResult) -> dict[str, Any]:
    """Extent, uncertainty and quality of a profile, for JSON."""
    profile = estimate.profile
    distance, quality = profile["distance"].to_numpy(), profile["quality"].to_numpy()
    deviations = {
        rail.value: _rms_deviations(select_rail(profile, rail)) for rail in available_rails(profile)
    }
    mean = deviations.pop(Rail.MEAN.value)
    return {
        "from_m": float(distance[0]),
        "to_m": float(distance[-1]),
        "points": distance.size,
        "standard_deviation_mm": mean,
        **({"standard_deviation_per_rail_mm": deviations} if deviations else {}),
        "flagged_share": {
            flag.name.lower(): float(np.mean(quality & flag != 0)) for flag in Quality if flag.name
        },
        **estimate.figures,
        "notes": list(estimate.notes),
    }


def _rms_deviations(profile: xr.Dataset) -> dict[str, float]:
    """Root mean square of the stated standard deviation by band [mm]."""
    prefix = "standard_deviation_"
    return {
        name.removeprefix(prefix): 1e3 * float(np.sqrt(np.nanmean(profile[name] ** 2)))
        for name in map(str, profile.data_vars)
        if name.startswith(prefix)
    }


def _is_profile(path: Path) -> bool:
    try:
        return read(path).attrs["kind_of_data"] == "profile"
    except TrackprofileError:
        return False


def _is_simulated(path: Path) -> bool:
    try:
        return read(path).attrs.get("source") == SOURCE
    except TrackprofileError:
        return False

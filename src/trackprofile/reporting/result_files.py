"""What `infer` and `simulate` leave behind: data, a page and a picture beside them, and a summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

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


class Inferred(Protocol):
    """What any method of infer gives; see `trackprofile.inference.infer.Estimate`."""

    @property
    def profile(self) -> xr.Dataset: ...
    @property
    def used_signals(self) -> Mapping[str, NDArray[np.float64]]: ...
    @property
    def reproduced(self) -> Mapping[str, NDArray[np.float64]]: ...
    @property
    def sample_distance(self) -> NDArray[np.float64]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def figures(self) -> Mapping[str, float]: ...


def estimate_files(profile: str | Path) -> tuple[Path, Path, Path]:
    """The files that `write_estimate` would write: the profile, its page, its picture.

    Raises
    ------
    FileError : they could not be written there, or would replace what is not a profile.

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
        raise FileError(f"{profile}: it is there already and is no profile; choose another name.")
    return files


def write_estimate(
    estimate: Inferred, recording: xr.Dataset, profile: str | Path
) -> tuple[Path, ...]:
    """Write a profile and its HTML and PNG figures: all files, or none.

    Without the extra ``plot`` the profile is written alone: see `figure_notes`.

    Parameters
    ----------
    estimate : what a method of `trackprofile.inference` found
    recording : what it found it from
    profile : ends in a suffix that a profile may have

    Raises
    ------
    FileError : as of `estimate_files`.
    """
    files = estimate_files(profile)
    made = estimate.profile.assign_attrs(
        {
            RECORDING: recording_identity(recording),
            RECORDING_FINGERPRINT: legacy_fingerprint(recording),
        }
    )
    shown = _as_taken(recording, estimate.used_signals)
    drawn = (made, shown, estimate.sample_distance, estimate.reproduced)
    figures = _drawn(profile_chart(*drawn), *files[1:])
    with whole_files(files[0], *figures) as (profile_part, *figure_parts):
        write(made, profile_part)
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
    drawn = any(Path(file).suffix in FIGURE_SUFFIXES for file in files)
    return () if drawn else (NO_FIGURES,)


def _drawn(chart: Chart, html: Path, png: Path) -> dict[Path, Callable[[Path], None]]:
    """The writer of each figure, by path; a figure whose library is not installed is left out."""
    writers: dict[Path, Callable[[Path], None]] = {}
    with suppress(MissingExtraError):
        writers[html] = partial(write_html, interactive_figure(chart))
    with suppress(MissingExtraError):
        writers[png] = partial(write_png, static_figure(chart))
    return writers


def _as_taken(recording: xr.Dataset, taken: Mapping[str, NDArray[np.float64]]) -> xr.Dataset:
    """The recording with channels that were put right as they were taken; others keep what was left out of them."""
    shown = recording.copy()
    for name, values in taken.items():
        used = np.isfinite(values)
        if not np.array_equal(values[used], recording[name].to_numpy()[used]):
            shown[name] = recording[name].copy(data=values)
            shown[f"{name}_valid"] = recording[f"{name}_valid"] & used
    return shown


def simulation_files(recording: str | Path, truth: str | Path) -> tuple[Path, Path, Path, Path]:
    """The files that `write_simulation` would write: recording, truth, and a page and picture beside the recording.

    Raises
    ------
    FileError : they could not be written there, or would replace each other, or what was not simulated.

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
    # A recording as a TOML has a table beside it.
    table = recording.with_suffix(".csv") if recording.suffix.lower() == ".toml" else recording
    if truth.absolute() in {recording.absolute(), table.absolute()}:
        raise FileError(f"{truth}: the recording takes that name; give the truth another.")
    for file in {recording, table}:
        if file.exists() and not _is_simulated(recording):
            raise FileError(
                f"{file}: it is there already and was not simulated; choose another name."
            )
    if truth.exists() and not _is_profile(truth):
        raise FileError(f"{truth}: it is there already and is no profile; choose another name.")
    return files


def write_simulation(
    made: SimulatedRun, recording: str | Path, truth: str | Path, title: str
) -> tuple[Path, ...]:
    """Write a simulation's recording, truth and figures: all files, or none.

    Without the extra ``plot`` the figures are left out: see `figure_notes`.

    Raises
    ------
    FileError : as of `simulation_files`.
    """
    files = simulation_files(recording, truth)
    chart = simulation_chart(made.truth, made.recording, made.simulation, title)
    figures = _drawn(chart, *files[2:])
    with whole_files(files[1], *figures) as (truth_part, *figure_parts):
        write(made.truth, truth_part)
        for part, write_figure in zip(figure_parts, figures.values(), strict=True):
            write_figure(part)
        # Whole or not at all too, with the table that its TOML names.
        write(made.recording, files[0])
    return (*files[:2], *figures)


def simulation_summary(made: SimulatedRun, changes: Mapping[str, float]) -> dict[str, Any]:
    """A simulation in a few numbers, for JSON; ``changes`` are those at half the step, by sensor."""
    simulation = made.simulation
    return {
        "from_m": float(simulation.position[0]),
        "to_m": float(simulation.position[-1]),
        "samples": made.recording.sizes["sample"],
        "least_contact_force_n": float(simulation.contact_force.min()),
        "greatest_contact_force_n": float(simulation.contact_force.max()),
        "change_at_half_the_step": dict(changes),
        "notes": list(simulation.notes),
    }


def summary(estimate: Inferred) -> dict[str, Any]:
    """The extent, the uncertainty and the quality of a profile in a few numbers, for JSON."""
    profile = estimate.profile
    distance, quality = profile["distance"].to_numpy(), profile["quality"].to_numpy()
    apart = {
        rail.value: _deviations(select_rail(profile, rail)) for rail in available_rails(profile)
    }
    mean = apart.pop(Rail.MEAN.value)
    return {
        "from_m": float(distance[0]),
        "to_m": float(distance[-1]),
        "points": distance.size,
        "standard_deviation_mm": mean,
        **({"standard_deviation_per_rail_mm": apart} if apart else {}),
        "flagged_share": {
            flag.name.lower(): float(np.mean(quality & flag != 0)) for flag in Quality if flag.name
        },
        **estimate.figures,
        "notes": list(estimate.notes),
    }


def _deviations(profile: xr.Dataset) -> dict[str, float]:
    """By band, the root mean square of what is stated, mm."""
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

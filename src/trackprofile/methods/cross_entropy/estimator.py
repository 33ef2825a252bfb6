"""The method of O'Brien et al. 2017: cross-entropy search of the profile, one window at a time (theory, section 6).

A window of m elevations is optimised at a time. Its first half is kept, the state of the model is advanced over the
kept elevations, and the second half gives the initial means of the next window.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Quality, append_provenance, build_profile
from trackprofile.errors import DataError
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import observations
from trackprofile.inference.orientation import expect_as_described
from trackprofile.inference.outliers import describe_observations
from trackprofile.inference.problem import loading
from trackprofile.inference.rail_decomposition import mean_observations
from trackprofile.methods.cross_entropy import cross_entropy_kernels as kernels
from trackprofile.methods.cross_entropy.forward_model import ForwardModel, forward_model
from trackprofile.methods.cross_entropy.optimisation import Misfits, SearchRun, solve_phase
from trackprofile.methods.cross_entropy.scans import Scans, select_scans
from trackprofile.methods.cross_entropy.search_settings import (
    TABLE_5,
    TABLE_6,
    CrossEntropySettings,
    Evaluation,
    SearchSettings,
)
from trackprofile.methods.registry import INTERRUPTED
from trackprofile.models.integrate import wilson
from trackprofile.models.kinematics import along_track
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

MINIMUM_REACTION = 0.01
"""Minimum reaction of a sensor to an elevation within the window, as a share of its strongest reaction."""


@dataclass(frozen=True)
class Phase:
    """One window of the search.

    Parameters
    ----------
    start : position of its first elevation, m
    first : its first scan
    kept : number of elevations kept
    runs : optimisation runs until two agreed
    agreed : whether two consecutive runs agreed
    """

    start: float
    first: int
    kept: int
    runs: tuple[SearchRun, ...]
    agreed: bool

    @property
    def solved(self) -> bool:
        """Whether two runs agreed and all runs converged."""
        return self.agreed and all(run.converged for run in self.runs)


@dataclass(frozen=True)
class CrossEntropyResult:
    """Result of the cross-entropy method.

    Parameters
    ----------
    profile : the profile contract, a point estimate at each scan's position
    used_signals : by channel, (samples,), the signal used: upright and without gravity; NaN where it was not used
    reproduced : by channel, (samples,), the model's signal for the profile; NaN where no scan was used
    sample_distance : (samples,), position of the leading wheel, m
    phases : history of the search
    notes : assumptions and problems, one sentence each
    stopped : reason why the search ended before the end of the recording; empty where it did not
    """

    profile: xr.Dataset
    used_signals: dict[str, Array]
    reproduced: dict[str, Array]
    sample_distance: Array
    phases: tuple[Phase, ...]
    notes: tuple[str, ...]
    stopped: str

    @property
    def figures(self) -> dict[str, float]:
        """Statistics of the search, by name."""
        return {
            "phases": len(self.phases),
            "phases_not_converged": sum(not one.solved for one in self.phases),
            "runs_per_phase": float(np.mean([len(one.runs) for one in self.phases])),
            "generations_per_run": float(
                np.mean([len(run.objective) for one in self.phases for run in one.runs])
            ),
        }


def cross_entropy(
    recording: xr.Dataset,
    vehicle: Vehicle,
    settings: CrossEntropySettings | None = None,
    *,
    progress: Progress | None = None,
) -> CrossEntropyResult:
    """Infer the profile whose simulated signals match the recording, by cross-entropy optimisation.

    The method of O'Brien et al. 2017, doi 10.1177/0954409716664936. It gives no uncertainty, and assumes static
    equilibrium on level track at the start of the recording; offsets and noise of the sensors cause drift of the
    profile. The smoother is recommended for practical use.

    Parameters
    ----------
    recording : the recording contract, every sample valid
    vehicle : the vehicle that carries the sensors
    settings : installation, track, search, evaluation and seed; None uses the defaults
    progress : called with the stage and the share done after each phase

    Returns
    -------
    the result; after an interrupt (Ctrl-C) or where the model diverges, the result up to that point

    Raises
    ------
    DataError
        Where scans are missing, uneven or fewer than a window has, or do not react to the profile.
    ModelError
        Where the vehicle lacks the body of a sensor, or the time step is too long for it.
    """
    settings = settings or CrossEntropySettings()
    installation, track = settings.installation, settings.track
    expect_as_described(recording, "the cross-entropy method")
    data = mean_observations(observations(recording, installation), vehicle, installation)
    search = settings.search or (TABLE_5 if len(data.sensors) == 1 else TABLE_6)
    scans, scan_notes = select_scans(data, installation, search)
    notes = (*describe_observations(data), *scan_notes)
    model = forward_model(
        vehicle, track, data.sensors, wilson(scans.step), scans.position, scans.speed
    )
    _check_reaction(model, search)
    marching = _Marching(
        search, settings.evaluation, np.random.default_rng(settings.seed),
        progress or (lambda stage, share: None),
    )  # fmt: skip
    march = _march(model, scans, marching)
    provenance = "; ".join([f"infer: {search}, seed {settings.seed}", *notes])
    profile = build_profile(
        model.position[model.before : model.before + march.decided],
        march.elevation[model.before : model.before + march.decided],
        kind="point",
        method=f"cross-entropy, {search.variant.value}, by {search.objective.value}",
        quality=_quality(march),
        loading=loading(track),
        vehicle=vehicle.name,
    )
    result = CrossEntropyResult(
        append_provenance(profile, provenance),
        {
            one.name: signal
            for one, signal in zip(data.sensors, data.used.T, strict=True)
            if one.name in recording
        },
        _reproduced_signals(recording, model, scans, march),
        along_track(data.motion, installation.origin, installation.distance_scale).distance,
        tuple(march.phases),
        notes,
        march.stopped,
    )
    return replace(result, notes=(*notes, *_describe_search(result, search)))


@dataclass(frozen=True)
class _Marching:
    """What stays the same from window to window."""

    search: SearchSettings
    evaluation: Evaluation
    generator: np.random.Generator
    progress: Progress


@dataclass
class _March:
    """Elevations (before + scans,), the number of decided scans, the phases so far, and why the march stopped."""

    elevation: Array
    decided: int
    phases: list[Phase]
    stopped: str = ""


def _march(model: ForwardModel, scans: Scans, marching: _Marching) -> _March:
    """Solve window after window; an interrupt or divergence ends the march after the last complete window."""
    march = _March(np.zeros(len(model.position)), 0, [])
    search, count = marching.search, len(scans.signals)
    mean = np.full(search.unknowns, search.mean)
    weight = sensor_weights(scans.signals)
    gain = None
    try:
        while march.decided < count:
            first = march.decided
            size = min(search.unknowns, count - first)
            if gain is None or size < search.unknowns or not model.time_invariant:
                gain = model.gain_matrix(march.elevation, first, size)
            free = model.free_response(march.elevation, first, size)
            target = np.ascontiguousarray((scans.signals[first : first + size] - free).T)
            misfits = _misfits(model, march, gain, target, weight, marching.evaluation)
            level = float(march.elevation[model.before + first - 1])
            mean, runs, agreed = solve_phase(
                misfits, mean[:size], level, search, marching.generator, walk=first == 0
            )
            kept = size if first + size == count else max(search.unknowns // 2, 1)
            march.elevation[model.before + first : model.before + first + kept] = mean[:kept]
            model = model.advance(march.elevation, first, kept)
            start = float(model.position[model.before + first])
            march.phases.append(Phase(start, first, kept, tuple(runs), agreed))
            march.decided += kept
            mean = np.append(mean[kept:], np.full(search.unknowns - size + kept, mean[-1]))
            marching.progress("searching", march.decided / count)
    except (KeyboardInterrupt, DataError) as stop:
        if march.decided < 2:
            raise
        march.stopped = str(stop) or INTERRUPTED
    return march


def _misfits(
    model: ForwardModel, march: _March, gain: Array, target: Array, weight: Array, evaluation: Evaluation
) -> Misfits:  # fmt: skip
    """The misfit function of the next window; ``target`` (sensors, scans) is the signal without the free response."""
    if evaluation is Evaluation.AFFINE:
        return lambda x: kernels.misfits(gain, x, target, weight)
    first, size = march.decided, gain.shape[1]
    elevation = march.elevation.copy()
    window = slice(model.before + first, model.before + first + size)
    signals = target.T + model.free_response(elevation, first, size)

    def simulate_all(x: Array) -> Array:
        out = np.empty_like(x)
        for i, trial in enumerate(x):
            elevation[window] = trial
            out[i] = np.square(model.signals(elevation, first, size) - signals) @ weight
        return out

    return simulate_all


def sensor_weights(signals: Array) -> Array:
    """Weight W of each sensor, inversely proportional to its root mean square, with the sum 1 (equations 12, 13).

    Parameters
    ----------
    signals : (scans, sensors), m/s² or rad/s

    Returns
    -------
    (sensors,)

    Raises
    ------
    DataError
        Where a sensor's signal is 0 throughout.

    Examples
    --------
    >>> sensor_weights(np.array([[3.0, 1.0], [-3.0, 1.0]]))
    array([0.25, 0.75])
    """
    level = np.sqrt(np.mean(np.square(signals), axis=0))
    if not np.all(level > 0):
        raise DataError(
            "A channel is zero throughout, so the weights of the objective cannot be computed; remove the channel."
        )
    return (1 / level) / np.sum(1 / level)


def _check_reaction(model: ForwardModel, search: SearchSettings) -> None:
    """Check that a channel reacts to an elevation within a window, compared with its reaction under later wheels."""
    elevation = np.zeros(len(model.position))
    until = min(model.before + search.unknowns, len(model.position) - model.before)
    level = model.signals(elevation, 0, until)
    elevation[model.before] = 1.0
    reaction = np.abs(model.signals(elevation, 0, until) - level)
    strongest = reaction.max(axis=0)
    if not np.any(reaction[: search.unknowns].max(axis=0) > MINIMUM_REACTION * strongest):
        raise DataError(
            "No channel reacts to the leading wheel within a window, which the objective requires; "
            "use sensors on the leading bogie or axle box, or the smoother."
        )


def _quality(march: _March) -> NDArray[np.int16]:
    """Quality flags of the decided elevations."""
    quality = np.zeros(march.decided, np.int16)
    for one in march.phases:
        if not one.solved:
            quality[one.first : one.first + one.kept] |= Quality.UNCONVERGED
    return quality


def _reproduced_signals(
    recording: xr.Dataset, model: ForwardModel, scans: Scans, march: _March
) -> dict[str, Array]:
    signals = model.signals(march.elevation, 0, march.decided)
    out = {}
    for i, name in enumerate(scans.channels):
        if name not in recording:  # the mean of a pair of channels is not a channel itself
            continue
        out[name] = np.full(recording.sizes["sample"], np.nan)
        out[name][scans.samples[: march.decided]] = signals[:, i]
    return out


def _describe_search(result: CrossEntropyResult, search: SearchSettings) -> tuple[str, ...]:
    """The history of the search as sentences."""
    figures = result.figures
    sentences = [
        f"{figures['phases']} phases of {search.unknowns} elevations, {figures['runs_per_phase']:.1f} runs per phase, "
        f"{figures['generations_per_run']:.0f} generations per run"
    ]
    if failed := figures["phases_not_converged"]:
        sentences.append(
            f"{failed} phases did not converge within {search.generations} generations and {search.runs} runs; "
            "their elevations are flagged"
        )
    if result.stopped:
        end = float(result.profile["distance"][-1])
        sentences.append(f"the profile ends at {end:.2f} m: {result.stopped}")
    return tuple(sentences)

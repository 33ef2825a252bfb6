"""The paper's own method: trial profiles, the best of which say where to look next (theory, section 6).

A window of m elevations is searched at a time; its first half is kept, the model's state is carried over what is
kept, and the rest is where the next window begins.
"""

from __future__ import annotations

from collections.abc import Callable
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
from trackprofile.methods.cross_entropy.scans import Scans, select_scans
from trackprofile.methods.cross_entropy.search import (
    TABLE_5,
    TABLE_6,
    Evaluation,
    Objective,
    Search,
    Variant,
)
from trackprofile.models.integrate import wilson
from trackprofile.models.kinematics import along_track
from trackprofile.models.sensor import Installation
from trackprofile.models.track import RigidTrack, Track
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

Misfits = Callable[[Array], Array]
"""Of trial profiles (n, m) at each scan of the window, (n, m): O_t of equation 11."""

INTERRUPTED = "interrupted"

MINIMUM_REACTION = 0.01
"""Of a sensor's strongest reaction to an elevation, that within a window below which it says nothing of it."""


@dataclass(frozen=True)
class SearchRun:
    """One optimisation within a phase, generation by generation.

    Parameters
    ----------
    objective : (generations,), O of the best profile
    convergence : (generations,), sum of the squared changes of the means, m²
    converged : whether it fell below the threshold
    """

    objective: Array
    convergence: Array
    converged: bool


@dataclass(frozen=True)
class Phase:
    """A window: where it starts (m), its first scan, how many elevations it kept, and its runs until two agreed."""

    start: float
    first: int
    kept: int
    runs: tuple[SearchRun, ...]
    agreed: bool

    @property
    def solved(self) -> bool:
        """Whether two runs agreed, and all ended below the threshold."""
        return self.agreed and all(run.converged for run in self.runs)


@dataclass(frozen=True)
class CrossEntropyResult:
    """What the cross-entropy method found.

    Parameters
    ----------
    profile : the profile contract, a point estimate at each scan's place
    used_signals : by channel, (samples,), upright and without gravity; NaN where left out
    reproduced : by channel, (samples,), what the model makes of the profile; NaN where no scan was used
    sample_distance : (samples,), m, where the leading wheel stood
    phases : the history
    notes : what was assumed or went wrong, in sentences
    stopped : why before the end of the recording, empty where not
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
        """What says how well it went, by name."""
        return {
            "phases": len(self.phases),
            "phases_given_up": sum(not one.solved for one in self.phases),
            "runs_per_phase": float(np.mean([len(one.runs) for one in self.phases])),
            "generations_per_run": float(
                np.mean([len(run.objective) for one in self.phases for run in one.runs])
            ),
        }


def cross_entropy(
    recording: xr.Dataset,
    vehicle: Vehicle,
    *,
    installation: Installation | None = None,
    track: Track | None = None,
    search: Search | None = None,
    evaluation: Evaluation = Evaluation.MAP,
    seed: int = 0,
    progress: Progress | None = None,
) -> CrossEntropyResult:
    """The profile that reproduces what was recorded, by cross-entropy optimisation, as O'Brien et al. 2017.

    It gives no uncertainty, and takes the train to stand in static equilibrium on level track when the recording
    starts: offsets and noise of the sensors drift into the profile. For use, take the smoother.

    Parameters
    ----------
    recording : the recording contract, every sample valid
    vehicle : the vehicle that carries the sensors
    installation : of the sensors, from a calibration; None takes the recording's word
    track : what the wheels stand on; None is a rigid track
    search : settings; None takes Table 5 for one channel and Table 6 for several
    evaluation : how a population's signals are computed
    seed : of the random profiles
    progress : told the share done after each phase

    Returns
    -------
    what was found; on an interrupt (Ctrl-C), and where the model diverges, what was found until then

    Raises
    ------
    DataError
        Where scans are missing, uneven or fewer than a window has, or do not react to the profile.
    ModelError
        Where the vehicle does not have what a sensor stands on, or a step is too coarse for it.
    """
    installation, track = installation or Installation(), track or RigidTrack()
    progress = progress or (lambda stage, share: None)
    expect_as_described(recording, "the cross-entropy method")
    data = mean_observations(observations(recording, installation), vehicle, installation)
    search = search or (TABLE_5 if len(data.sensors) == 1 else TABLE_6)
    scans, notes = select_scans(data, installation, search)
    notes = (*describe_observations(data), *notes)
    model = forward_model(
        vehicle, track, data.sensors, wilson(scans.step), scans.position, scans.speed
    )
    _check_reaction(model, search)
    march = _march(model, scans, search, evaluation, np.random.default_rng(seed), progress)
    found = CrossEntropyResult(
        _profile(model, march, search, vehicle, track, seed, notes),
        {
            one.name: signal
            for one, signal in zip(data.sensors, data.used.T, strict=True)
            if one.name in recording
        },
        _reproduced(recording, model, scans, march),
        along_track(data.motion, installation.origin, installation.distance_scale).distance,
        tuple(march.phases),
        notes,
        march.stopped,
    )
    return replace(found, notes=(*notes, *_said(found, search)))


@dataclass
class _March:
    """Elevations (before + scans,) of which ``decided`` scans are, the phases so far, and why they ended."""

    elevation: Array
    decided: int
    phases: list[Phase]
    stopped: str = ""


def _march(
    model: ForwardModel, scans: Scans, search: Search, evaluation: Evaluation,
    generator: np.random.Generator, progress: Progress,
) -> _March:  # fmt: skip
    """Window by window; an interrupt, or elevations that no model bears, end it at the last whole one."""
    march = _March(np.zeros(len(model.place)), 0, [])
    mean = np.full(search.unknowns, search.mean)
    weight, count = sensor_weights(scans.signals), len(scans.signals)
    gain = None
    try:
        while march.decided < count:
            first = march.decided
            size = min(search.unknowns, count - first)
            if gain is None or size < search.unknowns or not model.steady:
                gain = model.gain(march.elevation, first, size)
            due = np.ascontiguousarray(
                (scans.signals[first : first + size] - model.free(march.elevation, first, size)).T
            )
            misfits = _misfits(model, march, gain, due, weight, evaluation)
            level = float(march.elevation[model.before + first - 1])
            mean, runs, agreed = solve_phase(
                misfits, mean[:size], level, search, generator, walk=first == 0
            )
            kept = size if first + size == count else max(search.unknowns // 2, 1)
            march.elevation[model.before + first : model.before + first + kept] = mean[:kept]
            model = model.advanced(march.elevation, first, kept)
            start = float(model.place[model.before + first])
            march.phases.append(Phase(start, first, kept, tuple(runs), agreed))
            march.decided += kept
            mean = np.append(mean[kept:], np.full(search.unknowns - size + kept, mean[-1]))
            progress("searching", march.decided / count)
    except (KeyboardInterrupt, DataError) as stop:
        if march.decided < 2:
            raise
        march.stopped = str(stop) or INTERRUPTED
    return march


def _misfits(
    model: ForwardModel,
    march: _March,
    gain: Array,
    due: Array,
    weight: Array,
    evaluation: Evaluation,
) -> Misfits:
    """The window's objective function, by the map or by simulation."""
    if evaluation is Evaluation.MAP:
        return lambda x: kernels.misfits(gain, x, due, weight)
    first, size = march.decided, gain.shape[1]
    elevation = march.elevation.copy()
    here = slice(model.before + first, model.before + first + size)
    wanted = due.T + model.free(elevation, first, size)

    def simulated(x: Array) -> Array:
        out = np.empty_like(x)
        for i, tried in enumerate(x):
            elevation[here] = tried
            out[i] = np.square(model.signals(elevation, first, size) - wanted) @ weight
        return out

    return simulated


def sensor_weights(signals: Array) -> Array:
    """W of each sensor, (sensors,): in inverse proportion to its root mean square, together 1 (equations 12, 13).

    Raises
    ------
    DataError
        Where a sensor recorded nothing but zeros.

    Examples
    --------
    >>> sensor_weights(np.array([[3.0, 1.0], [-3.0, 1.0]]))
    array([0.25, 0.75])
    """
    level = np.sqrt(np.mean(np.square(signals), axis=0))
    if not np.all(level > 0):
        raise DataError(
            "A channel is zero throughout, so that no weight equalises it with the others; leave it out."
        )
    return (1 / level) / np.sum(1 / level)


def solve_phase(
    misfits: Misfits, mean: Array, level: float, search: Search, generator: np.random.Generator,
    walk: bool,
) -> tuple[Array, list[SearchRun], bool]:  # fmt: skip
    """Optimise one window again and again until two runs agree.

    Parameters
    ----------
    misfits : of the window
    mean : (m,), m, where to start
    level : m, the last elevation that is decided
    walk : whether the first generation is a random walk

    Returns
    -------
    the elevations (m,), the mean of the two runs that agreed; the runs; and whether two did
    """
    spread = np.square(_reset(search)[: len(mean)])
    # Elevations have no natural zero; but what the literal variant finds agrees only in the paper's words.
    zero = 0.0 if search.variant is Variant.LITERAL else level
    runs: list[SearchRun] = []
    for number in range(search.runs):
        start, before = np.diag(spread), mean
        walks = walk and number == 0
        mean, run = optimise(misfits, before, start, search, generator, walks)
        runs.append(run)
        # Each run is as exact as its threshold makes it, on level track too, of which 5 % are nothing.
        near = search.agreement * np.linalg.norm(mean - zero) + 2 * np.sqrt(search.threshold)
        if number > 0 and np.linalg.norm(mean - before) <= near:
            return (mean + before) / 2, runs, True
    return mean, runs, False


def _reset(search: Search) -> Array:
    """Standard deviations (m,) at a phase's start: from 0.1 σ to σ, for what lies ahead is known less."""
    return search.standard_deviation * np.linspace(0.1, 1.0, search.unknowns)


def optimise(
    misfits: Misfits, mean: Array, covariance: Array, search: Search, generator: np.random.Generator,
    walk: bool = False,
) -> tuple[Array, SearchRun]:  # fmt: skip
    """Generation after generation, until the means move no more.

    Parameters
    ----------
    mean, covariance : (m,) in m, (m, m) in m², of the first generation
    walk : the first generation is a random walk instead (equation 9)
    """
    n, size = search.population, search.elite_size
    per_scan, full = search.objective is Objective.SCAN, search.variant is Variant.COVARIANCE
    if walk:
        order = np.arange(1.0, len(mean) + 1)
        covariance = search.standard_deviation**2 * np.minimum.outer(order, order)
        x = kernels.draw_random_walks(generator, n, mean, search.standard_deviation)
    else:
        x = kernels.draw_normal(generator, n, mean, covariance)
    objective, convergence, moved = [], [], np.inf
    for _ in range(search.generations):
        mean, covariance, best, moved = kernels.update_distribution(
            x, misfits(x), size, per_scan, full, search.smoothing, mean, covariance
        )
        objective.append(best)
        convergence.append(moved)
        if moved < search.threshold:
            break
        x = kernels.draw_normal(generator, n, mean, covariance)
    return mean, SearchRun(np.array(objective), np.array(convergence), moved < search.threshold)


def _check_reaction(model: ForwardModel, search: Search) -> None:
    """Within a window some channel must feel an elevation as it does when the other wheels come to it, or nearly."""
    elevation = np.zeros(len(model.place))
    until = min(model.before + search.unknowns, len(model.place) - model.before)
    level = model.signals(elevation, 0, until)
    elevation[model.before] = 1.0
    felt = np.abs(model.signals(elevation, 0, until) - level)
    if not np.any(felt[: search.unknowns].max(axis=0) > MINIMUM_REACTION * felt.max(axis=0)):
        raise DataError(
            "No channel reacts to the leading wheel within a window, which the objective needs; "
            "record on the leading bogie or axle box, or take the smoother."
        )


def _profile(
    model: ForwardModel, march: _March, search: Search, vehicle: Vehicle, track: Track, seed: int,
    notes: tuple[str, ...],
) -> xr.Dataset:  # fmt: skip
    quality = np.zeros(march.decided, np.int16)
    for one in march.phases:
        if not one.solved:
            quality[one.first : one.first + one.kept] |= Quality.UNCONVERGED
    here = slice(model.before, model.before + march.decided)
    profile = build_profile(
        model.place[here],
        march.elevation[here],
        kind="point",
        method=f"cross-entropy, {search.variant.value}, by {search.objective.value}",
        quality=quality,
        loading=loading(track),
        vehicle=vehicle.name,
    )
    return append_provenance(profile, "; ".join([f"infer: {search}, seed {seed}", *notes]))


def _reproduced(
    recording: xr.Dataset, model: ForwardModel, scans: Scans, march: _March
) -> dict[str, Array]:
    signals = model.signals(march.elevation, 0, march.decided)
    out = {}
    for i, name in enumerate(scans.channels):
        if name not in recording:  # the mean of two channels is neither
            continue
        out[name] = np.full(recording.sizes["sample"], np.nan)
        out[name][scans.samples[: march.decided]] = signals[:, i]
    return out


def _said(found: CrossEntropyResult, search: Search) -> tuple[str, ...]:
    """The history in sentences."""
    figures = found.figures
    describe_observations = (
        f"{figures['phases']} phases of {search.unknowns} elevations, {figures['runs_per_phase']:.1f} runs each, "
        f"{figures['generations_per_run']:.0f} generations a run",
    )
    if lost := figures["phases_given_up"]:
        describe_observations += (
            f"{lost} phases did not converge within {search.generations} generations and {search.runs} runs: "
            "their metres are flagged",
        )
    if found.stopped:
        end = float(found.profile["distance"][-1])
        describe_observations += (f"the profile ends at {end:.2f} m: {found.stopped}",)
    return describe_observations

"""A long run in overlapping blocks: bounded memory, and each block independent, so that work can be resumed.

The posterior of a profile has a short memory: data more than ``OVERLAP`` beyond the end of a block do not change it in
any band. Each block is smoothed with that much of its neighbours, and two blocks are blended over ``FADE`` where they
meet.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from trackprofile.bands import BANDS, D3, Band, band_pass, edge_distance
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import Observations
from trackprofile.inference.outliers import outlier_faults, outlier_mask, single_outliers
from trackprofile.inference.problem import Model, smoothing_problem
from trackprofile.inference.quality import quality, unexplained_samples
from trackprofile.inference.sensitivity import vehicle_sensitivity
from trackprofile.inference.track_correction import full_track_residual
from trackprofile.kalman.robust import RobustResult, smooth_robustly
from trackprofile.kalman.smoother import SmoothingProblem, prior_samples, smooth
from trackprofile.models.sensor import Installation
from trackprofile.models.track import Track
from trackprofile.preprocessing.faults import Fault

Array = NDArray[np.float64]

LENGTH = 6000.0
"""Length of a block, m: about 0.6 GB."""

SAMPLED_LENGTH = 512e3
"""Track length in all posterior samples together, m."""

MIN_SAMPLES, MAX_SAMPLES = 24, 128
"""Posterior samples, whatever the length of the run."""

FADE = 400.0
"""Length over which two blocks are blended, m."""

OVERLAP = 500.0
"""Length of its neighbours that a block includes, m: the reach of the filter of D3, and half the fade."""

assert edge_distance(D3) + FADE / 2 <= OVERLAP


@dataclass(frozen=True)
class BlockSettings:
    """What is the same for all blocks; see :class:`trackprofile.inference.infer.InferenceSettings`.

    Parameters
    ----------
    model : with all hyperparameters
    installation, track, seed, full_track_correction : as in the inference settings
    samples : number of posterior samples
    ends : position of the leading wheel at the first and the last sample of the run, m
    """

    model: Model
    installation: Installation
    track: Track
    samples: int
    seed: int
    full_track_correction: bool
    ends: tuple[float, float]


@dataclass(frozen=True)
class Block:
    """Samples ``rows`` of a recording; kept are the results of its ``own`` samples and from ``begin`` to ``end`` m."""

    number: int
    rows: slice
    own: slice
    begin: float
    end: float


@dataclass(frozen=True)
class BlockResult:
    """Result of one block.

    Parameters
    ----------
    position, elevation, standard_deviation : (knots,), m
    bands : standard deviation in each band by name, (knots,), m
    flags : (knots,), quality
    residual : (own samples, sensors), measured minus reproduced signal, NaN where invalid
    faults : by samples of the whole recording
    log_likelihood : of its own samples
    notes : one sentence each
    """

    position: Array
    elevation: Array
    standard_deviation: Array
    bands: dict[str, Array]
    flags: NDArray[np.int16]
    residual: Array
    faults: tuple[Fault, ...]
    log_likelihood: float
    notes: tuple[str, ...]


def cut_into_blocks(distance: Array) -> list[Block]:
    """Blocks of a run from the position of the leading wheel at its samples, (n,) m; one block for a short run.

    Examples
    --------
    >>> [(one.begin, one.end, one.own) for one in cut_into_blocks(np.arange(0.0, 12001.0))]
    [(0.0, 6200.0, slice(0, 6000, None)), (5800.0, 12000.0, slice(6000, 12001, None))]
    """
    length = distance[-1] - distance[0]
    count = max(1, round(length / LENGTH))
    edges = np.linspace(distance[0], distance[-1], count + 1)
    own = [0, *map(int, np.searchsorted(distance, edges[1:-1])), len(distance)]
    return [
        Block(
            number,
            slice(*map(int, np.searchsorted(distance, [begin - OVERLAP, end + OVERLAP + 1e-9]))),
            slice(own[number], own[number + 1]),
            float(begin) - (FADE / 2 if number > 0 else 0.0),
            float(end) + (FADE / 2 if number < count - 1 else 0.0),
        )
        for number, (begin, end) in enumerate(pairwise(edges))
    ]


def default_sample_count(blocks: Sequence[Block]) -> int:
    """Default number of posterior samples: a short run has fewer waves to average over, so it takes more samples.

    Examples
    --------
    >>> [default_sample_count(cut_into_blocks(np.array([0.0, run]))) for run in (1000.0, 8000.0, 100e3)]
    [128, 64, 24]
    """
    if len(blocks) > 1:
        return MIN_SAMPLES
    length = max(blocks[0].end - blocks[0].begin, 1.0)
    return round(min(max(SAMPLED_LENGTH / length, MIN_SAMPLES), MAX_SAMPLES))


def solve_block(
    data: Observations, block: Block, settings: BlockSettings, progress: Progress
) -> BlockResult:
    """Run the robust smoother on one block, with the uncertainty of every point and band.

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    """
    data = data.part(block.rows)
    model = settings.model
    problem = smoothing_problem(data, model)
    progress("smoothing", 0.2)
    run, position = problem.run, problem.run.knot_position
    robust = _smoothed(problem, data, settings)
    progress("smoothing", 0.5)
    errors = _posterior_errors(robust, settings, block)
    progress("smoothing", 0.8)
    elevation = robust.smoothed.elevation[:, 0]
    slopes = vehicle_sensitivity(
        data, model, settings.installation, position, elevation, progress=progress
    )
    # The vehicle errs in the same way in all blocks: its random directions do not depend on the block.
    generator = np.random.default_rng(settings.seed)
    directions = generator.standard_normal((slopes.shape[1], settings.samples))
    bands, notes = band_standard_deviations(errors + slopes @ directions, run.spacing)
    variance = np.maximum(robust.variances.elevation, 0.0) + np.sum(slopes**2, axis=1)
    faults = outlier_faults(robust.weights, data, model, run)
    flags = quality(
        position, bands, data, model, ends=settings.ends,
        unexplained=_unexplained(data, problem, robust), faulty=data.faulty | outlier_mask(faults, data, model),
    )  # fmt: skip
    kept = slice(*map(int, np.searchsorted(position, [block.begin, block.end + 1e-9])))
    residual, likelihood = _own_residual(data, block, problem, robust)
    return BlockResult(
        position[kept],
        elevation[kept],
        np.sqrt(variance)[kept],
        {name: values[kept] for name, values in bands.items()},
        flags[kept],
        residual,
        tuple(_own_faults(faults, block)),
        likelihood,
        notes,
    )


def join_blocks(results: Sequence[BlockResult]) -> BlockResult:
    """The result of a whole run, blended where two blocks meet."""
    first = results[0]
    if len(results) == 1:
        return first
    position = np.unique(np.concatenate([one.position for one in results]))
    starts = [int(np.searchsorted(position, one.position[0])) for one in results]
    weights = [_blend_weight(results, i) for i in range(len(results))]

    def blended(values: Sequence[Array]) -> Array:
        total = np.zeros(len(position))
        for start, weight, own in zip(starts, weights, values, strict=True):
            total[start : start + len(own)] += weight * own
        return total

    flags = np.zeros(len(position), np.int16)
    for start, weight, one in zip(starts, weights, results, strict=True):
        part = slice(start, start + len(weight))
        flags[part] = np.where(weight >= 0.5, one.flags, flags[part])
    names = [name for name in first.bands if all(name in one.bands for one in results)]
    return BlockResult(
        position,
        blended([one.elevation for one in results]),
        blended([one.standard_deviation for one in results]),
        {name: blended([one.bands[name] for one in results]) for name in names},
        flags,
        np.concatenate([one.residual for one in results]),
        tuple(fault for one in results for fault in one.faults),
        sum(one.log_likelihood for one in results),
        tuple(dict.fromkeys(note for one in results for note in one.notes)),
    )


def band_standard_deviations(
    errors: Array, spacing: float
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Standard deviation of the error in each band along the track, from error samples (knots, samples) in m.

    Returns
    -------
    by band, (knots,) in m, and a sentence for each band that the track is too short for
    """
    length = (len(errors) - 1) * spacing
    deviations, notes = {}, []
    for band in BANDS:
        if length < band.longest:
            notes.append(
                f"{length:.0f} m are too short for {band.name}, which has waves up to {band.longest:.0f} m"
            )
            continue
        deviations[band.name] = _local_rms(band_pass(errors.T, spacing, band), spacing, band)
    return deviations, tuple(notes)


def _smoothed(
    problem: SmoothingProblem, data: Observations, settings: BlockSettings
) -> RobustResult:
    """Robust smoother, repeated once on signals without what only the full track model explains."""
    robust = smooth_robustly(problem)
    if not settings.full_track_correction:
        return robust
    run = problem.run
    residual = full_track_residual(
        data, settings.model, settings.track, run.knot_position, robust.smoothed.elevation[:, 0]
    )
    # What the full model explains is no fault of a sensor: the weights are found again without it.
    signals = problem.signals - residual[run.samples, run.sensors][:, None]
    return smooth_robustly(replace(problem, signals=signals))


def _posterior_errors(robust: RobustResult, settings: BlockSettings, block: Block) -> Array:
    """Samples of the posterior's error, (knots, samples) in m."""
    generator = np.random.default_rng([settings.seed, block.number])
    profiles, simulated = prior_samples(robust.gains, settings.samples, generator)
    return profiles - smooth(robust.gains, simulated).elevation


def _local_rms(samples: Array, spacing: float, band: Band) -> Array:
    """Root mean square over the samples, and along one longest wavelength to make up for their small number."""
    count = max(1, round(band.longest / spacing))
    return np.sqrt(uniform_filter1d(np.mean(samples**2, axis=0), count, mode="nearest"))


def _unexplained(
    data: Observations, problem: SmoothingProblem, robust: RobustResult
) -> NDArray[np.bool_]:
    """Samples near which the model does not explain the signals, whatever weight they were given."""
    gains, smoothed = robust.gains, robust.smoothed
    expected = gains.innovation_variance - gains.variance + problem.variance
    normalised = smoothed.innovation / np.sqrt(expected)
    counted = ~single_outliers(robust.weights, problem.run)
    return unexplained_samples(
        data, problem.run, normalised, residual=smoothed.residual[:, 0], counted=counted
    )


def _own_residual(
    data: Observations, block: Block, problem: SmoothingProblem, robust: RobustResult
) -> tuple[Array, float]:
    """Residual of a block's own samples, and their log-likelihood."""
    run, smoothed = problem.run, robust.smoothed
    first = block.own.start - block.rows.start
    own = slice(first, first + block.own.stop - block.own.start)
    residual = np.full(data.signals.shape, np.nan)
    residual[run.samples, run.sensors] = smoothed.residual[:, 0]
    inside = (run.samples >= own.start) & (run.samples < own.stop)
    e, S = smoothed.innovation[inside], robust.gains.innovation_variance[inside]
    return residual[own], -0.5 * float(np.sum(np.log(2 * np.pi * S) + e**2 / S))


def _own_faults(faults: Sequence[Fault], block: Block) -> Iterator[Fault]:
    """Faults of a block's own samples, by samples of the whole recording."""
    for fault in faults:
        first = max(fault.first + block.rows.start, block.own.start)
        last = min(fault.last + block.rows.start, block.own.stop - 1)
        if first <= last:
            yield replace(fault, first=first, last=last)


def _blend_weight(results: Sequence[BlockResult], number: int) -> Array:
    """Weight of one block at each of its knots: 1, falling to 0 where it meets its neighbours."""
    position = results[number].position
    weight = np.ones(len(position))
    if number > 0:
        end = results[number - 1].position[-1]
        weight *= _smooth_step((position - position[0]) / (end - position[0]))
    if number < len(results) - 1:
        begin = results[number + 1].position[0]
        weight *= _smooth_step((position[-1] - position) / (position[-1] - begin))
    return weight


def _smooth_step(share: Array) -> Array:
    """u³ (10 - 15 u + 6 u²), from 0 to 1 with two continuous derivatives; its mirror image is 1 minus itself."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

"""Smoother of the profile that is robust against outliers, noisy stretches and offset jumps of the sensors.

Each iteration smooths with the present variances and adapts them to its residuals (`trackprofile.kalman.reweighting`):

- A sample whose leave-one-out residual exceeds five standard deviations is given a noise variance of its own.
- A stretch of one sensor whose median shows more noise than the sensor states is given a higher noise variance.
- An offset whose likelihood has a significant score over a jump is allowed to jump there.
- An offset whose scores are too large over the whole run is given a faster random walk.

Outlier-free data need one iteration and are smoothed as by :func:`trackprofile.kalman.smoother.smooth`. Large
residuals of a sensor over the whole run are errors of the model, which no weight of single samples removes: they raise
all thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.reweighting import (
    NOISE_RATIO_THRESHOLD,
    OUTLIER_THRESHOLD,
    STANDARD_DEVIATION_PER_MAD,
    Iteration,
    LeaveOneOutResiduals,
    is_converged,
    jump_statistics,
    limited_change,
    reweight,
)
from trackprofile.kalman.smoother import (
    KalmanGains,
    PosteriorVariances,
    SmootherResult,
    SmoothingProblem,
    kalman_gains,
    posterior_variances,
    smooth,
)
from trackprofile.kalman.time_steps import OffsetWalk, with_offset_variance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRETCH_SAMPLES = 128
"""Samples of one sensor over which its noise is taken to be constant: enough for a median."""

PIECE_SAMPLES = 16
"""Samples in which the ends of a noisy stretch are located. The median of so few scatters more than that of a stretch:
a piece differs from its stretch where their noise variances differ by the square of `NOISE_RATIO_THRESHOLD`."""

MIN_NOISE_RATIO = 1e-9
"""Lower limit of a noise ratio, so that it has a logarithm."""

JUMP_HYSTERESIS = 0.5
"""Share of the detection threshold above which a jump that was detected before is kept, so that jumps do not
alternate."""

WALK_RATIO_THRESHOLD = 1.25
"""Ratio of estimated to modelled variance, or its inverse, at which the random walk of an offset is adapted again."""

NEW_WALK_RATIO_THRESHOLD = 5.0
"""The same for an offset whose random walk is still the stated one, times the model-error ratio of the samples."""

MAX_MODEL_ERROR_RATIO = 4.0
"""Largest noise ratio, relative to the median stretch, that counts as model error; a larger one is a sensor fault."""

EXPLAINED_RATIO = 2.0
"""Model-error ratio below which the model is taken to explain the samples."""

MAX_WALK_CHANGE = 30.0
"""Largest factor by which the variance of an offset's random walk changes in one iteration: more than that of a noise
variance, since the stated walk may be wrong by orders of magnitude."""

FREE_ITERATIONS = 4
"""Iterations after which a noise variance falls at most to its geometric mean with the stated one: two samples of a
burst, each explained as long as the other is not, would alternate."""

MAX_ITERATIONS = 20
"""Outlier-free data need one iteration, spikes three or four, since large ones mask small ones."""

TOLERANCE = 0.2
"""Largest change of a variance's logarithm in the last iteration; larger than for positions, since each iteration
smooths the whole run."""


@dataclass(frozen=True)
class NoiseWeights:
    """Variances that replace the stated ones.

    Parameters
    ----------
    variance_ratio : (rows,), noise variance of the row's stretch over that of its sensor, at least 1
    outlier_variance : (rows,), noise variance of outliers, sensor's unit squared; else 0
    jump_variance : (bays, sensors), variance of each offset's jump at the end of a bay, sensor's unit squared
    walk_variance : (sensors,), variance per s of each offset's random walk beyond the stated one
    """

    variance_ratio: Array
    outlier_variance: Array
    jump_variance: Array
    walk_variance: Array

    def noise(self, variance: Array) -> Array:
        """Noise variance of each row, (rows,), where the sensors state ``variance``, (rows,)."""
        return np.where(
            self.outlier_variance > 0.0, self.outlier_variance, self.variance_ratio * variance
        )


@dataclass(frozen=True)
class RobustResult:
    """Result of the last iteration.

    Parameters
    ----------
    gains : Kalman gains with the adapted variances
    smoothed, variances : posterior mean and variances
    weights : adapted variances
    iterations : their number
    """

    gains: KalmanGains
    smoothed: SmootherResult
    variances: PosteriorVariances
    weights: NoiseWeights
    iterations: int


@dataclass(frozen=True)
class _RobustState:
    """Variances of an iteration, and the walk ratio of each offset in the iteration before, (sensors,)."""

    weights: NoiseWeights
    walk_ratio: Array


@dataclass(frozen=True)
class _StretchNoise:
    """Noise of the stretches of one sensor relative to the expected one.

    Parameters
    ----------
    ratio : (its rows,), variance ratio of noisy stretches, else 1
    typical : variance ratio of the median stretch, at least 1
    threshold : variance ratio that stretches reach by the differences between them
    """

    ratio: Array
    typical: float
    threshold: float


def smooth_robustly(problem: SmoothingProblem) -> RobustResult:
    """Posterior of the profile with noise variances, offset jumps and offset walks adapted to the data.

    Parameters
    ----------
    problem : run, prior, stated variances and signals

    Returns
    -------
    posterior, gains and the adapted variances
    """

    def iterate(state: _RobustState, iteration: int) -> Iteration[_RobustState, RobustResult]:
        result = _smooth_with(problem, state.weights, iteration)
        return _adapted(problem, state, result)

    return reweight(iterate, _initial_state(problem), MAX_ITERATIONS)


def _initial_state(problem: SmoothingProblem) -> _RobustState:
    bays, sensors = len(problem.run.F), problem.run.offsets
    weights = NoiseWeights(
        np.ones_like(problem.variance),
        np.zeros_like(problem.variance),
        np.zeros((bays, sensors)),
        np.zeros(sensors),
    )
    return _RobustState(weights, np.full(sensors, np.inf))


def _smooth_with(problem: SmoothingProblem, weights: NoiseWeights, iteration: int) -> RobustResult:
    added = weights.jump_variance + np.outer(problem.walk.duration, weights.walk_variance)
    gains = kalman_gains(
        with_offset_variance(problem.run, added),
        problem.spectrum,
        weights.noise(problem.variance),
        problem.start,
    )
    smoothed, variances = smooth(gains, problem.signals), posterior_variances(gains)
    return RobustResult(gains, smoothed, variances, weights, iteration)


def _adapted(
    problem: SmoothingProblem, state: _RobustState, result: RobustResult
) -> Iteration[_RobustState, RobustResult]:
    """Variances for the next iteration."""
    last, stated = state.weights, problem.variance
    weights, model_error = _reweighted(problem, result)
    walk_ratio = _walk_ratio(result, problem.walk)
    restrained = result.iterations > FREE_ITERATIONS
    if restrained:
        weights = _with_limited_fall(weights, last, stated)
    if restrained or _is_converged(weights, last, stated):
        # Walks are adapted last: outliers and jumps that are not yet detected enlarge their scores.
        ratio = np.minimum(walk_ratio, state.walk_ratio)
        weights = _with_adapted_walks(weights, ratio, problem.walk, model_error)
    return Iteration(
        result, _RobustState(weights, walk_ratio), _is_converged(weights, last, stated)
    )


def _reweighted(problem: SmoothingProblem, result: RobustResult) -> tuple[NoiseWeights, float]:
    """Outliers, noisy stretches and jumps of the last iteration, and the model-error ratio of the samples."""
    run, stated, last = problem.run, problem.variance, result.weights
    residuals = _leave_one_out(result)
    ratio, outlier = np.ones_like(stated), np.zeros_like(stated)
    threshold = model_error = 1.0
    for sensor in range(run.offsets):
        rows = run.sensors == sensor
        own = residuals.select(rows)
        stretch = _stretch_noise(own, stated[rows])
        ratio[rows] = stretch.ratio
        outlier[rows] = own.outlier_variance(
            stretch.ratio * stated[rows], OUTLIER_THRESHOLD**2 * stretch.typical
        )
        # A model error in one signal moves the offsets of the other sensors too.
        threshold = max(threshold, stretch.threshold)
        model_error = max(
            model_error, min(stretch.threshold, MAX_MODEL_ERROR_RATIO * stretch.typical)
        )
    jumps = _detected_jumps(result, OUTLIER_THRESHOLD**2 * threshold)
    if np.any((last.jump_variance > 0.0) & (jumps == 0.0)):
        # The jump that is removed may have hidden outliers: those of the last iteration are kept.
        hidden = (outlier == 0.0) & (last.outlier_variance > ratio * stated)
        outlier = np.where(hidden, last.outlier_variance, outlier)
    weights = replace(last, variance_ratio=ratio, outlier_variance=outlier, jump_variance=jumps)
    return weights, model_error


def _leave_one_out(result: RobustResult) -> LeaveOneOutResiduals:
    noise, precision = result.gains.variance, result.variances.precision
    residual = result.smoothed.residual[:, 0] / (noise * precision)
    return LeaveOneOutResiduals(np.square(residual), np.maximum(1.0 / precision - noise, 0.0))


def _stretch_noise(residuals: LeaveOneOutResiduals, stated: Array) -> _StretchNoise:
    """Variance ratios of the stretches of one sensor.

    The logarithms of the stretches' ratios have a median and, by their median absolute deviation, a scatter: on real
    track both show the error of the model. Only a stretch far outside that scatter is noisy.
    """
    ratio = np.ones_like(stated)
    stretches = np.array_split(np.arange(len(stated)), max(1, len(stated) // STRETCH_SAMPLES))
    of_stretch = [
        max(residuals.select(one).noise_ratio(stated[one]), MIN_NOISE_RATIO) for one in stretches
    ]
    median = float(np.median(np.log(of_stretch)))
    scatter = STANDARD_DEVIATION_PER_MAD * float(np.median(np.abs(np.log(of_stretch) - median)))
    typical = max(1.0, float(np.exp(median)))
    factor = float(np.exp(OUTLIER_THRESHOLD * scatter)) / NOISE_RATIO_THRESHOLD
    threshold = typical * max(1.0, factor)
    noisy = np.array(of_stretch) > NOISE_RATIO_THRESHOLD * threshold
    for number, stretch in enumerate(stretches):
        at_end = np.any(noisy[max(number - 1, 0) : number + 2] != noisy[number])
        count = max(1, len(stretch) // PIECE_SAMPLES) if at_end else 1
        lowest = (
            of_stretch[number] / NOISE_RATIO_THRESHOLD**2
            if noisy[number]
            else NOISE_RATIO_THRESHOLD**2 * threshold
        )
        for piece in np.array_split(stretch, count):
            if residuals.select(piece).noise_ratio(stated[piece]) > lowest:
                variance = residuals.select(stretch if noisy[number] else piece).noise_variance()
                ratio[piece] = max(1.0, variance / np.median(stated[piece]))
    return _StretchNoise(ratio, typical, threshold)


def _detected_jumps(result: RobustResult, threshold: float) -> Array:
    """Variance of each offset's jumps, (bays, sensors): those that remain, and the most significant new one.

    Only one is new per iteration: jumps of two sensors at one location may be the fault of one of them, or the track's.
    """
    last = result.weights.jump_variance
    scores, precisions = result.smoothed.offset_score, result.variances.offset_precision
    detected = [
        _jumps_of_offset(*offset, threshold)
        for offset in zip(last.T, scores.T, precisions.T, strict=True)
    ]
    jumps, significance = (np.stack(each, axis=1) for each in zip(*detected, strict=True))
    new = (jumps > 0.0) & (last == 0.0)
    jumps[new & (significance < np.max(significance, initial=0.0, where=new))] = 0.0
    return jumps


def _jumps_of_offset(
    last: Array, score: Array, precision: Array, threshold: float
) -> tuple[Array, Array]:
    """Jumps of one offset that remain and its most significant new one, and the significance at each bay.

    Returns
    -------
    variance, significance : (bays,), jump variance; squared jump over its variance
    """
    jump = jump_statistics(score, precision, last)
    variance = np.maximum(jump.variance, jump.round_off)
    significance = np.where(jump.determined, jump.square / variance, 0.0)
    first = np.arange(len(last)) == np.argmax(np.where(last > 0.0, 0.0, significance))
    detected = np.where(
        last > 0.0,
        significance > JUMP_HYSTERESIS * threshold,
        first & (significance > threshold),
    )
    return np.where(detected, np.maximum(jump.square - variance, 0.0), 0.0), significance


def _walk_ratio(result: RobustResult, walk: OffsetWalk) -> Array:
    """Estimated over modelled variance of each offset's random walk, Σ g² Δt / Σ q Δt, (sensors,)."""
    score, precision = result.smoothed.offset_score, result.variances.offset_precision
    return walk.duration @ np.square(score) / (walk.duration @ precision)


def _with_adapted_walks(
    weights: NoiseWeights, ratio: Array, walk: OffsetWalk, model_error: float
) -> NoiseWeights:
    """Weights with the random walks that the offsets show.

    Parameters
    ----------
    ratio : (sensors,), estimated over modelled variance of the walk
    model_error : model-error ratio of the samples
    """
    stated, last = walk.rate**2, weights.walk_variance
    # Two jumps of one offset make a walk plausible, if the model explains the samples otherwise.
    jumps_twice = np.count_nonzero(weights.jump_variance, axis=0) > 1
    plausible = (last > 0.0) | (jumps_twice & (model_error < EXPLAINED_RATIO))
    threshold = np.where(plausible, WALK_RATIO_THRESHOLD, NEW_WALK_RATIO_THRESHOLD * model_error)
    changes = (ratio > threshold) | (plausible & (ratio < 1.0 / WALK_RATIO_THRESHOLD))
    adapted = np.maximum((stated + last) * limited_change(ratio, MAX_WALK_CHANGE) - stated, 0.0)
    adapted = np.where(changes, adapted, last)
    # A new walk may explain the jumps of its offset: those that it does not are detected again.
    new = (adapted > 0.0) & (last == 0.0)
    return replace(
        weights, walk_variance=adapted, jump_variance=np.where(new, 0.0, weights.jump_variance)
    )


def _with_limited_fall(weights: NoiseWeights, last: NoiseWeights, stated: Array) -> NoiseWeights:
    """Weights whose noise falls at most to the geometric mean of the last noise and the stated one."""
    lowest = np.sqrt(last.noise(stated) * stated)
    outlier = weights.outlier_variance
    outlier = np.where((outlier > 0.0) & (outlier < lowest), lowest, outlier)
    lowest = np.where(last.outlier_variance > 0.0, stated, lowest)
    return replace(
        weights,
        outlier_variance=outlier,
        variance_ratio=np.maximum(weights.variance_ratio, lowest / stated),
    )


def _is_converged(weights: NoiseWeights, last: NoiseWeights, stated: Array) -> bool:
    ratio = weights.noise(stated) / last.noise(stated)
    return is_converged(
        ratio, TOLERANCE, (weights.jump_variance, last.jump_variance)
    ) and np.array_equal(weights.walk_variance, last.walk_variance)

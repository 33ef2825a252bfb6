"""Position and speed of a train from all sources, by one robust smoother.

The model of `trackprofile.positioning.position_model` is smoothed with iteratively reweighted noise
(`trackprofile.kalman.reweighting`): an outlier is given the noise variance that it shows, a source whose noise is not
stated the noise ratio of its residuals, and where the score of a jump is significant the wheel slips or the
acceleration changes. Each iteration linearises the model about the speed of the one before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from trackprofile.kalman.chain import ChainPosterior, log_likelihood, smooth_chain
from trackprofile.kalman.reweighting import (
    MAX_NOISE_CHANGE,
    NOISE_RATIO_THRESHOLD,
    OUTLIER_THRESHOLD,
    Iteration,
    LeaveOneOutResiduals,
    is_converged,
    jump_statistics,
    limited_change,
    reweight,
)
from trackprofile.positioning.position_model import (
    SCALE,
    SLIP,
    A,
    D,
    ObservationRows,
    PositionPrior,
    Q,
    V,
    WheelIntervals,
    observation_rows,
    position_chain,
)
from trackprofile.positioning.position_observations import PositionObservations, Source

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KEPT_OUTLIER_THRESHOLD = 4.0
"""Standard deviations beyond which an outlier of the last iteration remains one, so that the iteration ends."""

MAX_SCALE_CHANGE = 0.05
"""Largest change of the logarithm of the wheel scale in one iteration."""

SCALE_TOLERANCE = 1e-5
"""Largest change of the logarithm of the wheel scale in the last iteration."""

MIN_OBSERVATIONS = 10
"""Smallest number of observations from which the noise of a source is estimated."""

MAX_ACCELERATION_JUMP = 1.2
"""m/s², largest jump of a train's acceleration; a wheel with a larger one slips."""

SLIP_STD = 1.0
"""m, standard deviation of a jump of the slip in a step while the wheel slips: more than the other sources leave
open."""

SLIP_DURATION = 1.5
"""s before and after a detected slip in which the wheel may slip."""

JUMP_SEPARATION = 10.0
"""s, shortest interval between two jumps that are detected in one iteration."""

ODOMETRY_OUTLIERS_FROM = 3
"""Iteration from which odometer values can be outliers: slips are detected first."""

MAX_ITERATIONS = 25

TOLERANCE = 0.05
"""Largest change of a noise variance's logarithm in the last iteration."""

LOG_NOISE_STD = 1.0
"""Prior standard deviation of the logarithm of a standard deviation that is not stated, about its typical value."""

MAX_SPEED = 100.0
"""m/s, largest initial speed that is derived from positions."""


@dataclass(frozen=True)
class PositionWeights:
    """Variances that replace the stated ones.

    Parameters
    ----------
    noise_ratio : by source, noise variance over the stated or typical one
    outlier_variance : (rows,), noise variance of outliers, m² or m²/s²; else 0
    slip_variance : (steps,), variance of a jump of the wheel slip, m²
    jerk_variance : (steps,), variance of a jump of the acceleration, (m/s²)²
    """

    noise_ratio: Mapping[Source, float]
    outlier_variance: Array
    slip_variance: Array
    jerk_variance: Array

    def noise(self, rows: ObservationRows) -> Array:
        """Noise variance of each row, (rows,)."""
        return np.where(
            self.outlier_variance > 0.0, self.outlier_variance, self.ratio(rows) * rows.variance
        )

    def ratio(self, rows: ObservationRows) -> Array:
        """Noise ratio of each row's source, (rows,)."""
        return np.array([self.noise_ratio[one] for one in rows.source])


@dataclass(frozen=True)
class PositionEstimate:
    """Posterior of the position and speed of a train at the nodes.

    Parameters
    ----------
    time, distance, speed, acceleration : (n,), s, m, m/s, m/s²
    standard_deviation : (n,), of the distance, m
    scale, scale_std : true over nominal wheel diameter at the last node; standard deviation of its logarithm
    bias_std : standard deviation of the bias of GNSS fixes, m
    rows, weights : observations and their adapted variances
    slip : (n,), accumulated wheel slip, m
    iterations : their number
    """

    time: Array
    distance: Array
    speed: Array
    acceleration: Array
    standard_deviation: Array
    scale: float
    scale_std: float
    bias_std: float
    rows: ObservationRows
    weights: PositionWeights
    slip: Array
    iterations: int


@dataclass(frozen=True)
class _PositionState:
    """Variances, prior and linearisation speed, (n,) m/s, of an iteration."""

    weights: PositionWeights
    prior: PositionPrior
    speed: Array


@dataclass(frozen=True)
class _SmoothedPosition:
    """Posterior of an iteration, its variances and prior, and the speed for the next linearisation."""

    posterior: ChainPosterior
    state: _PositionState
    iterations: int


def smooth_position(
    observations: Sequence[PositionObservations],
    intervals: WheelIntervals,
    prior: PositionPrior,
    span: tuple[float, float],
) -> PositionEstimate:
    """Position of a train from all observations, with outliers, slips and noise adapted to the data.

    Parameters
    ----------
    observations : at most one per source
    intervals : standstills and failures of the odometer
    prior : initial state and wheel scale
    span : first and last time for which the position is wanted, s
    """
    rows = observation_rows(observations, intervals, span)
    steps = len(rows.time) - 1
    weights = PositionWeights(
        dict.fromkeys(Source, 1.0), np.zeros(len(rows.value)), np.zeros(steps), np.zeros(steps)
    )
    smoothed = _smooth(rows, _PositionState(weights, prior, initial_speed(rows)))
    fixes = rows.measured_by(Source.GNSS_POSITION)
    all_stated = prior.bias_stated and rows.stated[fixes].all()
    if np.count_nonzero(fixes) >= MIN_OBSERVATIONS and not all_stated:
        smoothed = _smooth(rows, _with_likely_gnss_noise(rows, smoothed.state))
    return _estimate(rows, smoothed)


def _smooth(rows: ObservationRows, start: _PositionState) -> _SmoothedPosition:
    def iterate(state: _PositionState, number: int) -> Iteration[_PositionState, _SmoothedPosition]:
        posterior = _posterior(rows, state)
        weights = _adapted(state.weights, rows, posterior, number >= ODOMETRY_OUTLIERS_FROM)
        error = float(
            np.clip(np.median(posterior.state[:, SCALE, 0]), -MAX_SCALE_CHANGE, MAX_SCALE_CHANGE)
        )
        speed = np.maximum(posterior.state[:, V, 0], 0.0)
        prior = replace(state.prior, scale=float(state.prior.scale * np.exp(error)))
        converged = (
            number >= ODOMETRY_OUTLIERS_FROM
            and _is_converged(weights, state.weights)
            and abs(error) < SCALE_TOLERANCE
        )
        result = _SmoothedPosition(posterior, replace(state, speed=speed), number)
        return Iteration(result, _PositionState(weights, prior, speed), converged)

    return reweight(iterate, start, MAX_ITERATIONS)


def _posterior(rows: ObservationRows, state: _PositionState) -> ChainPosterior:
    weights = state.weights
    chain, values = position_chain(
        rows, state.prior, state.speed, weights.slip_variance, weights.jerk_variance
    )
    return smooth_chain(chain, values[:, None], weights.noise(rows))


def _adapted(
    last: PositionWeights,
    rows: ObservationRows,
    posterior: ChainPosterior,
    odometry_outliers: bool,
) -> PositionWeights:
    """Variances for the next iteration; ``odometry_outliers``: whether odometer values may be outliers."""
    residuals = posterior.leave_one_out()
    ratio = {
        source: _noise_ratio(source, last.noise_ratio[source], rows, residuals)
        for source in last.noise_ratio
    }
    slip, jerk = _detected_jumps(last, rows, posterior)
    weights = PositionWeights(ratio, last.outlier_variance, slip, jerk)
    threshold = np.where(last.outlier_variance > 0.0, KEPT_OUTLIER_THRESHOLD, OUTLIER_THRESHOLD)
    outlier = residuals.outlier_variance(weights.ratio(rows) * rows.variance, threshold**2)
    never = rows.measured_by(Source.STANDSTILL)
    if not odometry_outliers:
        never |= rows.measured_by(Source.ODOMETRY)
    return replace(weights, outlier_variance=np.where(never, 0.0, outlier))


def _noise_ratio(
    source: Source, last: float, rows: ObservationRows, residuals: LeaveOneOutResiduals
) -> float:
    """Noise variance of a source over the stated or typical one; a stated one is only increased."""
    own = rows.measured_by(source)
    if source is Source.STANDSTILL or np.count_nonzero(own) < MIN_OBSERVATIONS:
        return last
    estimated = residuals.select(own).noise_ratio(last * rows.variance[own])
    adapted = last * float(limited_change(estimated, MAX_NOISE_CHANGE))
    if not rows.stated[own][0]:
        return adapted
    return max(1.0, adapted) if estimated > NOISE_RATIO_THRESHOLD or last > 1.0 else last


def _detected_jumps(
    last: PositionWeights, rows: ObservationRows, posterior: ChainPosterior
) -> tuple[Array, Array]:
    """Variances of the jumps of slip and acceleration, (steps,): those that remain and the most significant new ones.

    A jump of the acceleration beyond that of any train is a slip.
    """
    significance, variance = {}, {}
    for state, modelled in ((SLIP, last.slip_variance), (A, last.jerk_variance)):
        jump = jump_statistics(
            posterior.jump_score[:, state, 0], posterior.jump_precision[:, state], modelled
        )
        valid = jump.determined & (jump.variance > jump.round_off)
        significance[state] = np.where(valid, jump.square, 0.0) / np.where(
            valid, jump.variance, 1.0
        )
        variance[state] = np.maximum(jump.square - jump.variance, 0.0)
    significance[A][variance[A] > MAX_ACCELERATION_JUMP**2] = 0.0
    significance[SLIP][rows.odometer_fails] = 0.0
    slip = last.slip_variance.copy()
    jerk = np.where(last.jerk_variance > 0.0, variance[A], 0.0)
    largest = np.maximum(significance[SLIP], significance[A])
    largest *= (last.slip_variance == 0.0) * (last.jerk_variance == 0.0)
    middle = 0.5 * (rows.time[1:] + rows.time[:-1])
    while np.max(largest, initial=0.0) > OUTLIER_THRESHOLD**2:
        step = int(np.argmax(largest))
        if significance[SLIP][step] >= significance[A][step]:
            slip[np.abs(middle - middle[step]) < SLIP_DURATION] = SLIP_STD**2
        else:
            jerk[step] = variance[A][step]
        largest[np.abs(middle - middle[step]) < JUMP_SEPARATION] = 0.0
    return slip, jerk


def _is_converged(new: PositionWeights, old: PositionWeights) -> bool:
    ratio = np.array([new.noise_ratio[one] / old.noise_ratio[one] for one in new.noise_ratio])
    return is_converged(
        ratio,
        TOLERANCE,
        (new.outlier_variance, old.outlier_variance),
        (new.slip_variance, old.slip_variance),
        (new.jerk_variance, old.jerk_variance),
    )


def _with_likely_gnss_noise(rows: ObservationRows, state: _PositionState) -> _PositionState:
    """State with the most likely bias and noise of the GNSS fixes, as far as they are not stated.

    The logarithms of both standard deviations over their typical values have a Gaussian prior.
    """
    weights, prior = state.weights, state.prior
    stated = rows.stated[rows.measured_by(Source.GNSS_POSITION)][0]
    free = np.array([not prior.bias_stated, not stated])
    ratio = weights.noise_ratio[Source.GNSS_POSITION]

    def with_noise(logarithms: Array) -> _PositionState:
        every = np.zeros(len(free))
        every[free] = logarithms
        bias, noise = np.exp(every)
        ratios = {
            **weights.noise_ratio,
            Source.GNSS_POSITION: float(noise**2) if free[1] else ratio,
        }
        return replace(
            state,
            weights=replace(weights, noise_ratio=ratios),
            prior=replace(prior, bias_std=prior.bias_std * float(bias)),
        )

    def cost(logarithms: Array) -> float:
        trial = with_noise(logarithms)
        chain, values = position_chain(
            rows,
            trial.prior,
            trial.speed,
            trial.weights.slip_variance,
            trial.weights.jerk_variance,
        )
        likelihood = log_likelihood(chain, values[:, None], trial.weights.noise(rows))
        return 0.5 * float(np.sum(np.square(logarithms))) / LOG_NOISE_STD**2 - likelihood

    start = np.array([0.0, 0.5 * np.log(ratio)])[free]
    simplex = np.vstack([start, start - LOG_NOISE_STD * np.eye(len(start))])
    best = minimize(cost, start, method="Nelder-Mead",
                    options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05}).x  # fmt: skip
    return with_noise(best)


def initial_speed(rows: ObservationRows) -> Array:
    """Speed at the nodes, (n,) m/s, by the first source that has two observations: speeds, else slopes of positions."""
    for source in (Source.DISPLAYED_SPEED, Source.GNSS_SPEED):
        own = rows.measured_by(source)
        if np.count_nonzero(own) > 1:
            return np.interp(rows.time, rows.time[rows.node[own]], rows.value[own])
    for source in (Source.ODOMETRY, Source.GNSS_POSITION, Source.POST):
        own = rows.measured_by(source)
        if np.count_nonzero(own) > 1:
            position = np.interp(rows.time, rows.time[rows.node[own]], rows.value[own])
            return np.clip(np.gradient(position, rows.time), 0.0, MAX_SPEED)
    return np.zeros(len(rows.time))


def _estimate(rows: ObservationRows, smoothed: _SmoothedPosition) -> PositionEstimate:
    posterior, prior = smoothed.posterior, smoothed.state.prior
    state, P = posterior.state[:, :, 0], posterior.covariance
    error = state[:, SCALE]
    variance = P[:, Q, Q] + 2 * P[:, Q, D] + P[:, D, D]
    return PositionEstimate(
        time=rows.time,
        distance=state[:, Q] + state[:, D],
        speed=state[:, V] * (1.0 + error),
        acceleration=state[:, A] * (1.0 + error),
        standard_deviation=np.sqrt(np.maximum(variance, 0.0)),
        scale=float(prior.scale * np.exp(error[-1])),
        scale_std=float(np.sqrt(max(P[-1, SCALE, SCALE], 0.0))),
        bias_std=prior.bias_std,
        rows=rows,
        weights=smoothed.state.weights,
        slip=state[:, SLIP],
        iterations=smoothed.iterations,
    )

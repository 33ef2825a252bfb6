"""A smoother that keeps its head: samples, stretches and offsets that disagree with all the others count for less.

What each sample should be is known from all the others: y_k - ŷ_k = e_k = u_k/d_k, of variance 1/d_k = v_k + p_k, with
v_k the sample's noise, p_k what the others leave open, u_k = (S⁻¹ y)_k and d_k = (S⁻¹)_kk (de Jong 1988). A sample
``BEYOND`` standard deviations away is given the noise that it shows, v_k = e_k² - p_k, which is the maximum likelihood
of that variance (Thompson 1985). A stretch whose median shows more noise than its sensor's is given that. Offsets that
jump or drift are found likewise, by the slope of the likelihood over a jump at each place. What is not beyond is left
as it was: good data are smoothed once, as if nothing of this existed. What a sensor shows all along beyond its noise is
the model's error, which no weight of single samples heals: all is measured by that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.smoother import (
    KalmanGains,
    PosteriorVariances,
    SmootherResult,
    SmoothingProblem,
    kalman_gains,
    posterior_variances,
    smooth,
)
from trackprofile.kalman.time_steps import DiscretisedRun, OffsetWalk, with_offset_variance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BEYOND = 5.0
"""Standard deviations: of ten million good samples six are beyond."""

STRETCH = 128
"""Samples of one sensor over which its noise is taken to be constant: enough for a median."""

PIECE = 16
"""Samples by which it is told where a loud stretch ends: at nine times less, or more, than the stretch."""

LOUDER = 3.0
"""Times its variance that the noise of a stretch has to show before it is believed: five standard deviations of it."""

CHI_SQUARE_MEDIAN = 0.4549
"""Of the square of a standard normal number."""

NORMAL_DEVIATION = 1.4826
"""Standard deviation of normal numbers over the median of their distance from their median."""

STAYS = 0.5
"""Times what a jump has to show to be found, so that it stays."""

LEAST_TOLD = 1e-9
"""Share of the greatest precision below which nothing is told of an offset: at the very end of a ride."""

FASTER = 1.25
"""Times its variance, or that part of it, that an offset's walk has to show before it is believed."""

NOTED = 5.0
"""The same of a walk that was as usual so far, over what samples show beyond their noise."""

MOSTLY = 4.0
"""Times what half of the stretches show, or less, that is taken for what the model leaves: more is a fault."""

EXPLAINED = 2.0
"""Times its variance, or less, that samples show where the model explains them."""

BOLDEST = 30.0
"""Times by which the variance of an offset's walk may change in one round."""

FREE_ROUNDS = 4
"""After which noise falls only by half on a logarithmic scale, so that the rounds do not go in circles."""

MOST_ROUNDS = 20
"""Good data need one; spikes three or four, because of those in the shade of others."""

SETTLED = 0.2
"""Change of the logarithm of every variance below which the rounds end."""


@dataclass(frozen=True)
class NoiseWeights:
    """What is believed of each sample and offset.

    Parameters
    ----------
    louder : (rows,), noise variance of the stretch over that of the sensor
    own : (rows,), noise variance of samples that have one of their own, else 0, sensor's unit squared
    jumps : (bays, sensors), variance of each offset's jump at the end of a bay
    drift : (sensors,), variance per s of each offset's random walk beyond the usual one
    """

    louder: Array
    own: Array
    jumps: Array
    drift: Array

    def noise(self, variance: Array) -> Array:
        """Noise variance of each row, (rows,)."""
        return np.where(self.own > 0.0, self.own, self.louder * variance)


@dataclass(frozen=True)
class RobustResult:
    """A ride smoothed, with what was weighted down on the way, and how many rounds that took."""

    prepared: KalmanGains
    smoothed: SmootherResult
    variances: PosteriorVariances
    weights: NoiseWeights
    rounds: int


def smooth_robustly(problem: SmoothingProblem) -> RobustResult:
    """Smooth, down-weight what disagrees, and repeat until the weights no longer change."""
    run, variance, walk = problem.run, problem.variance, problem.walk
    weights = NoiseWeights(
        np.ones_like(variance),
        np.zeros_like(variance),
        np.zeros((len(run.F), run.offsets)),
        np.zeros(run.offsets),
    )
    rounds, before = 0, np.full(run.offsets, np.inf)
    while True:
        rounds += 1
        noise = weights.noise(variance)
        wandering = with_offset_variance(
            run, weights.jumps + np.outer(walk.duration, weights.drift)
        )
        prepared = kalman_gains(wandering, problem.spectrum, noise, problem.start)
        smoothed, judged = smooth(prepared, problem.signals), posterior_variances(prepared)
        again, left = _judged(weights, run, variance, noise, smoothed, judged)
        shown = _wandering(smoothed, judged, walk)
        if rounds > FREE_ROUNDS:
            again = _held(again, weights, variance)
        if rounds > FREE_ROUNDS or _same(again, weights, variance):
            # Drift is judged last: as long as outliers and jumps are not told apart, they look like it.
            again = _drifting(again, np.minimum(shown, before), walk, left)
        if _same(again, weights, variance) or rounds == MOST_ROUNDS:
            return RobustResult(prepared, smoothed, judged, weights, rounds)
        weights, before = again, shown


def _judged(
    weights: NoiseWeights, ride: DiscretisedRun, variance: Array, noise: Array,
    smoothed: SmootherResult, judged: PosteriorVariances,
) -> tuple[NoiseWeights, float]:  # fmt: skip
    """The weights that the last round asks for, and times their variance what samples show that the model leaves."""
    error = smoothed.residual[:, 0] / (noise * judged.precision)
    open_ = np.maximum(1.0 / judged.precision - noise, 0.0)
    squares = np.square(error)
    louder, beyond = np.ones_like(variance), np.zeros(len(variance), bool)
    bar = left = 1.0
    for i in range(ride.offsets):
        rows = ride.sensors == i
        louder[rows], usual, here = _louder(squares[rows], open_[rows], variance[rows])
        most = BEYOND**2 * usual * (louder * variance + open_)
        beyond[rows] = squares[rows] > most[rows]
        # What the model leaves open in one signal moves the offsets of the others too.
        bar, left = max(bar, here), max(left, min(here, MOSTLY * usual))
    own = np.where(beyond, squares - open_, 0.0)
    offsets = zip(weights.jumps.T, smoothed.offset_score.T, judged.offset_precision.T, strict=True)
    judgements = [_jumps(*offset, BEYOND**2 * bar) for offset in offsets]
    jumps, clear = (np.stack(each, axis=1) for each in zip(*judgements, strict=True))
    # Of the new ones the clearest: what two sensors show at one place may be one's fault, or the track's.
    new = (jumps > 0.0) & (weights.jumps == 0.0)
    jumps[new & (clear < np.max(clear, initial=0.0, where=new))] = 0.0
    if np.any((weights.jumps > 0.0) & (jumps == 0.0)):
        # Samples may have seemed good only for the jump that goes.
        stay = (own == 0.0) & (weights.own > louder * variance)
        own = np.where(stay, weights.own, own)
    return replace(weights, louder=louder, own=own, jumps=jumps), left


def _wandering(smoothed: SmootherResult, judged: PosteriorVariances, walk: OffsetWalk) -> Array:
    """What each offset's walk shows, times its variance, (sensors,)."""
    score, precision = smoothed.offset_score, judged.offset_precision
    return walk.duration @ np.square(score) / (walk.duration @ precision)


def _drifting(weights: NoiseWeights, shown: Array, walk: OffsetWalk, left: float) -> NoiseWeights:
    """The weights, with the walk that each offset shows, where ``left`` is left of the samples by the model."""
    usual = walk.rate**2
    # A second jump of the same offset makes a walk more likely than chance, if the model explains the rest.
    twice = (np.count_nonzero(weights.jumps, axis=0) > 1) & (left < EXPLAINED)
    known = (weights.drift > 0.0) | twice
    changes = (shown > np.where(known, FASTER, NOTED * left)) | (known & (shown < 1.0 / FASTER))
    bold = np.clip(shown, 1.0 / BOLDEST, BOLDEST)
    drift = np.maximum((usual + weights.drift) * bold - usual, 0.0)
    drift = np.where(changes, drift, weights.drift)
    # What a walk explains is no jump: those that remain are found again.
    first = (drift > 0.0) & (weights.drift == 0.0)
    return replace(weights, drift=drift, jumps=np.where(first, 0.0, weights.jumps))


def _jumps(jumps: Array, score: Array, precision: Array, least: float) -> tuple[Array, Array]:
    """Of one offset: those of the last round that still show, and the clearest other where it is ``least`` variances
    large; and how many each place shows.
    """
    known = precision > LEAST_TOLD * np.max(precision, initial=0.0)
    precise = np.where(known, precision, 1.0)
    shown = np.square(score / precise)
    # As far as round-off tells what is left of 1/precision without the jump's own variance.
    without = np.maximum(1.0 / precise - jumps, LEAST_TOLD / precise)
    clear = np.where(known, shown / without, 0.0)
    b = int(np.argmax(np.where(jumps > 0.0, 0.0, clear)))
    # One that is found does not go for being a little less clear, or jumps would take turns.
    stay = np.where(
        jumps > 0.0, clear > STAYS * least, (np.arange(len(jumps)) == b) & (clear > least)
    )
    return np.where(stay, np.maximum(shown - without, 0.0), 0.0), clear


def _louder(squares: Array, open_: Array, variance: Array) -> tuple[Array, float, float]:
    """How much louder stretches of one sensor are than it, (its rows,) of at least 1; how loud half of them are at
    least; and that times what they differ by anyway, above which one is louder.
    """
    louder = np.ones_like(variance)
    parts = np.array_split(np.arange(len(variance)), max(1, len(variance) // STRETCH))
    each = squares / (variance + open_)
    shown = [max(np.median(each[part]) / CHI_SQUARE_MEDIAN, LEAST_TOLD) for part in parts]
    mostly = float(np.median(np.log(shown)))
    differ = NORMAL_DEVIATION * float(np.median(np.abs(np.log(shown) - mostly)))
    usual = max(1.0, float(np.exp(mostly)))
    bar = usual * max(1.0, float(np.exp(BEYOND * differ)) / LOUDER)
    loud = np.array(shown) > LOUDER * bar
    for number, part in enumerate(parts):
        at_end = np.any(loud[max(number - 1, 0) : number + 2] != loud[number])
        for piece in np.array_split(part, max(1, len(part) // PIECE)) if at_end else [part]:
            times = np.median(each[piece]) / CHI_SQUARE_MEDIAN
            least = shown[number] / LOUDER**2 if loud[number] else LOUDER**2 * bar
            if times > least:
                of = part if loud[number] else piece
                own = np.median(squares[of]) / CHI_SQUARE_MEDIAN - np.median(open_[of])
                louder[piece] = max(1.0, own / np.median(variance[piece]))
    return louder, usual, bar


def _held(again: NoiseWeights, last: NoiseWeights, variance: Array) -> NoiseWeights:
    """The same, but no noise falls by more than half on a logarithmic scale, above that of the sensor."""
    before = last.noise(variance)
    least = np.sqrt(before * variance)
    own = np.where((again.own > 0.0) & (again.own < least), least, again.own)
    least = np.where(last.own > 0.0, variance, least)
    return replace(again, own=own, louder=np.maximum(again.louder, least / variance))


def _same(a: NoiseWeights, b: NoiseWeights, variance: Array) -> bool:
    change = np.abs(np.log(a.noise(variance) / b.noise(variance)))
    return bool(
        np.max(change) < SETTLED
        and np.array_equal(a.jumps > 0.0, b.jumps > 0.0)
        and np.array_equal(a.drift, b.drift)
    )

"""Iteratively reweighted smoothing: what the robust smoothers of this package have in common.

A smoother for Gaussian noise gives, besides the posterior, the leave-one-out residual of each observation,

    e_k = y_k - ŷ_k = u_k/d_k,    Var e_k = 1/d_k = v_k + p_k,    u = S⁻¹ y,    d_k = (S⁻¹)_kk

where ŷ_k is the prediction of y_k from all other observations, p_k the variance of that prediction, v_k the noise
variance of y_k and S the covariance of all observations (de Jong 1988). An observation whose |e_k| exceeds
`OUTLIER_THRESHOLD` standard deviations is given the noise variance v_k = e_k² - p_k, the maximum-likelihood estimate of
a variance of its own (Thompson 1985). A jump of the state at the end of a step is detected in the same way, by its
score (`JumpStatistics`). Weights that depend on residuals make the problem non-linear; it is solved by fixed-point
iteration (Huber 1964): smooth, adapt the variances, repeat until no variance changes (`reweight`).

Used by `trackprofile.kalman.robust` (sensors on a profile), `trackprofile.positioning.position_smoother` (position
sources) and `trackprofile.positioning.gnss_alignment` (GNSS fixes on a smooth curve). The passes of a fusion are
compared by variance components instead, see `trackprofile.fusion.rejection`.

Sources: P. J. Huber, Robust estimation of a location parameter, Annals of Mathematical Statistics 35(1), 1964.
R. Thompson, A note on restricted maximum likelihood estimation with an alternative outlier model, JRSS B 47(1), 1985.
P. de Jong, A cross-validation filter for time series models, Biometrika 75(3), 1988. A. C. Harvey, S. J. Koopman,
Diagnostic checking of unobserved-components time series models, Journal of Business & Economic Statistics 10(4), 1992.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
State = TypeVar("State")
Result = TypeVar("Result")

OUTLIER_THRESHOLD = 5.0
"""Standard deviations beyond which a residual or a jump is an outlier: 6 of 10 million Gaussian samples."""

NOISE_RATIO_THRESHOLD = 3.0
"""Smallest ratio of estimated to stated noise variance at which the stated one is replaced: for the median of 128
samples, five standard deviations above 1."""

CHI_SQUARE_MEDIAN = {1: 0.4549, 2: 1.3863 / 2}
"""Median of the mean square of so many standard normal numbers; for two it is ln 2."""

MAX_NOISE_CHANGE = 4.0
"""Largest factor by which the noise variance of a source changes in one iteration, so that outliers and noise level do
not alternate."""

STANDARD_DEVIATION_PER_MAD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation, 1/Φ⁻¹(3/4)."""

MIN_RELATIVE_PRECISION = 1e-9
"""Smallest precision, relative to the largest one, at which a jump is determined; below, round-off dominates."""


@dataclass(frozen=True)
class LeaveOneOutResiduals:
    """Residuals of observations against their predictions from all other observations.

    Parameters
    ----------
    square : (rows,), e²; of vectors the mean square of the components
    prediction_variance : (rows,), p, variance of the prediction of one component
    components : number of components of each observation, 1 or 2
    """

    square: Array
    prediction_variance: Array
    components: int = 1

    def select(self, rows: Mask | NDArray[np.intp]) -> LeaveOneOutResiduals:
        """Residuals of some rows."""
        return LeaveOneOutResiduals(
            self.square[rows], self.prediction_variance[rows], self.components
        )

    def noise_ratio(self, noise: Array | float) -> float:
        """Robust ratio of the residuals' variance to the expected one, v + p, from the median of their squares.

        Parameters
        ----------
        noise : (rows,) or one number, expected noise variance v

        Examples
        --------
        >>> square = np.square(3.0 * np.random.default_rng(1).standard_normal(10000))
        >>> round(LeaveOneOutResiduals(square, np.full(10000, 0.5)).noise_ratio(0.5), 1)
        9.1
        """
        ratio = np.median(self.square / (noise + self.prediction_variance))
        return float(ratio) / CHI_SQUARE_MEDIAN[self.components]

    def noise_variance(self) -> float:
        """Robust estimate of one noise variance for all rows; it may be negative where p is large."""
        total = np.median(self.square) / CHI_SQUARE_MEDIAN[self.components]
        return float(total - np.median(self.prediction_variance))

    def outlier_variance(self, noise: Array | float, threshold: Array | float) -> Array:
        """Noise variances of outliers, e² - p where e² > threshold (v + p), else 0.

        Parameters
        ----------
        noise : (rows,) or one number, noise variance v
        threshold : (rows,) or one number, ratio of variances

        Examples
        --------
        >>> residuals = LeaveOneOutResiduals(np.array([4.0, 100.0]), np.ones(2))
        >>> residuals.outlier_variance(1.0, OUTLIER_THRESHOLD**2)
        array([ 0., 99.])
        """
        outlying = self.square > threshold * (noise + self.prediction_variance)
        return np.where(outlying, self.square - self.prediction_variance, 0.0)


@dataclass(frozen=True)
class JumpStatistics:
    """Estimates of a jump of one state at the end of each step, each as if it were the only one.

    With the score g of the log-likelihood over the jump and its variance q, the estimate is g/q, of variance 1/q
    (auxiliary residuals, Harvey and Koopman 1992). 1/q includes the variance that the jump has in the model already.

    Parameters
    ----------
    square : (steps,), (g/q)²
    variance : (steps,), 1/q less the jump's variance in the model
    round_off : (steps,), smallest ``variance`` that is more than rounding
    determined : (steps,), whether q is large enough for an estimate
    """

    square: Array
    variance: Array
    round_off: Array
    determined: Mask


def jump_statistics(score: Array, precision: Array, modelled: Array) -> JumpStatistics:
    """Estimate the jump of a state at the end of each step.

    Parameters
    ----------
    score, precision : (steps,), g and q
    modelled : (steps,), variance of each jump in the model

    Examples
    --------
    >>> jump = jump_statistics(np.array([6.0, 0.0]), np.array([2.0, 0.0]), np.zeros(2))
    >>> jump.square, jump.variance, jump.determined
    (array([9., 0.]), array([0.5, 1. ]), array([ True, False]))
    """
    determined = precision > MIN_RELATIVE_PRECISION * np.max(precision, initial=0.0)
    positive = np.where(determined, precision, 1.0)
    return JumpStatistics(
        np.square(score / positive),
        1.0 / positive - modelled,
        MIN_RELATIVE_PRECISION / positive,
        determined,
    )


@dataclass(frozen=True)
class Iteration(Generic[State, Result]):
    """Result of one iteration, state for the next one, and whether both states are equal within the tolerance."""

    result: Result
    state: State
    converged: bool


def reweight(
    iterate: Callable[[State, int], Iteration[State, Result]], state: State, max_iterations: int
) -> Result:
    """Repeat smoothing and adapting of variances until they no longer change.

    Parameters
    ----------
    iterate : smooths with a state (variances and what else changes) and the number of the iteration, from 1
    state : initial state
    max_iterations : iterations after which the result counts as converged

    Returns
    -------
    the result of the last iteration

    Examples
    --------
    >>> def iterate(state, number):
    ...     return Iteration((state, number), 0.5 * (state + 2.0 / state), abs(state**2 - 2.0) < 1e-6)
    >>> reweight(iterate, 1.0, 20)[1]
    5
    """
    number = 1
    while True:
        outcome = iterate(state, number)
        if outcome.converged or number == max_iterations:
            return outcome.result
        state, number = outcome.state, number + 1


def is_converged(ratio: Array, tolerance: float, *pairs: tuple[Array, Array]) -> bool:
    """Whether no variance changes by more than a factor e^tolerance, and outliers and jumps are at the same elements.

    Parameters
    ----------
    ratio : (any,), new over previous variances
    tolerance : largest change of a variance's logarithm
    pairs : new and previous variances of outliers or of jumps, 0 where there is none

    Examples
    --------
    >>> is_converged(np.array([1.02]), 0.05, (np.array([0.0, 3.0]), np.array([0.0, 2.0])))
    True
    """
    change = np.max(np.abs(np.log(ratio)))
    return bool(
        change < tolerance and all(np.array_equal(new > 0.0, old > 0.0) for new, old in pairs)
    )


def limited_change(ratio: Array | float, factor: float) -> Array:
    """Ratio of new to previous variance, limited to 1/factor ... factor so that the iteration does not oscillate."""
    return np.clip(np.asarray(ratio), 1.0 / factor, factor)

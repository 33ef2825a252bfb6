"""Detection of track that changes: most track does not, and a rate that noise explains is none.

In each range of wavelengths the fitted rate ρ at a node, of standard deviation s, is that of unchanged track (rate 0)
or, with the prior probability π, that of changing track, whose rates have the standard deviation R. π and R maximise
the likelihood of the rates along the line. A node changes with the posterior probability p; its rate is p q ρ, with
the shrinkage factor q = R²/(R² + s²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert

Array = NDArray[np.float64]

_RATE_DEVIATIONS = np.geomspace(0.3, 300.0, 31)
"""Values of R that are tried, over the median of s."""

_CHANGING_SHARES = np.geomspace(1e-4, 1.0, 25)
"""Values of π that are tried."""

_MAX_NODES = 5000
"""Number of nodes at which the likelihood is evaluated."""

_MIN_LOG_LIKELIHOOD_RATIO = 3.0
"""Gain in log-likelihood over a line without change that is necessary for any change."""


@dataclass(frozen=True, eq=False)
class ChangeProbability:
    """Probability of change in one range of wavelengths.

    Parameters
    ----------
    probability : posterior probability p that the track changes (nodes)
    shrinkage : factor q of the rate if it does (nodes)
    """

    probability: Array
    shrinkage: Array


def detect_changes(
    rate: Array, deviation: Array, known: NDArray[np.bool_], independent_count: float
) -> ChangeProbability:
    """Estimate the probability that track changes, from the fitted rates along a line.

    The likelihood ratio at a node uses the squared envelope e² = (ρ² + ρ_H²)/s², with the Hilbert transform ρ_H of the
    rate, since the rate of changing track itself is zero at some points:

        Λ = exp(e²/2 · r/(1 + r))/(1 + r),  r = R²/s²,      p = π Λ/(π Λ + 1 - π).

    Parameters
    ----------
    rate : fitted rates in one range of wavelengths (nodes) [m/day]
    deviation : their standard deviation s (nodes) [m/day]
    known : whether there is a rate (nodes)
    independent_count : number of independent values along the line; dense nodes count as so many values

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(4000)
    >>> noise[2000:2010] += 30 * np.cos(np.arange(10))
    >>> change = detect_changes(noise, np.ones(4000), np.ones(4000, bool), 4000.0)
    >>> bool(change.probability[2005] > 0.99), bool(np.median(change.probability) < 0.01)
    (True, True)
    """
    # On a line that is long compared with the wavelengths the ends do not disturb the transform.
    envelope = np.abs(np.asarray(hilbert(np.where(known, rate, 0.0)))) ** 2 / deviation**2
    nodes = np.flatnonzero(known)[:: max(1, np.count_nonzero(known) // _MAX_NODES)]
    share, R = _maximum_likelihood(envelope[nodes], deviation[nodes], independent_count)
    ratio = share * _likelihood_ratio(envelope, deviation, R)
    probability = np.where(known, ratio / (ratio + 1.0 - share), 0.0)
    return ChangeProbability(probability, R**2 / (R**2 + deviation**2))


def _maximum_likelihood(
    envelope: Array, deviation: Array, independent_count: float
) -> tuple[float, float]:
    """Share π of track that changes and the standard deviation R of its rates; π = 0 unless the gain suffices."""
    scale = float(np.median(deviation)) if deviation.size else 1.0
    weight = min(1.0, independent_count / max(envelope.size, 1))
    largest, estimate = _MIN_LOG_LIKELIHOOD_RATIO, (0.0, scale)
    for relative_deviation in _RATE_DEVIATIONS:
        log_ratio = np.log(_likelihood_ratio(envelope, deviation, relative_deviation * scale))
        for share in _CHANGING_SHARES:
            log_unchanged = np.log1p(-min(share, 1 - 1e-12))
            gain = weight * float(np.logaddexp(log_unchanged, np.log(share) + log_ratio).sum())
            if gain > largest:
                largest, estimate = gain, (float(share), float(relative_deviation * scale))
    return estimate


def _likelihood_ratio(envelope: Array, deviation: Array, R: float) -> Array:
    """Likelihood of changing track over that of unchanged track."""
    r = (R / deviation) ** 2
    return np.exp(np.minimum(0.5 * envelope * r / (1.0 + r), 600.0)) / (1.0 + r)

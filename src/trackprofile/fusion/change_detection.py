"""Which places move: most track stays as it is, and a rate that noise explains is none.

In each range of waves the rate fitted at a place, of standard deviation s, is that of track that stands,
or that of track that moves, whose rates have the standard deviation R. The share π of track that moves,
and R, are those that make the rates along the line most probable; so each place moves with a
probability p, and the rate believed is p q ρ, q = R²/(R² + s²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert

Array = NDArray[np.float64]

_RATIOS = np.geomspace(0.3, 300.0, 31)  # R over the median of s
_MOST = 5000  # places that are asked
_WORTH = 3.0  # logarithm of the likelihood that has to be gained before anything moves
_SHARES = np.geomspace(1e-4, 1.0, 25)  # π


@dataclass(frozen=True, eq=False)
class Moving:
    """How far the rates of one range are believed.

    Parameters
    ----------
    probability : that a place moves (k)
    kept : share of its rate that is believed if it moves (k)
    """

    probability: Array
    kept: Array


def detect_changes(rate: Array, deviation: Array, known: NDArray[np.bool_], count: float) -> Moving:
    """Tell track that moves from track that stands.

    The two parts of the rate's envelope, itself and its Hilbert transform, are judged together, or a place
    would stand wherever its wave crosses zero.

    Parameters
    ----------
    rate : fitted, in a few waves (k) [m/day]
    deviation : standard deviation of it (k) [m/day]
    known : where there is one (k)
    count : of independent waves along the line: as often is it asked, however close the places

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(4000)
    >>> noise[2000:2010] += 30 * np.cos(np.arange(10))
    >>> found = moving(noise, np.ones(4000), np.ones(4000, bool), 4000.0)
    >>> bool(found.probability[2005] > 0.99), bool(np.median(found.probability) < 0.01)
    (True, True)
    """
    # The transform has no odd points or ends of its own if the line is long against the waves.
    envelope = np.abs(np.asarray(hilbert(np.where(known, rate, 0.0)))) ** 2 / deviation**2
    some = np.flatnonzero(known)[:: max(1, np.count_nonzero(known) // _MOST)]
    seen, scale = envelope[some], float(np.median(deviation[some])) if some.size else 1.0
    each = min(1.0, count / max(seen.size, 1))
    best, found = _WORTH, (0.0, scale)
    for ratio in _RATIOS:
        more = np.log(_odds(seen, deviation[some], ratio * scale))
        for share in _SHARES:
            stands = np.log1p(-min(share, 1 - 1e-12))
            gained = each * float(np.logaddexp(stands, np.log(share) + more).sum())
            if gained > best:
                best, found = gained, (float(share), float(ratio * scale))
    share, R = found
    odds = share * _odds(envelope, deviation, R)
    probability = np.where(known, odds / (odds + 1.0 - share), 0.0)
    return Moving(probability, R**2 / (R**2 + deviation**2))


def _odds(envelope: Array, deviation: Array, R: float) -> Array:
    """Likelihood of track that moves over that of track that stands."""
    more = (R / deviation) ** 2
    return np.exp(np.minimum(0.5 * envelope * more / (1.0 + more), 600.0)) / (1.0 + more)

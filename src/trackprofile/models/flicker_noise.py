"""Flicker, the 1/f noise of a sensor, as a sum of first-order Gauss-Markov processes: one to a decade of frequency.

One of variance σ² and corner f_k has the one-sided density (2σ²/π f_k) / (1 + (f/f_k)²). Corners a factor ρ apart, each
of σ² = F² ln ρ, add up to F²/f but for a ripple of 2/cosh(π²/ln ρ): 0.25 dB for a decade. A decade is left out where
white noise or the walk of the offset drowns its flicker. White noise, flicker and walk together are then less than
0.6 dB below what they should be, and 0.3 dB above, from 3 mHz up to ``HIGHEST``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.models.sensor import Sensor

Array = NDArray[np.float64]

LOWEST, HIGHEST = 1e-3, 10.0
"""Hz: what is slower is as good as constant in a block of a ride; at 30 m/s D1 begins with what is as fast."""

DROWNED = 0.1
"""Share of white noise and walk that flicker has to reach within a decade, or it is left out there."""

TINY = 1e-150
"""In place of a noise that is 0."""

DECADE = 10.0
"""Ratio of the corners' frequencies, ρ."""


@dataclass(frozen=True)
class Processes:
    """Independent ones, ṗ = -ω p + noise: ``rate`` ω (k,), rad/s, and ``variance`` (k,), sensor's unit squared."""

    rate: Array
    variance: Array

    def density(self, frequency: Array) -> Array:
        """One-sided density of their sum at the frequencies (m,) in Hz; (m,), sensor's unit squared per Hz."""
        turn = 2 * np.pi * np.asarray(frequency)[:, None]
        return np.sum(4 * self.variance * self.rate / (self.rate**2 + turn**2), axis=1)


def processes(sensor: Sensor) -> Processes:
    """The processes that stand for a sensor's flicker; none where it states none, or all of it drowns.

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=3e-4, flicker=8e-5)
    >>> processes(floor).rate / (2 * np.pi)  # Hz
    array([0.00316228, 0.03162278, 0.31622777])
    """
    flicker = sensor.flicker or 0.0
    edges = np.geomspace(LOWEST, HIGHEST, 1 + round(np.log(HIGHEST / LOWEST) / np.log(DECADE)))
    kept = _clearest(sensor, edges[:-1], edges[1:]) > DROWNED
    corner = np.sqrt(edges[:-1] * edges[1:])[kept]
    variance = np.full(len(corner), flicker**2 * np.log(DECADE))
    # The outermost stand for all beyond too, which in between add as much as they do over ρ - 1.
    variance[:1] += flicker**2 * np.log(DECADE) / (DECADE - 1)
    variance[-1:] += flicker**2 * np.log(DECADE) / (DECADE - 1)
    return Processes(2 * np.pi * corner, variance)


def _clearest(sensor: Sensor, low: Array, high: Array) -> Array:
    """Flicker over white noise and walk, where that is greatest between each pair of frequencies, (k,) as powers.

    F² f / (N² f² + W²), W = √2 D/2π, is greatest at f = W/N.
    """
    white, walk = sensor.noise_density or 0.0, np.sqrt(2) * sensor.drift_rate / (2 * np.pi)
    f = np.clip(walk / max(white, TINY), low, high)
    drowning = np.maximum(np.square(white * f) + walk**2, TINY)
    return np.square(sensor.flicker or 0.0) * f / drowning

"""Flicker (1/f) noise of a sensor as a sum of first-order Gauss-Markov processes, one per decade of frequency.

A process of variance σ² and corner frequency f_k has the one-sided density (2σ²/π f_k) / (1 + (f/f_k)²). Processes
whose corner frequencies are a factor ρ apart, each of variance σ² = F² ln ρ, add up to F²/f with a ripple of
2/cosh(π²/ln ρ), which is 0.25 dB for ρ = 10. A decade is omitted where white noise or the random walk of the offset
dominates the flicker. The sum of white noise, flicker and random walk then deviates from the stated density by less
than -0.6 dB and +0.3 dB between 3 mHz and ``HIGHEST_FREQUENCY``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.models.sensor import Sensor

Array = NDArray[np.float64]

LOWEST_FREQUENCY, HIGHEST_FREQUENCY = 1e-3, 10.0
"""Hz. Slower noise is constant within one block of a run; the wavelengths of D1 begin near 10 Hz at 30 m/s."""

MINIMUM_RATIO = 0.1
"""Ratio of the flicker's density to white noise plus random walk, below which a decade is omitted."""

MINIMUM_NOISE = 1e-150
"""Replaces a noise of 0 in divisions, in the sensor's unit."""

CORNER_RATIO = 10.0
"""Ratio ρ of neighbouring corner frequencies."""


@dataclass(frozen=True)
class FlickerProcesses:
    """Independent processes ṗ = -ω p + noise.

    Parameters
    ----------
    rate : ω, (k,), rad/s
    variance : stationary variance of p, (k,), sensor's unit squared
    """

    rate: Array
    variance: Array

    def density(self, frequency: Array) -> Array:
        """One-sided power spectral density of the sum of the processes.

        Parameters
        ----------
        frequency : (m,), Hz

        Returns
        -------
        (m,), sensor's unit squared per Hz
        """
        omega = 2 * np.pi * np.asarray(frequency)[:, None]
        return np.sum(4 * self.variance * self.rate / (self.rate**2 + omega**2), axis=1)


def flicker_processes(sensor: Sensor) -> FlickerProcesses:
    """Processes that represent a sensor's flicker noise.

    There are none where the sensor states no flicker, or where other noise dominates it in every decade.

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=3e-4, flicker=8e-5)
    >>> flicker_processes(floor).rate / (2 * np.pi)  # Hz
    array([0.00316228, 0.03162278, 0.31622777])
    """
    flicker = sensor.flicker or 0.0
    decades = round(np.log(HIGHEST_FREQUENCY / LOWEST_FREQUENCY) / np.log(CORNER_RATIO))
    edges = np.geomspace(LOWEST_FREQUENCY, HIGHEST_FREQUENCY, 1 + decades)
    kept = _maximum_ratio(sensor, edges[:-1], edges[1:]) > MINIMUM_RATIO
    corner = np.sqrt(edges[:-1] * edges[1:])[kept]
    variance = np.full(len(corner), flicker**2 * np.log(CORNER_RATIO))
    # The first and the last process also represent all decades beyond them, which add 1/(ρ - 1) of one decade.
    variance[:1] += flicker**2 * np.log(CORNER_RATIO) / (CORNER_RATIO - 1)
    variance[-1:] += flicker**2 * np.log(CORNER_RATIO) / (CORNER_RATIO - 1)
    return FlickerProcesses(2 * np.pi * corner, variance)


def _maximum_ratio(sensor: Sensor, low: Array, high: Array) -> Array:
    """Maximum over low..high (Hz, (k,)) of the density of flicker over that of white noise and random walk, (k,).

    F² f / (N² f² + W²) with W = √2 D/2π has its maximum at f = W/N.
    """
    white, walk = sensor.noise_density or 0.0, np.sqrt(2) * sensor.drift_rate / (2 * np.pi)
    f = np.clip(walk / max(white, MINIMUM_NOISE), low, high)
    other_noise = np.maximum(np.square(white * f) + walk**2, MINIMUM_NOISE)
    return np.square(sensor.flicker or 0.0) * f / other_noise

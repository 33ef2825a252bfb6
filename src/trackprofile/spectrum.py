"""Power spectral densities of track irregularity, one-sided, in m²/(rad/m) over Ω in rad/m."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spectrum:
    """The rational spectrum S(Ω) = A Ωc² / ((Ω² + Ωr²)(Ω² + Ωc²)) (theory, section 7).

    Parameters
    ----------
    name : what it is called
    amplitude : A, m² rad/m
    lower : Ωr, rad/m, below which long waves level off
    upper : Ωc, rad/m, beyond which short waves fall faster
    source : where the numbers come from

    Examples
    --------
    >>> fra6 = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)
    >>> round(1e3 * fra6.standard_deviation(3.0, 25.0), 2)  # mm in D1
    1.9
    """

    name: str
    amplitude: float
    lower: float
    upper: float
    source: str = ""

    def __post_init__(self) -> None:
        if not (self.amplitude > 0 and self.upper > self.lower > 0):
            raise ModelError(
                f"spectrum {self.name!r} needs amplitude > 0 and upper > lower > 0 rad/m, got "
                f"{self.amplitude}, {self.upper} and {self.lower}"
            )

    @property
    def variance(self) -> float:
        """∫ S dΩ = A Ωc² π / (2 Ωr Ωc (Ωr + Ωc)), m²."""
        return self.amplitude * np.pi * self.upper / (2 * self.lower * (self.lower + self.upper))

    def density(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), for Ω in rad/m."""
        square = np.square(spatial_frequency)
        return (
            self.amplitude * self.upper**2 / ((square + self.lower**2) * (square + self.upper**2))
        )

    def standard_deviation(self, shortest: float, longest: float) -> float:
        """Root of ∫ S dΩ over the wavelengths ``shortest`` to ``longest``, m."""
        low, high = 2 * np.pi / longest, 2 * np.pi / shortest
        a, b = self.lower, self.upper
        integral = (np.arctan(high / a) - np.arctan(low / a)) / a
        integral -= (np.arctan(high / b) - np.arctan(low / b)) / b
        return float(np.sqrt(self.amplitude * b**2 / (b**2 - a**2) * integral))


@dataclass(frozen=True)
class MarkovProfile:
    """The spectrum as a process over evenly spaced points: c_i = a1 c_(i-1) + a2 c_(i-2) + w_i.

    ``innovation`` is the variance of w, ``variance`` the stationary one of c, both m².
    """

    a1: float
    a2: float
    innovation: float
    variance: float

    def covariance(self, count: int) -> Array:
        """Stationary covariance of ``count`` neighbouring points, (count, count), m²."""
        lags = np.empty(max(count, 2))
        lags[0], lags[1] = 1.0, self.a1 / (1.0 - self.a2)
        for k in range(2, count):
            lags[k] = self.a1 * lags[k - 1] + self.a2 * lags[k - 2]
        index = np.arange(count)
        return self.variance * lags[np.abs(index[:, None] - index)]


def markov(spectrum: Spectrum, spacing: float) -> MarkovProfile:
    """The second-order Markov process with the spectrum's poles and variance (theory, section 7).

    a1 = e^(-Ωr h) + e^(-Ωc h), a2 = -e^(-(Ωr + Ωc) h); the innovation's variance follows from the stationary one.

    Parameters
    ----------
    spacing : h, m
    """
    r, c = np.exp(-spectrum.lower * spacing), np.exp(-spectrum.upper * spacing)
    a1, a2 = r + c, -r * c
    # Yule-Walker: γ0 (1 - a2)(1 - a1 - a2)(1 + a1 - a2)... written in the poles, which lose no digits.
    share = (1 - r * r) * (1 - c * c) * (1 - r * c) / (1 + r * c)
    return MarkovProfile(
        float(a1), float(a2), float(spectrum.variance * share), float(spectrum.variance)
    )


def scaled(spectrum: Spectrum, factor: float) -> Spectrum:
    """The same shape with ``factor`` times the density."""
    return replace(spectrum, amplitude=spectrum.amplitude * factor)


def draw(
    spectrum: Spectrum, distance: Array, generator: np.random.Generator, shortest: float = 0.5
) -> Array:
    """A random profile with that spectrum, m, at evenly or unevenly spaced ``distance`` (n,) in m.

    Sums cosines r = Σ √(2 S ΔΩ) cos(Ω x + φ) with random phases, from the shortest wavelength to ten times
    the length, spaced so that the sum does not repeat over the length.
    """
    length = float(distance[-1] - distance[0])
    step = np.pi / (2 * max(length, 100.0))
    omega = (np.arange(int(2 * np.pi / shortest / step)) + generator.random()) * step
    omega = omega[omega > 0].astype(np.float64)
    amplitude = np.sqrt(2 * spectrum.density(omega) * step)
    phase = generator.uniform(0, 2 * np.pi, len(omega))
    result = np.zeros(len(distance))
    for part in np.array_split(
        np.arange(len(omega)), max(1, len(omega) * len(distance) // 2_000_000)
    ):
        result += np.cos(np.outer(distance, omega[part]) + phase[part]) @ amplitude[part]
    return result

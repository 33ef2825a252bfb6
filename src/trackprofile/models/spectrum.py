"""Power spectral densities of track irregularity, one-sided, in m²/(rad/m) over Ω in rad/m."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

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
class SpectrumSegment:
    """A power law that may bend: S₀ (Ω/Ω₀)^-slope (1 + (Ω/Ωk)^sharpness)^(-fall/sharpness).

    Parameters
    ----------
    density : S₀, m²/(rad/m), at Ω₀ where there is no knee
    at : Ω₀, rad/m
    slope : by which the density falls below the knee; a slope of 2 is S ∝ Ω⁻²
    upper : up to which Ω the piece holds, rad/m
    knee : Ωk, rad/m
    fall : how much steeper it is beyond the knee
    sharpness : of the bend

    Examples
    --------
    >>> SpectrumSegment(density=1e-6, at=1.0, slope=2.0).density_at(np.array([1.0, 2.0]))
    array([1.0e-06, 2.5e-07])
    """

    density: float
    at: float
    slope: float
    upper: float = np.inf
    knee: float = np.inf
    fall: float = 0.0
    sharpness: float = 1.0

    def density_at(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), wherever the piece holds, for Ω in rad/m."""
        straight = self.density * (spatial_frequency / self.at) ** -self.slope
        bend = 1 + (spatial_frequency / self.knee) ** self.sharpness
        return straight * bend ** (-self.fall / self.sharpness)


@dataclass(frozen=True)
class PowerLaw:
    """A spectrum of one or more power laws, known between two wavelengths and nowhere else.

    Parameters
    ----------
    name : what it is called
    pieces : from long waves to short; each holds from the one before up to its ``upper``
    shortest, longest : wavelengths between which it is known, m
    source : where the numbers come from

    Raises
    ------
    ModelError : the pieces do not follow one another, or a number is not above 0.

    Examples
    --------
    >>> flat = PowerLaw("flat", (SpectrumSegment(1e-6, at=1.0, slope=0.0),), shortest=1.0, longest=100.0)
    >>> round(1e3 * flat.standard_deviation(3.0, 25.0), 3)  # √(1e-6 (2π/3 - 2π/25)) m
    1.358
    """

    name: str
    pieces: tuple[SpectrumSegment, ...]
    shortest: float
    longest: float
    source: str = ""

    def __post_init__(self) -> None:
        if not 0 < self.shortest < self.longest:
            raise ModelError(
                f"spectrum {self.name!r} needs 0 < shortest < longest wavelength, got "
                f"{self.shortest} m and {self.longest} m"
            )
        uppers = [0.0, *(piece.upper for piece in self.pieces)]
        if not all(a < b for a, b in pairwise(uppers)) or uppers[-1] < 2 * np.pi / self.shortest:
            raise ModelError(
                f"spectrum {self.name!r} needs pieces in the order of their upper end, the last beyond "
                f"{2 * np.pi / self.shortest:g} rad/m, got {uppers[1:]}"
            )
        for piece in self.pieces:
            if not min(piece.density, piece.at, piece.knee, piece.sharpness) > 0:
                raise ModelError(
                    f"spectrum {self.name!r} needs density, at, knee and sharpness above 0, got {piece}"
                )

    def density(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), for Ω in rad/m.

        Raises
        ------
        ModelError : a wavelength is longer or shorter than those for which it is known.
        """
        omega = np.asarray(spatial_frequency, dtype=np.float64)
        if omega.size:
            self._known(2 * np.pi / float(omega.max()), 2 * np.pi / float(omega.min()))
        which = np.searchsorted([piece.upper for piece in self.pieces[:-1]], omega)
        density = np.empty_like(omega)
        for number, piece in enumerate(self.pieces):
            density[which == number] = piece.density_at(omega[which == number])
        return density

    def standard_deviation(self, shortest: float, longest: float) -> float:
        """Root of ∫ S dΩ over the wavelengths ``shortest`` to ``longest``, m.

        Raises
        ------
        ModelError : as of `density`.
        """
        self._known(shortest, longest)
        low, high = 2 * np.pi / longest, 2 * np.pi / shortest
        inner = [piece.upper for piece in self.pieces[:-1] if low < piece.upper < high]
        ends = np.log([low, *inner, high])
        # Over ln Ω a power law is an exponential, and a knee is smooth: Gauss is exact to rounding.
        node, weight = np.polynomial.legendre.leggauss(64)
        half, middle = np.diff(ends)[:, None] / 2, (ends[1:] + ends[:-1])[:, None] / 2
        omega = np.exp(middle + half * node)
        return float(np.sqrt(np.sum(half * weight * omega * self.density(omega))))

    def _known(self, shortest: float, longest: float) -> None:
        rounding = 1e-9
        if shortest < self.shortest * (1 - rounding) or longest > self.longest * (1 + rounding):
            raise ModelError(
                f"spectrum {self.name!r} is known for wavelengths of {self.shortest:g} m to "
                f"{self.longest:g} m, got {shortest:g} m to {longest:g} m; stay within"
            )


Roughness = Spectrum | PowerLaw
"""Any spectrum of track irregularity."""


def require_rational(roughness: Roughness) -> Spectrum:
    """The spectrum, if it is of the rational form, which alone can be the prior of an estimate.

    Raises
    ------
    ModelError : it is of another form.
    """
    if isinstance(roughness, PowerLaw):
        raise ModelError(
            f"spectrum {roughness.name!r} is a power law, which no process of second order has and so "
            "no prior can be; choose one with amplitude, lower and upper, such as german-low"
        )
    return roughness


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


def markov_process(spectrum: Spectrum, spacing: float) -> MarkovProfile:
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


def scale_density(spectrum: Spectrum, factor: float) -> Spectrum:
    """The same shape with ``factor`` times the density."""
    return replace(spectrum, amplitude=spectrum.amplitude * factor)


def random_profile(
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

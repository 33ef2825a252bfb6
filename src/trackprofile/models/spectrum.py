"""Power spectral densities of track irregularity: one-sided, in m²/(rad/m) over the spatial frequency Ω in rad/m."""

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
    name : name of the spectrum
    amplitude : A, m² rad/m
    corner_low : Ωr, lower corner frequency, below which the density is constant, rad/m
    corner_high : Ωc, upper corner frequency, above which the density falls as Ω⁻⁴, rad/m
    source : source of the numbers

    Raises
    ------
    ModelError : not amplitude > 0 and corner_high > corner_low > 0.

    Examples
    --------
    >>> fra6 = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)
    >>> round(1e3 * fra6.standard_deviation(3.0, 25.0), 2)  # mm in D1
    1.9
    """

    name: str
    amplitude: float
    corner_low: float
    corner_high: float
    source: str = ""

    def __post_init__(self) -> None:
        if not (self.amplitude > 0 and self.corner_high > self.corner_low > 0):
            raise ModelError(
                f"spectrum {self.name!r} needs amplitude > 0 and corner_high > corner_low > 0 rad/m, got "
                f"{self.amplitude}, {self.corner_high} and {self.corner_low}"
            )

    @property
    def variance(self) -> float:
        """Variance of the profile: ∫ S dΩ = A Ωc² π / (2 Ωr Ωc (Ωr + Ωc)), m²."""
        return (
            self.amplitude
            * np.pi
            * self.corner_high
            / (2 * self.corner_low * (self.corner_low + self.corner_high))
        )

    def density(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), for Ω in rad/m."""
        square = np.square(spatial_frequency)
        return (
            self.amplitude
            * self.corner_high**2
            / ((square + self.corner_low**2) * (square + self.corner_high**2))
        )

    def standard_deviation(self, shortest: float, longest: float) -> float:
        """Root of ∫ S dΩ over the wavelengths ``shortest`` to ``longest``, m."""
        low, high = 2 * np.pi / longest, 2 * np.pi / shortest
        a, b = self.corner_low, self.corner_high
        integral = (np.arctan(high / a) - np.arctan(low / a)) / a
        integral -= (np.arctan(high / b) - np.arctan(low / b)) / b
        return float(np.sqrt(self.amplitude * b**2 / (b**2 - a**2) * integral))


@dataclass(frozen=True)
class SpectrumSegment:
    """A power law, optionally with a corner: S₀ (Ω/Ω₀)^-slope (1 + (Ω/Ωk)^sharpness)^(-added_slope/sharpness).

    Parameters
    ----------
    density : S₀, density at Ω₀ without the corner, m²/(rad/m)
    reference_frequency : Ω₀, rad/m
    slope : negative exponent below the corner; a slope of 2 is S ∝ Ω⁻²
    end : highest Ω at which the segment holds, rad/m
    corner_frequency : Ωk, rad/m
    added_slope : increase of the slope above the corner
    sharpness : sharpness of the corner

    Examples
    --------
    >>> SpectrumSegment(density=1e-6, reference_frequency=1.0, slope=2.0).density_at(np.array([1.0, 2.0]))
    array([1.0e-06, 2.5e-07])
    """

    density: float
    reference_frequency: float
    slope: float
    end: float = np.inf
    corner_frequency: float = np.inf
    added_slope: float = 0.0
    sharpness: float = 1.0

    def density_at(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), for Ω in rad/m within the segment."""
        straight = self.density * (spatial_frequency / self.reference_frequency) ** -self.slope
        bend = 1 + (spatial_frequency / self.corner_frequency) ** self.sharpness
        return straight * bend ** (-self.added_slope / self.sharpness)


@dataclass(frozen=True)
class PowerLaw:
    """A spectrum of one or more power laws, defined between two wavelengths.

    Parameters
    ----------
    name : name of the spectrum
    segments : in order of increasing Ω; each holds from the end of the one before up to its own ``end``
    shortest, longest : wavelengths between which the spectrum is defined, m
    source : source of the numbers

    Raises
    ------
    ModelError : the ends of the segments do not increase, or a number is not above 0.

    Examples
    --------
    >>> constant = SpectrumSegment(density=1e-6, reference_frequency=1.0, slope=0.0)
    >>> flat = PowerLaw("flat", (constant,), shortest=1.0, longest=100.0)
    >>> round(1e3 * flat.standard_deviation(3.0, 25.0), 3)  # √(1e-6 (2π/3 - 2π/25)) m
    1.358
    """

    name: str
    segments: tuple[SpectrumSegment, ...]
    shortest: float
    longest: float
    source: str = ""

    def __post_init__(self) -> None:
        if not 0 < self.shortest < self.longest:
            raise ModelError(
                f"spectrum {self.name!r} needs 0 < shortest < longest wavelength, got "
                f"{self.shortest} m and {self.longest} m"
            )
        ends = [0.0, *(segment.end for segment in self.segments)]
        if not all(a < b for a, b in pairwise(ends)) or ends[-1] < 2 * np.pi / self.shortest:
            raise ModelError(
                f"spectrum {self.name!r} needs segments with increasing ends, the last at least "
                f"{2 * np.pi / self.shortest:g} rad/m, got {ends[1:]}"
            )
        for segment in self.segments:
            if (
                not min(
                    segment.density,
                    segment.reference_frequency,
                    segment.corner_frequency,
                    segment.sharpness,
                )
                > 0
            ):
                raise ModelError(
                    f"spectrum {self.name!r} needs density, at, knee and sharpness above 0, got {segment}"
                )

    def density(self, spatial_frequency: Array) -> Array:
        """S(Ω), m²/(rad/m), for Ω in rad/m.

        Raises
        ------
        ModelError : a wavelength is outside the range for which the spectrum is defined.
        """
        omega = np.asarray(spatial_frequency, dtype=np.float64)
        if omega.size:
            self._check_range(2 * np.pi / float(omega.max()), 2 * np.pi / float(omega.min()))
        which = np.searchsorted([segment.end for segment in self.segments[:-1]], omega)
        density = np.empty_like(omega)
        for number, segment in enumerate(self.segments):
            density[which == number] = segment.density_at(omega[which == number])
        return density

    def standard_deviation(self, shortest: float, longest: float) -> float:
        """Root of ∫ S dΩ over the wavelengths ``shortest`` to ``longest``, m.

        Raises
        ------
        ModelError : as for `density`.
        """
        self._check_range(shortest, longest)
        low, high = 2 * np.pi / longest, 2 * np.pi / shortest
        inner = [segment.end for segment in self.segments[:-1] if low < segment.end < high]
        ends = np.log([low, *inner, high])
        # Over ln Ω a power law is an exponential and a corner is smooth: Gauss quadrature is exact to round-off.
        node, weight = np.polynomial.legendre.leggauss(64)
        half, middle = np.diff(ends)[:, None] / 2, (ends[1:] + ends[:-1])[:, None] / 2
        omega = np.exp(middle + half * node)
        return float(np.sqrt(np.sum(half * weight * omega * self.density(omega))))

    def _check_range(self, shortest: float, longest: float) -> None:
        rounding = 1e-9
        if shortest < self.shortest * (1 - rounding) or longest > self.longest * (1 + rounding):
            raise ModelError(
                f"spectrum {self.name!r} is defined for wavelengths of {self.shortest:g} m to "
                f"{self.longest:g} m, got {shortest:g} m to {longest:g} m; choose wavelengths in that range"
            )


Roughness = Spectrum | PowerLaw
"""Any spectrum of track irregularity; see `require_rational` for those that can be a prior."""


def require_rational(roughness: Roughness) -> Spectrum:
    """The spectrum itself if it has the rational form, the only one that can be the prior of an estimate.

    Raises
    ------
    ModelError : it has another form.
    """
    if isinstance(roughness, PowerLaw):
        raise ModelError(
            f"spectrum {roughness.name!r} is a power law, which is not the spectrum of a second-order Markov process "
            "and cannot be a prior; choose one with amplitude, corner_low and corner_high, such as german-low"
        )
    return roughness


@dataclass(frozen=True)
class MarkovProfile:
    """A second-order autoregressive process over evenly spaced points: c_i = a1 c_(i-1) + a2 c_(i-2) + w_i.

    Parameters
    ----------
    a1, a2 : coefficients
    innovation : variance of w, m²
    variance : stationary variance of c, m²
    """

    a1: float
    a2: float
    innovation: float
    variance: float

    def covariance(self, count: int) -> Array:
        """Stationary covariance of ``count`` consecutive points, (count, count), m²."""
        lags = np.empty(max(count, 2))
        lags[0], lags[1] = 1.0, self.a1 / (1.0 - self.a2)
        for k in range(2, count):
            lags[k] = self.a1 * lags[k - 1] + self.a2 * lags[k - 2]
        index = np.arange(count)
        return self.variance * lags[np.abs(index[:, None] - index)]


def markov_process(spectrum: Spectrum, spacing: float) -> MarkovProfile:
    """The second-order Markov process with the poles and the variance of a spectrum (theory, section 7).

    a1 = e^(-Ωr h) + e^(-Ωc h), a2 = -e^(-(Ωr + Ωc) h); the variance of the innovation follows from the stationary
    variance.

    Parameters
    ----------
    spacing : h, distance between points, m
    """
    r, c = np.exp(-spectrum.corner_low * spacing), np.exp(-spectrum.corner_high * spacing)
    a1, a2 = r + c, -r * c
    # The Yule-Walker equations, γ0 (1 - a2)(1 - a1 - a2)(1 + a1 - a2)..., in terms of the poles to avoid cancellation.
    share = (1 - r * r) * (1 - c * c) * (1 - r * c) / (1 + r * c)
    return MarkovProfile(
        float(a1), float(a2), float(spectrum.variance * share), float(spectrum.variance)
    )


def scale_density(spectrum: Spectrum, factor: float) -> Spectrum:
    """The same spectrum with ``factor`` times the density."""
    return replace(spectrum, amplitude=spectrum.amplitude * factor)


def random_profile(
    spectrum: Spectrum, distance: Array, generator: np.random.Generator, shortest: float = 0.5
) -> Array:
    """A random profile with a given spectrum at given distances.

    It is a sum of cosines r = Σ √(2 S ΔΩ) cos(Ω x + φ) with random phases, with wavelengths from ``shortest`` to ten
    times the length, spaced so that the sum does not repeat over the length. `irregularity.random_irregularity` gives
    a profile with derivatives at any distance.

    Parameters
    ----------
    distance : (n,), evenly or unevenly spaced, m
    generator : random generator
    shortest : shortest wavelength, m

    Returns
    -------
    (n,), m
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

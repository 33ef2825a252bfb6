"""The unloaded profile of a track as functions: elevation, slope and curvature at any distance.

A train on an elastic track needs r, r' and r'' of the profile under each wheel. Finite differences of a
sampled profile would cause an error of a sixth of the acceleration at a typical step, so a profile here is a
formula or a spline. Each class has the method

    at(distance (n,) [m]) -> (3, n): r [m], r' = dr/dx [-], r'' = d²r/dx² [1/m]; up is positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_interp_spline

from trackprofile.errors import DataError, ModelError
from trackprofile.models.cosine_kernels import sum_cosines

Array = NDArray[np.float64]

_MINIMUM_COSINES = 1000
_CHUNK = 1 << 18  # cosines evaluated at a time


class Irregularity(Protocol):
    """An unloaded profile that a wheel runs over."""

    def at(self, distance: Array) -> Array:
        """Elevation r [m], slope r' [-] and curvature r'' [1/m] at ``distance`` (n,) [m]; (3, n)."""
        ...


class Density(Protocol):
    """A spectrum: a one-sided power spectral density over Ω."""

    def density(self, spatial_frequency: Array) -> Array:
        """S(Ω) [m²/(rad/m)] for Ω [rad/m]."""
        ...


@dataclass(frozen=True)
class Flat:
    """A level profile without irregularity.

    Examples
    --------
    >>> Flat().at(np.array([7.0])).ravel()
    array([0., 0., 0.])
    """

    def at(self, distance: Array) -> Array:
        """Zeros (3, n)."""
        return np.zeros((3, len(distance)))


@dataclass(frozen=True)
class Bell:
    """An inverted bell, r = -depth exp(-(x - centre)² / (2 width²)).

    O'Brien, Bowe, Quirke and Cantero 2017, doi 10.1177/0954409716664936, use 2 mm and 0.5 m, and
    40 mm and 10 m.

    Parameters
    ----------
    depth : depth at the centre, positive down [m]
    width : standard deviation of the bell [m]
    centre : distance of the deepest point [m]

    Raises
    ------
    ModelError : a width that is not above 0.

    Examples
    --------
    >>> Bell(depth=0.002, width=0.5, centre=5.0).at(np.array([5.0])).ravel()
    array([-0.002,  0.   ,  0.008])
    """

    depth: float
    width: float
    centre: float

    def __post_init__(self) -> None:
        _check_positive("Bell", "width", self.width)

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m], (3, n)."""
        u = (distance - self.centre) / self.width
        bell = -self.depth * np.exp(-(u**2) / 2)
        return np.stack([bell, -u * bell / self.width, (u**2 - 1) * bell / self.width**2])


@dataclass(frozen=True)
class Dip:
    """Dipped rail joints, r = -depth/2 (1 + cos(π (x - joint) / half_length)) within half_length.

    The versed sine is a common model of a low joint. The curvature jumps by
    π² depth / (2 half_length²) at each end of the dip.

    Parameters
    ----------
    depth : depth at the joint, positive down [m]
    half_length : distance from the joint to where the rail is level again [m]
    position : distance of the first joint [m]
    count : number of joints
    spacing : distance between joints, the length of a rail; not used with one joint [m]

    Raises
    ------
    ModelError : a half_length not above 0, no joint, or joints that overlap.

    Examples
    --------
    >>> joints = Dip(depth=0.004, half_length=0.5, position=10.0, count=3, spacing=25.0)
    >>> joints.at(np.array([10.0, 10.5, 59.75]))[0]
    array([-0.004,  0.   , -0.002])
    """

    depth: float
    half_length: float
    position: float
    count: int = 1
    spacing: float = 25.0

    def __post_init__(self) -> None:
        _check_positive("Dip", "half_length", self.half_length)
        if self.count < 1:
            raise ModelError(f"Dip: expected a count of at least 1, got {self.count}.")
        if self.count > 1 and not self.spacing >= 2 * self.half_length:
            raise ModelError(
                f"Dip: expected joints at least {2 * self.half_length:g} m apart, twice the "
                f"half_length, got a spacing of {self.spacing:g} m; widen it or shorten the dip."
            )

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m], (3, n)."""
        offset = distance - self.position
        if self.count > 1:
            nearest = np.clip(np.rint(offset / self.spacing), 0, self.count - 1)
            offset = offset - nearest * self.spacing
        k = np.pi / self.half_length
        inside = np.abs(offset) < self.half_length
        cosine, sine = np.cos(k * offset), np.sin(k * offset)
        return self.depth / 2 * inside * np.stack([-1 - cosine, k * sine, k**2 * cosine])


@dataclass(frozen=True, eq=False)
class Cosines:
    """A sum of cosines r = w(x) Σ a cos(Ω x + φ) with the taper w.

    With u = (x - start) / taper, w is 0 before start, u³ (10 - 15 u + 6 u²) over the taper and 1
    after it, so that r'' is continuous.

    Parameters
    ----------
    amplitude : a (m,) [m]
    spatial_frequency : Ω (m,) [rad/m]; evenly spaced values are summed much faster
    phase : φ (m,) [rad]
    start : distance at which the profile starts; -∞ means no taper [m]
    taper : length over which the amplitude grows from 0 to full [m]

    Raises
    ------
    ModelError : the arrays differ in shape, or a start is given without a taper.

    Examples
    --------
    >>> wave = Cosines(np.array([0.001]), np.array([0.5]), np.array([0.0]))
    >>> wave.at(np.array([0.0])).ravel()
    array([ 0.001  ,  0.     , -0.00025])
    """

    amplitude: Array
    spatial_frequency: Array
    phase: Array
    start: float = -np.inf
    taper: float = 0.0

    def __post_init__(self) -> None:
        shapes = [np.shape(one) for one in (self.amplitude, self.spatial_frequency, self.phase)]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1:
            raise ModelError(
                "Cosines: expected amplitude, spatial frequency and phase as arrays of one shape "
                f"(m,), got the shapes {', '.join(map(str, shapes))}."
            )
        if np.isfinite(self.start):
            _check_positive("Cosines with a start", "taper", self.taper)

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m], (3, n)."""
        distance = np.ascontiguousarray(distance, dtype=np.float64)
        if not np.isfinite(self.start):
            return self._waves(distance)
        result = np.zeros((3, len(distance)))
        inside = distance > self.start
        s, ds, dds = self._waves(distance[inside])
        u = np.minimum((distance[inside] - self.start) / self.taper, 1.0)
        w = u**3 * (10 - 15 * u + 6 * u**2)
        dw = 30 * (u * (1 - u)) ** 2 / self.taper
        ddw = 60 * u * (1 - u) * (1 - 2 * u) / self.taper**2
        result[:, inside] = w * s, w * ds + dw * s, w * dds + 2 * dw * ds + ddw * s
        return result

    def _waves(self, distance: Array) -> Array:
        """The sum without the taper, (3, n)."""
        result = np.zeros((3, len(distance)))
        omega = np.asarray(self.spatial_frequency, dtype=np.float64)
        if _evenly_spaced(omega):
            coefficient = self.amplitude * np.exp(1j * self.phase)
            step = (omega[-1] - omega[0]) / (len(omega) - 1)
            sum_cosines(distance, omega, step, coefficient.real, coefficient.imag, result)
            return result
        points = max(1, _CHUNK // max(len(omega), 1))
        for first in range(0, len(distance), points):
            part = slice(first, first + points)
            angle = np.multiply.outer(distance[part], omega) + self.phase
            cosine, sine = np.cos(angle), np.sin(angle)
            result[0, part] = cosine @ self.amplitude
            result[1, part] = -sine @ (omega * self.amplitude)
            result[2, part] = -cosine @ (omega**2 * self.amplitude)
        return result


@dataclass(frozen=True, eq=False)
class Sampled:
    """A quintic spline through sampled values, so that r'' is smooth too.

    Parameters
    ----------
    distance : (n,), strictly increasing, n ≥ 6 [m]
    elevation : (n,) [m]

    Raises
    ------
    DataError : fewer than six values, a value that is not finite, or distances that do not increase.

    Examples
    --------
    >>> x = np.arange(0.0, 10.0, 0.5)
    >>> Sampled(x, 1e-3 * x**2).at(np.array([3.3])).ravel().round(9)
    array([0.01089, 0.0066 , 0.002  ])
    """

    distance: Array
    elevation: Array

    def __post_init__(self) -> None:
        if np.shape(self.distance) != np.shape(self.elevation) or np.size(self.distance) < 6:
            raise DataError(
                "Sampled profile: expected six or more distances and as many elevations, got the "
                f"shapes {np.shape(self.distance)} and {np.shape(self.elevation)}."
            )
        if not (np.isfinite(self.distance).all() and np.isfinite(self.elevation).all()):
            raise DataError(
                "Sampled profile: expected finite numbers, got a gap; fill the gap or cut the profile there."
            )
        if not (np.diff(self.distance) > 0).all():
            raise DataError(
                "Sampled profile: expected strictly increasing distances; sort the rows by distance."
            )

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m], (3, n).

        Raises
        ------
        DataError : a distance before the first value or after the last.
        """
        first, last = float(self.distance[0]), float(self.distance[-1])
        # A run that ends at the last value may end beyond it by round-off.
        rounding = 1e-12 * max(abs(first), abs(last), 1.0)
        if len(distance) and not (
            first - rounding <= np.min(distance) and np.max(distance) <= last + rounding
        ):
            raise DataError(
                f"Sampled profile: it covers {first:g} m to {last:g} m, but the run needs "
                f"{np.min(distance):g} m to {np.max(distance):g} m; shorten the run or give a "
                "longer profile."
            )
        return np.stack([self._spline(distance, nu=order) for order in range(3)])

    @cached_property
    def _spline(self) -> BSpline:
        return make_interp_spline(self.distance, self.elevation, k=5)


@dataclass(frozen=True)
class Sum:
    """The sum of several irregularities.

    Examples
    --------
    >>> Sum((Bell(0.002, 0.5, 5.0), Bell(0.001, 0.5, 5.0))).at(np.array([5.0]))[0]
    array([-0.003])
    """

    parts: tuple[Irregularity, ...]

    def at(self, distance: Array) -> Array:
        """r [m], r' [-] and r'' [1/m], (3, n)."""
        return sum((part.at(distance) for part in self.parts), start=Flat().at(distance))


def random_irregularity(
    spectrum: Density,
    generator: np.random.Generator | int,
    shortest: float,
    longest: float,
    *,
    length: float = 0.0,
    start: float = -np.inf,
    taper: float = 0.0,
) -> Cosines:
    """A random profile with a given spectrum: evenly spaced cosines with random phases.

    The amplitudes are a = √(2 S(Ω) ΔΩ) at the centres Ω of equal cells ΔΩ from 2π/longest to 2π/shortest (Shinozuka
    and Deodatis 1991, doi 10.1115/1.3119501), so that the variance of a band is ∫ S dΩ for any phases. There are
    1000 cosines, or more where ``length`` exceeds their common period 2π/ΔΩ, so that the profile does not repeat
    over ``length``.

    Parameters
    ----------
    spectrum : any object with the method ``density``
    generator : random generator or seed; the same seed gives the same profile
    shortest, longest : shortest and longest wavelength [m]
    length : length over which the profile does not repeat [m]
    start, taper : as for `Cosines` [m]

    Raises
    ------
    ModelError : not 0 < shortest < longest, or the spectrum is not defined for these wavelengths.

    Examples
    --------
    >>> from trackprofile.models.spectrum import Spectrum
    >>> fra6 = Spectrum("FRA 6", 1.5e-6, 0.0206, 0.825)
    >>> profile = random_irregularity(fra6, 1, shortest=3.0, longest=25.0)
    >>> round(1e3 * float(np.sum(profile.amplitude**2) / 2) ** 0.5, 2)  # mm, that of fra6 in D1
    1.9
    """
    if not 0 < shortest < longest < np.inf:
        raise ModelError(
            "Random profile: expected 0 < shortest < longest wavelength, got "
            f"{shortest:g} m and {longest:g} m."
        )
    low, high = 2 * np.pi / longest, 2 * np.pi / shortest
    count = max(_MINIMUM_COSINES, int(np.ceil(length * (high - low) / (2 * np.pi))))
    step = (high - low) / count
    omega = low + step * (np.arange(count, dtype=np.float64) + 0.5)
    amplitude = np.sqrt(2 * spectrum.density(omega) * step)
    phase = np.random.default_rng(generator).uniform(0, 2 * np.pi, count)
    return Cosines(amplitude, omega, phase, start, taper)


def _check_positive(what: str, name: str, value: ArrayLike) -> None:
    if not np.all(np.asarray(value) > 0):
        raise ModelError(f"{what}: expected a {name} above 0 m, got {value} m.")


def _evenly_spaced(omega: Array) -> bool:
    """Whether Ω is evenly spaced to within the effect of round-off on the phases."""
    if len(omega) < 2:
        return False
    even = np.linspace(omega[0], omega[-1], len(omega))
    return bool(np.abs(even - omega).max() <= 4 * np.finfo(float).eps * np.abs(omega).max())

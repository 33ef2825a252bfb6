"""Simulated passes of trains over one line, as an ideal smoother would give them: Wiener filter of truth plus noise.

At constant speed the posterior of a long recording has the mean G (z + n), with the gain G = S/(S + N), the prior's
spectrum S and the noise spectrum N of all sensors together, N⁻¹ = Σ |H|²/n², and the error spectrum G N (theory,
section 8). This module shares only the vehicle's response with the code under test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from functools import lru_cache

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, band_pass, edge_distance, gain
from trackprofile.contracts import build_profile, known_elevation
from trackprofile.fusion.fuse import FusionResult
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.irregularity import Dip
from trackprofile.models.receptance import point_track
from trackprofile.models.statespace import state_space, transfer_function

Array = np.ndarray
SPACING = 0.25
FIRST = date(2026, 5, 1)
VEHICLES = ("velaro", "multiple-unit", "intercity-coach")
LEAD_IN = 500.0  # m of track before the start of the line and after its end


@dataclass(frozen=True)
class Line:
    """A line of random track with a settling dip.

    ``settled`` [m] is the settlement in the middle of the dip after 30 days, ``half_length`` [m] the half-length of the
    dip, ``at`` [m] its position.
    """

    length: float = 2000.0
    seed: int = 1
    spectrum: str = "fra-5"
    settled: float = 0.0
    half_length: float = 6.0
    at: float = 1000.0

    @property
    def count(self) -> int:
        return 2 ** int(np.ceil(np.log2((self.length + 2 * LEAD_IN) / SPACING)))

    @property
    def grid(self) -> Array:
        """Distance of all points, periodic [m]."""
        return SPACING * np.arange(self.count) - LEAD_IN

    def omega(self) -> Array:
        return 2 * np.pi * np.fft.rfftfreq(self.count, SPACING)

    def random_coefficients(self, density: Array, seed: int | tuple[int, ...]) -> Array:
        """Random Fourier coefficients of a spectral density, (omega)."""
        size = np.sqrt(density * self.omega()[1] / 4) * self.count
        noise = np.random.default_rng(seed).standard_normal((2, density.size))
        coefficients = (noise[0] + 1j * noise[1]) * size
        coefficients[0] = 0.0
        return coefficients

    def level(self, day: float) -> Array:
        """True elevation on the grid, some days after the first [m]."""
        rough = np.fft.irfft(self.random_coefficients(prior(self), (7, self.seed)), n=self.count)
        if not self.settled:
            return rough
        return rough + Dip(self.settled, self.half_length, self.at).at(self.grid)[0] * day / 30.0


def prior(line: Line) -> Array:
    omega = line.omega()
    density = np.zeros(omega.size)
    density[1:] = read_spectrum(line.spectrum).density(omega[1:])
    density[omega > 2 * np.pi / 0.6] *= (
        1e-6  # the wheels' contact patch averages shorter wavelengths
    )
    return density


@lru_cache(maxsize=64)
def noise(vehicle: str, sensors: str, speed: float, line: Line) -> Array:
    """N(Ω) of all sensors together (omega) [m²/(rad/m)]."""
    omega = line.omega()
    system = state_space(
        read_vehicle(vehicle)[0], point_track(read_track("zhai")), read_sensors(sensors)
    )
    combined = np.full(omega.size, np.inf)
    densities = (
        np.array([one.noise_density for one in read_sensors(sensors)]) ** 2 * speed / (2 * np.pi)
    )
    # The response is smooth: computed on a logarithmic grid and interpolated.
    coarse = np.geomspace(omega[1], omega[-1], 3000)
    information = np.sum(np.abs(transfer_function(system, coarse, speed)) ** 2 / densities, axis=1)
    combined[1:] = np.exp(-np.interp(np.log(omega[1:]), np.log(coarse), np.log(information)))
    return combined


@dataclass(frozen=True)
class Train:
    """A train: its vehicle, speed, odometer error, and faults.

    ``ahead`` [m] is the odometer's offset at the start, ``scale`` its relative scale error. Faults that the profile
    does not state: ``gain`` (factor of the elevation), ``noise_ratio`` (factor of the noise's standard deviation) and
    ``distortion`` (relative error of the elevation at wavelengths around 12 m and 40 m, as with wrong suspension
    stiffness).
    """

    vehicle: str = "velaro"
    speed: float = 40.0
    sensors: str = "bogie-100ug"
    day: int = 0
    seed: int = 0
    ahead: float = 0.0
    scale: float = 0.0
    gain: float = 1.0
    noise_ratio: float = 1.0
    start: float = 0.0
    end: float | None = None
    name: str = ""
    distortion: tuple[float, float] = (0.0, 0.0)


def passing(line: Line, train: Train) -> DatedProfile:
    """The pass of a train, with the distances of its odometer."""
    S, N = prior(line), noise(train.vehicle, train.sensors, train.speed, line)
    with np.errstate(invalid="ignore"):
        G = np.where(np.isfinite(N), S / (S + np.where(np.isfinite(N), N, 1.0)), 0.0)
    posterior = G * np.where(np.isfinite(N), N, 1.0)
    posterior[0] = 0.0
    z = np.fft.rfft(line.level(float(train.day)))
    n = line.random_coefficients(np.where(np.isfinite(N), N, 0.0), (11, line.seed, train.seed))
    low, high = train.distortion
    distorted = (
        1.0
        + (train.gain - 1.0)
        + low * _near(line.omega(), 12.0)
        + high * _near(line.omega(), 40.0)
    )
    mean = np.fft.irfft(G * (distorted * z + train.noise_ratio * n), n=line.count)
    # The odometer reads x + ahead + scale x at the position x.
    counted = line.grid + train.ahead + train.scale * line.grid
    end = line.length if train.end is None else train.end
    ends = np.interp([train.start, end], line.grid, counted)
    distance = np.arange(np.ceil(ends[0] / SPACING), np.floor(ends[1] / SPACING) + 1) * SPACING
    omega = line.omega()
    stated = {
        band.name: np.sqrt(np.trapezoid(posterior * gain(band, omega) ** 2, omega))
        for band in BANDS
    }
    total = np.sqrt(np.trapezoid(posterior, omega))
    name = train.name or f"{train.vehicle} {train.speed:g} m/s, day {train.day}, {train.seed}"
    profile = build_profile(
        distance,
        CubicSpline(counted, mean)(distance),
        kind="posterior",
        method="smoother",
        standard_deviation=np.full(distance.size, total),
        band_standard_deviations={
            one: np.full(distance.size, value) for one, value in stated.items()
        },
        vehicle=train.vehicle,
    )
    return DatedProfile(profile, FIRST + timedelta(days=train.day), name)


def _near(omega: Array, length: float) -> Array:
    """Bell curve around one wavelength, an octave wide: effect of a wrong suspension stiffness."""
    curve = np.zeros(omega.size)
    curve[1:] = np.exp(-0.5 * np.log2(omega[1:] * length / (2 * np.pi)) ** 2)
    return curve


def fleet(count: int, seed: int = 0, **common: object) -> list[Train]:
    """Trains of three vehicles over a month, of different speed, day and odometer."""
    generator = np.random.default_rng((5, seed))
    days = np.linspace(0, 30, count).round().astype(int)
    return [
        Train(
            vehicle=VEHICLES[number % 3],
            speed=float(generator.uniform(20.0, 42.0)),
            day=int(day),
            seed=100 * seed + number,
            ahead=float(generator.uniform(-6.0, 6.0)),
            scale=float(generator.uniform(-1e-3, 1e-3)),
            name=f"pass {number}",
            **common,  # type: ignore[arg-type]
        )
        for number, day in enumerate(days)
    ]


def truth(line: Line, train: Train, day: float, distance: Array) -> xr.Dataset:
    """True profile at distances that a train's odometer reads."""
    counted = line.grid + train.ahead + train.scale * line.grid
    return build_profile(distance, CubicSpline(counted, line.level(day))(distance), kind="truth")


def errors(
    result: FusionResult, line: Line, trains: Sequence[Train], day: float
) -> dict[str, tuple[Array, Array]]:
    """Error of a fused level and its stated standard deviation, by band, away from the ends [m].

    The line's chainage agrees with no odometer to the millimetre: a constant lag to that of the median train does not
    count as an error.
    """
    median = min(
        (one for one in result.passes if one.lag is not None), key=lambda one: abs(one.lag or 0.0)
    )
    train = next(one for one in trains if one.name == median.name)
    distance, level = result.profile["distance"].to_numpy(), known_elevation(result.profile)
    exact, lag = level, 0.0
    for _ in range(3):
        exact = truth(line, train, day, distance - lag)["elevation"].to_numpy()
        slope, off = (
            band_pass(each, SPACING, BANDS[0])
            for each in (np.gradient(exact, SPACING), level - exact)
        )
        lag -= float(off[400:-400] @ slope[400:-400] / (slope[400:-400] @ slope[400:-400]))
    by_band = {}
    for band in BANDS:
        edge = int(edge_distance(band) / SPACING)
        inner = slice(edge, -edge)
        deviation = result.profile[f"standard_deviation_{band.name}"].to_numpy()
        by_band[band.name] = (band_pass(level - exact, SPACING, band)[inner], deviation[inner])
    return by_band

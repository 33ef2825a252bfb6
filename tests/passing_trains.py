"""Passes of trains over one line, as an ideal smoother would state them: the truth through Wiener's filter, with noise.

At a steady speed the posterior of a long ride has the mean G (z + n) with the gain G = S/(S + N), S the prior's
spectrum and N that of all sensors' noise together, N⁻¹ = Σ |H|²/n², and the spectrum G N (theory, section 8). Nothing
here is shared with what is tested but the vehicle's response.
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
from trackprofile.fusion.fuse import Fused
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
from trackprofile.models.irregularity import Dip
from trackprofile.models.receptance import point_track
from trackprofile.models.statespace import state_space, transfer_function

Array = np.ndarray
SPACING = 0.25
FIRST = date(2026, 5, 1)
VEHICLES = ("velaro", "multiple-unit", "intercity-coach")
BEFORE = 500.0  # m of track before the line begins


@dataclass(frozen=True)
class Line:
    """A line of random track and what settles on it.

    ``settled`` [m] is how far the middle of the dip has gone after 30 days, ``half_length`` [m] that of the dip,
    ``at`` [m] where it is.
    """

    length: float = 2000.0
    seed: int = 1
    spectrum: str = "fra-5"
    settled: float = 0.0
    half_length: float = 6.0
    at: float = 1000.0

    @property
    def count(self) -> int:
        return 2 ** int(np.ceil(np.log2((self.length + 2 * BEFORE) / SPACING)))

    @property
    def grid(self) -> Array:
        """Of the whole, [m]; it closes upon itself."""
        return SPACING * np.arange(self.count) - BEFORE

    def omega(self) -> Array:
        return 2 * np.pi * np.fft.rfftfreq(self.count, SPACING)

    def drawn(self, density: Array, seed: int | tuple[int, ...]) -> Array:
        """Random coefficients of that density, (omega)."""
        size = np.sqrt(density * self.omega()[1] / 4) * self.count
        noise = np.random.default_rng(seed).standard_normal((2, density.size))
        found = (noise[0] + 1j * noise[1]) * size
        found[0] = 0.0
        return found

    def level(self, day: float) -> Array:
        """On the grid, after some days [m]."""
        rough = np.fft.irfft(self.drawn(prior(self), (7, self.seed)), n=self.count)
        if not self.settled:
            return rough
        return rough + Dip(self.settled, self.half_length, self.at).at(self.grid)[0] * day / 30.0


def prior(line: Line) -> Array:
    omega = line.omega()
    density = np.zeros(omega.size)
    density[1:] = read_spectrum(line.spectrum).density(omega[1:])
    density[omega > 2 * np.pi / 0.6] *= 1e-6  # rail and wheels iron out what is shorter
    return density


@lru_cache(maxsize=64)
def noise(vehicle: str, sensors: str, speed: float, line: Line) -> Array:
    """N(Ω) of all sensors together (omega) [m²/(rad/m)]."""
    omega = line.omega()
    system = state_space(
        read_vehicle(vehicle)[0], point_track(read_track("zhai")), read_sensors(sensors)
    )
    found = np.full(omega.size, np.inf)
    densities = (
        np.array([one.noise_density for one in read_sensors(sensors)]) ** 2 * speed / (2 * np.pi)
    )
    # The response is smooth on a line of kilometres: a fine grid of its own, then between.
    own = np.geomspace(omega[1], omega[-1], 3000)
    gained = np.sum(np.abs(transfer_function(system, own, speed)) ** 2 / densities, axis=1)
    found[1:] = np.exp(-np.interp(np.log(omega[1:]), np.log(own), np.log(gained)))
    return found


@dataclass(frozen=True)
class Train:
    """What passes, how fast, how its odometer counts, and what is wrong with it.

    ``ahead`` [m] is what its odometer reads too much at the start, ``scale`` its share too much all along. Faults that
    it does not state: ``gain``, ``louder`` (times its noise's standard deviation) and ``distortion``, what is too much
    of waves about 12 m and about 40 m, as of a vehicle whose springs are others.
    """

    vehicle: str = "velaro"
    speed: float = 40.0
    sensors: str = "bogie-100ug"
    day: int = 0
    seed: int = 0
    ahead: float = 0.0
    scale: float = 0.0
    gain: float = 1.0
    louder: float = 1.0
    start: float = 0.0
    end: float | None = None
    name: str = ""
    distortion: tuple[float, float] = (0.0, 0.0)


def passing(line: Line, train: Train) -> DatedProfile:
    """The pass of a train, with its distances as its odometer counts them."""
    S, N = prior(line), noise(train.vehicle, train.sensors, train.speed, line)
    with np.errstate(invalid="ignore"):
        G = np.where(np.isfinite(N), S / (S + np.where(np.isfinite(N), N, 1.0)), 0.0)
    posterior = G * np.where(np.isfinite(N), N, 1.0)
    posterior[0] = 0.0
    z = np.fft.rfft(line.level(float(train.day)))
    n = line.drawn(np.where(np.isfinite(N), N, 0.0), (11, line.seed, train.seed))
    low, high = train.distortion
    wrong = (
        1.0
        + (train.gain - 1.0)
        + low * _near(line.omega(), 12.0)
        + high * _near(line.omega(), 40.0)
    )
    mean = np.fft.irfft(G * (wrong * z + train.louder * n), n=line.count)
    # What stands at x is counted at x + ahead + scale x.
    counted = line.grid + train.ahead + train.scale * line.grid
    end = line.length if train.end is None else train.end
    ends = np.interp([train.start, end], line.grid, counted)
    distance = np.arange(np.ceil(ends[0] / SPACING), np.floor(ends[1] / SPACING) + 1) * SPACING
    omega = line.omega()
    stated = {
        band.name: np.sqrt(np.trapezoid(posterior * gain(band, omega) ** 2, omega))
        for band in BANDS
    }
    everything = np.sqrt(np.trapezoid(posterior, omega))
    name = train.name or f"{train.vehicle} {train.speed:g} m/s, day {train.day}, {train.seed}"
    profile = build_profile(
        distance,
        CubicSpline(counted, mean)(distance),
        kind="posterior",
        method="smoother",
        standard_deviation=np.full(distance.size, everything),
        band_standard_deviations={
            one: np.full(distance.size, value) for one, value in stated.items()
        },
        vehicle=train.vehicle,
    )
    return DatedProfile(profile, FIRST + timedelta(days=train.day), name)


def _near(omega: Array, length: float) -> Array:
    """About one wavelength, an octave wide: what a wrong spring does."""
    found = np.zeros(omega.size)
    found[1:] = np.exp(-0.5 * np.log2(omega[1:] * length / (2 * np.pi)) ** 2)
    return found


def fleet(count: int, seed: int = 0, **same: object) -> list[Train]:
    """Trains of three vehicles over a month, no two of one speed, day or odometer."""
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
            **same,  # type: ignore[arg-type]
        )
        for number, day in enumerate(days)
    ]


def truth(line: Line, train: Train, day: float, distance: Array) -> xr.Dataset:
    """What stands at the places that a train's odometer counts so."""
    counted = line.grid + train.ahead + train.scale * line.grid
    return build_profile(distance, CubicSpline(counted, line.level(day))(distance), kind="truth")


def errors(
    found: Fused, line: Line, trains: Sequence[Train], day: float
) -> dict[str, tuple[Array, Array]]:
    """By band the error of a fused level and its stated deviation, away from the ends [m].

    The line's distance is that of no odometer to the millimetre: the lag to that of the train in the middle, which is
    the same all along, is no error.
    """
    middle = min(
        (one for one in found.members if one.lag is not None), key=lambda one: abs(one.lag or 0.0)
    )
    train = next(one for one in trains if one.name == middle.name)
    distance, level = found.profile["distance"].to_numpy(), known_elevation(found.profile)
    exact, lag = level, 0.0
    for _ in range(3):
        exact = truth(line, train, day, distance - lag)["elevation"].to_numpy()
        slope, off = (
            band_pass(each, SPACING, BANDS[0])
            for each in (np.gradient(exact, SPACING), level - exact)
        )
        lag -= float(off[400:-400] @ slope[400:-400] / (slope[400:-400] @ slope[400:-400]))
    every = {}
    for band in BANDS:
        edge = int(edge_distance(band) / SPACING)
        here = slice(edge, -edge)
        spread = found.profile[f"standard_deviation_{band.name}"].to_numpy()
        every[band.name] = (band_pass(level - exact, SPACING, band)[here], spread[here])
    return every

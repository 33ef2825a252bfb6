"""Stores of a simulated network, created in seconds: random track, and passes with the error that they state.

Nothing is inferred: a pass is the track, which settles at one location of each line, plus a random error in each band.
The size of a store and the speed of the web viewer are measured with it.

    python tests/network.py FOLDER --lines 20 --length 100000 --passes 20
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from narrowing import floats
from trackprofile import store as stores
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.bands import BANDS, gain
from trackprofile.contracts import Quality, build_profile, content_digest
from trackprofile.io.model_toml import presets, read_roughness
from trackprofile.store import AddResult, Origin, PassKey, Store

Array = NDArray[np.float64]

SPACING = 0.25
DEVIATIONS = {"D1": 5e-5, "D2": 1e-4, "D3": 3e-4}
LONG_WAVE_DEVIATION = 2e-3
MEAN_DIP_DEPTH = 7e-3
VEHICLES = ("intercity-coach", "multiple-unit", "high-speed")
SPEED = 44.4


@dataclass(frozen=True)
class Network:
    """A simulated network.

    Parameters
    ----------
    lines : number of lines, called ``Line 1`` and so on without `names`
    length : length of each line [m]
    passes : number of passes over each, one every `interval` days from `first`
    recording : length of a recording [m]; None is the whole line
    settled : settlement at one location of each line, from the first pass to the last [m]
    seed : seed of all random numbers
    names : names of the lines
    """

    lines: int = 2
    length: float = 5000.0
    passes: int = 3
    recording: float | None = None
    settled: float = 2e-3
    seed: int = 1
    first: date = date(2026, 5, 1)
    interval: int = 3
    names: tuple[str, ...] = ()

    def name(self, line: int) -> str:
        """Name of a line, counted from 0."""
        return self.names[line] if line < len(self.names) else f"Line {line + 1}"

    def day(self, number: int) -> date:
        """Day of a pass, counted from 0."""
        return self.first + timedelta(days=number * self.interval)

    def settles_at(self, line: int) -> float:
        """Position of the settlement of a line [m]."""
        return self.length * (0.3 + 0.4 * self._generator(line, 1).random())

    def track(self, line: int) -> Array:
        """Elevation of a line before it settles, every 0.25 m, with a dip in each kilometre [m]."""
        generator = self._generator(line, 0)
        level = _random_signal(generator, self._points, _track_density)
        for kilometre in range(int(self.length // 1000)):
            position, depth = (
                1000 * (kilometre + generator.random()),
                generator.exponential(MEAN_DIP_DEPTH),
            )
            level -= depth * np.exp(
                -0.5 * ((SPACING * np.arange(self._points) - position) / 2) ** 2
            )
        return level

    def passed(self, line: int, number: int) -> xr.Dataset:
        """Profile of one pass over a whole line."""
        return self.measured(line, number, self.track(line))

    def measured(self, line: int, number: int, track: Array) -> xr.Dataset:
        """Profile of one pass over a whole line whose track is arguments."""
        generator = self._generator(line, 2 + number)
        distance = SPACING * np.arange(self._points)
        dip = np.exp(-0.5 * ((distance - self.settles_at(line)) / 4) ** 2)
        level = track - self.settled * number / max(self.passes - 1, 1) * dip
        variation = np.exp(
            0.2 * _random_signal(generator, self._points, lambda omega: omega < 0.05, 1.0)
        )
        deviations = {name: size * variation for name, size in DEVIATIONS.items()}
        for band in BANDS:
            error = _random_signal(
                generator, self._points, lambda omega, b=band: gain(b, omega) ** 2, 1.0
            )
            level += deviations[band.name] * error
        level += _random_signal(
            generator, self._points, lambda omega: omega < 2 * np.pi / 250, LONG_WAVE_DEVIATION
        )
        total = np.sqrt(LONG_WAVE_DEVIATION**2 + sum(one**2 for one in deviations.values()))
        flags = np.zeros(self._points, np.int16)
        flags[:80] |= Quality.EDGE
        flags[-80:] |= Quality.EDGE
        lost = int(generator.integers(self._points - 60))
        flags[lost : lost + 60] = Quality.GAP
        return build_profile(
            distance, np.where(flags & Quality.GAP, np.nan, level), kind="posterior", method="smoother",
            standard_deviation=total, band_standard_deviations=deviations, quality=flags,
            vehicle=VEHICLES[number % len(VEHICLES)], provenance=["simulated"],
        )  # fmt: skip

    @property
    def _points(self) -> int:
        return round(self.length / SPACING) + 1

    def _generator(self, line: int, part: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, line, part])


def fill(
    store: Store, network: Network, progress: Callable[[int, int], None] | None = None
) -> tuple[AddResult, ...]:
    """Assess and add all passes of a network."""
    limits = read_limits("en-13848")
    spectra = {name: read_roughness(name) for name in presets("spectrum")}
    added = []
    for line in range(network.lines):
        track = network.track(line)
        for number in range(network.passes):
            whole = network.measured(line, number, track)
            for piece in _pieces(whole, network.recording):
                origin = Origin(
                    content_digest(piece), source=f"run-{line}-{number}.nc", vehicle=piece.attrs["vehicle"],
                    method="smoother", track="rigid", prior="german-low", limits=limits.name, speed=SPEED,
                    settings=hashlib.sha256(b"simulated").hexdigest()[:16],
                )  # fmt: skip
                key = PassKey(network.name(line), "up", network.day(number), "06:12")
                assessment = assess(piece, limits, SPEED, spectra=spectra)
                added.append(stores.add(store, key, piece, assessment, origin))
            if progress:
                progress(line * network.passes + number + 1, network.lines * network.passes)
    return tuple(added)


def _pieces(profile: xr.Dataset, length: float | None) -> Iterator[xr.Dataset]:
    """A profile in pieces of the length of a recording."""
    points = profile.sizes["distance"] if length is None else round(length / SPACING)
    for first in range(0, profile.sizes["distance"] - 1, points):
        yield profile.isel(distance=slice(first, first + points + 1))


def _track_density(omega: Array) -> Array:
    """Shape of a typical track spectrum, with its corner at 300 m; `_random_signal` scales it."""
    return np.where(omega < 2 * np.pi / 1.5, 1 / ((omega**2 + 0.02**2) * (omega**2 + 0.8**2)), 0.0)


def _random_signal(
    generator: np.random.Generator,
    count: int,
    density: Callable[[Array], NDArray],
    deviation: float = 4e-3,
) -> Array:
    """A random signal with the shape of a spectral density and a standard deviation."""
    omega = 2 * np.pi * np.fft.rfftfreq(count, SPACING)
    omega[0] = omega[1]
    coefficients = np.fft.rfft(generator.standard_normal(count)) * np.sqrt(
        density(floats(omega)).astype(np.float64)
    )
    coefficients[0] = 0.0
    signal = np.fft.irfft(coefficients, count)
    return signal * (deviation / signal.std())


def main() -> None:
    """Create a store in a new folder."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    options.add_argument("--lines", type=int, default=2)
    options.add_argument("--length", type=float, default=5000.0, help="of each line, m")
    options.add_argument("--passes", type=int, default=3)
    options.add_argument("--recording", type=float, help="length of a recording, m")
    arguments = options.parse_args()
    network = Network(arguments.lines, arguments.length, arguments.passes, arguments.recording)
    fill(
        stores.create(str(arguments.folder)), network,
        lambda done, of: print(f"{done}/{of}", end="\r", flush=True),  # noqa: T201
    )  # fmt: skip


if __name__ == "__main__":
    main()

"""A small store of two lines for tests of the web viewer: monthly passes over track that settles at one location."""

from __future__ import annotations

import hashlib
from datetime import date, timedelta

import numpy as np
import xarray as xr

from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.bands import BANDS
from trackprofile.contracts import Quality, build_profile
from trackprofile.io.model_toml import read_spectrum
from trackprofile.models.irregularity import random_irregularity
from trackprofile.store import Entry, Origin, PassKey, Store, add

EN, SPEED = read_limits("en-13848"), 140 / 3.6
MAIN, UP = "Main <b>line</b> & <img src=x onerror=document.title='taken'>", "up"
"""A name that is valid HTML, to test that the viewer escapes it."""

BRANCH, DOWN = "Branch", "down"
LENGTH, START = 6000.0, 12_000.0
FIRST = date(2026, 1, 5)
SETTLES = 3260.0
"""Position after the start at which the track settles by 2.5 mm a month [m]."""

DEEP, SHALLOW, CREST = 1500.0, 4400.0, 5100.0


def dip(at: np.ndarray, position: float, depth: float, half: float = 2.5) -> np.ndarray:
    """Elevation of a dip [m]."""
    return -depth * np.exp(-0.5 * ((at - position) / half) ** 2)


def level(at: np.ndarray, months: float, seed: int = 3) -> np.ndarray:
    """True elevation some months after the first pass, at distances from the line's start [m]."""
    rough = random_irregularity(read_spectrum("fra-6"), seed, 2.0, 150.0, length=LENGTH).at(at)[0]
    dips = dip(at, DEEP, 0.045) + dip(at, SHALLOW, 0.018) - dip(at, CREST, 0.022)
    return 0.7 * rough + dips + dip(at, SETTLES, 0.008 + 0.0025 * months, 3.0)


def seen(
    months: float, length: float = LENGTH, *, first: float = 0.0, zero: float = 0.0, seed: int = 3,
    gap: bool = False,
) -> xr.Dataset:  # fmt: skip
    """Profile of a pass that starts `first` metres after the line's start: the truth plus the error that it states.

    The line starts at the chainage `zero`.
    """
    at = first + np.arange(0.0, length, 0.25)
    generator = np.random.default_rng(int(100 * months + first) + 1)
    error = sum(
        1e-4 * generator.standard_normal() * np.sin(2 * np.pi * at / wave + 7 * generator.random())
        for wave in (5.0, 8.0, 13.0, 21.0)
    )
    flags = np.zeros(at.size, np.int16)
    flags[:80] |= Quality.EDGE
    if gap:
        flags[(at > 2400) & (at < 2480)] |= Quality.GAP
        flags[(at > 2480) & (at < 2600)] |= Quality.SLOW
    variation = 1 + 0.5 * np.sin(at / 700) ** 2
    return build_profile(
        zero + at,
        np.where(flags & Quality.GAP, np.nan, level(at, months, seed) + error),
        kind="posterior",
        method="smoother",
        standard_deviation=4e-3 * variation,
        band_standard_deviations={
            band.name: factor * 1.5e-4 * variation
            for band, factor in zip(BANDS, (1.0, 2.5, 8.0), strict=True)
        },
        quality=flags,
        vehicle="velaro",
        provenance=["simulated"],
    )


def put(store: Store, key: PassKey, profile: xr.Dataset, vehicle: str = "velaro") -> Entry:
    """Assess a profile and store it."""
    name = f"{key.line} {key.direction} {key.day} {key.run}"
    origin = Origin(
        hashlib.sha256(name.encode()).hexdigest(), source=f"{key.day}.toml", vehicle=vehicle, method="smoother",
        track="zhai-layered", prior="german-low", limits=EN.name, speed=SPEED,
    )  # fmt: skip
    return add(store, key, profile, assess(profile, EN, SPEED), origin).entry


def fill(store: Store, passes: int = 4) -> None:
    """Store monthly passes over one line, the third with a gap, and two passes of one day over another line."""
    for month in range(passes):
        day = FIRST + timedelta(days=30 * month)
        put(store, PassKey(MAIN, UP, day, "<i>06:12</i>"), seen(month, zero=START, gap=month == 2))
    for run, first in (("early", 0.0), ("late", 2000.0)):
        piece = seen(0, 2500.0, first=first, seed=5)
        put(store, PassKey(BRANCH, DOWN, FIRST, run), piece, vehicle="coach <script>1</script>")

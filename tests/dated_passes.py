"""A small store of two lines for the page's tests: passes of some months over track that settles in places."""

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
"""A name that would be markup if anybody took it for that."""

BRANCH, DOWN = "Branch", "down"
LENGTH, START = 6000.0, 12_000.0
FIRST = date(2026, 1, 5)
SETTLES = 3260.0
"""m after the start, where the track settles by 2.5 mm a month in truth."""

DEEP, SHALLOW, CREST = 1500.0, 4400.0, 5100.0


def dip(at: np.ndarray, place: float, depth: float, half: float = 2.5) -> np.ndarray:
    """A hollow in the track [m]."""
    return -depth * np.exp(-0.5 * ((at - place) / half) ** 2)


def level(at: np.ndarray, months: float, seed: int = 3) -> np.ndarray:
    """The true track some months after the first pass [m]; distances from the line's start."""
    rough = random_irregularity(read_spectrum("fra-6"), seed, 2.0, 150.0, length=LENGTH).at(at)[0]
    hollows = dip(at, DEEP, 0.045) + dip(at, SHALLOW, 0.018) - dip(at, CREST, 0.022)
    return 0.7 * rough + hollows + dip(at, SETTLES, 0.008 + 0.0025 * months, 3.0)


def seen(
    months: float, length: float = LENGTH, *, first: float = 0.0, zero: float = 0.0, seed: int = 3,
    gap: bool = False,
) -> xr.Dataset:  # fmt: skip
    """A pass's profile from some metres after the line's start: the truth, with an error that it states.

    The line starts at the distance `zero`.
    """
    at = first + np.arange(0.0, length, 0.25)
    noise = np.random.default_rng(int(100 * months + first) + 1)
    error = sum(
        1e-4 * noise.standard_normal() * np.sin(2 * np.pi * at / wave + 7 * noise.random())
        for wave in (5.0, 8.0, 13.0, 21.0)
    )
    flags = np.zeros(at.size, np.int16)
    flags[:80] |= Quality.EDGE
    if gap:
        flags[(at > 2400) & (at < 2480)] |= Quality.GAP
        flags[(at > 2480) & (at < 2600)] |= Quality.SLOW
    grown = 1 + 0.5 * np.sin(at / 700) ** 2
    return build_profile(
        zero + at,
        np.where(flags & Quality.GAP, np.nan, level(at, months, seed) + error),
        kind="posterior",
        method="smoother",
        standard_deviation=4e-3 * grown,
        band_standard_deviations={
            band.name: factor * 1.5e-4 * grown
            for band, factor in zip(BANDS, (1.0, 2.5, 8.0), strict=True)
        },
        quality=flags,
        vehicle="velaro",
        provenance=["simulated"],
    )


def put(store: Store, place: PassKey, profile: xr.Dataset, vehicle: str = "velaro") -> Entry:
    """Judge a profile and store it."""
    name = f"{place.line} {place.direction} {place.day} {place.run}"
    origin = Origin(
        hashlib.sha256(name.encode()).hexdigest(), source=f"{place.day}.toml", vehicle=vehicle, method="smoother",
        track="zhai-layered", prior="german-low", limits=EN.name, speed=SPEED,
    )  # fmt: skip
    return add(store, place, profile, assess(profile, EN, SPEED), origin).entry


def fill(store: Store, passes: int = 4) -> None:
    """Monthly passes over one line, the third with a gap; two trains on one day over another."""
    for month in range(passes):
        day = FIRST + timedelta(days=30 * month)
        put(store, PassKey(MAIN, UP, day, "<i>06:12</i>"), seen(month, zero=START, gap=month == 2))
    for run, first in (("early", 0.0), ("late", 2000.0)):
        piece = seen(0, 2500.0, first=first, seed=5)
        put(store, PassKey(BRANCH, DOWN, FIRST, run), piece, vehicle="coach <script>1</script>")

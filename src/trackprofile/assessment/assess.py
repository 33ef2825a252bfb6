"""assess: what a profile obliges to, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from trackprofile.assessment.defects import Defect, find_defects
from trackprofile.assessment.levels import BandLevel, NotAssessed, band_levels, not_assessed
from trackprofile.assessment.limits import KM_H, Limits, unverified
from trackprofile.assessment.roughness import Nearest, Psd, common_range, nearest, psd
from trackprofile.assessment.sections import Section, assess_sections
from trackprofile.bands import BANDS, FILTER_NAMES, Band, resample
from trackprofile.contracts import Quality
from trackprofile.contracts.validation import DISTANCE_DEVIATION
from trackprofile.errors import DataError
from trackprofile.models.spectrum import Roughness

SECTION_LENGTHS = (200.0, 100.0)
"""Over which standard deviations are taken [m]; 200 m is usual, some networks take 100 m."""

LEAST_PROBABILITY = 0.05
"""That the lowest limit is exceeded, from which a defect is listed."""

STRETCH = 1000.0
"""Over which a spectrum is estimated and named [m]."""


@dataclass(frozen=True)
class Assessment:
    """A profile judged by limits.

    Parameters
    ----------
    limits, speed : what it was judged by; the line's speed [m/s]
    start, end : of the profile [m]
    levels : per band, the level, its uncertainty and where it was not judged
    defects : of all bands, by where they start
    sections : of all bands and lengths
    not_assessed : stretches that were not judged, with the reason
    spectra : the nearest known spectrum of each stretch of `STRETCH`
    spectrum : of the whole profile; None where it is too short
    known : the spectra that it was compared with, by name
    least_probability : from which defects are listed
    notes : what has to be said with every number, in sentences
    about : kind, method, loading, vehicle, provenance of the profile
    filter : of the bands
    """

    limits: Limits
    speed: float
    start: float
    end: float
    levels: Mapping[str, BandLevel]
    defects: tuple[Defect, ...]
    sections: tuple[Section, ...]
    not_assessed: tuple[NotAssessed, ...]
    spectra: tuple[Nearest, ...]
    spectrum: Psd | None
    known: Mapping[str, Roughness]
    least_probability: float
    notes: tuple[str, ...]
    about: Mapping[str, str]
    filter: str


def assess(
    profile: xr.Dataset,
    limits: Limits,
    speed: float,
    *,
    bands: Sequence[Band] = BANDS,
    lengths: Sequence[float] = SECTION_LENGTHS,
    spectra: Mapping[str, Roughness] | None = None,
    least_probability: float = LEAST_PROBABILITY,
    forward_backward: bool = False,
) -> Assessment:
    """Judge a profile by the limits of its line's speed, band by band (EN 13848-5 and -6).

    Parameters
    ----------
    profile : the profile contract; its distance is the chainage that results are stated by
    limits : as a limits file holds them
    speed : that the line is run at [m/s]
    bands : to assess
    lengths : of sections [m]
    spectra : known spectra by name, to name the nearest to each stretch
    least_probability : that the lowest limit is exceeded, from which a defect is listed
    forward_backward : apply the band filter forwards and backwards, see `bands.band_pass`

    Raises
    ------
    DataError : the speed is not above 0 or beyond the limits', or the profile is too short for any band.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits import Action, DefectLimits
    >>> distance = np.arange(0.0, 400.0, 0.25)
    >>> dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    >>> rule = DefectLimits("D1", 0.0, 50.0, "ours", True, {Action.ALERT: 0.01, Action.INTERVENTION: 0.02})
    >>> found = assess(build_profile(distance, dip, kind="truth"), Limits("ours", (rule,)), 40.0)
    >>> [(one.band, one.peak, one.exceeded.words) for one in found.defects]
    [('D1', 200.0, 'intervention')]
    """
    if not speed > 0:
        raise DataError(f"Speed of the line: expected above 0 km/h, got {speed / KM_H:g} km/h.")
    if not 0 < least_probability < 1:
        raise DataError(f"Least probability: expected between 0 and 1, got {least_probability:g}.")
    levels, notes = band_levels(profile, bands, forward_backward=forward_backward)
    defects, sections, untold = [], [], []
    for name, level in levels.items():
        heights, classes = limits.defects_at(name, speed), limits.classes_at(name, speed)
        if heights is None or not heights.heights:
            untold.append(name)
        else:
            defects += find_defects(level, heights, least_probability)
        for length in lengths:
            sections += assess_sections(level, length, classes)
    whole, stretches = _spectra(profile, spectra or {})
    distance = profile["distance"].to_numpy()
    return Assessment(
        limits=limits,
        speed=speed,
        start=float(distance[0]),
        end=float(distance[-1]),
        levels=levels,
        defects=tuple(sorted(_located(defects, profile), key=lambda one: (one.start, one.band))),
        sections=tuple(sections),
        not_assessed=tuple(one for level in levels.values() for one in not_assessed(level)),
        spectra=stretches,
        spectrum=whole,
        known=spectra or {},
        least_probability=least_probability,
        notes=(
            *unverified(limits, list(levels), speed),
            *_untold(untold, limits, speed),
            *_unstated(levels, profile),
            *notes,
        ),
        about={str(name): str(value) for name, value in profile.attrs.items()},
        filter=FILTER_NAMES[forward_backward],
    )


def _located(defects: Sequence[Defect], profile: xr.Dataset) -> Sequence[Defect]:
    """The defects with how well their places are known, where the profile says that."""
    if DISTANCE_DEVIATION not in profile:
        return defects
    at, known = profile["distance"].to_numpy(), profile[DISTANCE_DEVIATION].to_numpy()
    return [
        replace(one, location_deviation=float(np.interp(one.peak, at, known))) for one in defects
    ]


def _untold(bands: Sequence[str], limits: Limits, speed: float) -> tuple[str, ...]:
    return tuple(
        f"Limits {limits.name!r} have none for isolated defects in {band} at {speed / KM_H:.4g} km/h: "
        "its defects are not listed"
        for band in bands
    )


def _unstated(levels: Mapping[str, BandLevel], profile: xr.Dataset) -> tuple[str, ...]:
    """What to say where the profile states no uncertainty."""
    bands = ", ".join(name for name, level in levels.items() if not level.stated)
    if not bands:
        return ()
    kind = profile.attrs.get("kind", "profile")
    return (
        f"The profile ({kind}) states no standard deviation in {bands}: its values are taken as exact there, "
        "and probabilities are 0 or 1",
    )


def _spectra(
    profile: xr.Dataset, spectra: Mapping[str, Roughness]
) -> tuple[Psd | None, tuple[Nearest, ...]]:
    distance = profile["distance"].to_numpy()
    spacing = float(np.median(np.diff(distance)))
    elevation = np.where(
        profile["quality"].to_numpy() & Quality.GAP, np.nan, profile["elevation"].to_numpy()
    )
    shortest, longest = common_range(spectra)
    grid = distance[0] + spacing * np.arange(int((distance[-1] - distance[0]) / spacing + 1e-6) + 1)
    level = resample(distance, elevation, grid)
    found = []
    for number in range(int(grid[0] // STRETCH), int(grid[-1] // STRETCH) + 1):
        ends = (number * STRETCH, (number + 1) * STRETCH)
        piece = slice(*np.searchsorted(grid, ends))
        of_piece = psd(level[piece], spacing, shortest, longest)
        if of_piece is not None:
            start, end = max(ends[0], float(grid[0])), min(ends[1], float(grid[-1]))
            found.append(nearest(of_piece, spectra, start, end))
    whole = psd(level, spacing, shortest, longest)
    return whole, tuple(one for one in found if one is not None)

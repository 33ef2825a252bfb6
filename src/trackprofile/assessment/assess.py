"""Assessment of a profile against a limit set: defects, sections, stretches not assessed, spectra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from trackprofile.assessment.defects import Defect, find_defects
from trackprofile.assessment.levels import BandLevel, NotAssessed, band_levels, not_assessed
from trackprofile.assessment.limits import KM_H, Limits, unverified
from trackprofile.assessment.roughness import (
    Psd,
    SpectrumMatch,
    common_range,
    most_similar_spectrum,
    psd,
)
from trackprofile.assessment.sections import Section, assess_sections
from trackprofile.bands import BANDS, FILTER_NAMES, Band, resample
from trackprofile.contracts import Quality
from trackprofile.contracts.validation import DISTANCE_DEVIATION
from trackprofile.errors import DataError
from trackprofile.models.spectrum import Roughness

SECTION_LENGTHS = (200.0, 100.0)
"""Lengths of the sections for which standard deviations are computed [m]; 200 m is common, some networks use 100 m."""

LEAST_PROBABILITY = 0.05
"""Default of the minimum probability of exceeding the lowest limit for a defect to be listed."""

SPECTRUM_STRETCH = 1000.0
"""Length of the stretches whose spectra are estimated and compared with known ones [m]."""


@dataclass(frozen=True)
class Assessment:
    """Assessment of a profile against a limit set.

    Parameters
    ----------
    limits, speed : limit set, and speed of the line [m/s]
    start, end : ends of the profile [m]
    levels : level, standard deviation and reasons for not assessing, for each band by name
    defects : defects in all bands, by distance
    sections : sections in all bands and of all lengths
    not_assessed : stretches that were not assessed, with the reasons
    spectra : most similar known spectrum of each stretch of `SPECTRUM_STRETCH`
    spectrum : spectrum of the whole profile; None if it is too short
    known : known spectra used for the comparison, by name
    least_probability : minimum probability of exceeding the lowest limit for a defect to be listed
    notes : caveats that apply to the results, as sentences without full stop
    about : attributes of the profile: kind, method, loading, vehicle, provenance
    filter : name of the band filter
    """

    limits: Limits
    speed: float
    start: float
    end: float
    levels: Mapping[str, BandLevel]
    defects: tuple[Defect, ...]
    sections: tuple[Section, ...]
    not_assessed: tuple[NotAssessed, ...]
    spectra: tuple[SpectrumMatch, ...]
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
    """Assess a profile against the limits for the speed of its line, band by band (EN 13848-5 and -6).

    Parameters
    ----------
    profile : profile contract; its distance locates the results
    limits : limit set, see `trackprofile.assessment.limits_toml.read_limits`
    speed : speed of the line [m/s]
    bands : bands to assess
    lengths : lengths of the sections [m]
    spectra : known roughness spectra by name, of which the most similar is stated for each stretch
    least_probability : minimum probability of exceeding the lowest limit for a defect to be listed, dimensionless
    forward_backward : apply the band filter forwards and backwards, see `trackprofile.bands.band_pass`

    Raises
    ------
    DataError : the speed is not above 0 or exceeds those of the limit set, or the profile is too short for all bands.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits import Action, DefectLimits
    >>> distance = np.arange(0.0, 400.0, 0.25)
    >>> dip = -0.04 * np.exp(-0.5 * ((distance - 200) / 2) ** 2)
    >>> rule = DefectLimits("D1", 0.0, 50.0, "ours", True, {Action.ALERT: 0.01, Action.INTERVENTION: 0.02})
    >>> result = assess(build_profile(distance, dip, kind="truth"), Limits("ours", (rule,)), 40.0)
    >>> [(one.band, one.peak, one.exceeded.text) for one in result.defects]
    [('D1', 200.0, 'intervention')]
    """
    if not speed > 0:
        raise DataError(f"Speed of the line: expected above 0 km/h, got {speed / KM_H:g} km/h.")
    if not 0 < least_probability < 1:
        raise DataError(f"Least probability: expected between 0 and 1, got {least_probability:g}.")
    levels, notes = band_levels(profile, bands, forward_backward=forward_backward)
    defects, sections, without_limits = [], [], []
    for name, level in levels.items():
        heights, classes = limits.defects_at(name, speed), limits.classes_at(name, speed)
        if heights is None or not heights.heights:
            without_limits.append(name)
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
            *_missing_limits(without_limits, limits, speed),
            *_missing_deviations(levels, profile),
            *notes,
        ),
        about={str(name): str(value) for name, value in profile.attrs.items()},
        filter=FILTER_NAMES[forward_backward],
    )


def _located(defects: Sequence[Defect], profile: xr.Dataset) -> Sequence[Defect]:
    """The defects with the standard deviations of their locations, if the profile states them."""
    if DISTANCE_DEVIATION not in profile:
        return defects
    distance, deviation = profile["distance"].to_numpy(), profile[DISTANCE_DEVIATION].to_numpy()
    return [
        replace(one, location_deviation=float(np.interp(one.peak, distance, deviation)))
        for one in defects
    ]


def _missing_limits(bands: Sequence[str], limits: Limits, speed: float) -> tuple[str, ...]:
    return tuple(
        f"Limits {limits.name!r} have no limits for isolated defects in {band} at {speed / KM_H:.4g} km/h: defects in "
        f"{band} are not listed"
        for band in bands
    )


def _missing_deviations(levels: Mapping[str, BandLevel], profile: xr.Dataset) -> tuple[str, ...]:
    """Note on bands in which the profile states no standard deviation."""
    bands = ", ".join(name for name, level in levels.items() if not level.stated)
    if not bands:
        return ()
    kind = profile.attrs.get("kind", "profile")
    return (
        f"The profile ({kind}) states no standard deviation in {bands}: its values are assumed exact, and "
        "probabilities are 0 or 1",
    )


def _spectra(
    profile: xr.Dataset, spectra: Mapping[str, Roughness]
) -> tuple[Psd | None, tuple[SpectrumMatch, ...]]:
    distance = profile["distance"].to_numpy()
    spacing = float(np.median(np.diff(distance)))
    elevation = np.where(
        profile["quality"].to_numpy() & Quality.GAP, np.nan, profile["elevation"].to_numpy()
    )
    shortest, longest = common_range(spectra)
    grid = distance[0] + spacing * np.arange(int((distance[-1] - distance[0]) / spacing + 1e-6) + 1)
    level = resample(distance, elevation, grid)
    matches = []
    for number in range(int(grid[0] // SPECTRUM_STRETCH), int(grid[-1] // SPECTRUM_STRETCH) + 1):
        ends = (number * SPECTRUM_STRETCH, (number + 1) * SPECTRUM_STRETCH)
        piece = slice(*np.searchsorted(grid, ends))
        estimate = psd(level[piece], spacing, shortest, longest)
        if estimate is not None:
            start, end = max(ends[0], float(grid[0])), min(ends[1], float(grid[-1]))
            matches.append(most_similar_spectrum(estimate, spectra, start, end))
    whole = psd(level, spacing, shortest, longest)
    return whole, tuple(one for one in matches if one is not None)

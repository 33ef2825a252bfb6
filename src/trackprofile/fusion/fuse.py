"""Fusion of many passes into one profile of the line with its rate of change (theory, section 14).

The passes are aligned (`pass_alignment`), stacked on one grid (`stack`), weighted by the error variances that their
differences show (`weights`), and combined by generalised least squares in each subband (`combine`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, Band, band_pass_pieces
from trackprofile.contracts import Quality, append_provenance, build_profile, has_rate, with_rate
from trackprofile.contracts.rates import FUSION_METHOD
from trackprofile.errors import DataError
from trackprofile.fusion.combine import CombinedProfile, combine, combine_others
from trackprofile.fusion.pass_alignment import (
    REPORTED_LAG,
    AlignedPass,
    RejectedPass,
    align_passes,
    realign_pass,
)
from trackprofile.fusion.rejection import Contradiction, RejectionReason
from trackprofile.fusion.spectral_bands import (
    ALL_WAVELENGTHS,
    BAND_RANGES,
    RANGES,
    standard_deviations,
)
from trackprofile.fusion.stack import PassStack, stack_passes
from trackprofile.fusion.weights import PassWeights, estimate_weights

Array = NDArray[np.float64]

MIN_CHANGE_PROBABILITY, MIN_RATE_RATIO = 0.5, 3.0
"""Probability that track changes, and rate over its standard deviation, above which a change is reported."""


@dataclass(frozen=True)
class FusedPass:
    """Contribution of one pass to the fused profile.

    Parameters
    ----------
    name, day, vehicle : of the pass
    lag : mean of its own distance minus the line's chainage [m]; None where it could not be aligned
    error_ratio : standard deviation of its error over the stated one, by band [-]
    share : its mean weight in the line, by band (0 to 1)
    """

    name: str
    day: date
    vehicle: str
    lag: float | None
    error_ratio: Mapping[str, float]
    share: Mapping[str, float]


@dataclass(frozen=True)
class ChangingLocation:
    """A location where the track changes.

    Parameters
    ----------
    band : name of the band
    start, peak, end : where the change starts, is fastest and ends [m]
    per_day, deviation : rate in the band at the peak, and its standard deviation; settlement is negative [m/day]
    """

    band: str
    start: float
    peak: float
    end: float
    per_day: float
    deviation: float


@dataclass(frozen=True)
class FusionResult:
    """Profile of the line from all passes.

    Parameters
    ----------
    profile : profile contract, with the variables ``rate`` [m/day], ``rate_deviation``, and by band
        ``rate_deviation_D1`` and so on; all are 0 where no rate is known
    day : day of its level
    passes : contribution of each pass, sorted by day
    contradictions : passes that contradict the others
    changing : locations where the track changes, by band
    notes : remarks, in sentences
    """

    profile: xr.Dataset
    day: date
    passes: tuple[FusedPass, ...]
    contradictions: tuple[Contradiction, ...]
    changing: tuple[ChangingLocation, ...]
    notes: tuple[str, ...]


def fuse(passes: Sequence[DatedProfile], day: date | None = None) -> FusionResult:
    """Fuse passes over the same track into one profile with its rate of change (theory, section 14).

    Parameters
    ----------
    passes : passes over the same track, in any order
    day : day of the level; None is the day of the last pass

    Raises
    ------
    DataError : there is no pass, two have the same name, one is itself a fused profile or states no standard
        deviation, loaded and unloaded profiles are mixed, or the passes are not of the same track.

    Examples
    --------
    >>> wave = 0.01 * np.sin(np.arange(0.0, 400.0, 0.25) / 5)
    >>> profile = build_profile(
    ...     np.arange(0.0, 400.0, 0.25), wave, kind="posterior", standard_deviation=np.full(1600, 1e-3),
    ...     band_standard_deviations={"D1": np.full(1600, 1e-5)})
    >>> result = fuse([DatedProfile(profile, date(2026, 5, 4), "may")])
    >>> bool((result.profile["elevation"] == profile["elevation"]).all())
    True
    """
    ordered = _checked(passes)
    day = day or ordered[-1].day
    if len(ordered) == 1:
        return _single_pass(ordered[0], day)
    aligned, rejected = align_passes(ordered)
    stack = stack_passes(aligned)
    if len(aligned) > 2:
        aligned, also_rejected = _realign(stack)
        rejected += also_rejected
        stack = stack_passes(aligned)
    weights = estimate_weights(stack)
    mean_day = np.mean([one.dated.day.toordinal() for one in aligned])
    line = combine(stack, weights.days, weights.errors, day.toordinal() - float(mean_day))
    contradictions = (
        *(_rejected_pass(one) for one in rejected),
        *(
            _wrong_distances(one)
            for one in aligned
            if abs(one.lag) > REPORTED_LAG and len(aligned) > 2
        ),
        *weights.contradictions,
    )
    return FusionResult(
        profile=_profile(stack, line, weights, day, contradictions),
        day=day,
        passes=_fused_passes(ordered, stack, weights),
        contradictions=contradictions,
        changing=tuple(_changing_locations(stack, line)),
        notes=(*weights.notes, *_notes_on_days(aligned, day)),
    )


def _realign(stack: PassStack) -> tuple[tuple[AlignedPass, ...], tuple[RejectedPass, ...]]:
    """Align each pass with the line that all others give.

    All lags have in common the error that the noise of the reference pass causes, until each pass is aligned with the
    combination of the others.
    """
    weights = estimate_weights(stack)
    results = [
        realign_pass(one, _line_profile(stack, level), float(share))
        for one, level, share in zip(
            stack.passes,
            combine_others(stack, weights.errors),
            weights.share[D1.name],
            strict=True,
        )
    ]
    return (
        tuple(one for one in results if isinstance(one, AlignedPass)),
        tuple(one for one in results if isinstance(one, RejectedPass)),
    )


def _checked(passes: Sequence[DatedProfile]) -> list[DatedProfile]:
    """The passes sorted by day and name, if they can be fused."""
    if not passes:
        raise DataError("There is no pass to fuse; give at least one.")
    names = [one.name for one in passes]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"Two passes have the name {name!r}; give each pass its own name.")
    for one in passes:
        if has_rate(one.profile):
            raise DataError(
                f"{one.name} is a fused profile, whose errors depend on those of its passes; give the passes "
                "themselves."
            )
    loadings = {str(one.profile.attrs.get("loading")) for one in passes}
    if len(loadings) > 1:
        raise DataError(
            "Some passes are of the loaded track and some of the unloaded track, which differ by the deflection under "
            "the wheels; infer all of them with the same track."
        )
    return sorted(passes, key=lambda one: (one.day, one.name))


def _single_pass(one: DatedProfile, day: date) -> FusionResult:
    zero = np.zeros(one.profile.sizes["distance"])
    profile = append_provenance(with_rate(one.profile, zero, zero, {}), f"fuse: {one.name} alone")
    only = FusedPass(
        one.name, one.day, str(one.profile.attrs["vehicle"]), 0.0, {}, {band.name: 1.0 for band in BANDS}
    )  # fmt: skip
    note = "There is one pass only: its profile is returned unchanged, without a rate"
    return FusionResult(profile, day, passes=(only,), contradictions=(), changing=(), notes=(note,))


def _line_profile(stack: PassStack, level: Array) -> xr.Dataset:
    flags = np.where(np.isnan(level), Quality.GAP, 0)
    return build_profile(stack.distance, level, kind="point", quality=flags)


def _rejected_pass(one: RejectedPass) -> Contradiction:
    ends = one.dated.profile["distance"].to_numpy()[[0, -1]]
    reason = RejectionReason.REVERSED if one.reversed else RejectionReason.OTHER_TRACK
    return Contradiction(one.dated.name, reason, float(ends[0]), float(ends[1]))


def _wrong_distances(one: AlignedPass) -> Contradiction:
    ends = one.dated.profile["distance"].to_numpy()[[0, -1]]
    return Contradiction(
        one.dated.name,
        RejectionReason.LAG,
        float(ends[0]),
        float(ends[1]),
        magnitude=one.lag,
        used=True,
    )


def _profile(
    stack: PassStack,
    line: CombinedProfile,
    weights: PassWeights,
    day: date,
    contradictions: Sequence[Contradiction],
) -> xr.Dataset:
    """The line as a profile, with its rate and the passes it is from."""
    known = np.isfinite(line.level)
    deviations = _on_grid(stack, line.error_density)
    names = {name for one in stack.passes for name in _stated_bands(one.dated.profile)}
    vehicles = sorted({str(one.dated.profile.attrs["vehicle"]) for one in stack.passes})
    profile = build_profile(
        stack.distance,
        line.level,
        kind="posterior",
        method=f"{FUSION_METHOD} {int(weights.active.sum())} passes",
        standard_deviation=np.where(known, deviations[ALL_WAVELENGTHS], np.nan),
        band_standard_deviations={
            band.name: np.where(known, deviations[band.name], np.nan)
            for band in BANDS
            if band.name in names
        },
        quality=_flags(stack, weights),
        loading=str(stack.passes[0].dated.profile.attrs["loading"]),
        vehicle=", ".join(vehicles),
    )
    rates = _on_grid(stack, line.rate_error_density)
    in_bands = {name: rates[name] for name in sorted(names)}
    profile = with_rate(profile, line.rate, rates[ALL_WAVELENGTHS], in_bands)
    return append_provenance(profile, _provenance(stack, weights, day, contradictions))


def _on_grid(stack: PassStack, density: Array) -> dict[str, Array]:
    """Standard deviations by band, from a density at the nodes, interpolated to the grid (points)."""
    return {name: stack.interpolate(each) for name, each in standard_deviations(density).items()}


def _provenance(
    stack: PassStack, weights: PassWeights, day: date, contradictions: Sequence[Contradiction]
) -> str:
    used = [
        f"{one.dated.name} ({one.dated.day})"
        for one, active in zip(stack.passes, weights.active, strict=True)
        if active
    ]
    rejected = [one.name for one in contradictions if not one.used]
    step = f"fuse: level of {day} from {', '.join(used)}"
    return step + (f"; left out: {', '.join(rejected)}" if rejected else "")


def _changing_locations(stack: PassStack, line: CombinedProfile) -> Iterator[ChangingLocation]:
    """Locations where track probably changes and the rate in the band is significant.

    Points within the band's longest wavelength of each other are one location: in a band a dip has shoulders.
    """
    deviations = standard_deviations(line.rate_error_density)
    rate = np.where(np.isnan(line.level), np.nan, line.rate)
    for part in BAND_RANGES:
        band = next(one for one in BANDS if one.name == part.name)
        in_band = band_pass_pieces(rate, stack.spacing, band)
        deviation = stack.interpolate(deviations[part.name])
        probability = stack.interpolate(line.change_probability[RANGES.index(part)])
        significant = np.abs(np.nan_to_num(in_band)) > MIN_RATE_RATIO * deviation
        points = np.flatnonzero((probability > MIN_CHANGE_PROBABILITY) & significant)
        for location in _separate(points, stack.spacing, band):
            peak = location[np.argmax(np.abs(in_band[location]))]
            start, at, end = (float(stack.distance[i]) for i in (location[0], peak, location[-1]))
            yield ChangingLocation(
                part.name, start, at, end, float(in_band[peak]), float(deviation[peak])
            )


def _separate(points: NDArray[np.intp], spacing: float, band: Band) -> list[NDArray[np.intp]]:
    """Points in groups that are farther apart than the band's longest wavelength."""
    if not points.size:
        return []
    return np.split(points, np.flatnonzero(np.diff(points) * spacing > band.longest) + 1)


def _stated_bands(profile: xr.Dataset) -> list[str]:
    return [band.name for band in BANDS if f"standard_deviation_{band.name}" in profile]


def _flags(stack: PassStack, weights: PassWeights) -> NDArray[np.int16]:
    """Flags that all passes have at a point; a gap where no pass has a level."""
    known = np.isfinite(stack.level) & weights.active[:, None]
    flags = np.where(known, stack.flags, -1)
    common = np.bitwise_and.reduce(flags, axis=0)
    return np.where(known.any(axis=0), common, Quality.GAP).astype(np.int16)


def _fused_passes(
    ordered: Sequence[DatedProfile], stack: PassStack, weights: PassWeights
) -> tuple[FusedPass, ...]:
    row_of = {one.dated.name: i for i, one in enumerate(stack.passes)}

    def at_row(by_band: Mapping[str, Array], row: int | None) -> dict[str, float]:
        if row is None:
            return {}
        return {band: float(values[row]) for band, values in by_band.items()}

    passes = []
    for one in ordered:
        row = row_of.get(one.name)
        passes.append(
            FusedPass(
                one.name,
                one.day,
                str(one.profile.attrs["vehicle"]),
                lag=None if row is None else stack.passes[row].lag,
                error_ratio=at_row(weights.error_ratio, row),
                share=at_row(weights.share, row),
            )
        )
    return tuple(passes)


def _notes_on_days(aligned: Sequence[AlignedPass], day: date) -> list[str]:
    days = [one.dated.day for one in aligned]
    if min(days) == max(days):
        return [f"All passes are of {days[0]}: the profile has no rate"]
    if day > max(days) or day < min(days):
        return [
            f"{day} is outside the days of the passes, {min(days)} to {max(days)}: its level is extrapolated by the "
            "rate"
        ]
    return []

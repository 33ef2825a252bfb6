"""fuse: from passes to the profile of the line, its rate of change, and which pass contradicts the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.assessment.trend import DatedProfile
from trackprofile.bands import BANDS, D1, band_pass_pieces
from trackprofile.contracts import Quality, build_profile, has_rate, with_provenance, with_rate
from trackprofile.contracts.rates import FUSED
from trackprofile.errors import DataError
from trackprofile.fusion.combine import Combined, combine, without_each
from trackprofile.fusion.pass_alignment import (
    FAR,
    AlignedPass,
    RejectedPass,
    align_passes,
    realign_passes,
)
from trackprofile.fusion.rejection import Contradiction, RejectionReason
from trackprofile.fusion.spectral_bands import ALL, JUDGED, RANGES, deviations
from trackprofile.fusion.stack import PassStack, stack_passes
from trackprofile.fusion.weights import PassWeights, estimate_weights

Array = NDArray[np.float64]

LIKELY, BEYOND = 0.5, 3.0
"""Probability that a place moves, and standard deviations of its rate, from which it is said to."""


@dataclass(frozen=True)
class Member:
    """What was made of one pass.

    Parameters
    ----------
    name, day, vehicle : of the pass
    lag : how much farther along than the line it had its places, on the whole [m]; None where that is not known
    times : its error over what it states, in standard deviations, by band [-]
    share : of the line that rests on it, in the mean, by band (0 to 1)
    """

    name: str
    day: date
    vehicle: str
    lag: float | None
    times: Mapping[str, float]
    share: Mapping[str, float]


@dataclass(frozen=True)
class ChangingLocation:
    """A place that moves.

    Parameters
    ----------
    band : by name
    start, peak, end : where it begins, is fastest, ends [m]
    per_day, deviation : at the peak, in the band; settlement is negative [m/day]
    """

    band: str
    start: float
    peak: float
    end: float
    per_day: float
    deviation: float


@dataclass(frozen=True)
class Fused:
    """All passes in one.

    Parameters
    ----------
    profile : profile contract, with the variables ``rate`` [m/day], ``rate_deviation`` and, by band,
        ``rate_deviation_D1`` and so on; all 0 where no rate is known
    day : of its level
    members : what was made of each pass, in the order of their days
    contradictions : passes that contradict the others
    moving : places whose rate is no chance, by band
    notes : in sentences
    """

    profile: xr.Dataset
    day: date
    members: tuple[Member, ...]
    contradictions: tuple[Contradiction, ...]
    moving: tuple[ChangingLocation, ...]
    notes: tuple[str, ...]


def fuse(passes: Sequence[DatedProfile], day: date | None = None) -> Fused:
    """The profile of a line from many passes (theory, section 14).

    Parameters
    ----------
    passes : over the same track, in any order
    day : on which the level is wanted; None is that of the last pass

    Raises
    ------
    DataError : there is no pass, two have one name, one is a line itself or does not state its standard deviation,
        loaded and unloaded profiles are mixed, or the passes are not of the same track.

    Examples
    --------
    >>> wave = 0.01 * np.sin(np.arange(0.0, 400.0, 0.25) / 5)
    >>> one = build_profile(
    ...     np.arange(0.0, 400.0, 0.25), wave, kind="posterior", standard_deviation=np.full(1600, 1e-3),
    ...     band_standard_deviations={"D1": np.full(1600, 1e-5)})
    >>> alone = fuse([Pass(one, date(2026, 5, 4), "may")])
    >>> bool((alone.profile["elevation"] == one["elevation"]).all())
    True
    """
    ordered = _checked(passes)
    day = day or ordered[-1].day
    if len(ordered) == 1:
        return _alone(ordered[0], day)
    found, elsewhere = align_passes(ordered)
    laid = stack_passes(found)
    if len(found) > 2:
        # The lag that the noise of the middle one makes is in all others until each is laid on what all say.
        first = estimate_weights(laid)
        pairs = [
            realign_passes(one, _line(laid, line), float(share))
            for one, line, share in zip(
                found, without_each(laid, first.trust), first.share[D1.name], strict=True
            )
        ]
        found = tuple(one for one in pairs if isinstance(one, AlignedPass))
        elsewhere += tuple(one for one in pairs if isinstance(one, RejectedPass))
        laid = stack_passes(found)
    weighed = estimate_weights(laid)
    days = weighed.days
    mean = np.mean([one.of.day.toordinal() for one in found])
    line = combine(laid, days, weighed.trust, day.toordinal() - float(mean))
    contradictions = (
        *(_not_of_the_line(one) for one in elsewhere),
        *(_off(one) for one in found if abs(one.lag) > FAR and len(found) > 2),
        *weighed.contradictions,
    )
    profile = _profile(laid, line, weighed, day, contradictions)
    return Fused(
        profile,
        day,
        _members(ordered, laid, weighed),
        contradictions,
        tuple(_moving(laid, line)),
        (*weighed.notes, *_about_time(found, day)),
    )


def _checked(passes: Sequence[DatedProfile]) -> list[DatedProfile]:
    if not passes:
        raise DataError("There is no pass to fuse; give one or more.")
    names = [one.name for one in passes]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"Two passes are called {name!r}; give each its own name.")
    for one in passes:
        if has_rate(one.profile):
            raise DataError(
                f"{one.name} is a line made of many passes, and shares their errors; give the passes themselves."
            )
    loadings = {str(one.profile.attrs.get("loading")) for one in passes}
    if len(loadings) > 1:
        raise DataError(
            "Some passes are of the loaded track and some of the unloaded, which differ by what the wheels press it "
            "down; infer all of them with the same track."
        )
    return sorted(passes, key=lambda one: (one.day, one.name))


def _alone(one: DatedProfile, day: date) -> Fused:
    nothing = np.zeros(one.profile.sizes["distance"])
    profile = with_provenance(
        with_rate(one.profile, nothing, nothing, {}), f"fuse: {one.name} alone"
    )
    member = Member(
        one.name, one.day, str(one.profile.attrs["vehicle"]), 0.0, {}, {band.name: 1.0 for band in BANDS}
    )  # fmt: skip
    return Fused(
        profile,
        day,
        (member,),
        (),
        (),
        ("There is one pass: it comes back as it is, without a rate",),
    )


def _line(laid: PassStack, level: Array) -> xr.Dataset:
    flags = np.where(np.isnan(level), Quality.GAP, 0)
    return build_profile(laid.distance, level, kind="point", quality=flags)


def _not_of_the_line(one: RejectedPass) -> Contradiction:
    ends = one.of.profile["distance"].to_numpy()[[0, -1]]
    reason = RejectionReason.TURNED if one.turned else RejectionReason.ELSEWHERE
    return Contradiction(one.of.name, reason, float(ends[0]), float(ends[1]))


def _off(one: AlignedPass) -> Contradiction:
    ends = one.of.profile["distance"].to_numpy()[[0, -1]]
    return Contradiction(
        one.of.name, RejectionReason.LAG, float(ends[0]), float(ends[1]), size=one.lag, used=True
    )


def _profile(
    laid: PassStack,
    line: Combined,
    weighed: PassWeights,
    day: date,
    contradictions: Sequence[Contradiction],
) -> xr.Dataset:
    known = np.isfinite(line.level)
    spread = {name: laid.along(each) for name, each in deviations(line.error).items()}
    bands = {name for one in laid.passes for name in _bands_of(one.of.profile)}
    vehicles = sorted({str(one.of.profile.attrs["vehicle"]) for one in laid.passes})
    profile = build_profile(
        laid.distance,
        line.level,
        kind="posterior",
        method=f"{FUSED} {int(weighed.active.sum())} passes",
        standard_deviation=np.where(known, spread[ALL], np.nan),
        band_standard_deviations={
            band.name: np.where(known, spread[band.name], np.nan)
            for band in BANDS
            if band.name in bands
        },
        quality=_flags(laid, weighed),
        loading=str(laid.passes[0].of.profile.attrs["loading"]),
        vehicle=", ".join(vehicles),
    )
    rates = {name: laid.along(each) for name, each in deviations(line.rate_error).items()}
    profile = with_rate(
        profile, line.rate, rates[ALL], {name: rates[name] for name in sorted(bands)}
    )
    used = [
        f"{one.of.name} ({one.of.day})"
        for one, here in zip(laid.passes, weighed.active, strict=True)
        if here
    ]
    left_out = [one.name for one in contradictions if not one.used]
    step = f"fuse: level of {day} from {', '.join(used)}"
    return with_provenance(
        profile, step + (f"; left out: {', '.join(left_out)}" if left_out else "")
    )


def _moving(laid: PassStack, line: Combined) -> Iterator[ChangingLocation]:
    """Where it is likely that track moves, and its rate in the band is beyond what its deviation explains.

    What lies within the band's longest wave of each other is one place: a dip has shoulders in any band.
    """
    rates = deviations(line.rate_error)
    of_line = np.where(np.isnan(line.level), np.nan, line.rate)
    for part in JUDGED:
        band = next(one for one in BANDS if one.name == part.name)
        of_band = band_pass_pieces(of_line, laid.spacing, band)
        spread = laid.along(rates[part.name])
        likely = laid.along(line.moves[RANGES.index(part)]) > LIKELY
        sure = np.flatnonzero(likely & (np.abs(np.nan_to_num(of_band)) > BEYOND * spread))
        apart = np.flatnonzero(np.diff(sure) * laid.spacing > band.longest) + 1
        for there in np.split(sure, apart) if sure.size else ():
            top = there[np.argmax(np.abs(of_band[there]))]
            start, peak, end = (float(laid.distance[i]) for i in (there[0], top, there[-1]))
            yield ChangingLocation(
                part.name, start, peak, end, float(of_band[top]), float(spread[top])
            )


def _bands_of(profile: xr.Dataset) -> list[str]:
    return [band.name for band in BANDS if f"standard_deviation_{band.name}" in profile]


def _flags(laid: PassStack, weighed: PassWeights) -> NDArray[np.int16]:
    """What all passes have alike at a place; a gap where no pass says anything."""
    says = np.isfinite(laid.level) & weighed.active[:, None]
    flags = np.where(says, laid.flags, -1)
    alike = np.bitwise_and.reduce(flags, axis=0)
    return np.where(says.any(axis=0), alike, Quality.GAP).astype(np.int16)


def _members(
    ordered: Sequence[DatedProfile], laid: PassStack, weighed: PassWeights
) -> tuple[Member, ...]:
    at = {one.of.name: i for i, one in enumerate(laid.passes)}
    found = []
    for one in ordered:
        i = at.get(one.name)
        times = {} if i is None else {band: float(each[i]) for band, each in weighed.times.items()}
        share = {} if i is None else {band: float(each[i]) for band, each in weighed.share.items()}
        lag = None if i is None else laid.passes[i].lag
        found.append(
            Member(one.name, one.day, str(one.profile.attrs["vehicle"]), lag, times, share)
        )
    return tuple(found)


def _about_time(found: Sequence[AlignedPass], day: date) -> list[str]:
    days = [one.of.day for one in found]
    if min(days) == max(days):
        return [f"All passes are of {days[0]}: there is no rate"]
    if day > max(days) or day < min(days):
        return [
            f"{day} lies outside the passes' days, {min(days)} to {max(days)}: the level there rests on the rate"
        ]
    return []

"""Summary of a fusion of passes, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackprofile.arrays import NORMAL_95
from trackprofile.bands import BANDS
from trackprofile.fusion.fuse import ChangingLocation, FusionResult
from trackprofile.fusion.rejection import Contradiction, RejectionReason

MAX_NAMED_LOCATIONS = 5
"""Number of changing locations that the summary names; the JSON output has all of them."""

_MILLI = 1e3
_PERIOD = 30  # days over which a change is given


def fusion_summary(result: FusionResult) -> list[str]:
    """Sentences on what was fused, with what uncertainty, where the track changes, and which passes contradict.

    Examples
    --------
    See `docs/fusion.md`.
    """
    distance = result.profile["distance"].to_numpy()
    vehicles = len({one.vehicle for one in result.passes})
    days = sorted(one.day for one in result.passes)
    count = "1 pass" if len(days) == 1 else f"{len(days)} passes"
    span = f"of {days[0]}" if days[0] == days[-1] else f"from {days[0]} to {days[-1]}"
    return [
        f"Level of {result.day}, {round(distance[0])} m to {round(distance[-1])} m, from {count} of {vehicles} "
        f"{'vehicle' if vehicles == 1 else 'vehicles'} {span}.",
        _deviation_sentence(result),
        *_change_sentences(result.changing, has_rate=len(set(days)) > 1),
        *(contradiction_sentence(one) for one in result.contradictions),
    ]


def _deviation_sentence(result: FusionResult) -> str:
    parts = []
    for band in BANDS:
        deviation = result.profile.get(f"standard_deviation_{band.name}")
        if deviation is not None:
            parts.append(f"{band.name} {_MILLI * float(np.nanmedian(deviation)):.3g} mm")
    return f"Median standard deviation: {', '.join(parts)}."


def _change_sentences(locations: Sequence[ChangingLocation], *, has_rate: bool) -> list[str]:
    if not has_rate:
        return []
    if not locations:
        return ["No change of the track is significant."]
    fastest = sorted(locations, key=lambda one: -abs(one.per_day))
    text = "; ".join(_rate_text(one) for one in fastest[:MAX_NAMED_LOCATIONS])
    remaining = len(fastest) - MAX_NAMED_LOCATIONS
    more = f"; and {remaining} more" if remaining > 0 else ""
    count = "1 location" if len(locations) == 1 else f"{len(locations)} locations"
    return [f"The track changes at {count} (± 95 % interval): {text}{more}."]


def _rate_text(one: ChangingLocation) -> str:
    change = _PERIOD * _MILLI * one.per_day
    half_width = _PERIOD * NORMAL_95 * _MILLI * one.deviation
    return f"{one.peak:.0f} m ({one.band}, {change:+.2f} ± {half_width:.2f} mm in {_PERIOD} days)"


def contradiction_sentence(one: Contradiction) -> str:
    """Sentence on a pass that contradicts the others: where, by how much, why, and with what consequence.

    Examples
    --------
    >>> lag = Contradiction("may.nc", RejectionReason.LAG, 0.0, 900.0, magnitude=40.0, used=True)
    >>> contradiction_sentence(lag)
    'may.nc contradicts the others from 0 m to 900 m: its distances are wrong, by 40.0 m; it is shifted and used.'
    """
    ratio = ""
    if one.error_ratio is not None:
        ratio = f" ({', '.join(one.bands)}, {one.error_ratio:.2g} times the stated error)"
    magnitude = ""
    if one.magnitude is not None:
        magnitude = (
            f", by {one.magnitude:.1f} m"
            if one.reason is RejectionReason.LAG
            else f", {100 * one.magnitude - 100:+.1f} %"
        )
    consequence = "it is left out"
    if one.used:
        consequence = "it is down-weighted" if one.error_ratio else "it is shifted and used"
    return (
        f"{one.name} contradicts the others from {round(one.start)} m to {round(one.end)} m{ratio}: "
        f"{one.reason.value}{magnitude}; {consequence}."
    )

"""What fusing passes found, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackprofile.bands import BANDS
from trackprofile.fusion.fuse import ChangingLocation, Fused
from trackprofile.fusion.rejection import Contradiction, RejectionReason

NAMED = 5
"""Places that are named in a sentence; all are in the tables."""

_MILLI = 1e3


def summary(found: Fused) -> list[str]:
    """What was fused, how sure it is, what moves, and which pass contradicts the others."""
    distance = found.profile["distance"].to_numpy()
    vehicles = len({one.vehicle for one in found.members})
    days = sorted(one.day for one in found.members)
    made = "1 pass" if len(days) == 1 else f"{len(days)} passes"
    span = f"of {days[0]}" if days[0] == days[-1] else f"from {days[0]} to {days[-1]}"
    return [
        f"{made} of {vehicles} {'vehicle' if vehicles == 1 else 'vehicles'} {span} "
        f"{'makes' if len(days) == 1 else 'make'} the level of {found.day}, "
        f"{round(distance[0])} m to {round(distance[-1])} m.",
        *_certainty(found),
        *_moves(found.moving, len(set(days)) > 1),
        *(contradiction_words(one) for one in found.contradictions),
    ]


def _certainty(found: Fused) -> list[str]:
    said = []
    for band in BANDS:
        spread = found.profile.get(f"standard_deviation_{band.name}")
        if spread is not None:
            said.append(f"{band.name} {_MILLI * float(np.nanmedian(spread)):.3g} mm")
    return [f"Standard deviation: {', '.join(said)}."]


def _moves(places: Sequence[ChangingLocation], timed: bool) -> list[str]:
    if not timed:
        return []
    if not places:
        return ["Nothing moves beyond what the passes' uncertainty explains."]
    fastest = sorted(places, key=lambda one: -abs(one.per_day))
    text = "; ".join(
        f"{one.peak:.0f} m ({one.band}, {30 * _MILLI * one.per_day:+.2f} ± {59 * _MILLI * one.deviation:.2f} mm in "
        "30 days)"
        for one in fastest[:NAMED]
    )
    rest = len(fastest) - NAMED
    more = f"; and {rest} more" if rest > 0 else ""
    return [f"{len(places)} {'place moves' if len(places) == 1 else 'places move'}: {text}{more}."]


def contradiction_words(one: Contradiction) -> str:
    """Of one pass: where it contradicts the others, how much, why, and what was done.

    Examples
    --------
    >>> contradiction_words(Contradiction("may.nc", Reason.LAG, 0.0, 900.0, size=40.0, used=True))
    'may.nc contradicts the others from 0 m to 900 m: its distances are off, by 40.0 m; it is moved, and used.'
    """
    times = (
        ""
        if one.times is None
        else f" ({', '.join(one.bands)}, {one.times:.2g} times what it states)"
    )
    size = ""
    if one.size is not None:
        size = (
            f", by {one.size:.1f} m"
            if one.reason is RejectionReason.LAG
            else f", {100 * one.size - 100:+.1f} %"
        )
    done = "it is left out"
    if one.used:
        done = "its weight is taken down" if one.times else "it is moved, and used"
    return (
        f"{one.name} contradicts the others from {round(one.start)} m to {round(one.end)} m{times}: "
        f"{one.reason.value}{size}; {done}."
    )

"""An assessment in sentences: what, where, how sure, and what it obliges to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.limits import KM_H, Action
from trackprofile.assessment.tables import words
from trackprofile.assessment.trend import ChangedLocation, Trend
from trackprofile.positioning.chainage import ChainageTable

NAMED = 5
"""Places that are named in a sentence; all are in the table."""

_MILLI = 1e3


def summary(found: Assessment, way: ChainageTable) -> list[str]:
    """What a track engineer wants to know first, gravest first.

    Examples
    --------
    >>> import numpy as np
    >>> from trackprofile.assessment.assess import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits_toml import read_limits
    >>> at = np.arange(0.0, 600.0, 0.25)
    >>> dip = build_profile(at, -0.04 * np.exp(-0.5 * ((at - 300) / 2) ** 2), kind="truth")
    >>> print(summary(assess(dip, read_limits("en-13848"), 40.0), Way())[0])
    1 place calls for immediate action: km 0.300 (D1, 26.3 mm down, beyond 23 mm with 100 %).
    """
    said = []
    for action in sorted(Action, reverse=True):
        of_action = [one for one in found.defects if one.likely == action]
        if of_action:
            said += _called_for(action, of_action, found, way)
    if not said:
        said.append("No place calls for anything: no limit is exceeded with 50 % or more.")
    possible = [one for one in found.defects if one.likely is None]
    if possible:
        said.append(
            f"{_places(len(possible))} may exceed a limit, with {100 * found.least_probability:.0f} to 50 %: "
            f"{_named(possible, way)}."
        )
    return [*said, *_classes(found, way), *_judged(found)]


def _called_for(
    action: Action, defects: Sequence[Defect], found: Assessment, way: ChainageTable
) -> list[str]:
    verb = "calls" if len(defects) == 1 else "call"
    kind = {Action.ALERT: "an alert"}.get(action, action.words)
    text = f"{_places(len(defects))} {verb} for {kind}: {_named(defects, way)}."
    duties = found.limits.duties
    if duties is None or action not in duties.words:
        return [text]
    return [text, f"This obliges to: {duties.words[action]}."]


def _places(count: int) -> str:
    return "1 place" if count == 1 else f"{count} places"


def _named(defects: Sequence[Defect], way: ChainageTable) -> str:
    gravest = sorted(defects, key=gravity, reverse=True)
    text = "; ".join(_place(one, way) for one in gravest[:NAMED])
    rest = len(defects) - NAMED
    return text + (f"; and {rest} more in the table" if rest > 0 else "")


def gravity(one: Defect) -> tuple[float, float]:
    """To sort defects by: what they call for, and how far they are beyond the lowest limit."""
    return float(one.likely or 0), abs(one.height) / min(one.limits.heights.values())


def _place(one: Defect, way: ChainageTable) -> str:
    action = one.likely or min(one.probabilities)
    way_up = "up" if one.height > 0 else "down"
    size = f"{abs(_MILLI * one.height):.1f}"
    if one.deviation:
        wide = 1.96 * _MILLI * one.deviation
        size += f" ± {wide:.1f}" if wide >= 0.1 else f" ± {wide:.2f}"
    return (
        f"{way.name(one.peak)} ({one.band}, {size} mm {way_up}, beyond "
        f"{_MILLI * one.limits.heights[action]:g} mm with {percent(one.probabilities[action])})"
    )


def percent(probability: float) -> str:
    """Of a probability: neither 0 nor 100 unless it is.

    Examples
    --------
    >>> percent(0.9997), percent(0.5), percent(1.0)
    ('>99 %', '50 %', '100 %')
    """
    if 0.995 <= probability < 1:
        return ">99 %"
    return "<1 %" if 0 < probability < 0.005 else f"{100 * probability:.0f} %"


def _classes(found: Assessment, way: ChainageTable) -> list[str]:
    said = []
    for band in found.levels:
        ones = [
            one
            for one in found.sections
            if one.band == band and one.classes and one.length == _longest(found)
        ]
        if not ones:
            continue
        classes = ones[0].classes
        counted = Counter(one.quality_class for one in ones)
        shares = ", ".join(
            f"{100 * counted[name] / len(ones):.0f} % {name}"
            for name in (classes.names if classes else ())
            if counted[name]
        )
        worst = max(ones, key=lambda one: one.standard_deviation)
        said.append(
            f"Sections of {_longest(found):g} m by class in {band}: {shares}; the worst begins at "
            f"{way.name(worst.start)}, with a standard deviation of {_MILLI * worst.standard_deviation:.2f} mm "
            f"({_MILLI * worst.low:.2f} to {_MILLI * worst.high:.2f} mm)."
        )
    return said


def _longest(found: Assessment) -> float:
    return max((one.length for one in found.sections), default=0.0)


def _judged(found: Assessment) -> list[str]:
    shares = ", ".join(
        f"{100 * float(level.assessed.mean()):.1f} % in {name}"
        for name, level in found.levels.items()
    )
    return [f"Judged: {shares} of the length; the rest is listed with its reasons."]


def headline(found: Assessment, way: ChainageTable) -> str:
    """From where to where, and at which speed."""
    return (
        f"{(found.end - found.start) / _MILLI:.3g} km, {way.name(found.start)} to {way.name(found.end)}, run "
        f"{way.direction}; line speed {found.speed / KM_H:.4g} km/h; limits: {found.limits.name}"
    )


def changes_summary(found: Trend, way: ChainageTable) -> list[str]:
    """What changed between passes, gravest first."""
    first, last = found.passes[0], found.passes[-1]
    span = f"from {first[1]} ({first[0]}) to {last[1]} ({last[0]})"
    if not found.places:
        said = [f"No change {span} beyond what the passes' uncertainty explains."]
    else:
        deepest = sorted(found.places, key=lambda one: -abs(one.change))
        text = "; ".join(change_words(one, way) for one in deepest[:NAMED])
        rest = len(deepest) - NAMED
        more = f"; and {rest} more in the table" if rest > 0 else ""
        verb = "place" if len(deepest) == 1 else "places"
        said = [f"{len(deepest)} {verb} changed {span}: {text}{more}."]
    for one in found.repeatabilities:
        kind = "the same vehicle" if one.same_vehicle else "different vehicles"
        limit = "" if one.limit is None else f" (to stay below {_MILLI * one.limit:g} mm)"
        said.append(
            f"{one.band}: 95 % of the differences between passes of {kind} are below "
            f"{_MILLI * one.difference:.3g} mm{limit}."
        )
    return said


def change_words(one: ChangedLocation, way: ChainageTable) -> str:
    """Of one place: how much, how fast, until when."""
    text = f"{way.name(one.peak)} ({one.band}, {_MILLI * one.change:+.2f} ± {1.96 * _MILLI * one.deviation:.2f} mm"
    if one.per_day is not None and one.per_day_deviation is not None:
        text += f", {30 * _MILLI * one.per_day:+.2f} ± {59 * _MILLI * one.per_day_deviation:.2f} mm in 30 days"
    ahead = next((each for each in one.reached if each.median), None)
    if ahead:
        latest = ahead.latest or "not within ten years"
        text += (
            f", {words(ahead.action)} at {_MILLI * ahead.limit:g} mm on {ahead.median} "
            f"({ahead.earliest} to {latest})"
        )
    return text + ")"

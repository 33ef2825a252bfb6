"""Summary of an assessment in sentences: defects and required actions, sections, assessed length, change."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from trackprofile.arrays import NORMAL_95
from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.defects import Defect
from trackprofile.assessment.limits import KM_H, Action
from trackprofile.assessment.tables import action_text
from trackprofile.assessment.trend import ChangedLocation, Trend
from trackprofile.positioning.chainage import ChainageTable

MAX_NAMED = 5
"""Maximum number of locations that a sentence names; the table lists all of them."""

_MILLI = 1e3
_MONTH = 30  # days


def summary(assessment: Assessment, chainage: ChainageTable) -> list[str]:
    """The main results in sentences, the most severe first.

    Examples
    --------
    >>> import numpy as np
    >>> from trackprofile.assessment.assess import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits_toml import read_limits
    >>> at = np.arange(0.0, 600.0, 0.25)
    >>> dip = build_profile(at, -0.04 * np.exp(-0.5 * ((at - 300) / 2) ** 2), kind="truth")
    >>> print(summary(assess(dip, read_limits("en-13848"), 40.0), ChainageTable())[0])
    1 location requires immediate action: km 0.300 (D1, 26.3 mm down, exceeds 23 mm with probability 100 %).
    """
    sentences = []
    for action in sorted(Action, reverse=True):
        defects = [one for one in assessment.defects if one.required_action == action]
        if defects:
            sentences += _required(action, defects, assessment, chainage)
    if not sentences:
        sentences.append(
            "No location requires an action: no limit is exceeded with a probability of 50 % or more."
        )
    possible = [one for one in assessment.defects if one.required_action is None]
    if possible:
        sentences.append(
            f"{_locations(len(possible))} may exceed a limit (probability {100 * assessment.least_probability:.0f} "
            f"to 50 %): {_named(possible, chainage)}."
        )
    return [*sentences, *_classes(assessment, chainage), _assessed_length(assessment)]


def _required(
    action: Action, defects: Sequence[Defect], assessment: Assessment, chainage: ChainageTable
) -> list[str]:
    verb = "requires" if len(defects) == 1 else "require"
    name = {Action.ALERT: "an alert"}.get(action, action.text)
    text = f"{_locations(len(defects))} {verb} {name}: {_named(defects, chainage)}."
    action_texts = assessment.limits.action_texts
    if action_texts is None or action not in action_texts.texts:
        return [text]
    return [text, f"Required action: {action_texts.texts[action]}."]


def _locations(count: int) -> str:
    return "1 location" if count == 1 else f"{count} locations"


def _named(defects: Sequence[Defect], chainage: ChainageTable) -> str:
    ordered = sorted(defects, key=severity, reverse=True)
    text = "; ".join(_defect(one, chainage) for one in ordered[:MAX_NAMED])
    return text + _rest(len(defects))


def _rest(count: int) -> str:
    return f"; and {count - MAX_NAMED} more in the table" if count > MAX_NAMED else ""


def severity(defect: Defect) -> tuple[float, float]:
    """Sort key of a defect: its required action, then the ratio of its height to the lowest limit."""
    return float(defect.required_action or 0), abs(defect.height) / min(
        defect.limits.heights.values()
    )


def _defect(defect: Defect, chainage: ChainageTable) -> str:
    action = defect.required_action or min(defect.probabilities)
    side = "up" if defect.height > 0 else "down"
    size = f"{abs(_MILLI * defect.height):.1f}"
    if defect.deviation:
        half = NORMAL_95 * _MILLI * defect.deviation
        digits = ".1f" if half >= 0.1 else ".2f" if half >= 0.005 else ".1g"
        size += f" ± {half:{digits}}"
    return (
        f"{chainage.name(defect.peak)} ({defect.band}, {size} mm {side}, exceeds "
        f"{_MILLI * defect.limits.heights[action]:g} mm with probability {percent(defect.probabilities[action])})"
    )


def percent(probability: float) -> str:
    """A probability in percent; 0 and 100 only where it is exactly that.

    Examples
    --------
    >>> percent(0.9997), percent(0.5), percent(1.0)
    ('>99 %', '50 %', '100 %')
    """
    if 0.995 <= probability < 1:
        return ">99 %"
    return "<1 %" if 0 < probability < 0.005 else f"{100 * probability:.0f} %"


def _classes(assessment: Assessment, chainage: ChainageTable) -> list[str]:
    """The share of each quality class among the longest sections, per band."""
    length = max((one.length for one in assessment.sections), default=0.0)
    sentences = []
    for band in assessment.levels:
        sections = [
            one
            for one in assessment.sections
            if one.band == band and one.classes and one.length == length
        ]
        if not sections:
            continue
        classes = sections[0].classes
        counts = Counter(one.quality_class for one in sections)
        shares = ", ".join(
            f"{100 * counts[name] / len(sections):.0f} % {name}"
            for name in (classes.names if classes else ())
            if counts[name]
        )
        worst = max(sections, key=lambda one: one.standard_deviation)
        sentences.append(
            f"Sections of {length:g} m by class in {band}: {shares}; the worst begins at "
            f"{chainage.name(worst.start)}, with a standard deviation of {_MILLI * worst.standard_deviation:.2f} mm "
            f"({_MILLI * worst.low:.2f} to {_MILLI * worst.high:.2f} mm)."
        )
    return sentences


def _assessed_length(assessment: Assessment) -> str:
    shares = ", ".join(
        f"{100 * float(level.assessed.mean()):.1f} % in {name}"
        for name, level in assessment.levels.items()
    )
    return f"Assessed length: {shares}; the rest is listed with the reasons."


def headline(assessment: Assessment, chainage: ChainageTable) -> str:
    """Length, ends, direction, line speed and limit set in one line."""
    return (
        f"{(assessment.end - assessment.start) / _MILLI:.3g} km, {chainage.name(assessment.start)} to "
        f"{chainage.name(assessment.end)}, run {chainage.direction}; line speed {assessment.speed / KM_H:.4g} km/h; "
        f"limits: {assessment.limits.name}"
    )


def caveat_line(assessment: Assessment) -> str:
    """One line that says how many caveats apply; empty without any. The report lists them."""
    count = len(set(assessment.notes))
    if not count:
        return ""
    return (
        f"{'1 caveat applies' if count == 1 else f'{count} caveats apply'} to limits and assessment"
    )


def trend_summary(trend: Trend, chainage: ChainageTable) -> list[str]:
    """Changes between passes in sentences, the largest first."""
    first, last = trend.passes[0], trend.passes[-1]
    span = f"from {first[1]} ({first[0]}) to {last[1]} ({last[0]})"
    if not trend.changed_locations:
        sentences = [
            f"No significant change {span}: the uncertainty of the passes explains all differences."
        ]
    else:
        ordered = sorted(trend.changed_locations, key=lambda one: -abs(one.change))
        text = "; ".join(changed_location(one, chainage) for one in ordered[:MAX_NAMED])
        sentences = [f"{_locations(len(ordered))} changed {span}: {text}{_rest(len(ordered))}."]
    for one in trend.repeatabilities:
        vehicles = "the same vehicle" if one.same_vehicle else "different vehicles"
        limit = "" if one.limit is None else f" (required: below {_MILLI * one.limit:g} mm)"
        sentences.append(
            f"{one.band}: 95 % of the differences between passes of {vehicles} are below "
            f"{_MILLI * one.difference:.3g} mm{limit}."
        )
    return sentences


def changed_location(one: ChangedLocation, chainage: ChainageTable) -> str:
    """A changed location: size and rate of the change, and when it reaches a limit."""
    half = NORMAL_95 * _MILLI * one.deviation
    text = f"{chainage.name(one.peak)} ({one.band}, {_MILLI * one.change:+.2f} ± {half:.2f} mm"
    if one.per_day is not None and one.per_day_deviation is not None:
        rate, rate_half = (
            _MONTH * _MILLI * value for value in (one.per_day, NORMAL_95 * one.per_day_deviation)
        )
        text += f", {rate:+.2f} ± {rate_half:.2f} mm in {_MONTH} days"
    crossing = next((each for each in one.limit_crossings if each.median), None)
    if crossing:
        latest = crossing.latest or "not within ten years"
        text += (
            f", {action_text(crossing.action)} at {_MILLI * crossing.limit:g} mm on {crossing.median} "
            f"({crossing.earliest} to {latest})"
        )
    return text + ")"

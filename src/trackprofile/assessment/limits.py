"""Limit sets: heights from which defects require an action, and standard deviations of quality classes.

Limits are data in files, never constants in code. Each has its source, and whether it was verified against that
source. EN 13848-5 and -6 state them by line speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import TypeVar

from trackprofile.errors import DataError

Kind = TypeVar("Kind", bound="SpeedBand")

KM_H = 1 / 3.6
"""m/s of one km/h."""


class Action(IntEnum):
    """Action that an exceeded limit requires, in order of severity (EN 13848-5)."""

    ALERT = 1
    INTERVENTION = 2
    IMMEDIATE_ACTION = 3

    @property
    def text(self) -> str:
        """Name of the action, such as ``immediate action``."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class SpeedBand:
    """Limits in one wavelength band for a range of line speeds.

    Parameters
    ----------
    band : name of the wavelength band
    above, up_to : range of line speed, lower end excluded, upper end included [m/s]
    source : source of the numbers
    verified : whether the numbers were compared with the source
    """

    band: str
    above: float
    up_to: float
    source: str
    verified: bool

    @property
    def speeds(self) -> str:
        """Range of line speed as text, such as ``80 to 120 km/h``."""
        return f"{self.above / KM_H:.4g} to {self.up_to / KM_H:.4g} km/h"


@dataclass(frozen=True)
class DefectLimits(SpeedBand):
    """Limits for isolated defects, from mean to peak.

    Parameters
    ----------
    heights : height above which each action is required [m]; empty if the band has no limits
    """

    heights: Mapping[Action, float]

    def __post_init__(self) -> None:
        what = f"Isolated defects in {self.band}, {self.speeds}"
        _check_rising(what, [self.heights[action] for action in sorted(self.heights)])


@dataclass(frozen=True)
class QualityClasses(SpeedBand):
    """Track quality classes by the standard deviation over a section.

    Parameters
    ----------
    below : upper bound of the standard deviation of each class, best class first [m]
    beyond : name of the class of all higher standard deviations
    """

    below: Mapping[str, float]
    beyond: str

    def __post_init__(self) -> None:
        what = f"Quality classes in {self.band}, {self.speeds}"
        _check_rising(what, list(self.below.values()))
        if self.beyond in self.below:
            raise DataError(f"{what}: class {self.beyond!r} occurs twice; rename one.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all classes, best first."""
        return (*self.below, self.beyond)


@dataclass(frozen=True)
class Accuracy:
    """Required repeatability and reproducibility of runs over the same track (EN 13848-2).

    Parameters
    ----------
    band : name of the wavelength band
    repeatability, reproducibility : maximum of the 95th percentile of the differences between runs of the same system,
        and of different systems [m]
    source : source of the numbers
    verified : whether the numbers were compared with the source
    """

    band: str
    repeatability: float
    reproducibility: float
    source: str
    verified: bool


@dataclass(frozen=True)
class ActionTexts:
    """What each action requires of the infrastructure manager, as text.

    Parameters
    ----------
    texts : text of each action
    source : source of the texts
    verified : whether the texts were compared with the source
    """

    texts: Mapping[Action, str]
    source: str
    verified: bool


@dataclass(frozen=True)
class Limits:
    """All limits of one railway or standard.

    Parameters
    ----------
    name : name of the limit set
    defects, classes : limits for isolated defects, and quality classes; the speed ranges of each band begin at 0 and
        have no overlap or gap
    accuracies : required repeatability and reproducibility, at most one per band
    action_texts : what each action requires
    source : source of the limit set

    Raises
    ------
    DataError : speed ranges overlap, have a gap or do not begin at 0, or limits do not increase with severity.

    Examples
    --------
    >>> low = DefectLimits("D1", 0.0, 40.0, "a rule", True, {Action.ALERT: 0.01})
    >>> high = DefectLimits("D1", 35.0, 60.0, "a rule", True, {Action.ALERT: 0.008})
    >>> Limits("ours", defects=(low, high))
    Traceback (most recent call last):
    trackprofile.errors.DataError: Isolated defects in D1: the speed ranges 0 to 144 km/h and ... overlap; ...
    """

    name: str
    defects: tuple[DefectLimits, ...] = ()
    classes: tuple[QualityClasses, ...] = ()
    accuracies: tuple[Accuracy, ...] = ()
    action_texts: ActionTexts | None = None
    source: str = ""

    def __post_init__(self) -> None:
        _check_speeds("Isolated defects", self.defects)
        _check_speeds("Quality classes", self.classes)
        bands = [one.band for one in self.accuracies]
        for band in bands:
            if bands.count(band) > 1:
                raise DataError(f"Accuracy in {band} occurs twice; remove one.")

    def defects_at(self, band: str, speed: float) -> DefectLimits | None:
        """Limits for isolated defects at a line speed [m/s]; None if the band has none at any speed."""
        return _at_speed("isolated defects", self.name, self.defects, band, speed)

    def classes_at(self, band: str, speed: float) -> QualityClasses | None:
        """Quality classes at a line speed [m/s]; None if the band has none at any speed."""
        return _at_speed("quality classes", self.name, self.classes, band, speed)

    def accuracy(self, band: str) -> Accuracy | None:
        """Required accuracy in a band; None if the limit set has none."""
        return next((one for one in self.accuracies if one.band == band), None)


def unverified(limits: Limits, bands: Sequence[str], speed: float) -> tuple[str, ...]:
    """One note for each limit that `assess` uses and that was not verified against its source.

    Parameters
    ----------
    limits : limit set
    bands : names of the assessed bands
    speed : speed of the line [m/s]
    """
    used: list[tuple[str, _Rule | None]] = []
    for band in bands:
        used.append((f"isolated defects in {band}", limits.defects_at(band, speed)))
        used.append((f"quality classes in {band}", limits.classes_at(band, speed)))
    used.append(("required actions", limits.action_texts))
    return _unverified(limits, used)


UNVERIFIED = "not verified against the standard"

UNVERIFIED_NOTE = (
    "Limits are not verified against the standard; see `trackprofile report` or docs/assessment.md"
)
"""Stands for all notes about unverified limits where a list of them would hide the results."""


def condense_notes(notes: Sequence[str]) -> list[str]:
    """The notes of an assessment with one note in place of all that name unverified limits.

    Examples
    --------
    >>> notes = ["Limits 'ours', isolated defects in D1: not verified against the standard (source: memo)", "Other"]
    >>> condense_notes(notes)[1:]
    ['Other']
    """
    others = [one for one in notes if UNVERIFIED not in one]
    return others if len(others) == len(notes) else [UNVERIFIED_NOTE, *others]


def unverified_accuracies(limits: Limits, bands: Sequence[str]) -> tuple[str, ...]:
    """One note for each required accuracy in some bands that was not verified against its source."""
    return _unverified(
        limits, [(f"repeatability in {band}", limits.accuracy(band)) for band in bands]
    )


_Rule = DefectLimits | QualityClasses | Accuracy | ActionTexts


def _unverified(limits: Limits, used: Sequence[tuple[str, _Rule | None]]) -> tuple[str, ...]:
    return tuple(
        f"Limits {limits.name!r}, {what}: {UNVERIFIED} (source: {one.source})"
        for what, one in used
        if one is not None and not one.verified and not _empty(one)
    )


def _empty(one: _Rule) -> bool:
    return isinstance(one, DefectLimits) and not one.heights


def _at_speed(what: str, name: str, limits: Sequence[Kind], band: str, speed: float) -> Kind | None:
    in_band = [one for one in limits if one.band == band]
    for one in in_band:
        if one.above < speed <= one.up_to * (1 + 1e-9):
            return one
    if in_band:
        highest = max(one.up_to for one in in_band)
        raise DataError(
            f"Limits {name!r}, {what} in {band}: expected a speed above 0 and up to {highest / KM_H:.4g} km/h, got "
            f"{speed / KM_H:.4g} km/h; choose another speed, or a limit set for it."
        )
    return None


def _check_speeds(what: str, limits: Sequence[SpeedBand]) -> None:
    for band in dict.fromkeys(one.band for one in limits):
        ordered = sorted((one for one in limits if one.band == band), key=lambda one: one.above)
        where = f"{what} in {band}"
        for one in ordered:
            if not one.above < one.up_to:
                raise DataError(f"{where}: expected above < up_to, got {one.speeds}.")
        if ordered[0].above > 0:
            raise DataError(
                f"{where}: no speed range covers 0 to {ordered[0].above / KM_H:.4g} km/h; "
                "add it, without limits if there are none."
            )
        for one, after in pairwise(ordered):
            _check_neighbours(where, one, after)


def _check_neighbours(where: str, one: SpeedBand, after: SpeedBand) -> None:
    tolerance = 1e-6
    if after.above < one.up_to - tolerance:
        raise DataError(
            f"{where}: the speed ranges {one.speeds} and {after.speeds} overlap; "
            "let each range begin at the end of the previous one."
        )
    if after.above > one.up_to + tolerance:
        raise DataError(
            f"{where}: no speed range covers {one.up_to / KM_H:.4g} to {after.above / KM_H:.4g} km/h; "
            "add it, without limits if there are none."
        )


def _check_rising(what: str, values: Sequence[float]) -> None:
    if not all(a < b for a, b in pairwise([0.0, *values])):
        millimetres = ", ".join(f"{1e3 * value:g}" for value in values)
        raise DataError(
            f"{what}: expected limits above 0 that increase with severity, got {millimetres} mm."
        )

"""Limits: from which height a defect obliges to something, and which class a section is of.

They are replaceable data, never constants in code: each stands with its source, and with whether it
was verified against that source. EN 13848-5 and -6 sort them by the line's speed.
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
    """What an exceeded limit calls for, from the mildest (EN 13848-5)."""

    ALERT = 1
    INTERVENTION = 2
    IMMEDIATE_ACTION = 3

    @property
    def words(self) -> str:
        """Such as ``immediate action``."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class SpeedBand:
    """Limits of one band of wavelengths for lines above one speed and up to another.

    Parameters
    ----------
    band : of wavelengths, by name
    above, up_to : the line's speed, the first excluded, the second included [m/s]
    source : where the numbers come from
    verified : whether they were compared with that source
    """

    band: str
    above: float
    up_to: float
    source: str
    verified: bool

    @property
    def speeds(self) -> str:
        """Such as ``80 to 120 km/h``."""
        return f"{self.above / KM_H:.4g} to {self.up_to / KM_H:.4g} km/h"


@dataclass(frozen=True)
class DefectLimits(SpeedBand):
    """Heights of isolated defects, from the mean to the peak.

    Parameters
    ----------
    heights : what is called for above which height [m]; empty where a band has no limits
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
    below : per class, best first, the standard deviation that it stays below [m]
    beyond : the class of all others
    """

    below: Mapping[str, float]
    beyond: str

    def __post_init__(self) -> None:
        what = f"Quality classes in {self.band}, {self.speeds}"
        _check_rising(what, list(self.below.values()))
        if self.beyond in self.below:
            raise DataError(f"{what}: class {self.beyond!r} is there twice; rename one.")

    @property
    def names(self) -> tuple[str, ...]:
        """All classes, best first."""
        return (*self.below, self.beyond)


@dataclass(frozen=True)
class Accuracy:
    """What runs over the same track may differ by (EN 13848-2).

    Parameters
    ----------
    band : of wavelengths, by name
    repeatability, reproducibility : 95 % of the differences of runs by the same system, and by
        different ones, are to stay below [m]
    """

    band: str
    repeatability: float
    reproducibility: float
    source: str
    verified: bool


@dataclass(frozen=True)
class Duties:
    """What each action obliges to, in words."""

    words: Mapping[Action, str]
    source: str
    verified: bool


@dataclass(frozen=True)
class Limits:
    """All limits of one railway or standard.

    Parameters
    ----------
    name : what they are called
    defects, classes : each band of wavelengths from standstill on, without overlap or hole
    accuracies : at most one per band
    duties : of the actions
    source : of the whole

    Raises
    ------
    DataError : speed bands overlap, leave a hole or do not begin at 0; limits that do not rise.

    Examples
    --------
    >>> low = DefectLimits("D1", 0.0, 40.0, "a rule", True, {Action.ALERT: 0.01})
    >>> high = DefectLimits("D1", 35.0, 60.0, "a rule", True, {Action.ALERT: 0.008})
    >>> Limits("ours", defects=(low, high))
    Traceback (most recent call last):
    trackprofile.errors.DataError: Isolated defects in D1: the speed bands 0 to 144 km/h and ... overlap; ...
    """

    name: str
    defects: tuple[DefectLimits, ...] = ()
    classes: tuple[QualityClasses, ...] = ()
    accuracies: tuple[Accuracy, ...] = ()
    duties: Duties | None = None
    source: str = ""

    def __post_init__(self) -> None:
        _check_speeds("Isolated defects", self.defects)
        _check_speeds("Quality classes", self.classes)
        bands = [one.band for one in self.accuracies]
        for band in bands:
            if bands.count(band) > 1:
                raise DataError(f"Accuracy in {band} is there twice; remove one.")

    def defects_at(self, band: str, speed: float) -> DefectLimits | None:
        """Those of a band at a line speed [m/s]; None where the band has none at any speed."""
        return _at("isolated defects", self.name, self.defects, band, speed)

    def classes_at(self, band: str, speed: float) -> QualityClasses | None:
        """Those of a band at a line speed [m/s]; None where the band has none at any speed."""
        return _at("quality classes", self.name, self.classes, band, speed)

    def accuracy(self, band: str) -> Accuracy | None:
        """Of a band, if it is stated."""
        return next((one for one in self.accuracies if one.band == band), None)


def unverified(limits: Limits, bands: Sequence[str], speed: float) -> tuple[str, ...]:
    """One sentence for each limit that `assess` uses and that was not verified against its source.

    Parameters
    ----------
    limits : as they were read
    bands : names of the bands that are assessed
    speed : of the line [m/s]
    """
    used: list[tuple[str, _Rule | None]] = []
    for band in bands:
        used.append((f"isolated defects in {band}", limits.defects_at(band, speed)))
        used.append((f"quality classes in {band}", limits.classes_at(band, speed)))
    used.append(("what the actions oblige to", limits.duties))
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
    """The same for what runs may differ by, in some bands by name."""
    return _unverified(
        limits, [(f"repeatability in {band}", limits.accuracy(band)) for band in bands]
    )


_Rule = DefectLimits | QualityClasses | Accuracy | Duties


def _unverified(limits: Limits, used: Sequence[tuple[str, _Rule | None]]) -> tuple[str, ...]:
    return tuple(
        f"Limits {limits.name!r}, {what}: {UNVERIFIED} (source: {one.source})"
        for what, one in used
        if one is not None and not one.verified and not _empty(one)
    )


def _empty(one: _Rule) -> bool:
    return isinstance(one, DefectLimits) and not one.heights


def _at(what: str, name: str, ones: Sequence[Kind], band: str, speed: float) -> Kind | None:
    of_band = [one for one in ones if one.band == band]
    for one in of_band:
        if one.above < speed <= one.up_to * (1 + 1e-9):
            return one
    if of_band:
        last = max(one.up_to for one in of_band)
        raise DataError(
            f"Limits {name!r}, {what} in {band}: there are none at {speed / KM_H:.4g} km/h, only above 0 "
            f"and up to {last / KM_H:.4g} km/h; choose another speed, or a file that has them."
        )
    return None


def _check_speeds(what: str, ones: Sequence[SpeedBand]) -> None:
    for band in dict.fromkeys(one.band for one in ones):
        sorted_ones = sorted((one for one in ones if one.band == band), key=lambda one: one.above)
        where = f"{what} in {band}"
        for one in sorted_ones:
            if not one.above < one.up_to:
                raise DataError(f"{where}: expected above < up_to, got {one.speeds}.")
        if sorted_ones[0].above > 0:
            raise DataError(
                f"{where}: no speed band covers 0 to {sorted_ones[0].above / KM_H:.4g} km/h; "
                "add it, without limits if there are none."
            )
        for one, after in pairwise(sorted_ones):
            _check_neighbours(where, one, after)


def _check_neighbours(where: str, one: SpeedBand, after: SpeedBand) -> None:
    tolerance = 1e-6
    if after.above < one.up_to - tolerance:
        raise DataError(
            f"{where}: the speed bands {one.speeds} and {after.speeds} overlap; "
            "let each begin where the one before ends."
        )
    if after.above > one.up_to + tolerance:
        raise DataError(
            f"{where}: no speed band covers {one.up_to / KM_H:.4g} to {after.above / KM_H:.4g} km/h; "
            "add it, without limits if there are none."
        )


def _check_rising(what: str, values: Sequence[float]) -> None:
    if not all(a < b for a, b in pairwise([0.0, *values])):
        millimetres = ", ".join(f"{1e3 * value:g}" for value in values)
        raise DataError(
            f"{what}: expected limits above 0 that rise with severity, got {millimetres} mm."
        )

"""What a column of a logger's file probably is, by its name, its unit and its values; for a person to correct."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import UnitError
from trackprofile.io.column_info import ColumnInfo
from trackprofile.units import FACTORS, unit_factor

Array = NDArray[np.float64]


class Role(StrEnum):
    """What a column can be."""

    TIME = "time"
    DISTANCE = "distance"
    SPEED = "speed"
    LATITUDE = "latitude"
    LONGITUDE = "longitude"
    GNSS_SPEED = "satellite speed"
    PULSES = "odometer pulses"
    POST = "kilometre posts"
    VERTICAL = "vertical acceleration"
    PITCH = "pitch rate"
    ROLL = "roll rate"
    ACCELERATION = "acceleration, not vertical"
    RATE = "rate, of neither pitch nor roll"
    OTHER = "other"


DIMENSIONS: Mapping[Role, str] = {
    Role.TIME: "time",
    Role.DISTANCE: "length",
    Role.SPEED: "speed",
    Role.LATITUDE: "angle",
    Role.LONGITUDE: "angle",
    Role.GNSS_SPEED: "speed",
    Role.POST: "length",
    Role.VERTICAL: "acceleration",
    Role.PITCH: "angular rate",
    Role.ROLL: "angular rate",
}

SENSOR_ROLES = (Role.VERTICAL, Role.PITCH, Role.ROLL)
"""What a recording's channels measure."""

_ACCELERATION = r"acc|beschl|\ba_?[xyz]\b|加速度"
_NOT_VERTICAL = "lat|quer|long|längs"
_RATE = r"gyr|rate|omega|winkelgeschw|dreh(rate|geschw)|角速度"
_SATELLITE = "gps|gnss|doppler|衛星"
_SPEED = r"speed|veloc|geschw|tacho|\bv\b|速度"
_NAMES: tuple[tuple[Role, str], ...] = (
    (Role.ACCELERATION, rf"({_ACCELERATION}).*({_NOT_VERTICAL}|[_ ]?[xy]\b)|({_NOT_VERTICAL}).*({_ACCELERATION})"),
    (Role.VERTICAL, _ACCELERATION),
    (Role.PITCH, r"pitch|nick|ピッチ"),
    (Role.RATE, rf"({_RATE}).*(yaw|gier|[_ ]?z\b)|(yaw|gier)"),
    (Role.ROLL, rf"({_RATE}).*[_ ]?x\b|roll|wank|ロール"),
    (Role.PITCH, _RATE),
    (Role.GNSS_SPEED, rf"({_SATELLITE}).*({_SPEED})|({_SPEED}).*({_SATELLITE})"),
    (Role.SPEED, _SPEED),
    (Role.LATITUDE, r"\blat(itude)?\b|breite|緯度"),
    (Role.LONGITUDE, r"\b(lon|lng|long)(gitude)?\b|länge(ngrad)?\b|経度"),
    (Role.PULSES, r"puls|impuls|\bticks?\b|encoder|zähl|counter|パルス"),
    (Role.POST, r"post|hektomet|(km|kilomet\w*)[ -]?(stein|tafel|mark)|milestone|キロ程標|距離標"),
    (Role.DISTANCE, r"dist|weg|chainage|mileage|kilomet|station|odo|距離"),
    (Role.TIME, r"time|zeit|stamp|\bt\b|\butc|時刻"),
)  # fmt: skip
_BOGIE = "bogie|drehg|truck|台車"
_REAR = "rear|trail|hint|nachl|2"
_BODIES = (
    (rf"({_REAR}).*({_BOGIE})|({_BOGIE}).*({_REAR})", "trailing bogie"),
    (_BOGIE, "leading bogie"),
    (r"axle|box|wheel|radsatz|achs|軸箱", "wheelset 1"),
)  # fmt: skip

_LEFT, _RIGHT = r"\b(left|links?|l|li|lh)\b|左", r"\b(right|rechts?|r|re|rh)\b|右"

SIDE_OFFSET = 1.0
"""m from the middle, at which a sensor probably is of which only the side is said."""

_MAX_DEGREES = {Role.LATITUDE: 90.0, Role.LONGITUDE: 180.0}

MIN_MISSING_SHARE_OF_POSTS = 0.5
"""Share of missing values from which kilometres are posts passed, and no distance."""

MIN_MONOTONIC_SHARE = 0.99
"""Share of steps in one direction that make a distance."""

_MAX_SPEED = 60.0
"""m/s: what is above is in km/h."""

_MAX_KILOMETRE = 3000.0
"""km: posts below say kilometres."""


@dataclass(frozen=True)
class ColumnGuess:
    """Role, unit, and the body that carries it, how far to the left of its middle; ``sure`` where the file says the
    unit itself."""

    role: Role
    unit: str = ""
    body: str = ""
    sure: bool = False
    lateral: float = 0.0


def guess(heading: ColumnInfo, values: Array) -> ColumnGuess:
    """What a column, with its values (n,), probably is.

    Examples
    --------
    >>> guess(ColumnInfo("Bogie acc z", "g"), np.array([1.0, 1.01]))
    Guess(role=<Role.VERTICAL: 'vertical acceleration'>, unit='g', body='leading bogie', sure=True, lateral=0.0)
    >>> guess(ColumnInfo("GPS speed"), np.array([0.0, 140.0])).unit
    'km/h'
    """
    if heading.form:
        role = Role.OTHER if heading.form == "text" else Role.TIME
        return ColumnGuess(role, heading.form if role is Role.TIME else "", sure=role is Role.TIME)
    unit = heading.unit or _unit_in_name(heading.name)
    role = _role_by_name(heading.name)
    if role is Role.OTHER:
        role = _role_by_unit(unit)
        if role is Role.DISTANCE and not _is_monotonic(values):
            role = Role.OTHER  # a height, or some other length
    role = _role_by_values(role, values)
    if role is Role.PULSES:
        return ColumnGuess(role, "pulses", sure=True)
    dimension = DIMENSIONS.get(role)
    if dimension is None:
        return ColumnGuess(role, unit)
    sure = _is_unit_of(unit, dimension)
    body = _body_in_name(heading.name) if role in SENSOR_ROLES else ""
    lateral = _lateral_in_name(heading.name) if role is Role.VERTICAL else 0.0
    return ColumnGuess(role, unit if sure else _unit_by_values(role, values), body, sure, lateral)


def _role_by_values(role: Role, values: Array) -> Role:
    """The role, or another where the values cannot be of it."""
    known = values[np.isfinite(values)]
    if role in _MAX_DEGREES and known.size and np.max(np.abs(known)) > _MAX_DEGREES[role]:
        return Role.OTHER
    if role is Role.DISTANCE and 0 < known.size < (1.0 - MIN_MISSING_SHARE_OF_POSTS) * values.size:
        return Role.POST
    return role


def _is_monotonic(values: Array) -> bool:
    """Whether values rise, or fall, as a distance does."""
    steps = np.diff(values[np.isfinite(values)])
    return steps.size > 0 and bool(
        max(np.mean(steps >= 0), np.mean(steps <= 0)) > MIN_MONOTONIC_SHARE
    )


def _role_by_name(name: str) -> Role:
    plain = re.sub(r"[_./]+", " ", name.lower())
    return next((role for role, words in _NAMES if re.search(words, plain)), Role.OTHER)


def _role_by_unit(unit: str) -> Role:
    return next(
        (role for role, dimension in DIMENSIONS.items() if _is_unit_of(unit, dimension)), Role.OTHER
    )


def _is_unit_of(unit: str, dimension: str) -> bool:
    try:
        unit_factor(unit, dimension)
    except UnitError:
        return False
    return bool(unit)


def _unit_in_name(name: str) -> str:
    """A unit at the end of a name, such as in ``distance_m`` or ``speed_km_h``."""
    plain = name.lower().replace("_per_", "/").replace("deg", "°")
    found = [""]
    for unit in (unit for units in FACTORS.values() for unit in units):
        written = unit.lower().replace("²", "2").replace(" ", "_")
        forms = {written, written.replace("/", "_"), written.replace("/", "")}
        found += [unit for form in forms if plain.endswith(("_" + form, " " + form))]
    return max(found, key=len)


def _unit_by_values(role: Role, values: Array) -> str:
    """The unit in which such values are likely; SI where that tells nothing."""
    known = values[np.isfinite(values)]
    if known.size:
        if role is Role.VERTICAL and abs(abs(np.median(known)) - 1.0) < 0.1:
            return "g"
        if role in {Role.SPEED, Role.GNSS_SPEED} and np.max(np.abs(known)) > _MAX_SPEED:
            return "km/h"
        if role is Role.VERTICAL and abs(abs(np.median(known)) - 1000.0) < 100.0:
            return "mg"
        if role in _MAX_DEGREES:
            return "°"
        if role is Role.POST and np.max(np.abs(known)) < _MAX_KILOMETRE:
            return "km"
    return next(iter(FACTORS[DIMENSIONS[role]]))


def _body_in_name(name: str) -> str:
    plain = name.lower()
    return next((body for words, body in _BODIES if re.search(words, plain)), "body")


def _lateral_in_name(name: str) -> float:
    """m to the left; 0 where a name says neither side, or both."""
    plain = re.sub(r"[_./]+", " ", name.lower())
    left, right = (bool(re.search(words, plain)) for words in (_LEFT, _RIGHT))
    return SIDE_OFFSET * (left - right)

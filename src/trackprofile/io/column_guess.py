"""Probable meaning of a column in a file of a logger, by its name, unit and values; a person has to check it."""

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
    """Meaning of a column."""

    TIME = "time"
    DISTANCE = "distance"
    SPEED = "speed"
    LATITUDE = "latitude"
    LONGITUDE = "longitude"
    GNSS_SPEED = "GNSS speed"
    PULSES = "odometer pulses"
    POST = "kilometre posts"
    VERTICAL = "vertical acceleration"
    PITCH = "pitch rate"
    ROLL = "roll rate"
    ACCELERATION = "other acceleration"
    RATE = "other angular rate"
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
"""Roles of the channels of a recording."""

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
"""Assumed distance from the middle of a sensor of which only the side is stated [m]."""

_MAX_DEGREES = {Role.LATITUDE: 90.0, Role.LONGITUDE: 180.0}

MIN_MISSING_SHARE_OF_POSTS = 0.5
"""Share of missing values above which kilometres are those of kilometre posts, and not a distance."""

MIN_MONOTONIC_SHARE = 0.99
"""Share of steps in one direction above which values are a distance."""

_MAX_SPEED = 60.0
"""Speed above which the unit is km/h [m/s]."""

_MAX_KILOMETRE = 3000.0
"""Location of a post below which the unit is km [km]."""


@dataclass(frozen=True)
class ColumnGuess:
    """Probable meaning of a column.

    Parameters
    ----------
    role : what it measures
    unit : its unit
    body : body of the vehicle that carries the sensor; "" for other columns
    sure : whether the file states the unit
    lateral : distance of the sensor to the left of the centre of the body [m]
    """

    role: Role
    unit: str = ""
    body: str = ""
    sure: bool = False
    lateral: float = 0.0


def guess(heading: ColumnInfo, values: Array) -> ColumnGuess:
    """Guess the meaning of a column.

    Parameters
    ----------
    heading : information in the file
    values : values of the column, (n,) [unit of the column]

    Examples
    --------
    >>> guess(ColumnInfo("Bogie acc z", "g"), np.array([1.0, 1.01]))
    ColumnGuess(role=<Role.VERTICAL: 'vertical acceleration'>, unit='g', body='leading bogie', sure=True, lateral=0.0)
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
            role = Role.OTHER  # a height, or another length
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
    """Role, corrected where the values are impossible for it."""
    known = values[np.isfinite(values)]
    if role in _MAX_DEGREES and known.size and np.max(np.abs(known)) > _MAX_DEGREES[role]:
        return Role.OTHER
    if role is Role.DISTANCE and 0 < known.size < (1.0 - MIN_MISSING_SHARE_OF_POSTS) * values.size:
        return Role.POST
    return role


def _is_monotonic(values: Array) -> bool:
    """Whether values increase, or decrease, as a distance does."""
    steps = np.diff(values[np.isfinite(values)])
    return steps.size > 0 and bool(
        max(np.mean(steps >= 0), np.mean(steps <= 0)) > MIN_MONOTONIC_SHARE
    )


def _role_by_name(name: str) -> Role:
    """First role whose pattern matches the name."""
    plain = re.sub(r"[_./]+", " ", name.lower())
    return next((role for role, words in _NAMES if re.search(words, plain)), Role.OTHER)


def _role_by_unit(unit: str) -> Role:
    """First role with the dimension of the unit."""
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
    """Unit at the end of a name, such as in ``distance_m`` or ``speed_km_h``; "" if there is none."""
    plain = name.lower().replace("_per_", "/").replace("deg", "°")
    candidates = [""]
    for unit in (unit for units in FACTORS.values() for unit in units):
        text = unit.lower().replace("²", "2").replace(" ", "_")
        forms = {text, text.replace("/", "_"), text.replace("/", "")}
        candidates += [unit for form in forms if plain.endswith(("_" + form, " " + form))]
    return max(candidates, key=len)


def _unit_by_values(role: Role, values: Array) -> str:
    """Probable unit of values; the SI unit if they do not determine it."""
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
    """Assumed distance to the left [m]; 0 if the name has neither side, or both."""
    plain = re.sub(r"[_./]+", " ", name.lower())
    left, right = (bool(re.search(words, plain)) for words in (_LEFT, _RIGHT))
    return SIDE_OFFSET * (left - right)

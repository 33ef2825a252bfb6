"""Units: input is converted once, on reading; inside the package all values are in SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackprofile.errors import UnitError

STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²], exact (SI brochure, 9th edition)."""

FACTORS: Mapping[str, Mapping[str, float]] = {
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "area": {"m²": 1.0, "mm²": 1e-6},
    "time": {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "min": 60.0, "h": 3600.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704},
    "acceleration": {
        "m/s²": 1.0,
        "mm/s²": 1e-3,
        "g": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY,
        "µg": 1e-6 * STANDARD_GRAVITY,
    },
    "angle": {"rad": 1.0, "°": math.pi / 180, "deg": math.pi / 180},
    "angular rate": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180, "°/s": math.pi / 180},
    "mass": {"kg": 1.0, "t": 1e3},
    "inertia": {"kg m²": 1.0, "t m²": 1e3},
    "stiffness": {"N/m": 1.0, "kN/m": 1e3, "MN/m": 1e6},
    "rotational stiffness": {"N m/rad": 1.0, "kN m/rad": 1e3, "MN m/rad": 1e6},
    "bending stiffness": {"N m²": 1.0, "kN m²": 1e3, "MN m²": 1e6},
    "mass per length": {"kg/m": 1.0},
    "damping": {"N s/m": 1.0, "kN s/m": 1e3},
    "spatial frequency": {"rad/m": 1.0},
    "roughness": {"m² rad/m": 1.0, "cm² rad/m": 1e-4},
}
"""SI value of one unit, by dimension, the SI unit first; other spellings are accepted too."""

# Other spellings of micro, degree, square and product: Greek mu, ordinal indicator, ASCII.
_SPELLINGS = str.maketrans(
    {"μ": "µ", "º": "°", "⁄": "/", "2": "²", "^": None, "·": None, "*": None, " ": None}
)
_ASCII_MICRO = {"us": "µs", "ug": "µg"}


def unit_factor(unit: str, dimension: str) -> float:
    """SI value of one unit.

    Parameters
    ----------
    unit : such as ``"km/h"``, ``"mm"``, ``"m/s^2"``, ``"m/s2"``, ``"°/s"``
    dimension : key of `FACTORS`, such as "speed"

    Raises
    ------
    UnitError : the unit is unknown, or of another dimension.

    Examples
    --------
    >>> unit_factor("km/h", "speed") * 36
    10.0
    >>> unit_factor("g", "acceleration")
    9.80665
    """
    accepted = FACTORS[dimension]
    for name, factor in accepted.items():
        if _plain(name) == _plain(unit):
            return factor
    raise UnitError(
        f"Unit {unit!r} is not a unit of {dimension}; use one of {', '.join(accepted)}."
    )


def si_unit(dimension: str) -> str:
    """SI unit of a dimension.

    Examples
    --------
    >>> si_unit("inertia")
    'kg m²'
    """
    return next(iter(FACTORS[dimension]))


def quantity(text: str, dimension: str, *, default_unit: str = "") -> float:
    """Convert text with a number and its unit to SI.

    Parameters
    ----------
    text : such as ``"150 km/h"``
    dimension : key of `FACTORS`
    default_unit : unit of a number without one; empty: a unit is required

    Raises
    ------
    UnitError : the text is not a finite number followed by a unit of that dimension.

    Examples
    --------
    >>> quantity("36 km/h", "speed")
    10.0
    >>> quantity("75", "length", default_unit="m")
    75.0
    """
    match = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\D.*?)?\s*", text)
    unit = (match[2] or default_unit) if match else ""
    try:
        number = float(match[1]) if match else math.nan
    except ValueError:
        number = math.nan
    if not (unit and math.isfinite(number)):
        raise UnitError(
            f"{text!r} is not a {dimension}; write a number and its unit, "
            f"one of {', '.join(FACTORS[dimension])}."
        )
    return number * unit_factor(unit, dimension)


def to_si(values: ArrayLike, unit: str, dimension: str) -> NDArray[np.float64]:
    """Convert values to the SI unit of their dimension.

    An amplitude density per root hertz has the factor of the unit of its channel.

    Parameters
    ----------
    values : array of any shape [unit]
    unit, dimension : see `unit_factor`

    Raises
    ------
    UnitError : the unit is unknown, or of another dimension.

    Examples
    --------
    >>> to_si([36.0, 72.0], "km/h", "speed")
    array([10., 20.])
    """
    return np.asarray(values, dtype=np.float64) * unit_factor(unit, dimension)


def counted(number: int, noun: str) -> str:
    """A number of things, with the noun in singular or plural.

    Examples
    --------
    >>> counted(1, "location"), counted(2, "pass"), counted(0, "file")
    ('1 location', '2 passes', '0 files')
    """
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun}{'es' if noun.endswith(('s', 'x', 'ch', 'sh')) else 's'}"


def _plain(unit: str) -> str:
    name = unit.translate(_SPELLINGS)
    return _ASCII_MICRO.get(name, name)

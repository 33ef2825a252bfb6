"""A profile per rail: left, right and their difference, in the dataset with the mean of both.

In addition to ``elevation``, which is the mean of both rails, a profile may have ``elevation_left``,
``elevation_right`` and ``elevation_difference`` (left minus right: the cross level, per band), each with a standard
deviation such as ``elevation_left_standard_deviation``, the same per band with ``_D1`` and so on.
``elevation_difference_quality`` has the quality flags that only the sensors of both sides together determine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.contracts.profile import Quality, validate_profile
from trackprofile.contracts.validation import (
    check_outside_gaps,
    float_values,
    integer_values,
    put_variable,
)
from trackprofile.errors import DataError

Array = NDArray[np.float64]


class Rail(StrEnum):
    """Rail of an elevation; left in the direction of travel."""

    MEAN = "mean"
    LEFT = "left"
    RIGHT = "right"
    DIFFERENCE = "difference"


SEPARATE_RAILS = (Rail.LEFT, Rail.RIGHT, Rail.DIFFERENCE)
"""Rails with variables of their own."""

DIFFERENCE_QUALITY = "elevation_difference_quality"
_SPREAD = "standard_deviation"


@dataclass(frozen=True, eq=False)
class RailLevel:
    """Elevation of one rail, its standard deviation, and the same by name of the band; each (points,) [m]."""

    elevation: ArrayLike
    standard_deviation: ArrayLike | None = None
    band_standard_deviations: Mapping[str, ArrayLike] = field(default_factory=dict)


def with_rails(
    profile: xr.Dataset, levels: Mapping[Rail, RailLevel], quality: ArrayLike | None = None
) -> xr.Dataset:
    """Add left, right and difference to the profile of the mean, and validate it.

    Parameters
    ----------
    profile : the profile contract
    levels : by rail of `SEPARATE_RAILS`, at the points of the profile; a missing difference is left minus right
    quality : (points,), sums of `Quality` of the difference; None: no flags

    Raises
    ------
    DataError : see `validate_rails`.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> mean = build_profile([0.0, 0.25], [1e-3, 2e-3], kind="truth")
    >>> sides = {Rail.LEFT: RailLevel([2e-3, 2e-3]), Rail.RIGHT: RailLevel([0.0, 2e-3])}
    >>> select_rail(with_rails(mean, sides), Rail.DIFFERENCE)["elevation"].values
    array([0.002, 0.   ])
    """
    result = profile.copy()
    metre = {"units": "m"}
    for rail, level in _with_difference(levels).items():
        name = rail_variable(rail)
        put_variable(result, name, "distance", level.elevation, metre)
        if level.standard_deviation is not None:
            put_variable(result, f"{name}_{_SPREAD}", "distance", level.standard_deviation, metre)
        for band, values in level.band_standard_deviations.items():
            put_variable(result, f"{name}_{_SPREAD}_{band}", "distance", values, metre)
    flags = np.zeros(result.sizes["distance"], np.int16) if quality is None else quality
    put_variable(
        result, DIFFERENCE_QUALITY, "distance", flags, _quality_attributes(profile), np.int16
    )
    return validate_rails(result)


def available_rails(profile: xr.Dataset) -> tuple[Rail, ...]:
    """Rails of which a profile has an elevation: the mean, and all others or none.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> available_rails(build_profile([0.0, 0.25], [1e-3, 2e-3], kind="truth"))
    (<Rail.MEAN: 'mean'>,)
    """
    return (Rail.MEAN, *(rail for rail in SEPARATE_RAILS if rail_variable(rail) in profile))


def select_rail(profile: xr.Dataset, rail: Rail) -> xr.Dataset:
    """Profile of one rail: its elevation, standard deviations and flags under the names of the contract.

    Raises
    ------
    DataError : the profile has no elevation of that rail.
    """
    single = profile.drop_vars([name for name in map(str, profile.data_vars) if _is_separate(name)])
    if rail is Rail.MEAN:
        return single
    if rail not in available_rails(profile):
        raise DataError(
            f"Profile: expected an elevation of the rail {rail!s}, got the mean of both only; infer it from sensors on "
            "the left and on the right, or choose the mean."
        )
    own = rail_variable(rail)
    single = single.drop_vars(
        [name for name in map(str, single.data_vars) if name.startswith(_SPREAD)]
    )
    for name in map(str, profile.data_vars):
        if name == own or name.startswith(f"{own}_{_SPREAD}"):
            target = "elevation" if name == own else name.removeprefix(f"{own}_")
            single[target] = profile[name]
    flags = (
        profile[DIFFERENCE_QUALITY]
        if DIFFERENCE_QUALITY in profile
        else xr.zeros_like(profile["quality"])
    )
    quality = flags if rail is Rail.DIFFERENCE else profile["quality"] | flags
    single["quality"] = quality.astype(np.int16).assign_attrs(profile["quality"].attrs)
    if single.attrs["kind"] == "posterior" and _SPREAD not in single:
        single = single.assign_attrs(kind="point")
    return validate_profile(single)


def validate_rails(profile: xr.Dataset) -> xr.Dataset:
    """Check a profile and its single rails against the contract, and return it.

    Raises
    ------
    DataError : see `validate_profile`; or one of left, right and difference is missing.
    RowError : an elevation is missing outside a gap, or a standard deviation is missing or negative.
    """
    validate_profile(profile)
    rails = available_rails(profile)[1:]
    if not rails:
        return profile
    if rails != SEPARATE_RAILS:
        missing = ", ".join(rail_variable(rail) for rail in SEPARATE_RAILS if rail not in rails)
        raise DataError(
            f"A profile per rail needs left, right and difference; add the missing {missing}."
        )
    flags = integer_values(profile, "quality", "distance")
    gaps = (
        integer_values(profile, DIFFERENCE_QUALITY, "distance")
        if DIFFERENCE_QUALITY in profile
        else 0 * flags
    )
    for rail in SEPARATE_RAILS:
        own = rail_variable(rail)
        gap = (gaps & Quality.GAP) != 0
        if rail is not Rail.DIFFERENCE:
            gap = gap | ((flags & Quality.GAP) != 0)
        for name in (one for one in map(str, profile.data_vars) if one.startswith(own)):
            if name == DIFFERENCE_QUALITY:
                continue
            values = float_values(profile, name, "distance", "m")
            check_outside_gaps(name, values, gap, signed=name == own)
    return profile


def rail_variable(rail: Rail) -> str:
    """Name of the elevation of a rail.

    Examples
    --------
    >>> rail_variable(Rail.MEAN), rail_variable(Rail.LEFT)
    ('elevation', 'elevation_left')
    """
    return "elevation" if rail is Rail.MEAN else f"elevation_{rail}"


def _with_difference(levels: Mapping[Rail, RailLevel]) -> Mapping[Rail, RailLevel]:
    if Rail.DIFFERENCE in levels or not {Rail.LEFT, Rail.RIGHT} <= levels.keys():
        return levels
    left, right = (np.asarray(levels[one].elevation, np.float64) for one in SEPARATE_RAILS[:2])
    return {**levels, Rail.DIFFERENCE: RailLevel(left - right)}


def _is_separate(name: str) -> bool:
    return any(name.startswith(rail_variable(rail)) for rail in SEPARATE_RAILS)


def _quality_attributes(profile: xr.Dataset) -> Mapping[str, object]:
    return {str(key): value for key, value in profile["quality"].attrs.items()}

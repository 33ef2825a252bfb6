"""A profile per rail: the left, the right and their difference beside the mean, in the same dataset.

Beside ``elevation``, which is the mean of both rails, a profile may have ``elevation_left``, ``elevation_right`` and
``elevation_difference`` (left minus right, the cross level in its bands), each with its own
``elevation_left_standard_deviation``, the same per band with ``_D1`` and so on, and ``elevation_difference_quality``:
flags of what only both sides together can tell.
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
    """Of which rail an elevation is; left as the train runs."""

    MEAN = "mean"
    LEFT = "left"
    RIGHT = "right"
    DIFFERENCE = "difference"


SEPARATE_RAILS = (Rail.LEFT, Rail.RIGHT, Rail.DIFFERENCE)
"""Those that have variables of their own."""

DIFFERENCE_QUALITY = "elevation_difference_quality"
_SPREAD = "standard_deviation"


@dataclass(frozen=True, eq=False)
class RailLevel:
    """One rail's elevation, (points,), its standard deviation, and the same per band by its name, all in m."""

    elevation: ArrayLike
    standard_deviation: ArrayLike | None = None
    band_standard_deviations: Mapping[str, ArrayLike] = field(default_factory=dict)


def with_rails(
    profile: xr.Dataset, levels: Mapping[Rail, RailLevel], quality: ArrayLike | None = None
) -> xr.Dataset:
    """The profile of the mean with those of left, right and difference beside it, validated.

    Parameters
    ----------
    profile : the profile contract
    levels : of `SEPARATE_RAILS`, at the profile's points; without a difference it is left minus right
    quality : (points,), sums of `Quality` of the difference; None if all are good

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
    found = profile.copy()
    metre = {"units": "m"}
    for rail, level in _with_difference(levels).items():
        name = rail_variable(rail)
        put_variable(found, name, "distance", level.elevation, metre)
        if level.standard_deviation is not None:
            put_variable(found, f"{name}_{_SPREAD}", "distance", level.standard_deviation, metre)
        for band, values in level.band_standard_deviations.items():
            put_variable(found, f"{name}_{_SPREAD}_{band}", "distance", values, metre)
    flags = np.zeros(found.sizes["distance"], np.int16) if quality is None else quality
    put_variable(found, DIFFERENCE_QUALITY, "distance", flags, _described(profile), np.int16)
    return validate_rails(found)


def available_rails(profile: xr.Dataset) -> tuple[Rail, ...]:
    """The rails that a profile has an elevation of: the mean, and all others or none.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> available_rails(build_profile([0.0, 0.25], [1e-3, 2e-3], kind="truth"))
    (<Rail.MEAN: 'mean'>,)
    """
    return (Rail.MEAN, *(rail for rail in SEPARATE_RAILS if rail_variable(rail) in profile))


def select_rail(profile: xr.Dataset, rail: Rail) -> xr.Dataset:
    """The profile of one rail alone: its elevation, standard deviations and flags under the usual names.

    Raises
    ------
    DataError : it has none of that rail.
    """
    alone = profile.drop_vars([name for name in map(str, profile.data_vars) if _apart(name)])
    if rail is Rail.MEAN:
        return alone
    if rail not in available_rails(profile):
        raise DataError(
            f"The profile has no elevation of the {rail} rail, only the mean of both; infer it from sensors left and "
            "right, or leave --rail out."
        )
    own = rail_variable(rail)
    alone = alone.drop_vars(
        [name for name in map(str, alone.data_vars) if name.startswith(_SPREAD)]
    )
    for name in map(str, profile.data_vars):
        if name == own or name.startswith(f"{own}_{_SPREAD}"):
            usual = "elevation" if name == own else name.removeprefix(f"{own}_")
            alone[usual] = profile[name]
    flags = (
        profile[DIFFERENCE_QUALITY]
        if DIFFERENCE_QUALITY in profile
        else xr.zeros_like(profile["quality"])
    )
    quality = flags if rail is Rail.DIFFERENCE else profile["quality"] | flags
    alone["quality"] = quality.astype(np.int16).assign_attrs(profile["quality"].attrs)
    if alone.attrs["kind"] == "posterior" and _SPREAD not in alone:
        alone = alone.assign_attrs(kind="point")
    return validate_profile(alone)


def validate_rails(profile: xr.Dataset) -> xr.Dataset:
    """The profile itself, if what it says of single rails keeps the contract too.

    Raises
    ------
    DataError : the profile alone does not, or one of left, right and difference is missing; `RowError` where an
        elevation is missing outside a gap, or a standard deviation is missing or negative.
    """
    validate_profile(profile)
    there = available_rails(profile)[1:]
    if not there:
        return profile
    if there != SEPARATE_RAILS:
        missing = ", ".join(rail_variable(rail) for rail in SEPARATE_RAILS if rail not in there)
        raise DataError(f"A profile per rail has left, right and difference; {missing} is missing.")
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
    """The name of a rail's elevation.

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


def _apart(name: str) -> bool:
    return any(name.startswith(rail_variable(rail)) for rail in SEPARATE_RAILS)


def _described(profile: xr.Dataset) -> Mapping[str, object]:
    return {str(key): value for key, value in profile["quality"].attrs.items()}

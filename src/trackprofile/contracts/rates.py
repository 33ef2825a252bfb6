"""A line made of many passes: how fast its level changes, beside the level, in the same dataset.

Beside ``elevation`` such a profile has ``rate``, its change, and ``rate_deviation``, the standard deviation of that in
all waves, and the same per band with ``_D1`` and so on. Only a fusion of passes knows them; a single pass has none.
"""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr
from numpy.typing import ArrayLike

from trackprofile.contracts.profile import Quality
from trackprofile.contracts.rails import validate_rails
from trackprofile.contracts.validation import (
    check_outside_gaps,
    float_values,
    integer_values,
    put_variable,
)
from trackprofile.errors import DataError

FUSION_METHOD = "fusion of"
"""With which the method of a profile begins that was made of many passes."""

RATE, RATE_DEVIATION = "rate", "rate_deviation"
RATE_UNIT = "m/day"


def with_rate(
    profile: xr.Dataset,
    rate: ArrayLike,
    deviation: ArrayLike,
    band_deviations: Mapping[str, ArrayLike],
) -> xr.Dataset:
    """The profile with its rate of change, validated.

    Parameters
    ----------
    profile : the profile contract
    rate : (points,) [m/day]
    deviation : (points,), standard deviation of that [m/day]
    band_deviations : the same within a band of wavelengths, by the band's name

    Raises
    ------
    DataError : see `validate_rate`.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> line = build_profile([0.0, 0.25], [1e-3, 2e-3], kind="point")
    >>> has_rate(line), has_rate(with_rate(line, [0.0, -1e-5], [1e-6, 1e-6], {}))
    (False, True)
    """
    found, unit = profile.copy(), {"units": RATE_UNIT}
    put_variable(found, RATE, "distance", rate, unit)
    put_variable(found, RATE_DEVIATION, "distance", deviation, unit)
    for band, values in band_deviations.items():
        put_variable(found, f"{RATE_DEVIATION}_{band}", "distance", values, unit)
    return validate_rate(found)


def has_rate(profile: xr.Dataset) -> bool:
    """Whether a profile is that of a line, made of many passes."""
    return RATE in profile


def rate_variables(profile: xr.Dataset) -> list[str]:
    """The names of the rate and its deviations."""
    return [name for name in map(str, profile.data_vars) if name == RATE or _is_deviation(name)]


def validate_rate(profile: xr.Dataset) -> xr.Dataset:
    """The profile itself, if what it says of its rate keeps the contract too.

    Raises
    ------
    DataError : the profile alone does not, or a rate stands without its deviation; `RowError` where one is missing
        outside a gap, or a deviation is negative.
    """
    validate_rails(profile)
    names = rate_variables(profile)
    if names and not {RATE, RATE_DEVIATION} <= set(names):
        raise DataError(f"A line has both {RATE} and {RATE_DEVIATION}; this one has {names[0]}.")
    gap = (integer_values(profile, "quality", "distance") & Quality.GAP) != 0
    for name in names:
        values = float_values(profile, name, "distance", RATE_UNIT)
        check_outside_gaps(name, values, gap, signed=name == RATE)
    return profile


def _is_deviation(name: str) -> bool:
    return name == RATE_DEVIATION or name.startswith(f"{RATE_DEVIATION}_")

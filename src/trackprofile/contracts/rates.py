"""The rate of change of a profile that is a fusion of many passes.

In addition to ``elevation`` such a profile has ``rate``, the change of the elevation with time, and
``rate_deviation``, the standard deviation of the rate over all wavelengths, and the same per band with ``_D1`` and so
on. The profile of a single pass has none of them.
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
"""Beginning of the attribute ``method`` of a profile that is a fusion of passes."""

RATE, RATE_DEVIATION = "rate", "rate_deviation"
RATE_UNIT = "m/day"


def with_rate(
    profile: xr.Dataset,
    rate: ArrayLike,
    deviation: ArrayLike,
    band_deviations: Mapping[str, ArrayLike],
) -> xr.Dataset:
    """Add the rate of change to a profile, and validate it.

    Parameters
    ----------
    profile : the profile contract
    rate : (points,) [m/day]
    deviation : standard deviation of the rate, (points,) [m/day]
    band_deviations : the same in a wavelength band, by name of the band, each (points,) [m/day]

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
    result, unit = profile.copy(), {"units": RATE_UNIT}
    put_variable(result, RATE, "distance", rate, unit)
    put_variable(result, RATE_DEVIATION, "distance", deviation, unit)
    for band, values in band_deviations.items():
        put_variable(result, f"{RATE_DEVIATION}_{band}", "distance", values, unit)
    return validate_rate(result)


def has_rate(profile: xr.Dataset) -> bool:
    """Whether a profile has a rate of change, as a fusion of passes has."""
    return RATE in profile


def rate_variables(profile: xr.Dataset) -> list[str]:
    """Names of the rate and its standard deviations."""
    return [name for name in map(str, profile.data_vars) if name == RATE or _is_deviation(name)]


def validate_rate(profile: xr.Dataset) -> xr.Dataset:
    """Check a profile and its rate of change against the contract, and return it.

    Raises
    ------
    DataError : see `validate_rails`; or only one of rate and standard deviation is given.
    RowError : a value is missing outside a gap, or a standard deviation is negative.
    """
    validate_rails(profile)
    names = rate_variables(profile)
    if names and not {RATE, RATE_DEVIATION} <= set(names):
        raise DataError(
            f"Profile: expected both {RATE} and {RATE_DEVIATION}, got {names[0]} only; add the other."
        )
    gap = (integer_values(profile, "quality", "distance") & Quality.GAP) != 0
    for name in names:
        values = float_values(profile, name, "distance", RATE_UNIT)
        check_outside_gaps(name, values, gap, signed=name == RATE)
    return profile


def _is_deviation(name: str) -> bool:
    return name == RATE_DEVIATION or name.startswith(f"{RATE_DEVIATION}_")

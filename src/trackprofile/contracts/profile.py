"""The profile: the track's longitudinal level, and how well it is known."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from enum import IntFlag

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.contracts.validation import (
    DISTANCE_DEVIATION,
    check_deviation,
    check_finite,
    check_increasing,
    expect_kind,
    float_values,
    integer_values,
    put_variable,
    refuse_rows,
    text_attribute,
)
from trackprofile.errors import DataError

KINDS = ("posterior", "point", "truth")
LOADINGS = ("unloaded", "loaded")


class Quality(IntFlag):
    """Flags of a profile's points; 0 is good."""

    GAP = 1
    """No valid sample informed this place."""
    UNCERTAIN = 2
    """The standard deviation is close to the prior's."""
    EDGE = 4
    """Near an end."""
    SLOW = 8
    """The train was slow or stood."""
    UNCONVERGED = 16
    """The search for the elevation did not end."""
    SATURATED = 32
    """A sensor was at the end of its range."""
    UNEXPLAINED = 64
    """The model does not explain what was recorded here."""
    FAULTY = 128
    """Faulty samples were left out or weighted down here; the uncertainty says what that costs."""


def build_profile(
    distance: ArrayLike,
    elevation: ArrayLike,
    *,
    kind: str,
    method: str = "",
    standard_deviation: ArrayLike | None = None,
    band_standard_deviations: Mapping[str, ArrayLike] | None = None,
    quality: ArrayLike | None = None,
    loading: str = "unloaded",
    vehicle: str = "",
    provenance: Iterable[str] = (),
    distance_deviation: ArrayLike | None = None,
) -> xr.Dataset:
    """A profile from arrays in SI units, validated.

    Parameters
    ----------
    distance, elevation : (points,) [m]; elevation may be NaN where quality says gap
    kind : one of `KINDS`; a posterior has a standard deviation
    method, vehicle : in words
    standard_deviation : (points,) of the elevation [m]
    band_standard_deviations : the same within a band of wavelengths, by the band's name [m]
    quality : (points,) sums of `Quality`; None if all are good
    loading : one of `LOADINGS`
    provenance : what was done so far
    distance_deviation : (points,), standard deviation of where each point is [m]; None: not known

    Raises
    ------
    DataError : see `validate_profile`.

    Examples
    --------
    >>> profile = build_profile([0.0, 0.25], [1e-3, 2e-3], kind="point")
    >>> profile["elevation"].attrs["units"], profile.attrs["kind"]
    ('m', 'point')
    """
    dataset = xr.Dataset(
        attrs={
            "kind_of_data": "profile",
            "kind": kind,
            "method": method,
            "loading": loading,
            "vehicle": vehicle,
            "provenance": json.dumps(list(provenance), ensure_ascii=False),
        }
    )
    metre = {"units": "m"}
    put_variable(dataset, "distance", "distance", distance, metre)
    put_variable(dataset, "elevation", "distance", elevation, metre)
    if standard_deviation is not None:
        put_variable(dataset, "standard_deviation", "distance", standard_deviation, metre)
    for band, values in (band_standard_deviations or {}).items():
        put_variable(dataset, f"standard_deviation_{band}", "distance", values, metre)
    if distance_deviation is not None:
        put_variable(dataset, DISTANCE_DEVIATION, "distance", distance_deviation, metre)
    flags = np.zeros(dataset.sizes["distance"], np.int16) if quality is None else quality
    described = {
        "flag_masks": np.array(list(Quality), np.int16),
        "flag_meanings": " ".join(str(flag.name).lower() for flag in Quality),
    }
    put_variable(dataset, "quality", "distance", flags, described, np.int16)
    return validate_profile(dataset)


def validate_profile(profile: xr.Dataset) -> xr.Dataset:
    """The profile itself, if it keeps the contract.

    Raises
    ------
    DataError : it has fewer than two points, a variable or attribute is missing or unknown;
        `RowError` where distance does not increase, the elevation is missing outside a gap, or a
        standard deviation is missing or negative.
    """
    expect_kind(profile, "profile")
    for name, accepted in (("kind", KINDS), ("loading", LOADINGS)):
        found = text_attribute(profile.attrs, name)
        if found not in accepted:
            raise DataError(
                f"A profile's {name} is one of {', '.join(accepted)}, this one says {found!r}."
            )
    distance = float_values(profile, "distance", "distance", "m")
    elevation = float_values(profile, "elevation", "distance", "m")
    gap = (integer_values(profile, "quality", "distance") & Quality.GAP) != 0
    if len(distance) < 2:
        raise DataError(f"A profile needs at least 2 points, this one has {len(distance)}.")
    check_finite("distance", distance)
    check_increasing("distance", distance, "m")
    refuse_rows(
        ~np.isfinite(elevation) & ~(gap & np.isnan(elevation)),
        "elevation",
        "there is no finite number and the quality does not say gap (1); mark or remove the row.",
    )
    spreads = [str(name) for name in profile if str(name).startswith("standard_deviation")]
    for name in spreads:
        spread = float_values(profile, name, "distance", "m")
        good = ((spread >= 0) & np.isfinite(spread)) | (gap & np.isnan(spread))
        refuse_rows(~good, name, "expected a finite number, zero or more; mend or remove it.")
    if DISTANCE_DEVIATION in profile:
        check_deviation(
            DISTANCE_DEVIATION, float_values(profile, DISTANCE_DEVIATION, "distance", "m")
        )
    if profile.attrs["kind"] == "posterior" and "standard_deviation" not in spreads:
        raise DataError("A posterior needs its standard_deviation; without it, it is a point.")
    return profile


def known_elevation(profile: xr.Dataset) -> NDArray[np.float64]:
    """A profile's elevation, NaN at every point that is flagged as a gap [m]."""
    elevation = profile["elevation"].to_numpy()
    if "quality" not in profile:
        return elevation
    return np.where(profile["quality"].to_numpy() & Quality.GAP, np.nan, elevation)

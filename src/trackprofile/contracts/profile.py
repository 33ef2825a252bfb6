"""The profile: longitudinal level of a track, with its standard deviation."""

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
    """Quality flags of a point of a profile; 0: no remark."""

    GAP = 1
    """No valid sample observes this point."""
    UNCERTAIN = 2
    """The standard deviation is close to that of the prior."""
    EDGE = 4
    """Near an end of the profile."""
    SLOW = 8
    """The train was slow or stood still."""
    UNCONVERGED = 16
    """The search for the elevation did not converge."""
    SATURATED = 32
    """A sensor was saturated: at the end of its range."""
    UNEXPLAINED = 64
    """The model does not explain the recorded signals."""
    FAULTY = 128
    """Faulty samples were excluded or down-weighted; the standard deviation accounts for it."""


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
    """Build a profile from arrays in SI units, and validate it.

    Parameters
    ----------
    distance, elevation : (points,) [m]; elevation may be NaN in a gap
    kind : one of `KINDS`; a posterior needs a standard deviation
    method, vehicle : free text
    standard_deviation : of the elevation, (points,) [m]
    band_standard_deviations : of the elevation in a wavelength band, by name of the band, each (points,) [m]
    quality : (points,), sums of `Quality`; None: no flags
    loading : one of `LOADINGS`
    provenance : processing steps so far
    distance_deviation : standard deviation of the distance of each point, (points,) [m]; None: unknown

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
    attributes = {
        "flag_masks": np.array(list(Quality), np.int16),
        "flag_meanings": " ".join(str(flag.name).lower() for flag in Quality),
    }
    put_variable(dataset, "quality", "distance", flags, attributes, np.int16)
    return validate_profile(dataset)


def validate_profile(profile: xr.Dataset) -> xr.Dataset:
    """Check a profile against the contract, and return it.

    Raises
    ------
    DataError : it has fewer than two points, or a variable or attribute is missing or unknown.
    RowError : distance does not increase, an elevation is missing outside a gap, or a standard deviation is missing
        or negative.
    """
    expect_kind(profile, "profile")
    for name, accepted in (("kind", KINDS), ("loading", LOADINGS)):
        value = text_attribute(profile.attrs, name)
        if value not in accepted:
            raise DataError(
                f"Profile, attribute {name}: expected one of {', '.join(accepted)}, got {value!r}."
            )
    distance = float_values(profile, "distance", "distance", "m")
    elevation = float_values(profile, "elevation", "distance", "m")
    gap = (integer_values(profile, "quality", "distance") & Quality.GAP) != 0
    if len(distance) < 2:
        raise DataError(
            f"A profile needs at least 2 points, got {len(distance)}; select a longer stretch."
        )
    check_finite("distance", distance)
    check_increasing("distance", distance, "m")
    refuse_rows(
        ~np.isfinite(elevation) & ~(gap & np.isnan(elevation)),
        "elevation",
        "expected a finite number where the quality is not a gap (1); mark the row as a gap or remove it.",
    )
    deviations = [str(name) for name in profile if str(name).startswith("standard_deviation")]
    for name in deviations:
        deviation = float_values(profile, name, "distance", "m")
        is_valid = ((deviation >= 0) & np.isfinite(deviation)) | (gap & np.isnan(deviation))
        refuse_rows(
            ~is_valid, name, "expected a finite number, zero or more; correct or remove the row."
        )
    if DISTANCE_DEVIATION in profile:
        check_deviation(
            DISTANCE_DEVIATION, float_values(profile, DISTANCE_DEVIATION, "distance", "m")
        )
    if profile.attrs["kind"] == "posterior" and "standard_deviation" not in deviations:
        raise DataError(
            "Profile: a posterior needs the variable standard_deviation; add it, or set the attribute kind to point."
        )
    return profile


def known_elevation(profile: xr.Dataset) -> NDArray[np.float64]:
    """Elevation of a profile, (points,) [m]; NaN at points that are flagged as a gap."""
    elevation = profile["elevation"].to_numpy()
    if "quality" not in profile:
        return elevation
    return np.where(profile["quality"].to_numpy() & Quality.GAP, np.nan, elevation)

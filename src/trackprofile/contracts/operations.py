"""Operations on recordings and profiles."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from trackprofile.arrays import integral
from trackprofile.contracts.identity import IDENTITY, recording_identity, stretch_identity
from trackprofile.contracts.rates import validate_rate
from trackprofile.contracts.recording import validate_recording
from trackprofile.contracts.validation import provenance_steps, text_attribute
from trackprofile.errors import DataError


def validate(dataset: xr.Dataset) -> xr.Dataset:
    """Check a recording or profile against its contract, and return it.

    Raises
    ------
    DataError : it is neither; or see `validate_recording` and `validate_profile`.
    """
    checks = {"recording": validate_recording, "profile": validate_rate}
    kind = text_attribute(dataset.attrs, "kind_of_data")
    if kind is None or kind not in checks:
        raise DataError(
            f"Attribute kind_of_data: expected 'recording' or 'profile', got {kind!r}; build the dataset with "
            "build_recording or build_profile."
        )
    return checks[kind](dataset)


def append_provenance(dataset: xr.Dataset, step: str) -> xr.Dataset:
    """Dataset with one more step in its provenance.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> append_provenance(build_profile([0, 1], [0, 0], kind="truth"), "resampled").attrs["provenance"]
    '["resampled"]'
    """
    steps = [*provenance_steps(dataset), step]
    return dataset.assign_attrs(provenance=json.dumps(steps, ensure_ascii=False))


def select_stretch(dataset: xr.Dataset, from_m: float | None, to_m: float | None) -> xr.Dataset:
    """Restrict a recording or profile to a stretch of track, both ends included.

    A recording without a distance gets one: the integral of its speed over time, from 0 m. An attribute ``identity``
    becomes that of the stretch, see `trackprofile.contracts.identity.stretch_identity`.

    Parameters
    ----------
    from_m, to_m : ends of the stretch along the track [m]; None leaves that end open

    Raises
    ------
    DataError : fewer than two rows are inside, or a channel has no valid sample inside.

    Examples
    --------
    >>> from trackprofile.contracts import build_profile
    >>> profile = build_profile([0.0, 1.0, 2.0, 3.0], [0.0] * 4, kind="truth")
    >>> select_stretch(profile, 1.0, None)["distance"].values
    array([1., 2., 3.])
    """
    if from_m is None and to_m is None:
        return dataset
    if "distance" not in dataset:
        distance = integral(dataset["speed"].to_numpy(), dataset["time"].to_numpy())
        dataset = dataset.assign(distance=("sample", distance, {"units": "m"}))
    distance = dataset["distance"].to_numpy()
    low = -np.inf if from_m is None else from_m
    high = np.inf if to_m is None else to_m
    inside = np.flatnonzero((distance >= low) & (distance <= high))
    if len(inside) < 2:
        raise DataError(
            f"Between {low:g} m and {high:g} m: expected at least 2 rows of the {dataset.attrs['kind_of_data']}, got "
            f"{len(inside)}; it extends from {distance[0]:g} m to {distance[-1]:g} m, choose a stretch inside it."
        )
    piece = dataset.isel({dataset["distance"].dims[0]: inside})
    piece = append_provenance(piece, f"between {low:g} m and {high:g} m")
    if IDENTITY in dataset.attrs:
        piece.attrs[IDENTITY] = stretch_identity(recording_identity(dataset), from_m, to_m)
    return validate(piece)

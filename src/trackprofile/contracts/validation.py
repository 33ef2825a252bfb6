"""What both contracts share: putting variables in, and refusing the first row that is wrong."""

from __future__ import annotations

import json
from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.errors import DataError, RowError

Array = NDArray[np.float64]

DISTANCE_DEVIATION = "distance_deviation"
"""The variable that says how well each place is known [m], of both contracts."""


def put_variable(
    dataset: xr.Dataset,
    name: str,
    dimension: str,
    values: ArrayLike,
    attributes: Mapping[str, object],
    dtype: type[np.generic] = np.float64,
) -> None:
    array = np.asarray(values, dtype)
    length = dataset.sizes.get(dimension, array.size)
    if array.shape != (length,):
        raise DataError(f"{name}: expected {length} values in a row, got shape {array.shape}.")
    dataset[name] = (dimension, array, dict(attributes))


def expect_kind(dataset: xr.Dataset, kind: str) -> None:
    found = text_attribute(dataset.attrs, "kind_of_data")
    if found != kind:
        raise DataError(f"Expected a {kind} (attribute kind_of_data), got {found!r}.")
    provenance_steps(dataset)


def provenance_steps(dataset: xr.Dataset) -> list[str]:
    """The provenance, step by step."""
    text = dataset.attrs.get("provenance", "[]")
    try:
        steps = json.loads(text)
    except (TypeError, ValueError):
        steps = None
    if not isinstance(steps, list) or not all(isinstance(step, str) for step in steps):
        raise DataError(f"Expected provenance to be a list of texts in JSON, got {text!r}.")
    return steps


def text_attribute(attributes: Mapping[Any, object], name: str) -> str | None:
    """An attribute as text, so that it can be compared whatever a file holds."""
    value = attributes.get(name)
    return None if value is None else str(value)


def number_attribute(attributes: Mapping[Any, object], name: str) -> float:
    """An attribute as a number, NaN if it is none."""
    value = attributes.get(name)
    return float(value) if isinstance(value, Real) else np.nan


def float_values(dataset: xr.Dataset, name: str, dimension: str, unit: str) -> Array:
    """A variable's values, refused if missing, or of another shape or unit."""
    if name not in dataset:
        raise DataError(f"{name}: the variable is missing.")
    variable = dataset[name]
    units = text_attribute(variable.attrs, "units")
    if variable.dims != (dimension,) or units != unit or variable.dtype.kind not in "fiu":
        raise DataError(
            f"{name}: expected one value per {dimension} in {unit}, "
            f"got {variable.dtype} with dimensions {variable.dims} and units {units!r}."
        )
    return variable.to_numpy().astype(np.float64, copy=False)


def integer_values(dataset: xr.Dataset, name: str, dimension: str) -> NDArray[np.integer]:
    """A variable of whole numbers, 0 and 1 for no and yes."""
    variable = dataset.get(name)
    if variable is None or variable.dims != (dimension,) or variable.dtype.kind not in "biu":
        raise DataError(f"{name}: expected one whole number per {dimension}.")
    return variable.to_numpy()


def check_finite(name: str, values: Array) -> None:
    refuse_rows(~np.isfinite(values), name, "there is no finite number; fill or remove the row.")


def check_deviation(name: str, values: Array) -> None:
    refuse_rows(
        ~((values >= 0) & np.isfinite(values)),
        name,
        "expected a finite number, zero or more; mend or remove it.",
    )


def check_outside_gaps(name: str, values: Array, gap: NDArray[np.bool_], *, signed: bool) -> None:
    """Refuses what is not finite, but for NaN in a gap, and what is below zero unless it is ``signed``."""
    good = np.isfinite(values) & ((values >= 0) | signed)
    wanted = "a finite number" if signed else "a finite number, zero or more"
    refuse_rows(
        ~(good | (gap & np.isnan(values))), name, f"expected {wanted}; mark or remove the row."
    )


def check_increasing(
    name: str, values: Array, unit: str, *, standing_allowed: bool = False
) -> None:
    step = np.diff(values, prepend=-np.inf)
    refuse_rows(
        step < 0 if standing_allowed else step <= 0,
        name,
        f"{name} does not increase: {{:g}} {unit} follows {{:g}} {unit}; sort or mend the rows.",
        values,
        np.roll(values, 1),
    )


def refuse_rows(bad: NDArray[np.bool_], variable: str, problem: str, *shown: Array) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        raise RowError(variable, row + 1, problem.format(*(values[row] for values in shown)))

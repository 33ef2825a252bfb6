"""Building and checking the variables of both contracts; the first wrong row is named."""

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
"""Variable of both contracts: standard deviation of the distance [m]."""


def put_variable(
    dataset: xr.Dataset,
    name: str,
    dimension: str,
    values: ArrayLike,
    attributes: Mapping[str, object],
    dtype: type[np.generic] = np.float64,
) -> None:
    """Add a variable to a dataset; its length must be that of the dimension."""
    array = np.asarray(values, dtype)
    length = dataset.sizes.get(dimension, array.size)
    if array.shape != (length,):
        raise DataError(
            f"{name}: expected a one-dimensional array of {length} values, got shape {array.shape}."
        )
    dataset[name] = (dimension, array, dict(attributes))


def expect_kind(dataset: xr.Dataset, kind: str) -> None:
    """Refuse a dataset of the other contract, or with a provenance that cannot be read."""
    actual = text_attribute(dataset.attrs, "kind_of_data")
    if actual != kind:
        raise DataError(f"Attribute kind_of_data: expected {kind!r}, got {actual!r}.")
    provenance_steps(dataset)


def provenance_steps(dataset: xr.Dataset) -> list[str]:
    """Steps of the provenance, first to last."""
    text = dataset.attrs.get("provenance", "[]")
    try:
        steps = json.loads(text)
    except (TypeError, ValueError):
        steps = None
    if not isinstance(steps, list) or not all(isinstance(step, str) for step in steps):
        raise DataError(f"Attribute provenance: expected a list of texts in JSON, got {text!r}.")
    return steps


def text_attribute(attributes: Mapping[Any, object], name: str) -> str | None:
    """Attribute as text, whatever its type in a file; None if it is missing."""
    value = attributes.get(name)
    return None if value is None else str(value)


def number_attribute(attributes: Mapping[Any, object], name: str) -> float:
    """Attribute as a number; NaN if it is not one."""
    value = attributes.get(name)
    return float(value) if isinstance(value, Real) else np.nan


def float_values(dataset: xr.Dataset, name: str, dimension: str, unit: str) -> Array:
    """Values of a variable; refused if it is missing or has another shape or unit."""
    if name not in dataset:
        raise DataError(f"{name}: the variable is missing; add it.")
    variable = dataset[name]
    units = text_attribute(variable.attrs, "units")
    if variable.dims != (dimension,) or units != unit or variable.dtype.kind not in "fiu":
        raise DataError(
            f"{name}: expected one value per {dimension} in {unit}, "
            f"got {variable.dtype} with dimensions {variable.dims} and units {units!r}."
        )
    return variable.to_numpy().astype(np.float64, copy=False)


def integer_values(dataset: xr.Dataset, name: str, dimension: str) -> NDArray[np.integer]:
    """Values of a variable of integers or booleans; refused if it is missing or has another shape."""
    variable = dataset.get(name)
    if variable is None or variable.dims != (dimension,) or variable.dtype.kind not in "biu":
        raise DataError(f"{name}: expected one integer per {dimension}.")
    return variable.to_numpy()


def check_finite(name: str, values: Array) -> None:
    """Refuse values that are not finite."""
    refuse_rows(~np.isfinite(values), name, "expected a finite number; fill or remove the row.")


def check_deviation(name: str, values: Array) -> None:
    """Refuse standard deviations that are negative or not finite."""
    refuse_rows(
        ~((values >= 0) & np.isfinite(values)),
        name,
        "expected a finite number, zero or more; correct or remove the row.",
    )


def check_outside_gaps(name: str, values: Array, gap: NDArray[np.bool_], *, signed: bool) -> None:
    """Refuse values that are not finite outside gaps and, unless ``signed``, negative values."""
    good = np.isfinite(values) & ((values >= 0) | signed)
    expected = "a finite number" if signed else "a finite number, zero or more"
    refuse_rows(
        ~(good | (gap & np.isnan(values))),
        name,
        f"expected {expected}; mark the row as a gap or remove it.",
    )


def check_increasing(
    name: str, values: Array, unit: str, *, standing_allowed: bool = False
) -> None:
    """Refuse values that decrease and, unless ``standing_allowed``, values that repeat."""
    step = np.diff(values, prepend=-np.inf)
    refuse_rows(
        step < 0 if standing_allowed else step <= 0,
        name,
        f"{name} does not increase: {{:g}} {unit} follows {{:g}} {unit}; sort or correct the rows.",
        values,
        np.roll(values, 1),
    )


def refuse_rows(bad: NDArray[np.bool_], variable: str, problem: str, *shown: Array) -> None:
    """Raise `RowError` at the first bad row; ``problem`` is formatted with the values of ``shown`` in that row."""
    if bad.any():
        row = int(np.argmax(bad))
        raise RowError(variable, row + 1, problem.format(*(values[row] for values in shown)))

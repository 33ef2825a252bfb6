"""The named parameters that a calibration may fit, as functions of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.inference.measured import Model
from trackprofile.sensor import UNITS
from trackprofile.vehicle import parameter_values, with_parameters

Array = NDArray[np.float64]

ORIGIN, UNMODELLED, REFERENCE_ERROR = "origin", "unmodelled acceleration", "error of the reference"


@dataclass(frozen=True)
class Parameter:
    """A number to fit. Positive ones are fitted by their logarithm.

    ``spread`` is the prior's standard deviation (of the logarithm where positive) about the start; a ``nuisance``
    is fitted along and not reported, even where the data do not tell it.
    """

    name: str
    unit: str
    spread: float
    positive: bool = True
    nuisance: bool = False


def free_parameters(model: Model, names: Sequence[str] | None) -> list[Parameter]:
    """The parameters of that name, or all there are; noise is always fitted along.

    Raises
    ------
    ModelError
        Where there is none of a name.
    """
    fitted = {one.name: one for one in _all(model)}
    noise = [one for one in fitted.values() if one.name == UNMODELLED or one.name.startswith("noise of")]
    error = Parameter(REFERENCE_ERROR, "m² rad/m", 2.0, nuisance=True)
    if names is None:
        return [*fitted.values(), error]
    for name in names:
        if name not in fitted:
            raise ModelError(f"There is no parameter {name!r} to fit; there are {', '.join(fitted)}.")
    return [*(one for one in fitted.values() if one.name in names or one in noise), error]


def _all(model: Model) -> list[Parameter]:
    every = [Parameter(one.name, one.unit, 0.5) for one in model.vehicle.parameters]
    every.append(Parameter(ORIGIN, "m", 5.0, positive=False))
    for sensor in model.sensors:
        every.append(Parameter(f"position of {sensor.name}", "m", 1.0, positive=False))
    if model.unmodelled > 0:
        every.append(Parameter(UNMODELLED, "of the measured", 2.0))
    for sensor in model.sensors:
        unit = UNITS[sensor.quantity].replace("m/s2", "m/s²") + "/√Hz"
        every.append(Parameter(f"noise of {sensor.name}", unit, 2.0, nuisance=True))
    return every


def value_of(model: Model, parameter: Parameter) -> float:
    """The parameter's value in the model; its logarithm where it is positive."""
    values = {**parameter_values(model.vehicle), ORIGIN: model.origin, UNMODELLED: model.unmodelled}
    values[REFERENCE_ERROR] = model.spectrum.amplitude
    for sensor in model.sensors:
        values[f"position of {sensor.name}"] = sensor.position
        values[f"noise of {sensor.name}"] = sensor.noise_density or 0.0
    value = values[parameter.name]
    return float(np.log(value)) if parameter.positive else float(value)


def changed(model: Model, parameters: Sequence[Parameter], at: Array) -> Model:
    """The model with the parameters at those values (logarithms where positive)."""
    values = {
        one.name: float(np.exp(value) if one.positive else value)
        for one, value in zip(parameters, at, strict=True)
    }
    vehicle_names = {one.name for one in model.vehicle.parameters}
    sensors = tuple(
        replace(
            sensor,
            position=values.get(f"position of {sensor.name}", sensor.position),
            noise_density=values.get(f"noise of {sensor.name}", sensor.noise_density),
        )
        for sensor in model.sensors
    )
    return replace(
        model,
        vehicle=with_parameters(
            model.vehicle, {name: value for name, value in values.items() if name in vehicle_names}
        ),
        sensors=sensors,
        origin=values.get(ORIGIN, model.origin),
        unmodelled=values.get(UNMODELLED, model.unmodelled),
        spectrum=replace(
            model.spectrum, amplitude=values.get(REFERENCE_ERROR, model.spectrum.amplitude)
        ),
    )

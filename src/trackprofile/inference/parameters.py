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

ORIGIN, UNMODELLED = "origin", "unmodelled acceleration"


@dataclass(frozen=True)
class Parameter:
    """A number to fit. Positive ones are fitted by their logarithm.

    ``spread`` is the prior's standard deviation (of the logarithm where positive) about the start.
    """

    name: str
    unit: str
    spread: float
    positive: bool = True


def mechanical_parameters(model: Model, names: Sequence[str] | None) -> list[Parameter]:
    """Those of the vehicle and the sensors' places, of the given names or all.

    Raises
    ------
    ModelError
        Where there is none of a name.
    """
    every = [Parameter(one.name, one.unit, 0.5) for one in model.vehicle.parameters]
    every.append(Parameter(ORIGIN, "m", 5.0, positive=False))
    every += [
        Parameter(f"position of {one.name}", "m", 1.0, positive=False) for one in model.sensors
    ]
    if names is None:
        return every
    known = [one.name for one in every]
    for name in names:
        if name not in known:
            raise ModelError(
                f"There is no parameter {name!r} to fit; there are {', '.join(known)}."
            )
    return [one for one in every if one.name in names]


def noise_parameters(model: Model) -> list[Parameter]:
    """White noise and drift of each sensor, and the unmodelled acceleration where the model has any."""
    every = []
    for one in model.sensors:
        unit = UNITS[one.quantity].replace("s2", "s²")
        every.append(Parameter(f"noise of {one.name}", unit + "/√Hz", 2.0))
        if one.drift:
            every.append(Parameter(f"drift of {one.name}", unit + "/√s", 2.0))
    if model.unmodelled > 0:
        every.append(Parameter(UNMODELLED, "of the measured", 2.0))
    return every


def value_of(model: Model, parameter: Parameter) -> float:
    """The parameter's value in the model; its logarithm where it is positive."""
    values = {**parameter_values(model.vehicle), ORIGIN: model.origin, UNMODELLED: model.unmodelled}
    for sensor in model.sensors:
        values[f"position of {sensor.name}"] = sensor.position
        values[f"noise of {sensor.name}"] = sensor.noise_density or 0.0
        values[f"drift of {sensor.name}"] = sensor.drift or 0.0
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
            drift=values.get(f"drift of {sensor.name}", sensor.drift),
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
    )

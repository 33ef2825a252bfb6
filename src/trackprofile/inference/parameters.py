"""Named parameters of the model that can be estimated: how to read each from the model and how to set it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.inference.problem import Model
from trackprofile.models.sensor import UNITS, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.track import ElasticTrack
from trackprofile.models.vehicle import ROLL_FIELDS, parameter_values, with_parameters

Array = NDArray[np.float64]

ORIGIN = "origin"

LOAD_STD = 0.15
"""Standard deviation of the logarithm of a body's mass from day to day: from empty to crush-loaded is 40 %."""

POSITION_STD = 0.3
"""Standard deviation of a stated sensor position, measured with a tape, m."""


@dataclass(frozen=True)
class ModelParameter:
    """A number of the model. Positive parameters are estimated by their logarithm.

    Parameters
    ----------
    standard_deviation : of the prior about the start (of the logarithm where positive)
    get, put : read the value from a model; the model with another value; both in ``unit``
    """

    name: str
    unit: str
    standard_deviation: float
    get: Callable[[Model], float]
    put: Callable[[Model, float], Model]
    positive: bool = True


def value_of(model: Model, parameter: ModelParameter) -> float:
    """The parameter's value in the model; its logarithm where it is positive."""
    value = parameter.get(model)
    return float(np.log(value)) if parameter.positive else float(value)


def values_of(model: Model, parameters: Sequence[ModelParameter]) -> Array:
    """The values of several parameters, (parameters,)."""
    return np.array([value_of(model, one) for one in parameters], dtype=np.float64)


def with_values(model: Model, parameters: Sequence[ModelParameter], at: Array) -> Model:
    """The model with the parameters at those values (logarithms where positive)."""
    values = [
        float(np.exp(value) if one.positive else value)
        for one, value in zip(parameters, at, strict=True)
    ]
    return reduce(
        lambda changed, pair: pair[0].put(changed, pair[1]),
        zip(parameters, values, strict=True),
        model,
    )


def select_parameters(
    every: Sequence[ModelParameter], names: Sequence[str]
) -> list[ModelParameter]:
    """The parameters with these names.

    Raises
    ------
    ModelError
        Where no parameter has a name.
    """
    known = [one.name for one in every]
    for name in names:
        if name not in known:
            raise ModelError(
                f"There is no parameter {name!r}; known parameters are {', '.join(known)}."
            )
    return [one for one in every if one.name in names]


def vehicle_parameters(model: Model) -> list[ModelParameter]:
    """Masses, inertias and suspension by the vehicle's names, without those that act in roll only."""

    def one(name: str, unit: str, deviation: float) -> ModelParameter:
        return ModelParameter(
            name, unit, deviation,
            lambda model: parameter_values(model.vehicle)[name],
            lambda model, value: replace(model, vehicle=with_parameters(model.vehicle, {name: value})),
        )  # fmt: skip

    return [
        one(p.name, p.unit, p.log_std)
        for p in model.vehicle.parameters
        if any(field not in ROLL_FIELDS for _, field in p.used_by)
    ]


def position_parameters(model: Model) -> list[ModelParameter]:
    """Position of the train on the line, and of the sensors on the train."""
    return [_field(ORIGIN, "m", 5.0, "origin", positive=False)] + [
        _sensor_field(model, i, "position", "m", POSITION_STD, "position", positive=False)
        for i in range(len(model.sensors))
    ]


def mounting_parameters(model: Model) -> list[ModelParameter]:
    """Gain and tilt of the sensors, and the scale of the odometer."""
    every = [_field("distance scale", "true per recorded", 0.01, "distance_scale")]
    for i, sensor in enumerate(model.sensors):
        every.append(_sensor_field(model, i, "gain", "reading per quantity", 0.05, "gain"))
        if sensor.quantity == VERTICAL_ACCELERATION:
            every.append(_sensor_field(model, i, "tilt", "rad", 0.05, "tilt", positive=False))
    return every


def track_parameters(model: Model) -> list[ModelParameter]:
    """k_t and c_t under each wheel of an elastic track."""
    if not isinstance(model.track, ElasticTrack):
        return []
    every = [_field("track stiffness", "N/m", 0.3, "track.stiffness")]
    if model.track.damping > 0:
        every.append(_field("track damping", "N s/m", 0.5, "track.damping"))
    return every


def calibrated_parameters(model: Model) -> list[ModelParameter]:
    """All parameters that a calibration may estimate, besides the noise."""
    return (
        vehicle_parameters(model)
        + position_parameters(model)
        + mounting_parameters(model)
        + track_parameters(model)
    )


def prior_parameters(model: Model) -> list[ModelParameter]:
    """Level of the prior's spectrum."""
    return [_field("prior level", "m² rad/m", 3.0, "spectrum.amplitude")]


def corner_parameter(model: Model) -> ModelParameter:
    """Corner frequency of the prior's spectrum towards short waves."""
    return _field("prior corner", "rad/m", 0.7, "spectrum.corner_high")


def load_parameter(model: Model) -> ModelParameter:
    """Mass of the first body relative to its mass in the model; its inertia scales with it."""
    empty = model.vehicle.bodies[0]

    def put(model: Model, share: float) -> Model:
        pitch, roll = (
            None if one is None else share * one
            for one in (empty.pitch_inertia, empty.roll_inertia)
        )
        loaded = replace(empty, mass=share * empty.mass, pitch_inertia=pitch, roll_inertia=roll)
        bodies = (loaded, *model.vehicle.bodies[1:])
        return replace(model, vehicle=replace(model.vehicle, bodies=bodies))

    return ModelParameter(
        "load", f"times the mass of {empty.name!r}", LOAD_STD,
        lambda model: model.vehicle.bodies[0].mass / empty.mass, put,
    )  # fmt: skip


def white_noise_parameters(model: Model) -> list[ModelParameter]:
    """White noise density of each sensor."""
    return [
        _sensor_field(model, i, "noise", _unit(one) + "/√Hz", 2.0, "noise_density")
        for i, one in enumerate(model.sensors)
    ]


def noise_parameters(model: Model) -> list[ModelParameter]:
    """White noise and drift of each sensor, and the unmodelled acceleration."""
    every = []
    for i, (one, white) in enumerate(
        zip(model.sensors, white_noise_parameters(model), strict=True)
    ):
        every.append(white)
        if one.drift:
            every.append(_sensor_field(model, i, "drift", _unit(one) + "/√s", 2.0, "drift"))
    if model.unmodelled > 0:
        every.append(_field("unmodelled acceleration", "of the measured RMS", 2.0, "unmodelled"))
    return every


def residual_parameters(model: Model) -> list[ModelParameter]:
    """Parameters of the coloured residual of each sensor that has one."""
    return [
        _sensor_field(model, i, f"residual {name}", unit, deviation, f"residual.{name}")
        for i, one in enumerate(model.sensors)
        if one.residual
        for name, unit, deviation in (
            ("share", "of the signal", 2.0), ("frequency", "Hz", 0.7), ("damping", "1", 0.5),
        )
    ]  # fmt: skip


def _unit(sensor: Sensor) -> str:
    return UNITS[sensor.quantity].replace("s2", "s²")


def _field(
    name: str, unit: str, deviation: float, path: str, *, positive: bool = True
) -> ModelParameter:
    """The parameter of a field of the model, by its dotted path."""
    return ModelParameter(
        name, unit, deviation,
        lambda model: float(attrgetter(path)(model)),
        lambda model, value: _with(model, path.split("."), value),
        positive,
    )  # fmt: skip


def _sensor_field(
    model: Model,
    i: int,
    name: str,
    unit: str,
    deviation: float,
    path: str,
    *,
    positive: bool = True,
) -> ModelParameter:
    """The parameter of a field of sensor ``i``, by its dotted path."""

    def put(model: Model, value: float) -> Model:
        sensors: list[Sensor] = list(model.sensors)
        sensors[i] = _with(sensors[i], path.split("."), value)
        return replace(model, sensors=tuple(sensors))

    return ModelParameter(
        f"{name} of {model.sensors[i].name}", unit, deviation,
        lambda model: float(attrgetter(path)(model.sensors[i])),
        put,
        positive,
    )  # fmt: skip


def _with(whole: Any, path: Sequence[str], value: float) -> Any:
    """The dataclass with the field at that path replaced."""
    first, *rest = path
    inner = _with(getattr(whole, first), rest, value) if rest else value
    return replace(whole, **{first: inner})

"""The named parameters that a calibration may fit: how each is read off the model, and put into it."""

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

LOADED = 0.15
"""Standard deviation of the logarithm of a body's mass from day to day: from empty to crush-loaded is 40 %."""

MEASURED = 0.3
"""m, standard deviation of where a sensor is said to sit, measured with a tape."""


@dataclass(frozen=True)
class ModelParameter:
    """A number of the model. Positive ones are fitted by their logarithm.

    Parameters
    ----------
    spread : the prior's standard deviation (of the logarithm where positive) about the start
    get, put : read it off a model, and give the model with another value, in ``unit``
    """

    name: str
    unit: str
    spread: float
    get: Callable[[Model], float]
    put: Callable[[Model, float], Model]
    positive: bool = True


def value_of(model: Model, parameter: ModelParameter) -> float:
    """The parameter's value in the model; its logarithm where it is positive."""
    value = parameter.get(model)
    return float(np.log(value)) if parameter.positive else float(value)


def values_of(model: Model, parameters: Sequence[ModelParameter]) -> Array:
    """Those of several, (parameters,)."""
    return np.array([value_of(model, one) for one in parameters], dtype=np.float64)


def with_values(model: Model, parameters: Sequence[ModelParameter], at: Array) -> Model:
    """The model with the parameters at those values (logarithms where positive)."""
    values = [
        float(np.exp(value) if one.positive else value)
        for one, value in zip(parameters, at, strict=True)
    ]
    return reduce(
        lambda made, pair: pair[0].put(made, pair[1]), zip(parameters, values, strict=True), model
    )


def select_parameters(
    every: Sequence[ModelParameter], names: Sequence[str]
) -> list[ModelParameter]:
    """Those of the given names.

    Raises
    ------
    ModelError
        Where there is none of a name.
    """
    known = [one.name for one in every]
    for name in names:
        if name not in known:
            raise ModelError(
                f"There is no parameter {name!r} to fit; there are {', '.join(known)}."
            )
    return [one for one in every if one.name in names]


def vehicle_parameters(model: Model) -> list[ModelParameter]:
    """Masses, inertias and suspension, as the vehicle names them; without those that only roll feels."""

    def one(name: str, unit: str, spread: float) -> ModelParameter:
        return ModelParameter(
            name, unit, spread,
            lambda model: parameter_values(model.vehicle)[name],
            lambda model, value: replace(model, vehicle=with_parameters(model.vehicle, {name: value})),
        )  # fmt: skip

    return [
        one(p.name, p.unit, p.log_std)
        for p in model.vehicle.parameters
        if any(field not in ROLL_FIELDS for _, field in p.used_by)
    ]


def place_parameters(model: Model) -> list[ModelParameter]:
    """The train's place on the line, and the sensors' on the train."""
    return [_field(ORIGIN, "m", 5.0, "origin", positive=False)] + [
        _of_sensor(model, i, "position", "m", MEASURED, "position", positive=False)
        for i in range(len(model.sensors))
    ]


def mounting_parameters(model: Model) -> list[ModelParameter]:
    """Gain and tilt of the sensors, and the wheel that counts the distance."""
    every = [_field("distance scale", "true per recorded", 0.01, "distance_scale")]
    for i, sensor in enumerate(model.sensors):
        every.append(_of_sensor(model, i, "gain", "reading per quantity", 0.05, "gain"))
        if sensor.quantity == VERTICAL_ACCELERATION:
            every.append(_of_sensor(model, i, "tilt", "rad", 0.05, "tilt", positive=False))
    return every


def track_parameters(model: Model) -> list[ModelParameter]:
    """k_t and c_t under each wheel, where the track has them."""
    if not isinstance(model.track, ElasticTrack):
        return []
    every = [_field("track stiffness", "N/m", 0.3, "track.stiffness")]
    if model.track.damping > 0:
        every.append(_field("track damping", "N s/m", 0.5, "track.damping"))
    return every


def calibrated_parameters(model: Model) -> list[ModelParameter]:
    """All that a calibration may fit, beside the noise."""
    return (
        vehicle_parameters(model)
        + place_parameters(model)
        + mounting_parameters(model)
        + track_parameters(model)
    )


def prior_parameters(model: Model) -> list[ModelParameter]:
    """How rough the track is."""
    return [_field("prior level", "m² rad/m", 3.0, "spectrum.amplitude")]


def corner_parameter(model: Model) -> ModelParameter:
    """Where the spectrum's short waves begin to fall faster."""
    return _field("prior knee", "rad/m", 0.7, "spectrum.corner_high")


def load_parameter(model: Model) -> ModelParameter:
    """What the first body weighs on the day, of what it weighs in the model; its inertia goes with it."""
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
        "load", f"of the {empty.name}'s mass", LOADED,
        lambda model: model.vehicle.bodies[0].mass / empty.mass, put,
    )  # fmt: skip


def white_noise_parameters(model: Model) -> list[ModelParameter]:
    """The white noise of each sensor."""
    return [
        _of_sensor(model, i, "noise", _unit(one) + "/√Hz", 2.0, "noise_density")
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
            every.append(_of_sensor(model, i, "drift", _unit(one) + "/√s", 2.0, "drift"))
    if model.unmodelled > 0:
        every.append(_field("unmodelled acceleration", "of the measured", 2.0, "unmodelled"))
    return every


def residual_parameters(model: Model) -> list[ModelParameter]:
    """The coloured residual of each sensor that has one."""
    return [
        _of_sensor(model, i, f"residual {word}", unit, spread, f"residual.{word}")
        for i, one in enumerate(model.sensors)
        if one.residual
        for word, unit, spread in (
            ("share", "of the signal", 2.0), ("frequency", "Hz", 0.7), ("damping", "1", 0.5),
        )
    ]  # fmt: skip


def _unit(sensor: Sensor) -> str:
    return UNITS[sensor.quantity].replace("s2", "s²")


def _field(
    name: str, unit: str, spread: float, path: str, *, positive: bool = True
) -> ModelParameter:
    """A field of the model, or a field of a field of it."""
    return ModelParameter(
        name, unit, spread,
        lambda model: float(attrgetter(path)(model)),
        lambda model, value: _with(model, path.split("."), value),
        positive,
    )  # fmt: skip


def _of_sensor(
    model: Model, i: int, word: str, unit: str, spread: float, path: str, *, positive: bool = True
) -> ModelParameter:
    """A field of one sensor, or a field of a field of it."""

    def put(model: Model, value: float) -> Model:
        sensors: list[Sensor] = list(model.sensors)
        sensors[i] = _with(sensors[i], path.split("."), value)
        return replace(model, sensors=tuple(sensors))

    return ModelParameter(
        f"{word} of {model.sensors[i].name}", unit, spread,
        lambda model: float(attrgetter(path)(model.sensors[i])),
        put,
        positive,
    )  # fmt: skip


def _with(whole: Any, path: Sequence[str], value: float) -> Any:
    """The dataclass with a field, or a field of a field, replaced."""
    first, *rest = path
    inner = _with(getattr(whole, first), rest, value) if rest else value
    return replace(whole, **{first: inner})

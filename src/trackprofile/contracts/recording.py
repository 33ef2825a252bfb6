"""The recording: what a train's sensors measured, and how it moved meanwhile."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.contracts.identity import IDENTITY, check_identity
from trackprofile.contracts.validation import (
    DISTANCE_DEVIATION,
    Array,
    check_deviation,
    check_finite,
    check_increasing,
    expect_kind,
    float_values,
    integer_values,
    number_attribute,
    put_variable,
    refuse_rows,
    text_attribute,
)
from trackprofile.errors import DataError

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "vertical acceleration": ("m/s2", "acceleration"),
    "pitch rate": ("rad/s", "angular rate"),
    "roll rate": ("rad/s", "angular rate"),
}
"""What a channel may measure: its SI unit, and its dimension in `trackprofile.units`."""

FIRST_END, LAST_END = VEHICLE_ENDS = ("first", "last")
"""Which wheel of a vehicle leads, as its positions count."""

MAX_DECELERATION = 3.0
"""Above what any train's brakes do [m/s²]; emergency brakes of trams reach it."""

SENSOR_NUMBERS = ("noise_density", "bandwidth", "flicker")
"""What a channel may state of itself, each above zero."""

_MOTION_UNITS = {"time": "s", "distance": "m", "speed": "m/s"}


@dataclass(frozen=True, eq=False)
class Channel:
    """What one sensor recorded.

    Parameters
    ----------
    name : of the variable; without "/", not ending in "_valid"
    values : (samples,) [m/s² or rad/s]
    quantity : a key of `QUANTITIES`
    body : the vehicle's body that carries the sensor
    position : ahead of that body's centre [m]
    lateral : to the left of that body's middle [m]
    noise_density : one-sided, in the channel's unit per √Hz; None if not known
    valid : (samples,), False where the sample is not to be used; None if all are good
    bandwidth : where the sensor's own filter cuts off [Hz]; None if the sampling sets it
    flicker : root of the one-sided density of the 1/f noise at 1 Hz, in the channel's unit per √Hz; None if not known
    """

    name: str
    values: Array
    quantity: str
    body: str
    position: float
    lateral: float = field(default=0.0, kw_only=True)
    noise_density: float | None = None
    valid: NDArray[np.bool_] | None = None
    bandwidth: float | None = None
    flicker: float | None = None


def build_recording(
    channels: Sequence[Channel],
    *,
    time: ArrayLike | None = None,
    distance: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    line: str = "",
    direction: str = "",
    source: str = "",
    vehicle: str = "",
    provenance: Iterable[str] = (),
    clock_fault: ArrayLike | None = None,
    distance_deviation: ArrayLike | None = None,
    wheel_scale: float | None = None,
    leading_end: str = "",
    identity: str = "",
) -> xr.Dataset:
    """A recording from arrays in SI units, validated.

    Parameters
    ----------
    channels : at least one
    time, distance, speed : (samples,) [s, m, m/s]; speed may be left out only where both others are
    line, direction, source, vehicle : in words
    provenance : what was done so far
    clock_fault : (samples,), sums of `trackprofile.preprocessing.faults.ClockFault`; None: the clock was good
    distance_deviation : (samples,), standard deviation of the distance [m]; None: not known
    wheel_scale : true over nominal diameter of the wheel, where positions have put the distance right by it
    leading_end : of the vehicle as it is described, where that is known: one of `VEHICLE_ENDS`
    identity : digest that identifies what was read from a file; "": the recording is identified by its arrays

    Raises
    ------
    DataError : see `validate_recording`.

    Examples
    --------
    >>> floor = Channel("floor", [0.0, 0.1, 0.0], "vertical acceleration", "body", 6.9)
    >>> recording = build_recording([floor], time=[0.0, 0.1, 0.2], speed=[20.0, 20.0, 20.0])
    >>> recording["floor"].attrs["units"]
    'm/s2'
    """
    dataset = xr.Dataset(
        attrs={
            "kind_of_data": "recording",
            "line": line,
            "direction": direction,
            "source": source,
            "vehicle": vehicle,
            "provenance": json.dumps(list(provenance), ensure_ascii=False),
        }
    )
    for name, values in (("time", time), ("distance", distance), ("speed", speed)):
        if values is not None:
            put_variable(dataset, name, "sample", values, {"units": _MOTION_UNITS[name]})
    if distance_deviation is not None:
        put_variable(dataset, DISTANCE_DEVIATION, "sample", distance_deviation, {"units": "m"})
    if wheel_scale is not None:
        dataset.attrs["wheel_scale"] = float(wheel_scale)
    if leading_end:
        dataset.attrs["leading_end"] = leading_end
    if identity:
        dataset.attrs[IDENTITY] = identity
    if clock_fault is not None and np.any(clock_fault):
        put_variable(dataset, "clock_fault", "sample", clock_fault, {}, np.int8)
    for channel in channels:
        _put_channel(dataset, channel)
    return validate_recording(dataset)


def channels(recording: xr.Dataset) -> tuple[Channel, ...]:
    """The channels of a recording, in order, `Channel.valid` always an array.

    Examples
    --------
    >>> floor = Channel("floor", [0.0, 0.1], "vertical acceleration", "body", 6.9)
    >>> channels(build_recording([floor], time=[0.0, 0.1], speed=[20.0, 20.0]))[0].valid
    array([ True,  True])
    """
    return tuple(
        Channel(
            name=str(name),
            values=variable.to_numpy(),
            quantity=variable.attrs["quantity"],
            body=variable.attrs["body"],
            position=float(variable.attrs["position"]),
            lateral=float(variable.attrs.get("lateral", 0.0)),
            noise_density=_optional(variable.attrs.get("noise_density")),
            valid=integer_values(recording, f"{name}_valid", "sample").astype(bool),
            bandwidth=_optional(variable.attrs.get("bandwidth")),
            flicker=_optional(variable.attrs.get("flicker")),
        )
        for name, variable in recording.data_vars.items()
        if "quantity" in variable.attrs
    )


def validate_recording(recording: xr.Dataset) -> xr.Dataset:
    """The recording itself, if it keeps the contract.

    Raises
    ------
    DataError : it has no channel, fewer than two samples, does not say how the train moved, or a
        channel is not described; `RowError` where it is one row that cannot be used: a number
        missing that is not marked invalid, time that does not increase, distance or speed that
        runs backwards, a speed of zero where there is no time.
    """
    expect_kind(recording, "recording")
    samples = recording.sizes.get("sample", 0)
    if samples < 2:
        raise DataError(f"A recording needs at least 2 samples, this one has {samples}.")
    _check_motion(
        *(
            float_values(recording, name, "sample", unit) if name in recording else None
            for name, unit in _MOTION_UNITS.items()
        )
    )
    if "clock_fault" in recording:
        integer_values(recording, "clock_fault", "sample")
    leading_end(recording)
    check_identity(recording)
    scale = number_attribute({"wheel_scale": 1.0} | recording.attrs, "wheel_scale")
    if not 0 < scale < np.inf:
        raise DataError(
            f"A recording's wheel_scale is a number above zero, this one says {scale:g}."
        )
    if DISTANCE_DEVIATION in recording:
        check_deviation(
            DISTANCE_DEVIATION, float_values(recording, DISTANCE_DEVIATION, "sample", "m")
        )
    names = [name for name, one in recording.data_vars.items() if "quantity" in one.attrs]
    if not names:
        raise DataError("A recording needs at least one sensor channel, this one has none.")
    for name in names:
        _check_channel(str(name), recording)
    return recording


def leading_end(recording: xr.Dataset) -> str:
    """Which wheel of the vehicle leads, one of `VEHICLE_ENDS`; "" where the recording does not say.

    Raises
    ------
    DataError : it says something else.
    """
    end = text_attribute(recording.attrs, "leading_end") or ""
    if end not in {"", *VEHICLE_ENDS}:
        raise DataError(
            f"A recording's leading_end is one of {', '.join(VEHICLE_ENDS)}, this one says {end!r}."
        )
    return end


def _put_channel(dataset: xr.Dataset, channel: Channel) -> None:
    name = channel.name
    if (
        not name
        or "/" in name
        or name.endswith("_valid")
        or name in {*dataset, *_MOTION_UNITS, DISTANCE_DEVIATION}
    ):
        raise DataError(
            f"Channel {name!r}: expected a name of its own, without '/', not ending in '_valid', "
            f"and none of {', '.join(_MOTION_UNITS)}."
        )
    attributes = {
        "units": QUANTITIES.get(channel.quantity, ("", ""))[0],
        "quantity": channel.quantity,
        "body": channel.body,
        "position": float(channel.position),
    }
    if channel.lateral:
        attributes["lateral"] = float(channel.lateral)
    for optional in SENSOR_NUMBERS:
        if (number := getattr(channel, optional)) is not None:
            attributes[optional] = float(number)
    put_variable(dataset, name, "sample", channel.values, attributes)
    valid = np.ones(dataset.sizes["sample"], bool) if channel.valid is None else channel.valid
    put_variable(dataset, f"{name}_valid", "sample", valid, {}, np.bool_)


def _check_motion(time: Array | None, distance: Array | None, speed: Array | None) -> None:
    if time is None and distance is None:
        raise DataError("A recording needs time or distance, this one has neither.")
    if speed is None and (time is None or distance is None):
        raise DataError("A recording needs two of time, distance and speed, this one has one.")
    if time is not None:
        check_finite("time", time)
        check_increasing("time", time, "s")
    if distance is not None:
        check_finite("distance", distance)
        check_increasing("distance", distance, "m", standing_allowed=time is not None)
        if distance[-1] == distance[0]:
            raise DataError("The distance is the same in every row: the train never moved.")
    if speed is not None:
        _check_speed(speed, None if time is not None else distance)


def _check_speed(speed: Array, without_time: Array | None) -> None:
    """``without_time`` is the distance of a recording that has no time."""
    check_finite("speed", speed)
    refuse_rows(
        speed < 0,
        "speed",
        "the speed is {:g} m/s; expected zero or more: turn the recording round, or mend its sign.",
        speed,
    )
    if not speed.any():
        raise DataError("The speed is zero in every row: the train never moved.")
    if without_time is not None:
        refuse_rows(
            (speed == 0) & ~_can_stand(speed, without_time),
            "speed",
            "the speed is zero between rows where the train runs, and without time a recording cannot "
            "say how long it stood; add the time, or mend or remove the row.",
        )


def _can_stand(speed: Array, distance: Array) -> NDArray[np.bool_]:
    """Where no brake is needed that trains do not have: v² ≤ 2 a Δs against both neighbours.

    A train that creeps below the recorded step reads zero there.
    """
    reachable = 2 * MAX_DECELERATION * np.diff(distance) >= np.abs(np.diff(speed**2))
    return np.concatenate([[True], reachable]) & np.concatenate([reachable, [True]])


def _check_channel(name: str, recording: xr.Dataset) -> None:
    attributes = recording[name].attrs
    quantity = text_attribute(attributes, "quantity")
    if quantity is None or quantity not in QUANTITIES:
        raise DataError(
            f"Channel {name!r}: its quantity is one of {', '.join(QUANTITIES)}, got {quantity!r}."
        )
    body = attributes.get("body")
    if not (
        isinstance(body, str) and body and np.isfinite(number_attribute(attributes, "position"))
    ):
        raise DataError(f"Channel {name!r}: expected the body it is on, and a position on it in m.")
    if not np.isfinite(number_attribute({"lateral": 0.0} | attributes, "lateral")):
        raise DataError(
            f"Channel {name!r}: expected a lateral position in m, positive to the left."
        )
    for optional in SENSOR_NUMBERS:
        number = number_attribute({optional: 1.0} | attributes, optional)
        if not 0 < number < np.inf:
            raise DataError(f"Channel {name!r}: expected a {optional} above zero, got {number:g}.")
    values = float_values(recording, name, "sample", QUANTITIES[quantity][0])
    valid = integer_values(recording, f"{name}_valid", "sample").astype(bool)
    if not valid.any():
        raise DataError(f"Channel {name!r}: no sample is marked valid; leave this channel out.")
    refuse_rows(
        valid & ~np.isfinite(values),
        name,
        "there is no finite number; mark such samples invalid with a column of 1 and 0 "
        '(in the recording\'s TOML: valid = "its name").',
    )


def _optional(number: Any) -> float | None:
    return None if number is None else float(number)

"""The recording: signals of the sensors on a train, and its motion."""

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
"""Quantities of a channel: SI unit, and dimension in `trackprofile.units`."""

FIRST_END, LAST_END = VEHICLE_ENDS = ("first", "last")
"""Ends of a vehicle, of which one leads: that of its first or of its last wheel."""

MAX_DECELERATION = 3.0
"""Upper bound of the deceleration of a train [m/s²]; emergency brakes of trams reach it."""

SENSOR_NUMBERS = ("noise_density", "bandwidth", "flicker")
"""Optional positive numbers of a channel."""

_MOTION_UNITS = {"time": "s", "distance": "m", "speed": "m/s"}


@dataclass(frozen=True, eq=False)
class Channel:
    """Signal of one sensor.

    Parameters
    ----------
    name : name of the variable; without "/", not ending in "_valid"
    values : (samples,) [m/s² or rad/s]
    quantity : a key of `QUANTITIES`
    body : name of the vehicle's body that carries the sensor
    position : distance ahead of the centre of that body [m]
    lateral : distance to the left of the centre of that body [m]
    noise_density : one-sided amplitude density of the white noise [unit of the channel/√Hz]; None: unknown
    valid : (samples,), False where a sample must not be used; None: all are valid
    bandwidth : cut-off frequency of the sensor's filter [Hz]; None: set by the sampling
    flicker : one-sided amplitude density of the 1/f noise at 1 Hz [unit of the channel/√Hz]; None: unknown
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
    """Build a recording from arrays in SI units, and validate it.

    Parameters
    ----------
    channels : signals of at least one sensor
    time, distance, speed : (samples,) [s, m, m/s]; speed is optional where both others are given
    line, direction, source, vehicle : free text
    provenance : processing steps so far
    clock_fault : (samples,), sums of `trackprofile.preprocessing.faults.ClockFault`; None: the clock has none
    distance_deviation : (samples,), standard deviation of the distance [m]; None: unknown
    wheel_scale : true over nominal diameter of the wheel, where the distance was corrected by it
    leading_end : end of the vehicle that leads, one of `VEHICLE_ENDS`; "": unknown
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
    """Channels of a recording, in order; `Channel.valid` is always an array.

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
    """Check a recording against the contract, and return it.

    Raises
    ------
    DataError : it has no channel, fewer than two samples or no motion, or a channel is not described.
    RowError : a value is missing that is not marked invalid, time does not increase, distance decreases, speed is
        negative, or speed is zero in a recording without time.
    """
    expect_kind(recording, "recording")
    samples = recording.sizes.get("sample", 0)
    if samples < 2:
        raise DataError(
            f"A recording needs at least 2 samples, got {samples}; record or select more."
        )
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
            f"Recording, attribute wheel_scale: expected a number above zero, got {scale:g}."
        )
    if DISTANCE_DEVIATION in recording:
        check_deviation(
            DISTANCE_DEVIATION, float_values(recording, DISTANCE_DEVIATION, "sample", "m")
        )
    names = [name for name, one in recording.data_vars.items() if "quantity" in one.attrs]
    if not names:
        raise DataError("A recording needs at least one sensor channel, got none; add one.")
    for name in names:
        _check_channel(str(name), recording)
    return recording


def leading_end(recording: xr.Dataset) -> str:
    """End of the vehicle that leads, one of `VEHICLE_ENDS`; "" if it is unknown.

    Raises
    ------
    DataError : the attribute has another value.
    """
    end = text_attribute(recording.attrs, "leading_end") or ""
    if end not in {"", *VEHICLE_ENDS}:
        raise DataError(
            f"Recording, attribute leading_end: expected one of {', '.join(VEHICLE_ENDS)}, got {end!r}."
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
            f"Channel {name!r}: expected a unique name without '/' that does not end in '_valid' and is not one of "
            f"{', '.join(_MOTION_UNITS)}; rename the channel."
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
        raise DataError("A recording needs a time or a distance, got neither; add one.")
    if speed is None and (time is None or distance is None):
        raise DataError("A recording needs two of time, distance and speed, got one; add another.")
    if time is not None:
        check_finite("time", time)
        check_increasing("time", time, "s")
    if distance is not None:
        check_finite("distance", distance)
        check_increasing("distance", distance, "m", standing_allowed=time is not None)
        if distance[-1] == distance[0]:
            raise DataError(
                "distance: the same in every row, the train did not move; choose another column or recording."
            )
    if speed is not None:
        _check_speed(speed, None if time is not None else distance)


def _check_speed(speed: Array, without_time: Array | None) -> None:
    """Check the speed; ``without_time`` is the distance of a recording that has no time."""
    check_finite("speed", speed)
    refuse_rows(
        speed < 0,
        "speed",
        "expected a speed of zero or more, got {:g} m/s; reverse the recording, or correct the sign.",
        speed,
    )
    if not speed.any():
        raise DataError(
            "speed: zero in every row, the train did not move; choose another column or recording."
        )
    if without_time is not None:
        refuse_rows(
            (speed == 0) & ~_can_stand(speed, without_time),
            "speed",
            "the speed is zero between rows where the train runs, and a recording without time does not determine how "
            "long it stood; add the time, or correct or remove the row.",
        )


def _can_stand(speed: Array, distance: Array) -> NDArray[np.bool_]:
    """Rows in which the train can stand: v² ≤ 2 a Δs to both neighbours, with a of `MAX_DECELERATION`.

    A speed below the recorded step is recorded as zero.
    """
    reachable = 2 * MAX_DECELERATION * np.diff(distance) >= np.abs(np.diff(speed**2))
    return np.concatenate([[True], reachable]) & np.concatenate([reachable, [True]])


def _check_channel(name: str, recording: xr.Dataset) -> None:
    attributes = recording[name].attrs
    quantity = text_attribute(attributes, "quantity")
    if quantity is None or quantity not in QUANTITIES:
        raise DataError(
            f"Channel {name!r}: expected a quantity out of {', '.join(QUANTITIES)}, got {quantity!r}."
        )
    body = attributes.get("body")
    if not (
        isinstance(body, str) and body and np.isfinite(number_attribute(attributes, "position"))
    ):
        raise DataError(
            f"Channel {name!r}: expected the name of its body, and its position on it in m; add them."
        )
    if not np.isfinite(number_attribute({"lateral": 0.0} | attributes, "lateral")):
        raise DataError(
            f"Channel {name!r}: expected a lateral position in m, positive to the left, got a value that is not finite."
        )
    for optional in SENSOR_NUMBERS:
        number = number_attribute({optional: 1.0} | attributes, optional)
        if not 0 < number < np.inf:
            raise DataError(f"Channel {name!r}: expected a {optional} above zero, got {number:g}.")
    values = float_values(recording, name, "sample", QUANTITIES[quantity][0])
    valid = integer_values(recording, f"{name}_valid", "sample").astype(bool)
    if not valid.any():
        raise DataError(f"Channel {name!r}: no sample is marked valid; remove the channel.")
    refuse_rows(
        valid & ~np.isfinite(values),
        name,
        "expected a finite number; mark such samples invalid in a column of 1 and 0 "
        '(in the TOML of the recording: valid = "name of the column").',
    )


def _optional(number: Any) -> float | None:
    return None if number is None else float(number)

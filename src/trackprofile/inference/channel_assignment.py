"""Detection of exchanged channels, wrong signs and a reversed vehicle from the response of all channels to one profile.

All sensors respond to one profile: their spectra at a frequency f are one random number times the transfer functions
h(Ω), Ω = 2πf/v, so the covariance of all channels is α (h hᴴ + D). Exchanged channels or a wrong sign give phases or
amplitudes that no profile can cause. With the other end leading, the sensors pass over the track in another order, and
nose-up becomes nose-down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.inference.observations import Observations
from trackprofile.models.roll import RollVehicle
from trackprofile.models.sensor import PITCH_RATE, ROLL_RATE, Sensor
from trackprofile.models.statespace import state_space, transfer_function
from trackprofile.models.track import PointTrack
from trackprofile.models.vehicle import Vehicle, reversed_vehicle
from trackprofile.preprocessing.faults import Fault, FaultKind

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

WINDOW = 4.0
"""Length of the window of one spectrum, s."""

LOW, HIGH = 0.7, 15.0
"""Frequencies between which a rigid vehicle model holds for any train, Hz."""

MIN_SPEED = 8.0
"""Minimum speed of a window, m/s."""

MAX_WINDOWS = 40

MISFIT = 0.2
"""Error of model and noise as a share of each channel's power."""

MIN_GAIN = 0.5
"""Minimum gain of log-likelihood per frequency and window for a change."""

MIN_FREQUENCIES = 40
"""Minimum number of frequencies in all windows for a decision."""


@dataclass(frozen=True)
class ChannelAssignment:
    """Channel and sign of each sensor; ``turned``: on the reversed vehicle."""

    order: tuple[int, ...]
    sign: tuple[int, ...]
    turned: bool = False


def assign_channels(data: Observations, vehicle: Vehicle, track: PointTrack) -> Observations:
    """Observations with exchanged channels and wrong signs corrected, and reported in faults and notes.

    A change needs a clear gain of likelihood; a single channel is never changed. An accelerometer that reads gravity
    has the right sign.

    Parameters
    ----------
    vehicle : with the end first that is assumed to lead

    Raises
    ------
    DataError
        Where two channels contradict each other and either may have the wrong sign.
    """
    count = len(data.sensors)
    spectra = list(_spectra(data)) if count > 1 else []
    if not spectra:
        return data
    # The mean of both rails determines which end leads; the difference follows it.
    as_recorded, *others = _assignments(data, turnable=not isinstance(vehicle, RollVehicle))
    pairs = {False: _pairs(spectra, vehicle, track, data.sensors)}
    if others[0].turned:
        turned = turned_sensors(data).sensors
        pairs[True] = _pairs(spectra, reversed_vehicle(vehicle), track, turned)
    frequencies = sum(len(y) for y, _ in pairs[False])
    reference = _log_likelihood(pairs[False], as_recorded)
    gains = [_log_likelihood(pairs[one.turned], one) - reference for one in others]
    best = int(np.argmax(gains))
    if frequencies < MIN_FREQUENCIES or gains[best] < MIN_GAIN * frequencies:
        return data
    equivalent = [one for one, gain in zip(others, gains, strict=True) if gain > gains[best] - 1.0]
    if len([one for one in equivalent if not one.turned]) > 1:
        names = " and ".join(repr(one.name) for one in data.sensors)
        raise DataError(
            f"The signs of {names} contradict each other: one of them is wrong (at rest an accelerometer reads gravity "
            "upwards), or the last wheel leads (leading_end); correct the description of the recording."
        )
    return _corrected(data, equivalent)


def turned_sensors(data: Observations) -> Observations:
    """Observations on the reversed vehicle: ahead becomes behind, left becomes right, nose-up becomes nose-down."""
    sensors = tuple(
        replace(one, position=-one.position, lateral=-one.lateral, tilt=-one.tilt)
        for one in data.sensors
    )
    sign = np.array(_nose_down(data), dtype=np.float64)
    return replace(data, sensors=sensors, signals=data.signals * sign, turned=not data.turned)


def _nose_down(data: Observations) -> tuple[int, ...]:
    """Sign of each sensor's reading on the reversed vehicle."""
    return tuple(-1 if one.quantity in {PITCH_RATE, ROLL_RATE} else 1 for one in data.sensors)


def _pairs(
    spectra: list[tuple[Array, ComplexArray, float]], vehicle: Vehicle, track: PointTrack,
    sensors: tuple[Sensor, ...],
) -> list[tuple[ComplexArray, ComplexArray]]:  # fmt: skip
    """Spectra of windows, each with the transfer functions of the model."""
    system = state_space(vehicle, track, sensors)
    return [(y, transfer_function(system, 2 * np.pi * f / speed, speed)) for f, y, speed in spectra]


def _assignments(data: Observations, *, turnable: bool) -> list[ChannelAssignment]:
    """As recorded, vehicle reversed, one sign changed that gravity does not determine, or two channels exchanged."""
    count = len(data.sensors)
    straight, plus = tuple(range(count)), (1,) * count
    assignments = [ChannelAssignment(straight, plus)]
    if turnable:
        assignments.append(ChannelAssignment(straight, _nose_down(data), turned=True))
    upright = data.by_gravity or (False,) * count
    for i in (i for i in range(count) if not upright[i]):
        assignments.append(
            ChannelAssignment(straight, tuple(-1 if j == i else 1 for j in range(count)))
        )
    for i, j in combinations(range(count), 2):
        order = list(straight)
        order[i], order[j] = j, i
        assignments.append(ChannelAssignment(tuple(order), plus))
    return assignments


def _spectra(data: Observations) -> Iterator[tuple[Array, ComplexArray, float]]:
    """Frequencies (m,) in Hz, spectra (m, sensors) and mean speed (m/s) of windows in which all samples are valid."""
    time, speed = data.motion.time, data.motion.speed
    interval = float(np.median(np.diff(time)))
    size = max(round(WINDOW / interval), 2)
    f = np.asarray(np.fft.rfftfreq(size, interval), np.float64)
    inside = (f > LOW) & (f < HIGH)
    hop = max(size // 2, (len(time) - size) // MAX_WINDOWS, 1)
    taper = np.hanning(size)[:, None]
    for start in range(0, len(time) - size + 1, hop):
        rows = slice(start, start + size)
        t, v = time[rows], speed[rows]
        good = data.valid[rows].all() and len(t) == size
        if not good or np.any(np.diff(t) > 1.5 * interval) or v.min() < MIN_SPEED:
            continue
        signal = data.signals[rows] - data.signals[rows].mean(axis=0)
        yield f[inside], np.fft.rfft(taper * signal, axis=0)[inside], float(v.mean())


def _log_likelihood(
    pairs: list[tuple[ComplexArray, ComplexArray]], assignment: ChannelAssignment
) -> float:
    """Log-likelihood of spectra (m, sensors) under transfer functions (m, sensors), at the likeliest levels."""
    total = 0.0
    for measured, h in pairs:
        y = measured[:, list(assignment.order)] * np.array(assignment.sign, dtype=np.float64)
        power = np.abs(h) ** 2
        D = MISFIT * (power + np.mean(power, axis=0))
        # (h hᴴ + D)⁻¹ and its determinant, by the rank-one formulas.
        a = np.sum(power / D, axis=1)
        along = np.sum(np.conj(h) * y / D, axis=1)
        square = np.sum(np.abs(y) ** 2 / D, axis=1) - np.abs(along) ** 2 / (1 + a)
        level = np.maximum(square / y.shape[1], 1e-300)
        total -= float(
            np.sum(np.log(1 + a) + np.sum(np.log(D), axis=1) + y.shape[1] * np.log(level))
        )
    return total


def _corrected(data: Observations, equivalent: list[ChannelAssignment]) -> Observations:
    """Observations by the likeliest assignment; of two equivalent ones the exchange precedes the reversed vehicle."""
    turned = [one for one in equivalent if one.turned]
    others = [one for one in equivalent if not one.turned]
    exchanged = bool(others) and others[0].order != tuple(range(len(data.sensors)))
    if turned and not exchanged:
        return _reversed(data, others)
    return _reassigned(data, others[0], ", or the last wheel leads" if turned else "")


def _reversed(data: Observations, others: list[ChannelAssignment]) -> Observations:
    """Observations of the reversed vehicle; ``others`` explain the signals almost as well."""
    last = len(data.motion.time) - 1
    alternative = ""
    if others:
        name = data.sensors[others[0].sign.index(-1)].name
        alternative = f" (or the sign of {name!r} is wrong: then positions are off by up to the vehicle's length)"
    note = f"the vehicle is reversed, its last wheel leads: no profile explains the signals otherwise{alternative}"
    return replace(
        turned_sensors(data),
        faults=(*data.faults, Fault(FaultKind.REVERSED, "", 0, last)),
        notes=(*data.notes, f"{note}; state leading_end in the recording"),
    )


def _reassigned(
    data: Observations, assignment: ChannelAssignment, alternative: str
) -> Observations:
    order, sign = list(assignment.order), np.array(assignment.sign, dtype=np.float64)
    last = len(data.motion.time) - 1
    changed = [i for i, (j, s) in enumerate(zip(order, sign, strict=True)) if i != j or s < 0]
    names = [data.sensors[i].name for i in changed]
    if len(changed) == 1:
        kind = FaultKind.SIGN
        note = f"the sign of {names[0]!r} is wrong and was changed: no profile explains the signals otherwise"
    else:
        kind = FaultKind.EXCHANGED
        note = (
            f"{names[0]!r} and {names[1]!r} are exchanged{alternative}: no profile explains the signals otherwise; "
            "correct the description of the recording"
        )
    return replace(
        data,
        signals=data.signals[:, order] * sign,
        valid=data.valid[:, order],
        step=data.step[:, order],
        saturated=data.saturated[:, order],
        faulty=np.ones_like(data.faulty),
        faults=(*data.faults, *(Fault(kind, name, 0, last) for name in names)),
        notes=(*data.notes, note),
    )

"""Channels that were exchanged or turned round, and a vehicle that runs the other way round, told by what the same
track makes of each channel.

All sensors feel one profile, so that their spectra at a frequency f are those of one random number times the transfer
functions h(Ω), Ω = 2πf/v: the covariance of all channels is α (h hᴴ + D). An exchange or a change of sign puts phases
or sizes where no profile could; with the other end leading sensors feel the track in another order, and what was
nose-up is nose-down.
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
"""s of one spectrum."""

LOW, HIGH = 0.7, 15.0
"""Hz, between which a rigid car holds for any train."""

SLOWEST = 8.0
"""m/s, below which nothing is judged."""

MOST_WINDOWS = 40

MISFIT = 0.2
"""Share of each channel's power that model and noise may be wrong by."""

CLEARLY = 0.5
"""By which the logarithm of the likelihood has to be better for each frequency of each window."""

FEWEST = 40
"""Frequencies of windows below which nothing is judged."""


@dataclass(frozen=True)
class ChannelAssignment:
    """Which measured channel each sensor has, and with which sign; ``turned``: on the vehicle turned round."""

    order: tuple[int, ...]
    sign: tuple[int, ...]
    turned: bool = False


def assign_channels(data: Observations, vehicle: Vehicle, track: PointTrack) -> Observations:
    """The recording with channels put right that were exchanged or turned round, said in its faults and notes.

    Nothing is changed where it is not much more likely so; one channel alone cannot tell. An accelerometer that reads
    gravity has the right sign.

    Parameters
    ----------
    vehicle : with the end first that is taken to lead

    Raises
    ------
    DataError
        Where the sign of a channel is wrong, but not which: of two that contradict each other either may be right.
    """
    count = len(data.sensors)
    spectra = list(_spectra(data)) if count > 1 else []
    if not spectra:
        return data
    # Which end leads the mean of both rails tells; what rolls follows it.
    as_it_is, *others = _wirings(data, turnable=not isinstance(vehicle, RollVehicle))
    pairs = {False: _pairs(spectra, vehicle, track, data.sensors)}
    if others[0].turned:
        turned = turned_sensors(data).sensors
        pairs[True] = _pairs(spectra, reversed_vehicle(vehicle), track, turned)
    frequencies = sum(len(y) for y, _ in pairs[False])
    here = _log_likelihood(pairs[False], as_it_is)
    gains = [_log_likelihood(pairs[one.turned], one) - here for one in others]
    best = int(np.argmax(gains))
    if frequencies < FEWEST or gains[best] < CLEARLY * frequencies:
        return data
    alike = [one for one, gain in zip(others, gains, strict=True) if gain > gains[best] - 1.0]
    if len([one for one in alike if not one.turned]) > 1:
        names = " and ".join(repr(one.name) for one in data.sensors)
        raise DataError(
            f"The signs of {names} contradict each other: one of them is turned round; find out which (at rest an "
            "accelerometer reads gravity upwards), or the vehicle runs the other way round (leading_end): mend the "
            "recording."
        )
    return _put_right(data, alike)


def turned_sensors(data: Observations) -> Observations:
    """The same, on the vehicle turned round: what was ahead is behind, left is right, nose-up is nose-down."""
    sensors = tuple(
        replace(one, position=-one.position, lateral=-one.lateral, tilt=-one.tilt)
        for one in data.sensors
    )
    sign = np.array(_nose_down(data), dtype=np.float64)
    return replace(data, sensors=sensors, signals=data.signals * sign, turned=not data.turned)


def _nose_down(data: Observations) -> tuple[int, ...]:
    """The sign of what each sensor reads on the vehicle turned round."""
    return tuple(-1 if one.quantity in {PITCH_RATE, ROLL_RATE} else 1 for one in data.sensors)


def _pairs(
    spectra: list[tuple[Array, ComplexArray, float]], vehicle: Vehicle, track: PointTrack,
    sensors: tuple[Sensor, ...],
) -> list[tuple[ComplexArray, ComplexArray]]:  # fmt: skip
    """Spectra of windows, and the transfer functions that they should have."""
    system = state_space(vehicle, track, sensors)
    return [(y, transfer_function(system, 2 * np.pi * f / speed, speed)) for f, y, speed in spectra]


def _wirings(data: Observations, *, turnable: bool) -> list[ChannelAssignment]:
    """As it is, the vehicle turned, one sign turned that gravity does not tell, or two channels exchanged."""
    count = len(data.sensors)
    straight, plus = tuple(range(count)), (1,) * count
    found = [ChannelAssignment(straight, plus)]
    if turnable:
        found.append(ChannelAssignment(straight, _nose_down(data), turned=True))
    told = data.by_gravity or (False,) * count
    for i in (i for i in range(count) if not told[i]):
        found.append(ChannelAssignment(straight, tuple(-1 if j == i else 1 for j in range(count))))
    for i, j in combinations(range(count), 2):
        order = list(straight)
        order[i], order[j] = j, i
        found.append(ChannelAssignment(tuple(order), plus))
    return found


def _spectra(data: Observations) -> Iterator[tuple[Array, ComplexArray, float]]:
    """Frequencies (m,) in Hz, spectra (m, sensors) and mean speed of windows in which all is valid."""
    time, speed = data.motion.time, data.motion.speed
    interval = float(np.median(np.diff(time)))
    size = max(round(WINDOW / interval), 2)
    f = np.asarray(np.fft.rfftfreq(size, interval), np.float64)
    inside = (f > LOW) & (f < HIGH)
    apart = max(size // 2, (len(time) - size) // MOST_WINDOWS, 1)
    taper = np.hanning(size)[:, None]
    for start in range(0, len(time) - size + 1, apart):
        rows = slice(start, start + size)
        t, going = time[rows], speed[rows]
        good = data.valid[rows].all() and len(t) == size
        if not good or np.any(np.diff(t) > 1.5 * interval) or going.min() < SLOWEST:
            continue
        signal = data.signals[rows] - data.signals[rows].mean(axis=0)
        yield f[inside], np.fft.rfft(taper * signal, axis=0)[inside], float(going.mean())


def _log_likelihood(
    pairs: list[tuple[ComplexArray, ComplexArray]], wiring: ChannelAssignment
) -> float:
    """Of spectra (m, sensors) under transfer functions (m, sensors), the level at each frequency the likeliest."""
    total = 0.0
    for measured, h in pairs:
        y = measured[:, list(wiring.order)] * np.array(wiring.sign, dtype=np.float64)
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


def _put_right(data: Observations, alike: list[ChannelAssignment]) -> Observations:
    """The recording by the likeliest wiring, or by one of two that say the same: an exchange, or the vehicle turned."""
    turned = [one for one in alike if one.turned]
    others = [one for one in alike if not one.turned]
    exchanged = bool(others) and others[0].order != tuple(range(len(data.sensors)))
    if turned and not exchanged:
        return _turned(data, others)
    return _rewired(data, others[0], ", or the vehicle runs the other way round" if turned else "")


def _turned(data: Observations, others: list[ChannelAssignment]) -> Observations:
    """The recording of the vehicle turned round; ``others`` would explain it as well, and are less likely."""
    last = len(data.motion.time) - 1
    doubt = ""
    if others:
        name = data.sensors[others[0].sign.index(-1)].name
        doubt = f" (or the sign of {name!r} is turned: then places are off by up to the vehicle's length)"
    said = f"the vehicle runs the other way round, its last wheel leads: the signals fit no profile otherwise{doubt}"
    found = turned_sensors(data)
    return replace(
        found,
        faults=(*data.faults, Fault(FaultKind.TURNED, "", 0, last)),
        notes=(*data.notes, f"{said}; state leading_end in the recording"),
    )


def _rewired(data: Observations, wiring: ChannelAssignment, doubt: str) -> Observations:
    order, sign = list(wiring.order), np.array(wiring.sign, dtype=np.float64)
    last = len(data.motion.time) - 1
    changed = [i for i, (j, s) in enumerate(zip(order, sign, strict=True)) if i != j or s < 0]
    names = [data.sensors[i].name for i in changed]
    if len(changed) == 1:
        kind, said = (
            FaultKind.SIGN,
            f"the sign of {names[0]!r} is turned round: it fits no profile otherwise",
        )
    else:
        kind = FaultKind.EXCHANGED
        said = f"{names[0]!r} and {names[1]!r} are exchanged{doubt}: they fit no profile otherwise; mend the recording"
    return replace(
        data,
        signals=data.signals[:, order] * sign,
        valid=data.valid[:, order],
        step=data.step[:, order],
        saturated=data.saturated[:, order],
        faulty=np.ones_like(data.faulty),
        faults=(*data.faults, *(Fault(kind, name, 0, last) for name in names)),
        notes=(*data.notes, said),
    )

"""Channels that were exchanged or turned round, told by what the same track makes of each.

All sensors feel one profile, so that their spectra at a frequency f are those of one random number times the transfer
functions h(Ω), Ω = 2πf/v: the covariance of all channels is α (h hᴴ + D). An exchange or a change of sign puts phases
or sizes where no profile could.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from trackprofile.conditioning.faults import Fault, FaultKind
from trackprofile.errors import DataError
from trackprofile.inference.measured import Measured
from trackprofile.statespace import state_space, transfer_function
from trackprofile.track import PointTrack
from trackprofile.vehicle import Vehicle

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
class Wiring:
    """Which measured channel each sensor has, and with which sign."""

    order: tuple[int, ...]
    sign: tuple[int, ...]


def rewired(data: Measured, vehicle: Vehicle, track: PointTrack) -> Measured:
    """The recording with channels put right that were exchanged or turned round, said in its faults and notes.

    Nothing is changed where it is not much more likely so; one channel alone cannot tell.

    Raises
    ------
    DataError
        Where the sign of a channel is wrong, but not which: of two that contradict each other either may be right.
    """
    count = len(data.sensors)
    spectra = list(_spectra(data)) if count > 1 else []
    if not spectra:
        return data
    system = state_space(vehicle, track, data.sensors)
    pairs = [
        (y, transfer_function(system, 2 * np.pi * f / speed, speed)) for f, y, speed in spectra
    ]
    as_it_is, *others = _wirings(count)
    frequencies = sum(len(y) for y, _ in pairs)
    here = _log_likelihood(pairs, as_it_is)
    gains = [_log_likelihood(pairs, one) - here for one in others]
    best = int(np.argmax(gains))
    if frequencies < FEWEST or gains[best] < CLEARLY * frequencies:
        return data
    alike = [one for one, gain in zip(others, gains, strict=True) if gain > gains[best] - 1.0]
    if len(alike) > 1:
        names = " and ".join(repr(one.name) for one in data.sensors)
        raise DataError(
            f"The signs of {names} contradict each other: one of them is turned round; find out which (at rest an "
            "accelerometer reads gravity upwards), and turn it in the recording."
        )
    return _put_right(data, others[best])


def _wirings(count: int) -> list[Wiring]:
    """As it is, one sign turned, or two channels exchanged."""
    straight, plus = tuple(range(count)), (1,) * count
    found = [Wiring(straight, plus)]
    for i in range(count):
        found.append(Wiring(straight, tuple(-1 if j == i else 1 for j in range(count))))
    for i, j in combinations(range(count), 2):
        order = list(straight)
        order[i], order[j] = j, i
        found.append(Wiring(tuple(order), plus))
    return found


def _spectra(data: Measured) -> Iterator[tuple[Array, ComplexArray, float]]:
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


def _log_likelihood(pairs: list[tuple[ComplexArray, ComplexArray]], wiring: Wiring) -> float:
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


def _put_right(data: Measured, wiring: Wiring) -> Measured:
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
        said = f"{names[0]!r} and {names[1]!r} are exchanged: they fit no profile otherwise; mend the recording"
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

"""Noise and prior level that nobody stated, found by maximising the likelihood, and said."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.evidence import innovations_of
from trackprofile.inference.likelihood import Progress, maximise
from trackprofile.inference.measured import USUAL, Measured, Model
from trackprofile.inference.passes import Pass
from trackprofile.motion import Motion
from trackprofile.sensor import UNITS, Installation, Sensor
from trackprofile.spectrum import Spectrum
from trackprofile.track import PointTrack
from trackprofile.vehicle import Vehicle

Array = NDArray[np.float64]

LONGEST_STRETCH = 1500.0
"""m of the recording that are enough to find a noise level."""


@dataclass(frozen=True)
class Unknown:
    """A positive number to find: its logarithm is normal about ``centre`` with ``spread``."""

    name: str
    unit: str
    centre: float
    spread: float


def find_noise(
    data: Measured,
    vehicle: Vehicle,
    track: PointTrack,
    installation: Installation,
    prior: Spectrum | None,
    progress: Progress,
) -> tuple[Model, tuple[str, ...]]:
    """The model with every noise density and the prior filled in, and sentences that say how.

    What is stated is kept. Unknown are the prior's amplitude where no prior is given, and the noise of sensors
    that do not state theirs.
    """
    model = Model(
        vehicle,
        track,
        _started(data),
        installation.origin,
        installation.unmodelled or 0.0,
        prior or USUAL,
        installation.distance_scale,
    )
    unknowns = _unknowns(model, data, prior)
    if not unknowns:
        return model, _assumed(model)
    piece = _informative(data)

    def of_piece(logarithms: Array) -> tuple[Array, Array]:
        return innovations_of([Pass(piece)], _with(model, data, prior, np.exp(logarithms)))

    centre = np.log([unknown.centre for unknown in unknowns])
    precision = np.array([unknown.spread**-2 for unknown in unknowns])
    found = maximise(
        of_piece, centre, centre, precision, lambda share: progress("finding the noise", share)
    )
    values = np.exp(found.parameters)
    said = [
        f"{unknown.name} found by maximum likelihood: {value:.3g} {unknown.unit}"
        for unknown, value in zip(unknowns, values, strict=True)
    ]
    complete = _with(model, data, prior, values)
    return complete, (*said, *_assumed(complete))


def _assumed(model: Model) -> tuple[str, ...]:
    if model.unmodelled > 0.0:
        return ()
    return ("the vehicle's model is taken to be exact: no unmodelled acceleration was calibrated",)


def _started(data: Measured) -> tuple[Sensor, ...]:
    """Sensors, with a first guess of the noise of those that do not state it."""
    interval = float(np.median(np.diff(data.motion.time)))
    sensors = []
    for i, sensor in enumerate(data.sensors):
        rms = float(np.std(data.signals[data.valid[:, i], i]))
        guess = max(0.02 * rms, float(data.step[i]) / np.sqrt(12.0), 1e-9) * np.sqrt(2 * interval)
        sensors.append(replace(sensor, noise_density=sensor.noise_density or guess))
    return tuple(sensors)


def _unknowns(model: Model, data: Measured, prior: Spectrum | None) -> list[Unknown]:
    unknowns = []
    if prior is None:
        unknowns.append(Unknown("prior amplitude", "m² rad/m", USUAL.amplitude, 3.0))
    for stated, started in zip(data.sensors, model.sensors, strict=True):
        if stated.noise_density is None and started.noise_density is not None:
            unit = UNITS[stated.quantity].replace("m/s2", "m/s²") + "/√Hz"
            unknowns.append(Unknown(f"noise of {stated.name!r}", unit, started.noise_density, 2.0))
    return unknowns


def _with(model: Model, data: Measured, prior: Spectrum | None, values: Array) -> Model:
    """The model with its unknowns replaced, in the order of :func:`_unknowns`."""
    remaining = iter(float(value) for value in values)
    spectrum = model.spectrum
    if prior is None:
        spectrum = replace(spectrum, amplitude=next(remaining))
    sensors = tuple(
        replace(started, noise_density=next(remaining)) if stated.noise_density is None else started
        for stated, started in zip(data.sensors, model.sensors, strict=True)
    )
    return replace(model, spectrum=spectrum, sensors=sensors)


def _informative(data: Measured) -> Measured:
    """The fastest stretch of up to ``LONGEST_STRETCH``: where the signals are strongest."""
    distance = data.motion.distance
    if distance[-1] - distance[0] <= LONGEST_STRETCH:
        return data
    ends = np.searchsorted(distance, distance + LONGEST_STRETCH)
    starts = np.flatnonzero(ends < len(distance))
    time = data.motion.time
    first = starts[np.argmin(time[ends[starts]] - time[starts])]
    rows = slice(int(first), int(ends[first]))
    part = Motion(
        data.motion.time[rows],
        distance[rows],
        data.motion.speed[rows],
        data.motion.acceleration[rows],
    )
    return replace(data, motion=part, signals=data.signals[rows], valid=data.valid[rows])

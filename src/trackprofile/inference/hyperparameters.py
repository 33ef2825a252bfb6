"""Noise, prior level and load that nobody stated, found by maximising the likelihood, and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.marginal_likelihood import RunData, pooled_innovations
from trackprofile.inference.maximum_likelihood import Progress, maximise
from trackprofile.inference.observations import DEFAULT_SPECTRUM, Observations, outlier_free
from trackprofile.inference.parameters import (
    ModelParameter,
    corner_parameter,
    load_parameter,
    prior_parameters,
    values_of,
    white_noise_parameters,
    with_values,
)
from trackprofile.inference.problem import Model, smoothing_problem
from trackprofile.kalman.robust import smooth_robustly
from trackprofile.models.sensor import Installation, Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import PointTrack
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

LONGEST_STRETCH = 1500.0
"""m of the recording that are enough to find a noise level."""


def find_hyperparameters(
    data: Observations,
    vehicle: Vehicle,
    track: PointTrack,
    installation: Installation,
    prior: Spectrum | None,
    progress: Progress,
    *,
    load: bool = False,
    knee: bool = False,
) -> tuple[Model, tuple[str, ...]]:
    """The model with every noise density and the prior filled in, and sentences that say how.

    What is stated is kept. Unknown are the prior's amplitude where no prior is given, the noise of sensors
    that do not state theirs, and the load and the prior's knee where they are asked for.
    """
    model = Model(
        vehicle,
        track,
        _started(data),
        installation.origin,
        installation.unmodelled or 0.0,
        prior or DEFAULT_SPECTRUM,
        installation.distance_scale,
    )
    unknowns = _unknowns(model, data, prior, load=load, knee=knee)
    if not unknowns:
        return model, _assumed(model)
    piece = _informative(data)
    # Samples that no level of the track explains would set it.
    complete = _likeliest(
        replace(piece, valid=outlier_free(piece)), model, model, unknowns, progress
    )
    good = _believed(piece, complete)
    if good is not None:
        complete = _likeliest(good, model, complete, unknowns, progress)
    said = [
        f"{one.name} found by maximum likelihood: {one.get(complete):.3g} {one.unit}"
        for one in unknowns
    ]
    return complete, (*said, *_assumed(complete))


def _likeliest(
    piece: Observations,
    model: Model,
    begin: Model,
    unknowns: list[ModelParameter],
    progress: Progress,
) -> Model:
    pooled = pooled_innovations([RunData(piece)])

    precision = np.array([one.spread**-2 for one in unknowns])
    found = maximise(
        lambda at: pooled(with_values(model, unknowns, at)),
        values_of(begin, unknowns),
        values_of(model, unknowns),
        precision,
        lambda share: progress("finding the noise", share),
    )
    return with_values(model, unknowns, found.parameters)


def _believed(piece: Observations, model: Model) -> Observations | None:
    """Without what the smoother weighs down; None where that is nothing."""
    problem = smoothing_problem(piece, model)
    weights = smooth_robustly(problem).weights
    doubtful = (weights.own > 0.0) | (weights.louder > 1.0)
    if not doubtful.any():
        return None
    valid = piece.valid.copy()
    valid[problem.run.samples[doubtful], problem.run.sensors[doubtful]] = False
    return replace(piece, valid=valid)


def _assumed(model: Model) -> tuple[str, ...]:
    if model.unmodelled > 0.0:
        return ()
    return ("the vehicle's model is taken to be exact: no unmodelled acceleration was calibrated",)


def _started(data: Observations) -> tuple[Sensor, ...]:
    """Sensors, with a first guess of the noise of those that do not state it."""
    interval = float(np.median(np.diff(data.motion.time)))
    sensors = []
    for i, sensor in enumerate(data.sensors):
        rms = float(np.std(data.signals[data.valid[:, i], i]))
        rounding = float(np.median(data.step[data.valid[:, i], i])) / np.sqrt(12.0)
        guess = max(0.02 * rms, rounding, 1e-9) * np.sqrt(2 * interval)
        sensors.append(replace(sensor, noise_density=sensor.noise_density or guess))
    return tuple(sensors)


def _unknowns(
    model: Model, data: Observations, prior: Spectrum | None, *, load: bool, knee: bool
) -> list[ModelParameter]:
    level = [replace(one, name="prior amplitude") for one in prior_parameters(model)]
    noise = [
        replace(one, name=f"noise of {sensor.name!r}")
        for one, sensor in zip(white_noise_parameters(model), data.sensors, strict=True)
        if sensor.noise_density is None
    ]
    level += [corner_parameter(model)] if knee else []
    return [*(level if prior is None else []), *noise, *([load_parameter(model)] if load else [])]


def _informative(data: Observations) -> Observations:
    """The fastest stretch of up to ``LONGEST_STRETCH``: where the signals are strongest."""
    distance = data.motion.distance
    if distance[-1] - distance[0] <= LONGEST_STRETCH:
        return data
    ends = np.searchsorted(distance, distance + LONGEST_STRETCH)
    starts = np.flatnonzero(ends < len(distance))
    time = data.motion.time
    first = starts[np.argmin(time[ends[starts]] - time[starts])]
    return data.part(slice(int(first), int(ends[first])))

"""Hyperparameters of an inference by maximum likelihood: noise densities, prior level and load that are not stated."""

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
from trackprofile.inference.settings import InferenceSettings
from trackprofile.kalman.robust import smooth_robustly
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Sensor
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

MAX_LENGTH = 1500.0
"""Length of the recording that is used to estimate hyperparameters, m."""


def find_hyperparameters(
    data: Observations, vehicle: Vehicle, settings: InferenceSettings, progress: Progress, *,
    estimate_corner: bool = False,
) -> tuple[Model, tuple[str, ...]]:  # fmt: skip
    """The model with all noise densities and the prior, and a sentence for each estimate.

    Stated values are kept. Estimated are the prior's amplitude where no prior is given, the noise densities of sensors
    that do not state theirs, and, where requested, the load and the corner frequency of the prior.
    """
    installation = settings.installation
    model = Model(
        vehicle,
        point_track(settings.track),
        _first_guess(data),
        installation.origin,
        installation.unmodelled or 0.0,
        settings.prior or DEFAULT_SPECTRUM,
        installation.distance_scale,
    )
    unknowns = _unknowns(model, data, settings, estimate_corner=estimate_corner)
    if not unknowns:
        return model, _assumptions(model)
    piece = _fastest_stretch(data)
    # Samples that no level of the track explains would dominate the estimate.
    complete = _maximum(replace(piece, valid=outlier_free(piece)), model, model, unknowns, progress)
    reliable = _without_outliers(piece, complete)
    if reliable is not None:
        complete = _maximum(reliable, model, complete, unknowns, progress)
    estimates = [
        f"{one.name} estimated by maximum likelihood: {one.get(complete):.3g} {one.unit}"
        for one in unknowns
    ]
    return complete, (*estimates, *_assumptions(complete))


def _maximum(
    piece: Observations, model: Model, start: Model, unknowns: list[ModelParameter], progress: Progress
) -> Model:  # fmt: skip
    """The model at the maximum of the posterior of the unknowns; their priors stand about ``model``."""
    pooled = pooled_innovations([RunData(piece)])
    precision = np.array([one.standard_deviation**-2 for one in unknowns])
    maximum = maximise(
        lambda at: pooled(with_values(model, unknowns, at)),
        values_of(start, unknowns),
        values_of(model, unknowns),
        precision,
        lambda share: progress("estimating noise and prior", share),
    )
    return with_values(model, unknowns, maximum.parameters)


def _without_outliers(piece: Observations, model: Model) -> Observations | None:
    """The observations without the samples that the robust smoother down-weights; None where there are none."""
    problem = smoothing_problem(piece, model)
    weights = smooth_robustly(problem).weights
    outliers = (weights.outlier_variance > 0.0) | (weights.variance_ratio > 1.0)
    if not outliers.any():
        return None
    valid = piece.valid.copy()
    valid[problem.run.samples[outliers], problem.run.sensors[outliers]] = False
    return replace(piece, valid=valid)


def _assumptions(model: Model) -> tuple[str, ...]:
    if model.unmodelled > 0.0:
        return ()
    return ("the vehicle model is assumed to be exact: no unmodelled acceleration was calibrated",)


def _first_guess(data: Observations) -> tuple[Sensor, ...]:
    """Sensors, with a first guess of the noise density of those that do not state it."""
    interval = float(np.median(np.diff(data.motion.time)))
    sensors = []
    for i, sensor in enumerate(data.sensors):
        rms = float(np.std(data.signals[data.valid[:, i], i]))
        rounding = float(np.median(data.step[data.valid[:, i], i])) / np.sqrt(12.0)
        guess = max(0.02 * rms, rounding, 1e-9) * np.sqrt(2 * interval)
        sensors.append(replace(sensor, noise_density=sensor.noise_density or guess))
    return tuple(sensors)


def _unknowns(
    model: Model, data: Observations, settings: InferenceSettings, *, estimate_corner: bool
) -> list[ModelParameter]:
    """The parameters that neither the recording nor the settings state."""
    level = [replace(one, name="prior amplitude") for one in prior_parameters(model)]
    noise = [
        replace(one, name=f"noise of {sensor.name!r}")
        for one, sensor in zip(white_noise_parameters(model), data.sensors, strict=True)
        if sensor.noise_density is None
    ]
    level += [corner_parameter(model)] if estimate_corner else []
    load = [load_parameter(model)] if settings.estimate_load else []
    return [*(level if settings.prior is None else []), *noise, *load]


def _fastest_stretch(data: Observations) -> Observations:
    """The fastest stretch of up to ``MAX_LENGTH``: there the signals are strongest."""
    distance = data.motion.distance
    if distance[-1] - distance[0] <= MAX_LENGTH:
        return data
    ends = np.searchsorted(distance, distance + MAX_LENGTH)
    starts = np.flatnonzero(ends < len(distance))
    time = data.motion.time
    first = starts[np.argmin(time[ends[starts]] - time[starts])]
    return data.part(slice(int(first), int(ends[first])))

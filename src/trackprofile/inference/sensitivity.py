"""What an uncertain vehicle adds to the uncertainty of the profile."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import Observations
from trackprofile.inference.parameters import (
    calibrated_parameters,
    select_parameters,
    values_of,
    with_values,
)
from trackprofile.inference.problem import Model, problem_builder
from trackprofile.kalman.smoother import SmoothingProblem, smooth
from trackprofile.models.sensor import Installation, Sensor, Uncertainty

Array = NDArray[np.float64]


def vehicle_sensitivity(
    data: Observations, model: Model, installation: Installation, place: Array, elevation: Array,
    progress: Progress,
) -> Array:  # fmt: skip
    """How the profile moves with the calibration's parameters, in independent directions of one standard deviation.

    With Σ = V Λ Vᵀ the covariance of the parameters θ, column k is r̂(θ + √λ_k v_k) - r̂(θ), so that the columns'
    products with standard normal numbers are draws of the error that the vehicle makes.

    Parameters
    ----------
    place, elevation : (knots,), m, where and what the profile is with the model's parameters

    Returns
    -------
    (knots, p) in m; p = 0 where nothing is known of the parameters' errors

    Raises
    ------
    ModelError
        Where the installation speaks of a parameter that the model does not have.
    """
    sure = installation.uncertainty
    if sure is None:
        return np.zeros((len(place), 0))
    names = [_here(name, installation.sensors, data.sensors) for name in sure.names]
    parameters = select_parameters(calibrated_parameters(model), [name for name in names if name])
    order = [names.index(one.name) for one in parameters]
    covariance = np.asarray(sure.covariance, np.float64)[np.ix_(order, order)]
    values, directions = np.linalg.eigh(covariance)
    centre = values_of(model, parameters)
    columns, build = [], problem_builder(data)
    for k, step in enumerate((directions * np.sqrt(np.maximum(values, 0.0))).T):
        progress("carrying over the vehicle's uncertainty", k / len(values))
        moved = _profile(build(with_values(model, parameters, centre + step)), place)
        columns.append(moved - elevation)
    return np.stack(columns, axis=1)


def with_gain_uncertainty(sure: Uncertainty | None, data: Observations) -> Uncertainty:
    """The uncertainty with that of gains that the recording itself makes uncertain."""
    doubts = {
        f"gain of {sensor.name}": doubt**2
        for sensor, doubt in zip(data.sensors, data.gain_doubt, strict=True)
        if doubt > 0.0
    }
    known = Uncertainty((), ()) if sure is None else sure
    count = len(known.names)
    covariance = np.zeros((count + len(doubts), count + len(doubts)))
    covariance[:count, :count] = np.reshape(known.covariance, (count, count))
    covariance[range(count, len(covariance)), range(count, len(covariance))] = list(doubts.values())
    rows = tuple(tuple(map(float, row)) for row in covariance)
    return Uncertainty((*known.names, *doubts), rows)


def _here(name: str, calibrated: Sequence[Sensor], recorded: Sequence[Sensor]) -> str | None:
    """A parameter's name with the recording's name for the sensor; None where that was not recorded."""
    for one in calibrated:
        if name.endswith(f" of {one.name}"):
            alike = [s.name for s in recorded if (s.quantity, s.body) == (one.quantity, one.body)]
            return name.removesuffix(one.name) + alike[0] if alike else None
    return name


def _profile(problem: SmoothingProblem, place: Array) -> Array:
    """Smoothed profile of that problem, (knots,) m at ``place``."""
    elevation = smooth(problem.gains(), problem.signals).elevation[:, 0]
    return np.interp(place, problem.run.knot_position, elevation)

"""Sensitivity of the profile to the uncertain parameters of the vehicle."""

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
    data: Observations, model: Model, installation: Installation, position: Array, elevation: Array, *,
    progress: Progress,
) -> Array:  # fmt: skip
    """Change of the profile with the calibrated parameters, along independent directions of one standard deviation.

    With Σ = V Λ Vᵀ the covariance of the parameters θ, column k is r̂(θ + √λ_k v_k) - r̂(θ): its products with standard
    normal numbers are samples of the error that the vehicle's parameters cause.

    Parameters
    ----------
    position, elevation : (knots,), m, the profile under the model's parameters

    Returns
    -------
    (knots, p) in m; p = 0 where no uncertainty of the parameters is stated

    Raises
    ------
    ModelError
        Where the installation names a parameter that the model does not have.
    """
    uncertainty = installation.uncertainty
    if uncertainty is None:
        return np.zeros((len(position), 0))
    names = [_recorded_name(name, installation.sensors, data.sensors) for name in uncertainty.names]
    parameters = select_parameters(calibrated_parameters(model), [name for name in names if name])
    order = [names.index(one.name) for one in parameters]
    covariance = np.asarray(uncertainty.covariance, np.float64)[np.ix_(order, order)]
    values, directions = np.linalg.eigh(covariance)
    centre = values_of(model, parameters)
    columns, build = [], problem_builder(data)
    for k, step in enumerate((directions * np.sqrt(np.maximum(values, 0.0))).T):
        progress("propagating the uncertainty of the vehicle", k / len(values))
        shifted = _profile(build(with_values(model, parameters, centre + step)), position)
        columns.append(shifted - elevation)
    return np.stack(columns, axis=1)


def with_gain_uncertainty(uncertainty: Uncertainty | None, data: Observations) -> Uncertainty:
    """The uncertainty extended by the gains of sensors whose mounting angle is uncertain."""
    variances = {
        f"gain of {sensor.name}": doubt**2
        for sensor, doubt in zip(data.sensors, data.gain_doubt, strict=True)
        if doubt > 0.0
    }
    known = uncertainty or Uncertainty((), ())
    count = len(known.names)
    covariance = np.zeros((count + len(variances), count + len(variances)))
    covariance[:count, :count] = np.reshape(known.covariance, (count, count))
    covariance[range(count, len(covariance)), range(count, len(covariance))] = list(
        variances.values()
    )
    rows = tuple(tuple(map(float, row)) for row in covariance)
    return Uncertainty((*known.names, *variances), rows)


def _recorded_name(
    name: str, calibrated: Sequence[Sensor], recorded: Sequence[Sensor]
) -> str | None:
    """A parameter's name with the sensor's name in the recording; None where that sensor was not recorded."""
    for one in calibrated:
        if name.endswith(f" of {one.name}"):
            alike = [s.name for s in recorded if (s.quantity, s.body) == (one.quantity, one.body)]
            return name.removesuffix(one.name) + alike[0] if alike else None
    return name


def _profile(problem: SmoothingProblem, position: Array) -> Array:
    """Smoothed profile of that problem, (knots,) m at ``position``."""
    elevation = smooth(problem.gains(), problem.signals).elevation[:, 0]
    return np.interp(position, problem.run.knot_position, elevation)

"""Likelihood profiles: the posterior along each fitted parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.calibration.fitting import Fit
from trackprofile.inference.marginal_likelihood import pooled_innovations
from trackprofile.inference.maximum_likelihood import log_likelihood
from trackprofile.inference.parameters import values_of, with_values
from trackprofile.inference.problem import Model

Array = NDArray[np.float64]

STEPS = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Distances from the maximum at which the likelihood is evaluated, standard errors."""


@dataclass(frozen=True)
class LikelihoodProfile:
    """Loss of log-posterior along one parameter, with the others at their conditional optimum.

    Parameters
    ----------
    name, unit : of the parameter
    values : (n,), in ``unit``
    loss : (n,), log-posterior minus its maximum
    expected : (n,), the same of a Gaussian with the stated standard error
    prior : (n,), log-prior minus its maximum
    """

    name: str
    unit: str
    values: Array
    loss: Array
    expected: Array
    prior: Array


def likelihood_profiles(fit: Fit, centre: Model) -> tuple[LikelihoodProfile, ...]:
    """The log-posterior through the maximum, along each fitted parameter.

    The others follow linearly: θ(δ) = θ̂ + δ C_i / C_ii, with C the inverse of the sum of information and prior
    precision. For a Gaussian posterior this is the profile likelihood; otherwise the curve lies below it.

    Parameters
    ----------
    fit : a maximum
    centre : the model about which the priors stand
    """
    at, mean = fit.maximum.parameters, values_of(centre, fit.every)
    C, pooled = fit.maximum.covariance(), pooled_innovations(fit.runs)

    def height(at: Array) -> float:
        likelihood = log_likelihood(*pooled(with_values(fit.model, fit.every, at)))
        return likelihood - 0.5 * float(np.sum(fit.maximum.precision * (at - mean) ** 2))

    top, profiles = height(at), []
    for i, one in enumerate(fit.free):
        error = np.sqrt(C[i, i])
        heights = np.array([height(at + step * C[:, i] / error) for step in STEPS])
        values = at[i] + STEPS * error
        profiles.append(
            LikelihoodProfile(
                one.name,
                one.unit,
                np.exp(values) if one.positive else values,
                heights - top,
                -0.5 * STEPS**2,
                -0.5 * ((values - mean[i]) / one.standard_deviation) ** 2,
            )
        )
    return tuple(profiles)

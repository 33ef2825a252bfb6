"""How sharply data single out each parameter: the posterior along its profile."""

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
"""Standard errors from the maximum, at which the likelihood is looked at."""


@dataclass(frozen=True)
class LikelihoodProfile:
    """What each value of one parameter loses against the best, the others being as fits it best.

    Parameters
    ----------
    name, unit : of the parameter
    values : (n,), in ``unit``
    loss : (n,), log-posterior less its maximum
    expected : (n,), what a Gaussian of the stated standard error would lose
    prior : (n,), log-prior less its own maximum
    """

    name: str
    unit: str
    values: Array
    loss: Array
    expected: Array
    prior: Array


def likelihood_profiles(fit: Fit, centre: Model) -> tuple[LikelihoodProfile, ...]:
    """The log-posterior through the maximum, along each parameter that was fitted.

    The others follow as the information says they would: θ(δ) = θ̂ + δ C_i / C_ii, with C the inverse of
    information and prior precision together. For a Gaussian posterior that is the profile likelihood; elsewhere the
    curve drawn lies below it, never above.

    Parameters
    ----------
    fit : a maximum
    centre : the model where the priors are
    """
    at, mean = fit.found.parameters, values_of(centre, fit.every)
    C, pooled = fit.found.covariance(), pooled_innovations(fit.passes)

    def height(at: Array) -> float:
        likelihood = log_likelihood(*pooled(with_values(fit.model, fit.every, at)))
        return likelihood - 0.5 * float(np.sum(fit.found.precision * (at - mean) ** 2))

    top, profiles = height(at), []
    for i, one in enumerate(fit.free):
        error = np.sqrt(C[i, i])
        heights = np.array([height(at + step * C[:, i] / error) for step in STEPS])
        moved = at[i] + STEPS * error
        profiles.append(
            LikelihoodProfile(
                one.name,
                one.unit,
                np.exp(moved) if one.positive else moved,
                heights - top,
                -0.5 * STEPS**2,
                -0.5 * ((moved - mean[i]) / one.standard_deviation) ** 2,
            )
        )
    return tuple(profiles)

"""Stages of a calibration: vehicle and positions first, then the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from trackprofile.calibration.datasets import shortened
from trackprofile.calibration.identifiability import (
    NEGLIGIBLE,
    WEAK,
    identifiable,
    marginal_information,
)
from trackprofile.inference.marginal_likelihood import RunData, pooled_innovations, row_counts
from trackprofile.inference.maximum_likelihood import (
    Maximum,
    Progress,
    log_likelihood,
    maximise,
    slopes,
)
from trackprofile.inference.parameters import (
    ModelParameter,
    noise_parameters,
    prior_parameters,
    residual_parameters,
    values_of,
    with_values,
)
from trackprofile.inference.problem import Model

Array = NDArray[np.float64]

SHORT_LENGTH = 300.0
"""Length on which the search approaches the maximum before it uses all recordings, m."""

STARTS = 2
"""Random starts in addition to the given one."""

SCATTER = 0.5
"""Scatter of the random starts, in standard deviations of the prior."""

COARSE_TOLERANCE = 0.1
"""Tolerance of the search on a short piece, units of log-likelihood."""

SAME_MAXIMUM = 5.0
"""Distance within which two maxima are the same, standard errors."""

NOISE_STD = 0.5
"""Standard deviation of the logarithm of a noise density from a data sheet or from the signal's spectrum."""

MIN_DIFFERENCE = 0.15
"""Relative difference of a parameter between runs from which they may be of different vehicles."""

MIN_SIGNIFICANCE = 6.0
"""Standard errors of that difference: an inexact model causes smaller ones."""

FIRST_STEP = 0.5
"""First step of the search in the logarithm of each noise density."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to runs.

    Parameters
    ----------
    runs : that it was fitted to
    model : at the maximum
    free : the estimated parameters, the first of the maximum's
    every : all parameters of the maximum: ``free``, the noise, and the level of an unknown profile
    maximum : of the posterior
    """

    runs: list[RunData]
    model: Model
    free: list[ModelParameter]
    every: list[ModelParameter]
    maximum: Maximum


@dataclass(frozen=True)
class FitRequest:
    """Which parameters a calibration estimates.

    Parameters
    ----------
    free : the parameters
    by_name : whether the user named them: then holding one is an error
    keep_undetermined : estimate also parameters on which the data have less information than the prior
    """

    free: list[ModelParameter]
    by_name: bool = False
    keep_undetermined: bool = False


def fit_mechanics(
    runs: Sequence[RunData],
    centre: Model,
    request: FitRequest,
    notes: list[str],
    progress: Progress,
) -> Fit:
    """Fit vehicle and positions together with white noise; hold undetermined parameters, and fit the rest again.

    Parameters
    ----------
    centre : the model about which the priors stand, and where the search starts
    request : the parameters
    notes : receives a sentence for each parameter that is held
    """
    free = request.free
    if not request.keep_undetermined:
        free = _remove_negligible(runs, centre, request, notes)
    start = _best_start(runs, centre, free, notes, progress)
    while True:
        fit = fit_parameters(runs, centre, start, free, progress)
        if request.keep_undetermined:
            return fit
        count, precision = len(free), fit.maximum.precision
        information = marginal_information(fit.maximum.slopes.information, precision, count)
        remaining, held = identifiable(information, free, WEAK, requested=request.by_name)
        if len(remaining) == count:
            return fit
        notes.extend(held)
        removed = [one for one in free if one not in remaining]
        start, free = with_values(fit.model, removed, values_of(centre, removed)), remaining


def fit_parameters(
    runs: Sequence[RunData], centre: Model, start: Model, free: list[ModelParameter], progress: Progress,
    tolerance: float = 1e-3,
) -> Fit:  # fmt: skip
    """Maximum of the posterior over ``free``, the noise, and the prior level where the profile is unknown."""
    every = [*free, *nuisance_parameters(runs, centre)]
    precision = np.array([one.standard_deviation**-2 for one in every])

    pooled = pooled_innovations(runs)
    maximum = maximise(
        lambda at: pooled(with_values(start, every, at)), values_of(start, every), values_of(centre, every), precision,
        lambda share: progress("fitting the vehicle", share), tolerance,
    )  # fmt: skip
    return Fit(list(runs), with_values(start, every, maximum.parameters), free, every, maximum)


def nuisance_parameters(runs: Sequence[RunData], centre: Model) -> list[ModelParameter]:
    """Noise densities, and the prior's level where a profile is unknown."""
    noise = noise_parameters(replace(centre, unmodelled=0.0)) + residual_parameters(centre)
    if all(one.known for one in runs):
        return noise
    return [replace(one, standard_deviation=NOISE_STD) for one in noise] + prior_parameters(centre)


def _remove_negligible(
    runs: Sequence[RunData], start: Model, request: FitRequest, notes: list[str]
) -> list[ModelParameter]:
    """The requested parameters without those that the data do not determine at any value."""
    free = request.free
    some = runs if any(one.known for one in runs) else shortened(runs, SHORT_LENGTH)
    every = [*free, *nuisance_parameters(runs, start)]
    at = values_of(start, every)
    pooled = pooled_innovations(some)
    information = slopes(lambda at: pooled(with_values(start, every, at)), at).information
    precision = np.array([one.standard_deviation**-2 for one in every])
    information = marginal_information(information, precision, len(free))
    remaining, held = identifiable(information, free, NEGLIGIBLE, requested=request.by_name)
    notes.extend(held)
    return remaining


def _best_start(
    runs: Sequence[RunData], centre: Model, free: list[ModelParameter], notes: list[str], progress: Progress
) -> Model:  # fmt: skip
    """The best of the maxima that several starts reach on a short piece.

    Over a known profile the fit is a least-squares problem with one minimum near any usable start: no search is needed.
    """
    if any(one.known for one in runs):
        return centre
    some = shortened(runs, SHORT_LENGTH)
    generator = np.random.default_rng(0)
    scatter = SCATTER * np.array([one.standard_deviation for one in free])
    starts = [values_of(centre, free)]
    starts += [starts[0] + scatter * generator.standard_normal(len(free)) for _ in range(STARTS)]
    fits = [
        fit_parameters(
            some, centre, with_values(centre, free, at), free, progress, COARSE_TOLERANCE
        )
        for at in starts
    ]
    posteriors = [log_posterior(fit, centre) for fit in fits]
    best = int(np.argmax(posteriors))
    notes.extend(_other_maxima(fits, posteriors, best))
    return fits[best].model


def log_posterior(fit: Fit, centre: Model) -> float:
    """Log-posterior of a fit up to a constant."""
    deviation = fit.maximum.parameters - values_of(centre, fit.every)
    prior = -0.5 * float(np.sum(fit.maximum.precision * deviation**2))
    return fit.maximum.slopes.log_likelihood + prior


def _other_maxima(fits: Sequence[Fit], posteriors: Sequence[float], best: int) -> list[str]:
    """A sentence where another start reached a different maximum of almost equal posterior."""
    count = len(fits[best].free)
    errors = np.sqrt(np.diag(fits[best].maximum.covariance()))[:count]
    for fit, reached in zip(fits, posteriors, strict=True):
        distance = np.abs(fit.maximum.parameters - fits[best].maximum.parameters)[:count] / errors
        if posteriors[best] - reached < 3.0 and np.max(distance) > SAME_MAXIMUM:
            one = fit.free[int(np.argmax(distance))]
            values = one.get(fits[best].model), one.get(fit.model)
            return [
                f"the likelihood has several maxima: {one.name} = {values[0]:.4g} {one.unit} was chosen, and "
                f"{values[1]:.4g} is almost as likely; hold a parameter, or add recordings at other speeds"
            ]
    return []


def disagreement(fit: Fit) -> list[str]:
    """A sentence for the run whose own estimate of a parameter differs most: another vehicle, or another load.

    One scoring step from the common maximum with the run's data alone: δ = (I_k + Λ)⁻¹ g_k.
    """
    runs = fit.runs
    if len(runs) < 2:
        return []
    sizes = row_counts(runs)
    cuts = np.cumsum(sizes)[:-1]
    prior = np.diag(fit.maximum.precision)
    worst, notes = 0.0, []
    for k, scores in enumerate(np.split(fit.maximum.slopes.scores, cuts, axis=1)):
        information = fit.maximum.slopes.information * sizes[k] / sum(sizes)
        covariance = np.linalg.inv(information + prior)
        step = covariance @ np.sum(scores, axis=1)
        robust = np.sqrt(np.diag(covariance @ (scores @ scores.T + prior) @ covariance))
        significance = np.abs(step) / robust
        for i, one in enumerate(fit.free):
            differs = one.positive and abs(step[i]) > MIN_DIFFERENCE
            if differs and significance[i] > max(worst, MIN_SIGNIFICANCE):
                worst = float(significance[i])
                value = one.get(fit.model)
                notes = [
                    f"recording {runs[k].number} alone gives {one.name} = {value * np.exp(step[i]):.3g} "
                    f"{one.unit}, all recordings {value:.3g}: calibrate it separately if its vehicle or load differs"
                ]
    return notes


def fit_noise(runs: Sequence[RunData], model: Model, progress: Progress) -> Model:
    """The noise under which the known profiles are most probable given the signals.

    log p(r|y) = log p(y|r) - log p(y) + log p(r), of which the last term does not depend on the noise. Unlike p(y|r)
    alone, the difference is not affected by parts of the signals that are independent of the track.
    """
    known = [one for one in runs if one.known]
    unknown = [RunData(one.data) for one in known]
    spectrum = next(one.known.spectrum for one in known if one.known)
    noise = noise_parameters(model)
    centre = values_of(model, noise)
    precision = np.array([one.standard_deviation**-2 for one in noise])

    with_reference, without = pooled_innovations(known), pooled_innovations(unknown)

    def negative_log_posterior(at: Array) -> float:
        trial = replace(with_values(model, noise, at), spectrum=spectrum)
        conditional = log_likelihood(*with_reference(trial))
        marginal = log_likelihood(*without(trial))
        return marginal - conditional + 0.5 * float(np.sum(precision * (at - centre) ** 2))

    progress("fitting the noise", 0.0)
    simplex = np.vstack([centre, centre + FIRST_STEP * np.eye(len(centre))])
    minimum = minimize(
        negative_log_posterior, centre, method="Nelder-Mead",
        options={"xatol": 0.05, "fatol": 0.3, "initial_simplex": simplex},
    )  # fmt: skip
    progress("fitting the noise", 1.0)
    return with_values(model, noise, minimum.x)


def most_likely(runs: Sequence[RunData], models: Sequence[Model]) -> Model:
    """The most likely of several models."""
    pooled = pooled_innovations(runs)
    likelihoods = [log_likelihood(*pooled(model)) for model in models]
    return models[int(np.argmax(likelihoods))]

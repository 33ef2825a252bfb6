"""The stages of a calibration: vehicle and places first, then the noise that is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from trackprofile.calibration.datasets import shortened
from trackprofile.calibration.identifiability import LITTLE, NOTHING, identified, marginal
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

SHORT = 300.0
"""m on which the search comes near the maximum before it takes all that was recorded."""

STARTS = 2
"""Random starts beside the given one."""

SCATTER = 0.5
"""Of the prior's standard deviation, by which they are scattered."""

COARSE = 0.1
"""Units of log-likelihood: what a step on a short piece must promise, to be made."""

SAME_PEAK = 5.0
"""Standard errors within which two maxima are one."""

SHOWN = 0.5
"""Standard deviation of the logarithm of a noise that a data sheet states, or the signal's spectrum shows."""

DIFFERENT = 0.15
"""Of a parameter, by which passes of one vehicle do not differ."""

DISTINCT = 6.0
"""Standard errors by which two passes are told apart, beyond what a model that is not exact makes of them."""

FIRST_MOVE = 0.5
"""Of each logarithm of a noise, with which its search begins."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to passes.

    Parameters
    ----------
    passes : that it was fitted to
    model : at the maximum
    free : the parameters that were sought, the first of the maximum's
    every : those of the maximum: beside them the noise, and the level of an unknown profile
    found : the maximum
    """

    passes: list[RunData]
    model: Model
    free: list[ModelParameter]
    every: list[ModelParameter]
    found: Maximum


def fit_mechanics(
    passes: Sequence[RunData], centre: Model, free: list[ModelParameter], *, asked: bool, anyway: bool,
    notes: list[str], progress: Progress,
) -> Fit:  # fmt: skip
    """Fit vehicle and places together with white noise; hold what the data do not tell, and fit the rest again.

    Parameters
    ----------
    centre : the model where the priors are, and the search begins
    asked : whether the parameters were named one by one, so that holding one is refused
    anyway : whether to keep what the data tell less than the prior
    notes : gain a sentence for each that is held
    """
    if not anyway:
        free = _told_at_all(passes, centre, free, asked, notes)
    start = _best_start(passes, centre, free, notes, progress)
    while True:
        fit = fit_parameters(passes, centre, start, free, progress)
        if anyway:
            return fit
        count, precision = len(free), fit.found.precision
        information = marginal(fit.found.slopes.information, precision, count)
        left, said = identified(information, free, LITTLE, asked=asked)
        if len(left) == count:
            return fit
        notes.extend(said)
        lost = [one for one in free if one not in left]
        start, free = with_values(fit.model, lost, values_of(centre, lost)), left


def fit_parameters(
    passes: Sequence[RunData], centre: Model, start: Model, free: list[ModelParameter], progress: Progress,
    enough: float = 1e-3,
) -> Fit:  # fmt: skip
    """The maximum over ``free``, the noise, and the level where the profile is unknown."""
    every = [*free, *nuisances(passes, centre)]
    precision = np.array([one.standard_deviation**-2 for one in every])

    pooled = pooled_innovations(passes)
    found = maximise(
        lambda at: pooled(with_values(start, every, at)), values_of(start, every), values_of(centre, every), precision,
        lambda share: progress("fitting the vehicle", share), enough,
    )  # fmt: skip
    return Fit(list(passes), with_values(start, every, found.parameters), free, every, found)


def nuisances(passes: Sequence[RunData], centre: Model) -> list[ModelParameter]:
    """The noise, and the prior's level where a profile is unknown."""
    noise = noise_parameters(replace(centre, unmodelled=0.0)) + residual_parameters(centre)
    if all(one.known for one in passes):
        return noise
    return [replace(one, standard_deviation=SHOWN) for one in noise] + prior_parameters(centre)


def _told_at_all(
    passes: Sequence[RunData],
    start: Model,
    free: list[ModelParameter],
    asked: bool,
    notes: list[str],
) -> list[ModelParameter]:
    """Without what no fit could tell, whatever the values."""
    some = passes if any(one.known for one in passes) else shortened(passes, SHORT)
    every = [*free, *nuisances(passes, start)]
    at = values_of(start, every)
    pooled = pooled_innovations(some)
    information = slopes(lambda at: pooled(with_values(start, every, at)), at).information
    precision = np.array([one.standard_deviation**-2 for one in every])
    left, said = identified(marginal(information, precision, len(free)), free, NOTHING, asked=asked)
    notes.extend(said)
    return left


def _best_start(
    passes: Sequence[RunData], centre: Model, free: list[ModelParameter], notes: list[str], progress: Progress
) -> Model:  # fmt: skip
    """Near the highest of the maxima that several starts lead to on a short piece.

    Over a known profile the signals are reproduced by least squares, which has one minimum near any usable start.
    """
    if any(one.known for one in passes):
        return centre
    some = shortened(passes, SHORT)
    generator = np.random.default_rng(0)
    scatter = SCATTER * np.array([one.standard_deviation for one in free])
    starts = [values_of(centre, free)]
    starts += [starts[0] + scatter * generator.standard_normal(len(free)) for _ in range(STARTS)]
    fits = [
        fit_parameters(some, centre, with_values(centre, free, at), free, progress, COARSE)
        for at in starts
    ]
    heights = [height(fit, centre) for fit in fits]
    best = int(np.argmax(heights))
    notes.extend(_other_peaks(fits, heights, best))
    return fits[best].model


def height(fit: Fit, centre: Model) -> float:
    """Log-posterior of a fit, but for a constant."""
    off = fit.found.parameters - values_of(centre, fit.every)
    prior = -0.5 * float(np.sum(fit.found.precision * off**2))
    return fit.found.slopes.log_likelihood + prior


def _other_peaks(fits: Sequence[Fit], heights: Sequence[float], best: int) -> list[str]:
    """A sentence where another start ended as high, elsewhere."""
    count = len(fits[best].free)
    errors = np.sqrt(np.diag(fits[best].found.covariance()))[:count]
    for fit, reached in zip(fits, heights, strict=True):
        apart = np.abs(fit.found.parameters - fits[best].found.parameters)[:count] / errors
        if heights[best] - reached < 3.0 and np.max(apart) > SAME_PEAK:
            one = fit.free[int(np.argmax(apart))]
            values = one.get(fits[best].model), one.get(fit.model)
            return [
                f"the likelihood has several peaks, of which {one.name} = {values[0]:.4g} {one.unit} was taken and "
                f"{values[1]:.4g} is almost as likely: hold a parameter, or add recordings at other speeds"
            ]
    return []


def disagreement(fit: Fit) -> list[str]:
    """A sentence for the pass that would have a parameter elsewhere: another vehicle, or another load.

    One scoring step from the common maximum, by the pass alone: δ = (I_k + Λ)⁻¹ g_k.
    """
    passes = fit.passes
    if len(passes) < 2:
        return []
    sizes = row_counts(passes)
    cuts = np.cumsum(sizes)[:-1]
    prior = np.diag(fit.found.precision)
    worst, said = 0.0, []
    for k, scores in enumerate(np.split(fit.found.slopes.scores, cuts, axis=1)):
        information = fit.found.slopes.information * sizes[k] / sum(sizes)
        spread = np.linalg.inv(information + prior)
        step = spread @ np.sum(scores, axis=1)
        robust = np.sqrt(np.diag(spread @ (scores @ scores.T + prior) @ spread))
        sure = np.abs(step) / robust
        for i, one in enumerate(fit.free):
            far = abs(step[i]) > DIFFERENT if one.positive else False
            if far and sure[i] > max(worst, DISTINCT):
                worst = float(sure[i])
                value = one.get(fit.model)
                said = [
                    f"recording {passes[k].number} would have {one.name} near {value * np.exp(step[i]):.3g} "
                    f"{one.unit} and all together {value:.3g}: another vehicle or load? Calibrate it apart"
                ]
    return said


def fit_noise(passes: Sequence[RunData], model: Model, progress: Progress) -> Model:
    """The noise under which the known profiles are most probable, given the signals.

    log p(r|y) = log p(y|r) - log p(y) + log p(r), of which the last does not depend on the noise. Unlike
    p(y|r) alone, the difference is not swayed by what in the signals tells nothing of the track.
    """
    given = [one for one in passes if one.known]
    free = [RunData(one.data) for one in given]
    spectrum = next(one.known.spectrum for one in given if one.known)
    noise = noise_parameters(model)
    centre = values_of(model, noise)
    precision = np.array([one.standard_deviation**-2 for one in noise])

    with_reference, without = pooled_innovations(given), pooled_innovations(free)

    def improbability(at: Array) -> float:
        trial = replace(with_values(model, noise, at), spectrum=spectrum)
        sure = log_likelihood(*with_reference(trial))
        unsure = log_likelihood(*without(trial))
        return unsure - sure + 0.5 * float(np.sum(precision * (at - centre) ** 2))

    progress("fitting the noise", 0.0)
    simplex = np.vstack([centre, centre + FIRST_MOVE * np.eye(len(centre))])
    found = minimize(
        improbability, centre, method="Nelder-Mead",
        options={"xatol": 0.05, "fatol": 0.3, "initial_simplex": simplex},
    )  # fmt: skip
    progress("fitting the noise", 1.0)
    return with_values(model, noise, found.x)


def best_fit(passes: Sequence[RunData], trials: Sequence[Model]) -> Model:
    """The most likely of some models."""
    pooled = pooled_innovations(passes)
    heights: list[float] = [log_likelihood(*pooled(trial)) for trial in trials]
    return trials[int(np.argmax(heights))]

"""Marginal likelihood of recorded signals under a model, over an unknown or a known profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.observations import DEFAULT_SPECTRUM, Observations
from trackprofile.inference.problem import Model, problem_builder
from trackprofile.inference.reference import KnownProfile
from trackprofile.kalman.smoother import innovations
from trackprofile.models.spectrum import scale_density

Array = NDArray[np.float64]

REFERENCE_ERROR = scale_density(DEFAULT_SPECTRUM, 1e-9)
"""Prior of the error of a known profile."""


@dataclass(frozen=True)
class RunData:
    """Observations of one run.

    Parameters
    ----------
    data : observations
    known : the profile under the run; None where it is unknown
    number : of the recording, from 1
    """

    data: Observations
    known: KnownProfile | None = None
    number: int = 1

    @property
    def length(self) -> float:
        """Distance covered, m."""
        return float(np.ptp(self.data.motion.distance))


def pooled_innovations(runs: Sequence[RunData]) -> Callable[[Model], tuple[Array, Array]]:
    """A function that gives the innovations and their variances, each (rows,), of all runs under a model.

    The prior of an unknown profile is the model's spectrum. Over a known profile its response is subtracted from the
    signals first, and the prior of the remaining error is ``REFERENCE_ERROR``.
    """
    each = [_innovations(one) if one.known is None else _innovations_known(one) for one in runs]

    def pooled(model: Model) -> tuple[Array, Array]:
        parts = [innovations_of_run(model) for innovations_of_run in each]
        return np.concatenate([e[:, 0] for e, _ in parts]), np.concatenate([S for _, S in parts])

    return pooled


def row_counts(runs: Sequence[RunData]) -> list[int]:
    """Number of innovations of each run."""
    return [int(np.count_nonzero(one.data.valid)) for one in runs]


def _innovations(run: RunData) -> Callable[[Model], tuple[Array, Array]]:
    build = problem_builder(run.data)

    def under(model: Model) -> tuple[Array, Array]:
        problem = build(model)
        gains = problem.gains()
        return innovations(gains, problem.signals), gains.innovation_variance

    return under


def _innovations_known(run: RunData) -> Callable[[Model], tuple[Array, Array]]:
    build, known = problem_builder(run.data), run.known
    assert known is not None
    error_share = REFERENCE_ERROR.amplitude / DEFAULT_SPECTRUM.amplitude

    def under(model: Model) -> tuple[Array, Array]:
        problem = build(replace(model, spectrum=DEFAULT_SPECTRUM))
        signals = problem.signals - known.response(problem.run, problem.start)
        start = replace(problem.start, coefficients=error_share * problem.start.coefficients)
        gains = replace(problem, spectrum=REFERENCE_ERROR, start=start).gains()
        return innovations(gains, signals), gains.innovation_variance

    return under

"""How probable the signals are under a model: over a profile that is unknown, and over one that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.observations import (
    DEFAULT_SPECTRUM,
    Model,
    Observations,
    prepared_filter,
    ride_of,
    row_signals,
    start_of,
)
from trackprofile.inference.reference import KnownProfile
from trackprofile.kalman.smoother import innovations
from trackprofile.models.spectrum import scaled

Array = NDArray[np.float64]

EXACT = scaled(DEFAULT_SPECTRUM, 1e-9)
"""Of the error of a profile that is known."""


@dataclass(frozen=True)
class RunData:
    """What was measured, the profile under it (None where that is unknown), and which recording it is of."""

    data: Observations
    known: KnownProfile | None = None
    number: int = 1

    @property
    def length(self) -> float:
        """m that were run."""
        return float(np.ptp(self.data.motion.distance))


def pooled_innovations(passes: Sequence[RunData], model: Model) -> tuple[Array, Array]:
    """Innovations and their variances, each (rows,), of all passes.

    A profile that is unknown is one of the model's spectrum; of one that is known, the signals that it makes are
    taken off first, and what is left of it is one of ``EXACT``.
    """
    parts = [
        _of_one(one.data, model) if one.known is None else _given(one, model) for one in passes
    ]
    return np.concatenate([e[:, 0] for e, _ in parts]), np.concatenate([S for _, S in parts])


def row_counts(passes: Sequence[RunData]) -> list[int]:
    """How many innovations each pass has."""
    return [int(np.count_nonzero(one.data.valid)) for one in passes]


def _of_one(data: Observations, model: Model) -> tuple[Array, Array]:
    system, ride = ride_of(data, model)
    prepared = prepared_filter(data, model, ride, start_of(data, model, system, ride))
    return innovations(prepared, row_signals(data, model, ride)), prepared.innovation_variance


def _given(one: RunData, model: Model) -> tuple[Array, Array]:
    assert one.known is not None
    system, ride = ride_of(one.data, model)
    start = start_of(one.data, replace(model, spectrum=DEFAULT_SPECTRUM), system, ride)
    signals = row_signals(one.data, model, ride) - one.known.response(ride, start)
    around = replace(
        start, coefficients=EXACT.amplitude / DEFAULT_SPECTRUM.amplitude * start.coefficients
    )
    prepared = prepared_filter(one.data, replace(model, spectrum=EXACT), ride, around)
    return innovations(prepared, signals), prepared.innovation_variance

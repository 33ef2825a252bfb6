"""How probable the signals are under a model: with the profile unknown, and with the profile given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.inference.known import KnownProfile
from trackprofile.inference.measured import (
    USUAL,
    Measured,
    Model,
    prepared_filter,
    ride_of,
    row_signals,
    start_of,
)
from trackprofile.inference.smoother import innovations

Array = NDArray[np.float64]


def innovations_of(data: Sequence[Measured], model: Model) -> tuple[Array, Array]:
    """Innovations and their variances, each (rows,), of all recordings, over a profile like the model's spectrum."""
    parts = []
    for one in data:
        system, ride = ride_of(one, model)
        prepared = prepared_filter(one, model, ride, start_of(one, model, system, ride))
        parts.append((innovations(prepared, row_signals(one, ride)), prepared.innovation_variance))
    return _joined(parts)


def innovations_given(
    data: Sequence[Measured], known: KnownProfile, model: Model
) -> tuple[Array, Array]:
    """The same over the known profile, on top of which the model's spectrum is the reference's error."""
    parts = []
    for one in data:
        system, ride = ride_of(one, model)
        start = start_of(one, replace(model, spectrum=USUAL), system, ride)
        signals = row_signals(one, ride) - known.response(ride, start)
        share = model.spectrum.amplitude / USUAL.amplitude
        around = replace(start, coefficients=share * start.coefficients)
        prepared = prepared_filter(one, model, ride, around)
        parts.append((innovations(prepared, signals), prepared.innovation_variance))
    return _joined(parts)


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.concatenate([e[:, 0] for e, _ in parts]), np.concatenate([S for _, S in parts])

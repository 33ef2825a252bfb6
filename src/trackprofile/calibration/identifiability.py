"""Identifiability of parameters: the Fisher information, its null directions, and sentences on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import UndeterminedError
from trackprofile.inference.parameters import ModelParameter

Array = NDArray[np.float64]

WEAK, NEGLIGIBLE = 1.0, 0.01
"""Information on a direction relative to the prior's: less than the prior's own; practically none."""

MIN_SHARE = 0.3
"""Share of an undetermined direction from which a parameter counts as part of it."""


def marginal_information(information: Array, precision: Array, count: int) -> Array:
    """Information on the first ``count`` parameters, with the others unknown except for their priors.

    The Schur complement I_aa - I_ab (I_bb + Λ_b)⁻¹ I_ba.

    Parameters
    ----------
    information : (p, p)
    precision : (p,), Λ, of the priors

    Examples
    --------
    >>> marginal_information(np.array([[2.0, 1.0], [1.0, 1.0]]), np.zeros(2), 1)
    array([[1.]])
    """
    a, b = slice(count), slice(count, None)
    if information.shape[0] == count:
        return information
    others = information[b, b] + np.diag(precision[b])
    return information[a, a] - information[a, b] @ np.linalg.solve(others, information[b, a])


def weakest_direction(
    information: Array, free: Sequence[ModelParameter], threshold: float
) -> list[int] | None:
    """Parameters of the direction with the least information, the most involved first; None if it is determined.

    A direction is determined if its eigenvalue of the information, in units of the prior's, exceeds ``threshold``.
    """
    deviation = np.array([one.standard_deviation for one in free])
    values, directions = np.linalg.eigh(information * np.outer(deviation, deviation))
    if not free or values[0] > threshold:
        return None
    share = np.abs(directions[:, 0])
    # The first of those that share a direction equally: masses precede, and only their ratios are determined.
    worst = int(np.flatnonzero(share > 0.8 * np.max(share))[0])
    others = [int(i) for i in np.argsort(-share) if share[i] > MIN_SHARE and i != worst]
    return [worst, *others]


def identifiable(
    information: Array, free: Sequence[ModelParameter], threshold: float, *, requested: bool
) -> tuple[list[ModelParameter], list[str]]:
    """The parameters that the data determine, and a sentence for each of the others, removed one by one.

    Raises
    ------
    UndeterminedError
        Where the parameters were ``requested`` by name and one is not determined, or where none is.
    """
    remaining, notes = list(free), []
    while remaining and (weak := weakest_direction(information, remaining, threshold)) is not None:
        if requested:
            raise _undetermined(remaining, weak)
        notes.append(_held(remaining, weak))
        kept = [i for i in range(len(remaining)) if i != weak[0]]
        remaining, information = [remaining[i] for i in kept], information[np.ix_(kept, kept)]
    if free and not remaining:
        names = ", ".join(one.name for one in free)
        raise UndeterminedError(
            f"The recording determines none of {names}: it is too short, too slow, or its sensors do not respond to "
            "them; record a kilometre or more at line speed, best at several speeds."
        )
    return remaining, notes


def _undetermined(free: Sequence[ModelParameter], weak: Sequence[int]) -> UndeterminedError:
    """The error for a requested parameter that the data do not determine."""
    names = ", ".join(repr(free[i].name) for i in weak)
    if len(weak) == 1:
        return UndeterminedError(
            f"The data do not determine {names}: leave it out, or add recordings that excite it."
        )
    return UndeterminedError(
        f"The data determine {names} only in combination: leave one of them out, or add recordings at other speeds."
    )


def _held(free: Sequence[ModelParameter], weak: Sequence[int]) -> str:
    """A sentence on a parameter that is held at its start."""
    name, others = free[weak[0]].name, ", ".join(free[i].name for i in weak[1:])
    if others:
        return f"{name} is held at its start: the data do not separate it from {others}"
    return f"{name} is held at its start: the data do not determine it"

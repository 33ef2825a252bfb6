"""What data tell of parameters: the Fisher information, its null directions, and how to say them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import UndeterminedError
from trackprofile.inference.parameters import ModelParameter

Array = NDArray[np.float64]

LITTLE, NOTHING = 1.0, 0.01
"""Information of a direction, in units of the prior's: less than the prior's own; next to none."""

INVOLVED = 0.3
"""Share of an undetermined direction from which a parameter counts as part of it."""


def marginal(information: Array, precision: Array, count: int) -> Array:
    """Information on the first ``count`` parameters, the others being unknown but for their priors.

    The Schur complement I_aa - I_ab (I_bb + Λ_b)⁻¹ I_ba.

    Parameters
    ----------
    information : (p, p)
    precision : (p,), Λ, of the priors

    Examples
    --------
    >>> marginal(np.array([[2.0, 1.0], [1.0, 1.0]]), np.zeros(2), 1)
    array([[1.]])
    """
    a, b = slice(count), slice(count, None)
    if information.shape[0] == count:
        return information
    others = information[b, b] + np.diag(precision[b])
    return information[a, a] - information[a, b] @ np.linalg.solve(others, information[b, a])


def untold(information: Array, free: Sequence[ModelParameter], least: float) -> list[int] | None:
    """Parameters of the direction that the data tell least, the most involved first; None if it is told.

    A direction is told if its eigenvalue of the information, in units of the prior's, exceeds ``least``.
    """
    spread = np.array([one.standard_deviation for one in free])
    values, directions = np.linalg.eigh(information * np.outer(spread, spread))
    if not free or values[0] > least:
        return None
    share = np.abs(directions[:, 0])
    # The first of those that share a direction alike: masses stand first, and only their ratios are told.
    worst = int(np.flatnonzero(share > 0.8 * np.max(share))[0])
    others = [int(i) for i in np.argsort(-share) if share[i] > INVOLVED and i != worst]
    return [worst, *others]


def identified(
    information: Array, free: Sequence[ModelParameter], least: float, *, asked: bool
) -> tuple[list[ModelParameter], list[str]]:
    """Leave out, one by one, what the data do not tell, and say so.

    Raises
    ------
    UndeterminedError
        Where it was ``asked`` for, or nothing is left.
    """
    left, notes = list(free), []
    while left and (lost := untold(information, left, least)) is not None:
        if asked:
            raise undetermined(left, lost)
        notes.append(held(left, lost))
        keep = [i for i in range(len(left)) if i != lost[0]]
        left, information = [left[i] for i in keep], information[np.ix_(keep, keep)]
    if free and not left:
        names = ", ".join(one.name for one in free)
        raise UndeterminedError(
            f"The recording tells none of {names}: it is too short, too slow, or its sensors do not feel them; "
            "record a kilometre or more at line speed, best at several speeds."
        )
    return left, notes


def undetermined(free: Sequence[ModelParameter], lost: Sequence[int]) -> UndeterminedError:
    """That a parameter was asked for that the data do not tell."""
    names = ", ".join(repr(free[i].name) for i in lost)
    if len(lost) == 1:
        return UndeterminedError(
            f"The data do not tell {names}: leave it out, or add recordings that excite it."
        )
    return UndeterminedError(
        f"The data tell {names} only together, not each: leave one of them out, or add recordings at other speeds."
    )


def held(free: Sequence[ModelParameter], lost: Sequence[int]) -> str:
    """That a parameter is held, in a sentence."""
    name, others = free[lost[0]].name, ", ".join(free[i].name for i in lost[1:])
    return f"{name} is held at its start: the data do not tell it" + (
        f" apart from {others}" if others else ""
    )

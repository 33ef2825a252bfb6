"""How a vehicle swings by itself: natural frequencies and damping on a rigid, level track."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from trackprofile.models.roll import roll_unknowns, rolling
from trackprofile.models.track import RigidTrack
from trackprofile.models.vehicle import Vehicle, assemble

Array = NDArray[np.float64]

ROLL = "roll"

TAKES_PART = 0.1
"""Share of a mode's kinetic energy from which a motion is named."""

JOINED = 1e-12
"""Of the stiffest, or the strongest damper: less is what round-off leaves."""


@dataclass(frozen=True)
class Mode:
    """One mode.

    Parameters
    ----------
    frequency : |λ|/2π of its eigenvalue [Hz]
    damping_ratio : -Re λ/|λ| [-]; 1 where it creeps back without swinging
    motions : the (part, motion) that share its kinetic energy, the greatest first
    """

    frequency: float
    damping_ratio: float
    motions: tuple[tuple[str, str], ...]

    @property
    def words(self) -> str:
        """Such as ``leading bogie heave, trailing bogie heave``."""
        return ", ".join(" ".join(one) for one in self.motions)


def modes(vehicle: Vehicle) -> tuple[Mode, ...]:
    """The modes with all wheels held, by rising frequency.

    (λ² M + λ C + K) q = 0, solved as an eigenvalue problem of twice the size.

    Parameters
    ----------
    vehicle : any

    Returns
    -------
    one per pair of conjugate eigenvalues, and one per real eigenvalue

    Examples
    --------
    >>> from trackprofile.models.vehicle import Body, Link, Wheel
    >>> car = Vehicle("one mass", (Body("body", 1000.0),), wheels=(Wheel("wheel", 0.0, 0.0),),
    ...     links=(Link("spring", "body", "wheel", 0.0, 4e5, 4e3),))
    >>> for mode in modes(car):
    ...     print(f"{mode.frequency:.2f} Hz, {mode.damping_ratio:.2f}, {mode.words}")
    3.18 Hz, 0.10, body heave
    """
    assembly = assemble(vehicle)
    held = {wheel.name for wheel in vehicle.wheels}
    free = [i for i, (part, _) in enumerate(assembly.degrees_of_freedom) if part not in held]
    M, C, K = (
        one[np.ix_(free, free)] for one in (assembly.mass, assembly.damping, assembly.stiffness)
    )
    names = [assembly.degrees_of_freedom[i] for i in free]
    found: list[Mode] = []
    # Alone, so that two alike parts that do not feel each other do not swing in any mixture of both.
    for alone in _apart(C, K):
        part = np.ix_(alone, alone)
        found += _modes(M[part], C[part], K[part], [names[i] for i in alone])
    return tuple(sorted(found, key=lambda one: one.frequency))


def _apart(C: Array, K: Array) -> list[NDArray[np.intp]]:
    """Degrees of freedom, in groups that no spring or damper joins but by round-off."""
    joined = sum(np.abs(one) > JOINED * np.max(np.abs(one), initial=0.0) for one in (C, K))
    count, group = connected_components(joined, directed=False)
    return [np.flatnonzero(group == i) for i in range(count)]


def _modes(M: Array, C: Array, K: Array, names: list[tuple[str, str]]) -> list[Mode]:
    n, inverse = len(M), np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    values, vectors = np.linalg.eig(A)
    return [
        _mode(value, np.diag(M) * np.abs(vectors[:n, i]) ** 2, names)
        for i, value in enumerate(values)
        if value.imag >= 0
    ]


def roll_modes(vehicle: Vehicle) -> tuple[Mode, ...]:
    """The same in roll; none where the vehicle does not state what roll takes.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> slowest = roll_modes(read_vehicle("manchester-benchmark")[0])[0]
    >>> print(f"{slowest.frequency:.2f} Hz, {slowest.words}")
    1.08 Hz, body roll
    """
    if roll_unknowns(vehicle, RigidTrack()):
        return ()
    return tuple(
        replace(mode, motions=tuple((part, ROLL) for part, _ in mode.motions))
        for mode in modes(rolling(vehicle))
    )


def _mode(value: complex, energy: Array, names: list[tuple[str, str]]) -> Mode:
    share = np.round(energy / np.sum(energy), 6)  # equal ones keep the vehicle's order
    order = [int(i) for i in np.argsort(-share, kind="stable") if share[i] > TAKES_PART]
    return Mode(
        float(abs(value) / (2 * np.pi)),
        float(-value.real / abs(value)),
        tuple(names[i] for i in order),
    )

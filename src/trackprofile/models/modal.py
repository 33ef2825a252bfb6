"""Modal analysis of a vehicle: natural frequencies, damping ratios and mode shapes on a rigid, level track."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from trackprofile.models.roll import missing_roll_parameters, roll_vehicle
from trackprofile.models.track import RigidTrack
from trackprofile.models.vehicle import Vehicle, assemble

Array = NDArray[np.float64]

ROLL = "roll"

MINIMUM_ENERGY_SHARE = 0.1
"""Minimum share of a mode's kinetic energy for a motion to be named in the mode's description."""

COUPLING_TOLERANCE = 1e-12
"""Share of the largest stiffness or damping below which an entry is round-off and couples nothing."""


@dataclass(frozen=True)
class Mode:
    """One mode with the eigenvalue λ.

    Parameters
    ----------
    frequency : |λ|/2π [Hz]
    damping_ratio : -Re λ/|λ| [-]; 1 where the mode is overdamped
    motions : the (part, motion) pairs that hold its kinetic energy, largest share first
    """

    frequency: float
    damping_ratio: float
    motions: tuple[tuple[str, str], ...]

    @property
    def description(self) -> str:
        """The motions as text, such as ``leading bogie heave, trailing bogie heave``."""
        return ", ".join(" ".join(one) for one in self.motions)


def modes(vehicle: Vehicle) -> tuple[Mode, ...]:
    """The modes of a vehicle with all wheels fixed, in order of increasing frequency.

    (λ² M + λ C + K) q = 0 is solved as an eigenvalue problem of twice the size.

    Returns
    -------
    one mode per pair of conjugate eigenvalues and one per real eigenvalue

    Examples
    --------
    >>> from trackprofile.models.vehicle import Body, Link, Wheel
    >>> car = Vehicle("one mass", (Body("body", 1000.0),), wheels=(Wheel("wheel", 0.0, 0.0),),
    ...     links=(Link("spring", "body", "wheel", 0.0, 4e5, 4e3),))
    >>> for mode in modes(car):
    ...     print(f"{mode.frequency:.2f} Hz, {mode.damping_ratio:.2f}, {mode.description}")
    3.18 Hz, 0.10, body heave
    """
    assembly = assemble(vehicle)
    fixed = {wheel.name for wheel in vehicle.wheels}
    free = [i for i, (part, _) in enumerate(assembly.degrees_of_freedom) if part not in fixed]
    M, C, K = (
        one[np.ix_(free, free)] for one in (assembly.mass, assembly.damping, assembly.stiffness)
    )
    names = [assembly.degrees_of_freedom[i] for i in free]
    result: list[Mode] = []
    # Uncoupled groups are solved separately: equal parts have equal eigenvalues, whose eigenvectors could mix.
    for group in _uncoupled_groups(C, K):
        part = np.ix_(group, group)
        result += _modes(M[part], C[part], K[part], [names[i] for i in group])
    return tuple(sorted(result, key=lambda mode: mode.frequency))


def _uncoupled_groups(C: Array, K: Array) -> list[NDArray[np.intp]]:
    """Degrees of freedom in groups that no spring or damper couples."""
    coupled = sum(
        np.abs(one) > COUPLING_TOLERANCE * np.max(np.abs(one), initial=0.0) for one in (C, K)
    )
    count, group = connected_components(coupled, directed=False)
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
    """The roll modes of a vehicle with all wheels fixed; empty where its roll parameters are missing.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_vehicle
    >>> slowest = roll_modes(read_vehicle("manchester-benchmark")[0])[0]
    >>> print(f"{slowest.frequency:.2f} Hz, {slowest.description}")
    1.08 Hz, body roll
    """
    if missing_roll_parameters(vehicle, RigidTrack()):
        return ()
    return tuple(
        replace(mode, motions=tuple((part, ROLL) for part, _ in mode.motions))
        for mode in modes(roll_vehicle(vehicle))
    )


def _mode(value: complex, energy: Array, names: list[tuple[str, str]]) -> Mode:
    share = np.round(energy / np.sum(energy), 6)  # equal shares keep the vehicle's order
    order = [int(i) for i in np.argsort(-share, kind="stable") if share[i] > MINIMUM_ENERGY_SHARE]
    return Mode(
        float(abs(value) / (2 * np.pi)),
        float(-value.real / abs(value)),
        tuple(names[i] for i in order),
    )

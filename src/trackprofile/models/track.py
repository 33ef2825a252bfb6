"""Track models: a rigid path, a point track (spring, damper, mass per wheel), or a layered track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from trackprofile.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidTrack:
    """The wheel follows the profile exactly."""


@dataclass(frozen=True)
class Coupling:
    """Coupling of two wheels through the rail, tabulated over their distance.

    Values between the tabulated distances follow from a cubic spline; outside their range there is no coupling.

    Parameters
    ----------
    distance : (n,), distance between two wheels, increasing, m
    stiffness, damping, mass : (n,), off-diagonal terms of the two wheels, N/m, N s/m and kg
    """

    distance: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    mass: tuple[float, ...]


@dataclass(frozen=True)
class ElasticTrack:
    """A point track k_t + c_t d/dt + m_t d²/dt² under each wheel, fitted to the track's receptance at low frequency.

    Parameters
    ----------
    stiffness : k_t per wheel, N/m
    damping : c_t per wheel, N s/m
    source : source of the numbers
    mass : m_t per wheel, the mass that moves with the rail, kg
    coupling : coupling between wheels; None: none

    Examples
    --------
    >>> ElasticTrack(stiffness=87.8e6, damping=36e3).stiffness
    87800000.0
    """

    stiffness: float
    damping: float
    source: str = ""
    mass: float = 0.0
    coupling: Coupling | None = None

    def __post_init__(self) -> None:
        if not self.stiffness > 0 or self.damping < 0 or self.mass < 0:
            raise ModelError(
                "an elastic track needs a stiffness above 0, and damping and mass of at least 0, got "
                f"{self.stiffness} N/m, {self.damping} N s/m and {self.mass} kg"
            )


def wheel_matrices(track: ElasticTrack, positions: Array) -> Array:
    """Stiffness, damping and mass matrices of an elastic track under wheels at given positions.

    Parameters
    ----------
    positions : (wheels,), m

    Returns
    -------
    [K_t, C_t, M_t], (3, wheels, wheels), N/m, N s/m and kg

    Examples
    --------
    >>> wheel_matrices(ElasticTrack(8e7, 3e4), np.array([0.0, 2.5]))[0]
    array([[80000000.,        0.],
           [       0., 80000000.]])
    """
    own = np.array([track.stiffness, track.damping, track.mass])
    matrices = np.multiply.outer(own, np.eye(len(positions)))
    if track.coupling is not None:
        table = track.coupling
        distance = np.abs(positions[:, None] - positions)
        coupled = (distance >= table.distance[0]) & (distance <= table.distance[-1])
        values = np.stack([table.stiffness, table.damping, table.mass], axis=1)
        matrices[:, coupled] = CubicSpline(table.distance, values)(distance[coupled]).T
    return np.asarray(matrices, np.float64)


@dataclass(frozen=True)
class Support:
    """Support of the rail at one sleeper, for half the track (one rail).

    Parameters
    ----------
    pad_stiffness, pad_damping : between rail and sleeper, N/m and N s/m
    sleeper_mass : kg
    ballast_stiffness, ballast_damping : between sleeper and ballast, N/m and N s/m
    ballast_mass : kg
    subballast_stiffness, subballast_damping : between ballast and ground, N/m and N s/m
    """

    pad_stiffness: float
    pad_damping: float
    sleeper_mass: float
    ballast_stiffness: float
    ballast_damping: float
    ballast_mass: float
    subballast_stiffness: float
    subballast_damping: float = 0.0

    def __post_init__(self) -> None:
        for name in SUPPORT_FIELDS:
            value, damping = getattr(self, name), name.endswith("damping")
            if not (np.isfinite(value) and value >= 0) or (value == 0 and not damping):
                bound = "at least" if damping else "above"
                raise ModelError(
                    f"support: {name.replace('_', ' ')} must be {bound} 0, got {value:g}"
                )


SUPPORT_FIELDS = (
    "pad_stiffness", "pad_damping", "sleeper_mass", "ballast_stiffness", "ballast_damping",
    "ballast_mass", "subballast_stiffness", "subballast_damping",
)  # fmt: skip
"""Fields of `Support` in the order of the columns that the kernels expect."""


@dataclass(frozen=True)
class SupportChange:
    """A local change of the supports, such as a soft spot or a hanging sleeper.

    Parameters
    ----------
    field : name of the changed field of `Support`
    factor : factor on that field
    start, end : distances between which the factor applies, m
    """

    field: str
    factor: float
    start: float
    end: float

    def __post_init__(self) -> None:
        if self.field not in SUPPORT_FIELDS:
            raise ModelError(
                f"a change of the track has the unknown field {self.field!r}; use one of {', '.join(SUPPORT_FIELDS)}"
            )
        if not (self.factor >= 0 and self.end > self.start):
            raise ModelError(
                f"a change of {self.field!r} needs a factor of at least 0 and an end beyond its start, got "
                f"{self.factor:g} from {self.start:g} m to {self.end:g} m"
            )


@dataclass(frozen=True)
class LayeredTrack:
    """Rail on pads, sleepers, ballast and sub-ballast (theory, section 3), for half the track (one rail).

    The rail is an Euler-Bernoulli beam with one Hermite element per sleeper bay. Sleepers lie at the multiples
    of ``spacing``.

    Parameters
    ----------
    name : name of the track
    rail_bending_stiffness : EI, N m²
    rail_mass : mass per length, kg/m
    spacing : sleeper spacing, m
    support : support at every sleeper without a change
    changes : local changes of the supports
    source : source of the numbers

    Examples
    --------
    >>> support = Support(65e6, 75e3, 125.5, 137.75e6, 58.8e3, 531.4, 77.5e6)
    >>> soft = SupportChange("ballast_stiffness", 0.5, 100.0, 103.0)
    >>> track = LayeredTrack("soft spot", 6.62e6, 60.64, 0.545, support, (soft,))
    >>> support_table(track, 182, 3)[:, 3] / 1e6  # at 99.2, 99.7 and 100.3 m
    array([137.75 , 137.75 ,  68.875])
    """

    name: str
    rail_bending_stiffness: float
    rail_mass: float
    spacing: float
    support: Support
    changes: tuple[SupportChange, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        for field in ("rail_bending_stiffness", "rail_mass", "spacing"):
            value = getattr(self, field)
            if not (np.isfinite(value) and value > 0):
                raise ModelError(
                    f"track {self.name!r}: {field.replace('_', ' ')} must be above 0, got {value:g}"
                )


PointTrack = RigidTrack | ElasticTrack
"""Tracks described under each wheel only, which the state-space model takes."""

Track = PointTrack | LayeredTrack


def support_table(track: LayeredTrack, first: int, count: int) -> Array:
    """Supports of ``count`` sleepers from sleeper ``first`` on, (count, 8), columns in the order of SUPPORT_FIELDS."""
    table = np.tile([getattr(track.support, name) for name in SUPPORT_FIELDS], (count, 1))
    position = track.spacing * np.arange(first, first + count)
    for change in track.changes:
        inside = (position >= change.start) & (position <= change.end)
        table[inside, SUPPORT_FIELDS.index(change.field)] *= change.factor
    return table.astype(np.float64)


def beam_element(track: LayeredTrack) -> tuple[Array, Array]:
    """Stiffness and consistent mass matrices of one bay of rail, (4, 4) each.

    The degrees of freedom are deflection (m) and slope (rad) of the first end, then of the second.
    """
    h = track.spacing
    bending = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    inertia = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    return (
        track.rail_bending_stiffness / h**3 * bending,
        track.rail_mass * h / 420 * inertia,
    )

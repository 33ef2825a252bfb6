"""Matrices of a vehicle whose wheels follow given paths, for the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.models.integrate import Scheme
from trackprofile.models.receptance import dynamic_stiffness
from trackprofile.models.track import ElasticTrack, LayeredTrack, RigidTrack, Track
from trackprofile.models.vehicle import HEAVE, Vehicle, assemble

Array = NDArray[np.float64]

GRAVITY = 9.81
"""Gravity as in the paper's simulations, m/s²."""

MINIMUM_STEPS_PER_PERIOD = 5
"""Minimum number of steps per period of the stiffest mode; at 5, average acceleration makes that mode 11 % slow."""


@dataclass(frozen=True)
class VehicleMatrices:
    """M, C and K over the degrees of freedom of the bodies, then of the wheels.

    Parameters
    ----------
    freedoms : (part, motion) of the bodies' degrees of freedom
    mass : (bodies + wheels,), diagonal of M, kg or kg m²
    C, K : (bodies + wheels, bodies + wheels)
    weight : (bodies + wheels,), downward, 0 for pitch, N
    offsets : (wheels,), distance behind the leading wheel, m
    """

    freedoms: tuple[tuple[str, str], ...]
    mass: Array
    C: Array
    K: Array
    weight: Array
    offsets: Array

    @property
    def bodies(self) -> int:
        """Number of degrees of freedom of the bodies."""
        return len(self.freedoms)


def vehicle_matrices(vehicle: Vehicle) -> VehicleMatrices:
    """Assemble the matrices of a vehicle.

    Raises
    ------
    ModelError
        Where a body is not supported by the wheels through links with stiffness.
    """
    full = assemble(vehicle)
    bodies = len(full.degrees_of_freedom) - len(vehicle.wheels)
    mass = np.diag(full.mass).copy()
    heaves = np.array([motion == HEAVE for _, motion in full.degrees_of_freedom])
    inner = full.stiffness[:bodies, :bodies]
    values, modes = np.linalg.eigh(inner)
    if values[0] <= 1e-12 * values[-1]:
        part, motion = full.degrees_of_freedom[int(np.argmax(np.abs(modes[:, 0])))]
        raise ModelError(
            f"vehicle {vehicle.name!r}: no link supports the {motion} of {part!r}; add a link with stiffness"
        )
    offsets = np.array([wheel.position for wheel in vehicle.wheels])
    freedoms = full.degrees_of_freedom[:bodies]
    weight = GRAVITY * mass * heaves
    return VehicleMatrices(freedoms, mass, full.damping, full.stiffness, weight, offsets)


def check_step(car: VehicleMatrices, track: Track, scheme: Scheme) -> None:
    """Check that the time step resolves the stiffest mode of the vehicle on its track.

    Both schemes are stable at any step, but wrong with fewer than ``MINIMUM_STEPS_PER_PERIOD`` steps per period.

    Raises
    ------
    ModelError
        Where the step is too long, with the mode's frequency and the longest step; where a wheel on an elastic track
        has no mass.
    """
    b, mass, K = car.bodies, car.mass, car.K.copy()
    match track:
        case RigidTrack():
            free = np.arange(b)
        case ElasticTrack():
            if not np.all(mass[b:] > 0):
                raise ModelError(
                    "a wheel on an elastic track needs a mass; give every wheel a mass or use the rigid track"
                )
            free = np.arange(len(mass))
            K[b:, b:] += track.stiffness * np.eye(len(mass) - b)
        case LayeredTrack():
            free = np.flatnonzero(mass > 0)
            K[b:, b:] += float(dynamic_stiffness(track, np.zeros(1))[0].real) * np.eye(
                len(mass) - b
            )
    root = np.sqrt(mass[free])
    fastest = np.sqrt(np.linalg.eigvalsh(K[np.ix_(free, free)] / np.outer(root, root))[-1])
    frequency = float(fastest / (2 * np.pi))
    longest = 1.0 / (MINIMUM_STEPS_PER_PERIOD * frequency)
    if scheme.step > longest:
        raise ModelError(
            f"a time step of {1e3 * scheme.step:g} ms is too long for the stiffest mode, at {frequency:.1f} Hz; use "
            f"at most {1e3 * longest:.2g} ms"
        )

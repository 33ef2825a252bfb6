"""Receptance of a layered track, and the point track (spring, damper, mass per wheel) fitted to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from trackprofile.errors import ModelError
from trackprofile.models.track import (
    Coupling,
    ElasticTrack,
    LayeredTrack,
    PointTrack,
    Track,
    beam_element,
)

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TRACK_PER_SIDE = 40.0
"""Modelled track on each side of the force, m: the static deflection decays by more than e^-40 over it."""

MAXIMUM_FIT_FREQUENCY = 30.0
"""Highest frequency of the fit, Hz: bogies and bodies respond below it (theory, section 7)."""

MINIMUM_COUPLING_DISTANCE, MAXIMUM_COUPLING_DISTANCE = 1.0, 8.0
"""Distances between two wheels at which coupling is fitted, m: none are closer; beyond, coupling is negligible."""

LOCATIONS_PER_BAY = 4
"""Number of positions within a sleeper bay over which a wheel's support is averaged."""


def dynamic_stiffness(track: LayeredTrack, frequency: Array, fraction: float = 0.0) -> ComplexArray:
    """Dynamic stiffness of the rail: force over deflection under a stationary harmonic force.

    1 / (Nᵀ (K + iω C - ω² M)⁻¹ N), with the force at ``fraction`` of a bay beyond a sleeper.

    Parameters
    ----------
    frequency : (m,), Hz
    fraction : position in the sleeper bay; 0 is over a sleeper, 0.5 midway between two

    Returns
    -------
    (m,), complex, N/m

    Examples
    --------
    >>> from trackprofile.models.track import Support
    >>> support = Support(65e6, 75e3, 125.5, 137.75e6, 58.8e3, 531.4, 77.5e6)
    >>> table3 = LayeredTrack("Table 3", 6.6238e6, 60.64, 0.545, support)
    >>> at_rest = [dynamic_stiffness(table3, np.zeros(1), place)[0].real for place in (0.0, 0.5)]
    >>> [round(float(one) / 1e6, 1) for one in at_rest]
    [87.5, 88.1]
    """
    return np.asarray(1.0 / receptance(track, frequency, fraction, np.zeros(1))[:, 0])


def receptance(
    track: LayeredTrack, frequency: Array, fraction: float, distance: Array
) -> ComplexArray:
    """Receptance of the rail: deflection at given distances from a stationary harmonic unit force.

    Parameters
    ----------
    frequency : (m,), Hz
    fraction : position of the force in the sleeper bay, 0 over a sleeper
    distance : (n,), distance from the force, at least 0, m

    Returns
    -------
    (m, n), complex, m/N
    """
    nodes = 2 * int(np.ceil(TRACK_PER_SIDE / track.spacing)) + 2
    middle = nodes // 2
    at = middle + fraction + distance / track.spacing
    first = np.floor(at).astype(np.intp)
    rows = 2 * first[:, None] + np.arange(4)
    weights = _hermite(at - first, track.spacing)
    force = np.zeros(2 * nodes)
    force[2 * middle : 2 * middle + 4] = _hermite(np.array([fraction]), track.spacing)[0]
    bending, inertia = beam_element(track)
    result = np.empty((len(frequency), len(distance)), np.complex128)
    for i, omega in enumerate(2 * np.pi * frequency):
        bands = _bands(bending - omega**2 * inertia, _support_stiffness(track, omega), nodes)
        deflection = solve_banded((3, 3), bands, force.astype(np.complex128))
        result[i] = np.sum(weights * deflection[rows], axis=1)
    return result


def _hermite(x: Array, h: float) -> Array:
    """Hermite shape functions of a bay at the fractions x (n,), for deflection and slope of its ends, (n, 4)."""
    return np.stack(
        [
            1 - 3 * x**2 + 2 * x**3,
            h * (x - 2 * x**2 + x**3),
            3 * x**2 - 2 * x**3,
            h * (x**3 - x**2),
        ],
        axis=1,
    )


def point_track(track: Track) -> PointTrack:
    """Reduce a layered track to a point track: k_t + c_t d/dt + m_t d²/dt² under each wheel, with coupling.

    The dynamic stiffness k_t + iω c_t - ω² m_t is fitted by least squares, averaged over positions in a sleeper bay,
    at frequencies from 0 to ``MAXIMUM_FIT_FREQUENCY``. With α(d) the receptance at the distance d from the force,
    the coupling stiffness of two wheels is -α(d) / α(0)², fitted in the same way. Changes of single supports are
    ignored. A track that is already a point track is returned unchanged.

    Raises
    ------
    ModelError
        Where the fitted static stiffness is not above 0.

    Examples
    --------
    >>> from trackprofile.models.track import Support
    >>> support = Support(65e6, 75e3, 125.5, 137.75e6, 58.8e3, 531.4, 77.5e6)
    >>> fit = point_track(LayeredTrack("Table 3", 6.6238e6, 60.64, 0.545, support))
    >>> round(fit.stiffness / 1e6, 1), round(fit.damping / 1e3, 1), round(fit.mass)
    (88.0, 32.8, 374)
    """
    if not isinstance(track, LayeredTrack):
        return track
    frequency = np.linspace(0.0, MAXIMUM_FIT_FREQUENCY, 16)
    distance = np.concatenate(
        [[0.0], np.arange(MINIMUM_COUPLING_DISTANCE, MAXIMUM_COUPLING_DISTANCE, 0.25)]
    )
    fractions = np.arange(LOCATIONS_PER_BAY) / LOCATIONS_PER_BAY
    alpha = [receptance(track, frequency, fraction, distance) for fraction in fractions]
    own = np.mean([1.0 / one[:, :1] for one in alpha], axis=0)
    mutual = np.mean([-one[:, 1:] / one[:, :1] ** 2 for one in alpha], axis=0)
    omega = 2 * np.pi * frequency
    dynamic = np.asarray(np.hstack([own, mutual]), np.complex128)
    (stiffness, *stiffnesses), (mass, *masses) = np.linalg.lstsq(
        np.stack([np.ones_like(omega), -(omega**2)], 1), dynamic.real
    )[0]
    damping, *dampings = omega @ dynamic.imag / (omega @ omega)
    if not stiffness > 0:
        raise ModelError(
            f"track {track.name!r}: the static stiffness under a wheel must be above 0, got {stiffness:g} N/m; "
            "check its supports."
        )
    coupling = Coupling(tuple(distance[1:]), tuple(stiffnesses), tuple(dampings), tuple(masses))
    return ElasticTrack(
        float(stiffness), max(float(damping), 0.0), f"fitted to {track.name}",
        max(float(mass), 0.0), coupling,
    )  # fmt: skip


def _support_stiffness(track: LayeredTrack, omega: float) -> complex:
    """Dynamic stiffness of an unchanged support, with sleeper and ballast eliminated, N/m."""
    one = track.support
    pad = one.pad_stiffness + 1j * omega * one.pad_damping
    ballast = one.ballast_stiffness + 1j * omega * one.ballast_damping
    ground = one.subballast_stiffness + 1j * omega * one.subballast_damping
    below = ground - omega**2 * one.ballast_mass
    under_sleeper = ballast * below / (ballast + below) - omega**2 * one.sleeper_mass
    return pad * under_sleeper / (pad + under_sleeper)


def _bands(element: Array, support: complex, n: int) -> ComplexArray:
    """The rail's matrix over n nodes in the diagonal-ordered form of scipy.linalg.solve_banded, (7, 2 n)."""
    bands = np.zeros((7, 2 * n), np.complex128)
    for i in range(4):
        for j in range(4):
            columns = 2 * np.arange(n - 1) + j
            bands[3 + i - j, columns] += element[i, j]
    bands[3, 0::2] += support
    return bands

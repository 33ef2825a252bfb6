"""What a layered track gives under a wheel: its receptance, and the spring and damper that stand for it."""

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

REACH = 40.0
"""m of track to each side of the force: static deflection has fallen by e^-40 and more there."""

FITTED_UP_TO = 30.0
"""Hz: what bogies and bodies answer to lies below (theory, section 7)."""

COUPLED_FROM, COUPLED_UP_TO = 1.0, 8.0
"""m between wheels: no two wheels stand closer; farther from one the rail hardly moves with it."""

PLACES = 4
"""Places in a sleeper bay over which a wheel's support is averaged."""


def dynamic_stiffness(track: LayeredTrack, frequency: Array, fraction: float = 0.0) -> ComplexArray:
    """Force over deflection of the rail under a harmonic force that stands still, N/m.

    1 / (Nᵀ (K + iω C - ω² M)⁻¹ N), with the force at a ``fraction`` of the bay from a sleeper on.

    Parameters
    ----------
    frequency : (m,), Hz
    fraction : 0 is over a sleeper, 0.5 between two

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
    """Deflection of the rail at some distances from a harmonic unit force that stands still, (m, n), m/N.

    Parameters
    ----------
    frequency : (m,), Hz
    fraction : of the bay, from a sleeper on, where the force stands
    distance : (n,), m, of at least 0
    """
    nodes = 2 * int(np.ceil(REACH / track.spacing)) + 2
    middle = nodes // 2
    at = middle + fraction + distance / track.spacing
    first = np.floor(at).astype(np.intp)
    places = 2 * first[:, None] + np.arange(4)
    weights = _hermite(at - first, track.spacing)
    force = np.zeros(2 * nodes)
    force[2 * middle : 2 * middle + 4] = _hermite(np.array([fraction]), track.spacing)[0]
    bending, inertia = beam_element(track)
    found = np.empty((len(frequency), len(distance)), np.complex128)
    for i, omega in enumerate(2 * np.pi * frequency):
        bands = _bands(bending - omega**2 * inertia, _support_stiffness(track, omega), nodes)
        deflection = solve_banded((3, 3), bands, force.astype(np.complex128))
        found[i] = np.sum(weights * deflection[places], axis=1)
    return found


def _hermite(x: Array, h: float) -> Array:
    """Shape functions of a bay at fractions x, (n, 4), on deflection and slope of its ends."""
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
    """The track as each wheel feels it below 30 Hz: k_t + c_t d/dt + m_t d²/dt², and what it hands on to others.

    Least squares of the dynamic stiffness k_t + iω c_t - ω² m_t, averaged over places in a bay, at frequencies
    from 0 to ``FITTED_UP_TO``. With α(d) the receptance at the distance d from the force, two wheels feel
    -α(d) / α(0)² of each other, fitted alike. Changes of single supports are left out. Tracks of one
    point stay as they are.

    Raises
    ------
    ModelError
        Where the track has no stiffness at rest.

    Examples
    --------
    >>> from trackprofile.models.track import Support
    >>> support = Support(65e6, 75e3, 125.5, 137.75e6, 58.8e3, 531.4, 77.5e6)
    >>> found = point_track(LayeredTrack("Table 3", 6.6238e6, 60.64, 0.545, support))
    >>> round(found.stiffness / 1e6, 1), round(found.damping / 1e3, 1), round(found.mass)
    (88.0, 32.8, 374)
    """
    if not isinstance(track, LayeredTrack):
        return track
    frequency = np.linspace(0.0, FITTED_UP_TO, 16)
    distance = np.concatenate([[0.0], np.arange(COUPLED_FROM, COUPLED_UP_TO, 0.25)])
    alpha = [receptance(track, frequency, place, distance) for place in np.arange(PLACES) / PLACES]
    alone = np.mean([1.0 / one[:, :1] for one in alpha], axis=0)
    between = np.mean([-one[:, 1:] / one[:, :1] ** 2 for one in alpha], axis=0)
    omega = 2 * np.pi * frequency
    felt = np.asarray(np.hstack([alone, between]), np.complex128)
    (stiffness, *others), (mass, *masses) = np.linalg.lstsq(
        np.stack([np.ones_like(omega), -(omega**2)], 1), felt.real
    )[0]
    damping, *dampings = omega @ felt.imag / (omega @ omega)
    if not stiffness > 0:
        raise ModelError(f"track {track.name!r} does not carry a wheel: check its supports.")
    coupling = Coupling(tuple(distance[1:]), tuple(others), tuple(dampings), tuple(masses))
    return ElasticTrack(
        float(stiffness), max(float(damping), 0.0), f"fitted to {track.name}",
        max(float(mass), 0.0), coupling,
    )  # fmt: skip


def _support_stiffness(track: LayeredTrack, omega: float) -> complex:
    """Of a support that no change concerns, with sleeper and ballast eliminated, N/m."""
    one = track.support
    pad = one.pad_stiffness + 1j * omega * one.pad_damping
    ballast = one.ballast_stiffness + 1j * omega * one.ballast_damping
    ground = one.subballast_stiffness + 1j * omega * one.subballast_damping
    below = ground - omega**2 * one.ballast_mass
    under_sleeper = ballast * below / (ballast + below) - omega**2 * one.sleeper_mass
    return pad * under_sleeper / (pad + under_sleeper)


def _bands(element: Array, support: complex, n: int) -> ComplexArray:
    """The rail's matrix over n nodes in the diagonal form of scipy.linalg.solve_banded, (7, 2 n)."""
    bands = np.zeros((7, 2 * n), np.complex128)
    for i in range(4):
        for j in range(4):
            columns = 2 * np.arange(n - 1) + j
            bands[3 + i - j, columns] += element[i, j]
    bands[3, 0::2] += support
    return bands

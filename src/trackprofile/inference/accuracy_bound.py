"""Accuracy bound: the smallest error that any estimator can reach, from the posterior spectrum (theory, section 8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import quad_vec

from trackprofile.bands import BANDS, Band
from trackprofile.contracts import Rail
from trackprofile.errors import ModelError
from trackprofile.models.receptance import point_track
from trackprofile.models.roll import rail_modes, roll_track, roll_vehicle_for_sensors, sensor_pairs
from trackprofile.models.sensor import Sensor, sensor_noise_density
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.statespace import state_space, transfer_function
from trackprofile.models.track import Track
from trackprofile.models.vehicle import Vehicle

SEGMENTS = 32
"""Parts of a band from which the adaptive quadrature starts."""

QUADRATURE_TOLERANCE = 1e-6
"""Relative tolerance of the variance of each band."""


def accuracy_bound(
    vehicle: Vehicle,
    track: Track,
    sensors: Sequence[Sensor],
    speed: float,
    prior: Spectrum,
    bands: Sequence[Band] = BANDS,
) -> dict[str, float]:
    """Smallest possible root-mean-square error of the profile in each band, m.

    1/S_post(Ω) = 1/S_prior(Ω) + Σ |H(Ω, v)|² / S_noise, integrated over the band, with S_noise = S(f) v/(2π) per
    rad/m and S(f) the one-sided density of all noise that a sensor states, at f = Ωv/2π (theory, section 8).

    Parameters
    ----------
    vehicle, track : the model, assumed to be exact
    sensors : at least one, each with its noise_density
    speed : m/s
    prior : spectrum of the profile, m²/(rad/m)
    bands : wavelengths (m), with sharp edges

    Raises
    ------
    ModelError
        Where a noise density or a positive speed is missing.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
    >>> velaro, _ = read_vehicle("velaro")
    >>> sensors, prior = read_sensors("bogie-25ug"), read_spectrum("fra-6")
    >>> bound = accuracy_bound(velaro, read_track("rigid"), sensors, 150 / 3.6, prior)
    >>> {band: round(1e3 * error, 4) for band, error in bound.items()}  # mm
    {'D1': 0.0023, 'D2': 0.0073, 'D3': 0.0361}
    """
    if not speed > 0:
        raise ModelError(
            f"The accuracy bound needs a running train: expected a speed above 0 m/s, got {speed:g} m/s."
        )
    if not sensors or any(sensor.noise_density is None for sensor in sensors):
        raise ModelError(
            "The accuracy bound needs at least one sensor, and the noise_density of each."
        )
    system = state_space(vehicle, point_track(track), sensors)

    def posterior(omega: float) -> float:
        at = np.array([omega])
        frequency = at * speed / (2 * np.pi)
        noise = (
            np.concatenate([sensor_noise_density(one, frequency) for one in sensors])
            * speed
            / (2 * np.pi)
        )
        information = np.sum(np.abs(transfer_function(system, at, speed)[0]) ** 2 / noise)
        return float(1.0 / (1.0 / prior.density(at)[0] + information))

    errors = {}
    for band in bands:
        # Adaptive: where no sensor responds, the posterior spectrum has a narrow peak that a grid misses.
        ends = np.linspace(2 * np.pi / band.longest, 2 * np.pi / band.shortest, SEGMENTS + 1)
        variance, *_ = quad_vec(
            posterior,
            ends[0],
            ends[-1],
            epsabs=0.0,
            epsrel=QUADRATURE_TOLERANCE,
            points=list(ends[1:-1]),
        )
        errors[band.name] = float(np.sqrt(variance))
    return errors


def accuracy_bound_per_rail(
    vehicle: Vehicle, track: Track, sensors: Sequence[Sensor], speed: float, prior: Spectrum,
    bands: Sequence[Band] = BANDS,
) -> dict[Rail, dict[str, float]]:  # fmt: skip
    """Accuracy bound of the mean of both rails, and, where the sensors separate them, of difference and either rail.

    Mean and difference are independent on a vehicle that is symmetric about its longitudinal axis, so the variance of
    either rail is σ² = σ_m² + σ_c²/4 if the sensors left and right are equal. The prior is that of the mean; the
    difference is assumed to have the same density, which matters little where the sensors respond.

    Returns
    -------
    by rail and band, m; the mean alone without a left and right pair of sensors and without a roll rate

    Raises
    ------
    ModelError
        As :func:`accuracy_bound`; where the vehicle does not state its roll parameters.

    Examples
    --------
    >>> from trackprofile.io.model_toml import read_spectrum, read_track, read_vehicle
    >>> boxes = [Sensor(name, "vertical acceleration", "wheel 1", lateral=y, noise_density=1e-2)
    ...     for name, y in (("left", 1.0), ("right", -1.0))]
    >>> velaro, _ = read_vehicle("velaro")
    >>> bound = accuracy_bound_per_rail(velaro, read_track("rigid"), boxes, 150 / 3.6, read_spectrum("german-low"))
    >>> {rail.value: round(1e3 * errors["D1"], 3) for rail, errors in bound.items()}  # mm
    {'mean': 0.048, 'difference': 0.072, 'left': 0.06, 'right': 0.06}
    """
    mean, difference = rail_modes(sensors, sensor_pairs(sensors), vehicle.contact_spacing)
    bounds = {Rail.MEAN: accuracy_bound(vehicle, track, mean.sensors, speed, prior, bands)}
    if difference.sensors:
        car = roll_vehicle_for_sensors(vehicle, point_track(track), difference.sensors)
        support = roll_track(point_track(track))
        across = accuracy_bound(car, support, difference.sensors, speed, prior, bands)
        side = {
            band: float(np.hypot(error, 0.5 * across[band]))
            for band, error in bounds[Rail.MEAN].items()
        }
        bounds |= {Rail.DIFFERENCE: across, Rail.LEFT: side, Rail.RIGHT: side}
    return bounds

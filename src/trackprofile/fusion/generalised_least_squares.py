"""Generalised least-squares weights of all passes, for the level of the line and its rate of change.

In one subband, pass i by vehicle v(i), on day τ_i relative to the mean day, has the estimate

    m_i = G_i y_i,      y_i = a + ρ τ_i + u_v(i) + n_i,

of the level a and its rate of change ρ. The error n_i has the density λ_i N_i with N_i = P_i/G_i; the error u_v has
the density U_v and is common to all passes of vehicle v; a has the prior density S. With a_i = 1/(λ_i N_i),
h_i = (1, τ_i), b_v = Σ_{i in v} a_i h_i and κ_v = U_v/(1 + U_v Σ_{i in v} a_i), which eliminates u_v,

    J = e_1 e_1ᵀ/S + Σ_i a_i h_i h_iᵀ - Σ_v κ_v b_v b_vᵀ,      J x = Σ_i (h_i - κ_v(i) b_v(i)) m_i/(λ_i P_i)

give the estimate x = (a, ρ), of covariance J⁻¹; the level on day τ is (1, τ) x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.spectral_bands import CENTRE_WAVELENGTHS, RANGES
from trackprofile.fusion.stack import PassStack, moving_average

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

_MIN_INFORMATION = 1e-9
"""Information on the level where there is no prior and no pass [1/(m²/(rad/m))]."""

_MAX_RELATIVE_CHANGE = 10.0
"""Prior standard deviation of the change over the passes' time span, in units of the level's."""


@dataclass(frozen=True, eq=False)
class PassErrorModel:
    """Error variances of the passes, as estimated from their differences.

    Parameters
    ----------
    variance_ratio : λ, variance of each pass's error over the stated one (n, subbands) [-]
    local_ratio : further factor of that variance along the line (n, ranges, nodes) [-]
    used : whether a pass is used (n)
    vehicle_variance : ξ, variance of the error common to a vehicle's passes, over that of the track
        (vehicles, ranges) [-]
    hidden_share : variance of a common error that a single vehicle's passes cannot show, over the stated variance
        (ranges) [-]
    vehicle : index of each pass's vehicle (n)
    """

    variance_ratio: Array
    local_ratio: Array
    used: Mask
    vehicle_variance: Array
    hidden_share: Array
    vehicle: Indices


@dataclass(frozen=True, eq=False)
class EstimatorWeights:
    """Weights and variances in one subband, at each node.

    Parameters
    ----------
    level, rate : weight of each pass's estimate in the level and the rate (n, nodes) [-], [1/day]
    prior : weight of the prior mean in the level and the rate (2, nodes) [-], [1/day]
    variance : variance of the level, its covariance with the rate, and variance of the rate
        (3, nodes) [m²/(rad/m)], per day, per day²
    variance_without_rate : variance of the level if the rate is known to be zero (nodes) [m²/(rad/m)]
    """

    level: Array
    rate: Array
    prior: Array
    variance: Array
    variance_without_rate: Array


def _range_of(subband: int) -> int:
    return next(i for i, one in enumerate(RANGES) if subband in one.indices)


RANGE_OF_SUBBAND: Indices = np.array(
    [_range_of(subband) for subband in range(CENTRE_WAVELENGTHS.size)]
)
"""Index of the wavelength range of each subband."""


def least_squares_weights(
    stack: PassStack, subband: int, days: Array, errors: PassErrorModel, day: float
) -> EstimatorWeights:
    """Weights of all passes in one subband, for the level on a day and for its rate of change.

    Parameters
    ----------
    stack : the passes
    subband : index of the subband
    days : days of the passes, relative to their mean (n) [day]
    errors : error variances of the passes
    day : day of the level, relative to the same mean [day]
    """
    prior, track_prior = stack.prior(subband), stack.pass_prior[:, subband].max()
    variance_ratio = _local_variance_ratio(stack, subband, errors)
    # Per metre of the estimate m_i, and per metre of the level itself: a_i = 1/(λ_i N_i) = G_i/(λ_i P_i).
    G, precision = stack.gain(subband), _precision(stack, subband, errors, variance_ratio)
    a = G * precision
    known = a.sum(axis=0) > 0
    common = _common_density(stack, subband, errors)
    members = np.eye(common.shape[0])[errors.vehicle].T
    A, B = members @ a, members @ (days[:, None] * a)
    kappa = common / (1.0 + common * A)
    J = np.stack([(a.sum(axis=0) - (kappa * A**2).sum(axis=0)), B.sum(axis=0) - (kappa * A * B).sum(axis=0),
                  (days[:, None] ** 2 * a).sum(axis=0) - (kappa * B**2).sum(axis=0)])  # fmt: skip
    J[0] += max(1.0 / prior, _MIN_INFORMATION)
    span = float(np.ptp(days))
    J[2] += (max(span, 1.0) / _MAX_RELATIVE_CHANGE) ** 2 / track_prior
    determinant = J[0] * J[2] - J[1] ** 2
    C = np.stack([J[2], -J[1], J[0]]) / determinant
    # Level on the requested day: (1, day) times (level on the mean day, rate).
    row = np.stack([C[0] + day * C[1], C[1] + day * C[2]])
    v = errors.vehicle
    h = np.stack([1.0 - (kappa * A)[v], days[:, None] - (kappa * B)[v]])
    level = np.where(known, (row[0] * h[0] + row[1] * h[1]) * precision, 0.0)
    rate = np.where(known, (C[1] * h[0] + C[2] * h[1]) * precision, 0.0)
    variance = np.stack([row[0] + day * row[1], row[1], C[2]])
    common_error = stack.common_error(subband)
    variance[0] += _common_error_excess(level, common_error, variance_ratio)
    without_rate = np.where(known, h[0] * precision / J[0], 0.0)
    return EstimatorWeights(
        level=level,
        rate=rate,
        prior=np.stack([row[0], C[1]]) / prior,
        variance=variance,
        variance_without_rate=1.0 / J[0]
        + _common_error_excess(without_rate, common_error, variance_ratio),
    )


def _local_variance_ratio(stack: PassStack, subband: int, errors: PassErrorModel) -> Array:
    """λ_i times its local factor, smoothed over the wavelength (n, nodes) [-]."""
    step = float(stack.nodes[1] - stack.nodes[0])
    log_ratio = np.log(errors.local_ratio[:, RANGE_OF_SUBBAND[subband]])
    local = np.exp(moving_average(log_ratio, CENTRE_WAVELENGTHS[subband] / step))
    return errors.variance_ratio[:, subband, None] * local


def _precision(
    stack: PassStack, subband: int, errors: PassErrorModel, variance_ratio: Array
) -> Array:
    """1/(λ_i P_i) with the position error included, tapered, 0 for passes that are not used (n, nodes)."""
    position_error = stack.gain(subband) * stack.position_error(subband)
    error = variance_ratio * (stack.error_density[:, subband] + position_error)
    return errors.used[:, None] * stack.taper(subband) / error


def _common_error_excess(weight: Array, common_error: Array, variance_ratio: Array) -> Array:
    """Variance that the common error (1 - G_i) P_i adds to a weighted sum, since it does not average out.

    (Σ_i w_i √c_i)² - Σ_i w_i² λ_i c_i, with the density c_i of the common error.
    """
    in_phase = (weight * np.sqrt(common_error)).sum(axis=0) ** 2
    return in_phase - (weight**2 * variance_ratio * common_error).sum(axis=0)


def _common_density(stack: PassStack, subband: int, errors: PassErrorModel) -> Array:
    """Density U_v of the error common to the passes of each vehicle (vehicles, nodes) [m²/(rad/m)]."""
    number = RANGE_OF_SUBBAND[subband]
    from_track = errors.vehicle_variance[:, number, None] * stack.track_density(subband)
    stated = 1.0 / np.mean(1.0 / stack.error_density[:, subband], axis=0)
    return from_track + errors.hidden_share[number] * stated

"""The optimal smoother: posterior mean, variance, draws and likelihood of the profile (theory, section 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman import kernels as recursions
from trackprofile.kalman import simulation_kernels as forward_kernels
from trackprofile.kalman.time_steps import DiscretisedRun, OffsetWalk
from trackprofile.kalman.transition_kernels import COLUMNS, spline_weights
from trackprofile.models.spectrum import MarkovProfile, Spectrum, markov_process
from trackprofile.models.statespace import StateSpace, state_response

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InitialState:
    """The state before the first sample: the vehicle rides on the profile, and moves on top of that.

    x = stance · c + spread · ξ, with c from the prior and ξ standard normal.

    Parameters
    ----------
    coefficients : (ring, ring), covariance of the coefficients in the window, by place in the ring
    stance : (n, ring), quasi-static states on the coefficients
    spread : (n,), standard deviation of what the vehicle moves beyond, and of the offsets
    """

    coefficients: Array
    stance: Array
    spread: Array

    def covariance(self) -> Array:
        """Of [x; c], (n + ring, n + ring)."""
        cross = self.stance @ self.coefficients
        vehicle = cross @ self.stance.T + np.diag(self.spread**2)
        return np.block([[vehicle, cross], [cross.T, self.coefficients]])

    def draws(self, generator: np.random.Generator, count: int) -> Array:
        """Random starts, (n + ring, count)."""
        root = np.linalg.cholesky(self.coefficients)
        coefficients = root @ generator.standard_normal((len(root), count))
        beyond = self.spread[:, None] * generator.standard_normal((len(self.spread), count))
        return np.concatenate([self.stance @ coefficients + beyond, coefficients])


@dataclass(frozen=True)
class KalmanGains:
    """A ride with its gains: all of the smoother that does not depend on the data.

    ``variance`` (rows,) of the measurement rows, ``gains`` (rows, n + ring), ``innovation_variance``
    (rows,), ``knot_covariance`` (bays, n + ring),
    ``last_covariance`` (n + ring, n + ring).
    """

    ride: DiscretisedRun
    process: MarkovProfile
    variance: Array
    start: InitialState
    gains: Array
    innovation_variance: Array
    knot_covariance: Array
    last_covariance: Array


@dataclass(frozen=True)
class SmootherResult:
    """Posterior means of ``elevation`` (knots, signals) in m and of the noise, ``residual`` (rows, signals).

    ``innovation`` (rows,) is what each sample of the first signal says beyond all before it;
    ``offset_score`` (bays, sensors) is the slope of the first signal's log-likelihood over a jump of each sensor's
    offset at the end of each bay; ``log_likelihood`` (signals,).
    """

    elevation: Array
    residual: Array
    innovation: Array
    offset_score: Array
    log_likelihood: Array


@dataclass(frozen=True)
class PosteriorVariances:
    """Of the posterior's ``elevation`` (knots,), m²; and what single samples and offsets are judged by.

    ``precision`` (rows,) is the variance of residual / noise variance: its inverse is that of a sample about what all
    the others predict of it (de Jong 1988). ``offset_precision`` (bays, sensors) is that of the ``offset_score``.
    """

    elevation: Array
    precision: Array
    offset_precision: Array


@dataclass(frozen=True)
class SmoothingProblem:
    """A run with all that the smoother needs to know of it.

    Parameters
    ----------
    run : transitions and measurement rows
    spectrum : prior of the profile
    variance : (rows,), noise of each row, sensor's unit squared
    start : prior of the first state
    signals : (rows, 1), measured
    walk : random walk of the offsets that ``run`` includes
    """

    run: DiscretisedRun
    spectrum: Spectrum
    variance: Array
    start: InitialState
    signals: Array
    walk: OffsetWalk

    def gains(self) -> KalmanGains:
        """Kalman gains of the problem as it stands."""
        return kalman_gains(self.run, self.spectrum, self.variance, self.start)


def initial_state(
    system: StateSpace, spectrum: Spectrum, ride: DiscretisedRun, others: Array
) -> InitialState:
    """The prior of the first state.

    The vehicle stands on its paths quasi-statically; beyond that each state has the variance of its steady
    response at the first speed, ∫ |X(Ω) - X_static(Ω)|² S(Ω) dΩ. ``others`` are the standard deviations of
    the states after q and q̇: unmodelled accelerations and offsets.
    """
    n, f = len(system.A), len(system.freedoms)
    stiffness = -system.A[f : 2 * f, :f]
    sag = np.linalg.solve(stiffness, system.B[f : 2 * f, 0])
    omega = np.geomspace(2 * np.pi / 1000.0, 2 * np.pi / 0.5, 600)
    states, paths = state_response(system, omega, ride.start_speed)
    quasi_static = paths @ sag.T
    rate = 1j * omega[:, None] * ride.start_speed
    beyond = states[:, : 2 * f] - np.concatenate([quasi_static, rate * quasi_static], axis=1)
    power = np.abs(beyond) ** 2 * spectrum.density(omega)[:, None]
    spread = np.concatenate([np.sqrt(np.trapezoid(power, omega, axis=0)), others])
    stance = np.zeros((n, ride.ring))
    for i, behind in enumerate(system.wheel_positions):
        value, slope = _ring_weights(ride, ride.start_position - behind)
        stance[:f] += np.outer(sag[:, i], value)
        stance[f : 2 * f] += np.outer(sag[:, i], ride.start_speed * slope)
    order = (np.arange(ride.ring) - ride.first_knot) % ride.ring
    coefficients = markov_process(spectrum, ride.spacing).covariance(ride.ring)[
        np.ix_(order, order)
    ]
    return InitialState(coefficients, stance, spread)


def kalman_gains(
    ride: DiscretisedRun, spectrum: Spectrum, variance: Array, start: InitialState
) -> KalmanGains:
    """Run the covariances forwards: the gains for any data of this ride.

    ``variance`` (rows,) is that of each row's white noise, in the square of its unit.
    """
    process = markov_process(spectrum, ride.spacing)
    P = start.covariance()
    size, rows, bays = len(P), len(ride.rows), len(ride.F)
    gains, innovation_variance = np.empty((rows, size)), np.empty(rows)
    knots = np.empty((bays, size))
    recursions.covariances(
        P, process.a1, process.a2, process.innovation, ride.F, ride.G, ride.Q, ride.walk, ride.slots,
        ride.rows, variance, ride.first_row, ride.newest,
        gains, innovation_variance, knots,
    )  # fmt: skip
    return KalmanGains(ride, process, variance, start, gains, innovation_variance, knots, P)


def innovations(prepared: KalmanGains, signals: Array) -> Array:
    """What each sample of the signals (rows, m) says beyond all before it; (rows, m), of variance S."""
    return _forwards(prepared, signals)[0]


def smooth(prepared: KalmanGains, signals: Array) -> SmootherResult:
    """Posterior mean of the profile at every knot, for each of the signals (rows, m)."""
    residual, knots, last = _forwards(prepared, signals)
    innovation = residual[:, 0].copy()
    S = prepared.innovation_variance
    likelihood = -0.5 * (np.sum(np.log(2 * np.pi * S)) + np.sum(residual**2 / S[:, None], axis=0))
    ride, process = prepared.ride, prepared.process
    score = np.empty((len(ride.F), ride.offsets))
    recursions.smoothed(
        process.a1, process.a2, ride.F, ride.G, ride.slots, ride.rows, ride.first_row, ride.newest,
        prepared.gains, prepared.innovation_variance, prepared.variance, prepared.knot_covariance,
        residual, knots, score,
    )  # fmt: skip
    elevation = np.concatenate([knots, _window(ride) @ last])
    return SmootherResult(elevation, residual, innovation, score, likelihood)


def posterior_variances(prepared: KalmanGains) -> PosteriorVariances:
    """Posterior variance of the elevation at every knot, and the precisions of what is left of samples and offsets."""
    ride, process = prepared.ride, prepared.process
    knots, precision = np.empty(len(ride.F)), np.empty(len(ride.rows))
    offsets = np.empty((len(ride.F), ride.offsets))
    recursions.variances(
        process.a1, process.a2, ride.F, ride.G, ride.slots, ride.rows, ride.first_row, ride.newest,
        prepared.gains, prepared.innovation_variance, prepared.knot_covariance, knots, precision,
        offsets,
    )  # fmt: skip
    window = _window(ride)
    last = np.einsum("ki,ij,kj->k", window, prepared.last_covariance, window)
    return PosteriorVariances(np.concatenate([knots, last]), precision, offsets)


def prior_draws(
    prepared: KalmanGains, count: int, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Profiles (knots, count) from the prior, and noisy signals (rows, count) of rides over them."""
    ride, process = prepared.ride, prepared.process
    bays = len(ride.F)
    states = prepared.start.draws(generator, count)
    entering = np.sqrt(process.innovation) * generator.standard_normal((bays, count))
    shaking = generator.standard_normal((bays, ride.Q.shape[1], count))
    wandering = np.sqrt(ride.walk)[:, :, None] * generator.standard_normal(
        (*ride.walk.shape, count)
    )
    signals, knots = np.empty((len(ride.rows), count)), np.empty((bays, count))
    forward_kernels.simulated(
        states, process.a1, process.a2, entering, shaking, wandering, ride.F, ride.G, ride.Q, ride.slots, ride.rows,
        ride.first_row, ride.newest, signals, knots,
    )  # fmt: skip
    signals += np.sqrt(prepared.variance)[:, None] * generator.standard_normal(signals.shape)
    return np.concatenate([knots, _window(ride) @ states]), signals


def error_draws(prepared: KalmanGains, count: int, generator: np.random.Generator) -> Array:
    """Draws of the posterior's error, (knots, count) in m: r_s - smooth(y_s) with (r_s, y_s) from the prior.

    The posterior mean plus such a draw is a draw of the profile from the posterior.
    """
    profiles, signals = prior_draws(prepared, count, generator)
    return profiles - smooth(prepared, signals).elevation


def _forwards(prepared: KalmanGains, signals: Array) -> tuple[Array, Array, Array]:
    ride, process = prepared.ride, prepared.process
    innovations = np.array(signals, dtype=np.float64, order="C")
    means = np.zeros((prepared.knot_covariance.shape[1], innovations.shape[1]))
    knots = np.empty((len(ride.F), innovations.shape[1]))
    recursions.filtered(
        means, process.a1, process.a2, ride.F, ride.G, ride.slots, ride.rows, ride.first_row,
        ride.newest, prepared.gains, innovations, knots,
    )  # fmt: skip
    return innovations, knots, means


def _window(ride: DiscretisedRun) -> Array:
    """Rows that read the last window's knots, after the oldest one, off [x; c]; (ring - 3, n + ring)."""
    n, oldest = ride.F.shape[1], ride.newest + len(ride.F) - ride.ring
    rows = np.zeros((ride.ring - 3, n + ride.ring))
    for i, row in enumerate(rows):
        for k, weight in enumerate((1.0, 4.0, 1.0)):
            row[n + (oldest + 1 + i + k) % ride.ring] = weight / 6.0
    return rows


def _ring_weights(ride: DiscretisedRun, position: float) -> tuple[Array, Array]:
    """Weights of r and r' at ``position`` over the ring's places."""
    value, slope, curvature = np.empty((3, COLUMNS))
    base = int(np.floor(position / ride.spacing))
    spline_weights(position, ride.spacing, base, value, slope, curvature)
    places = (base + np.arange(COLUMNS)) % ride.ring
    over = np.zeros((2, ride.ring))
    np.add.at(over[0], places, value)
    np.add.at(over[1], places, slope)
    return over[0], over[1]

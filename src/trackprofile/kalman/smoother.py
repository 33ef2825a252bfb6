"""Optimal (Kalman) smoother: posterior mean, variance, samples and likelihood of the profile (theory, section 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman import kernels, simulation_kernels
from trackprofile.kalman.time_steps import DiscretisedRun, OffsetWalk
from trackprofile.kalman.transition_kernels import COLUMNS, spline_weights
from trackprofile.models.spectrum import MarkovProfile, Spectrum, markov_process
from trackprofile.models.statespace import StateSpace, state_response

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InitialState:
    """Prior of the state before the first sample: quasi-static equilibrium on the profile plus independent motion.

    x = S · c + diag(σ) · ξ, with S the quasi-static gain, c from the prior of the profile and ξ standard normal.

    Parameters
    ----------
    coefficients : (ring, ring), covariance of the spline coefficients in the window, by position in the ring, m²
    quasi_static_gain : (n, ring), states per coefficient in quasi-static equilibrium
    standard_deviation : (n,), of the motion beyond equilibrium, and of the sensor offsets
    """

    coefficients: Array
    quasi_static_gain: Array
    standard_deviation: Array

    def covariance(self) -> Array:
        """Covariance of [x; c], (n + ring, n + ring)."""
        cross = self.quasi_static_gain @ self.coefficients
        vehicle = cross @ self.quasi_static_gain.T + np.diag(self.standard_deviation**2)
        return np.block([[vehicle, cross], [cross.T, self.coefficients]])

    def samples(self, generator: np.random.Generator, count: int) -> Array:
        """Random initial states [x; c], (n + ring, count)."""
        root = np.linalg.cholesky(self.coefficients)
        coefficients = root @ generator.standard_normal((len(root), count))
        motion = self.standard_deviation[:, None] * generator.standard_normal(
            (len(self.standard_deviation), count)
        )
        return np.concatenate([self.quasi_static_gain @ coefficients + motion, coefficients])


@dataclass(frozen=True)
class KalmanGains:
    """Everything in the smoother that does not depend on the signals.

    Parameters
    ----------
    run : transitions and measurement rows
    process : Markov prior of the coefficients
    variance : (rows,), noise of the measurement rows, sensor's unit squared
    start : prior of the first state
    gains : (rows, n + ring), Kalman gains
    innovation_variance : (rows,), sensor's unit squared
    knot_covariance : (bays, n + ring), covariance of the oldest knot with the state at the end of each bay
    last_covariance : (n + ring, n + ring), of the last filtered state
    """

    run: DiscretisedRun
    process: MarkovProfile
    variance: Array
    start: InitialState
    gains: Array
    innovation_variance: Array
    knot_covariance: Array
    last_covariance: Array


@dataclass(frozen=True)
class SmootherResult:
    """Posterior means for one or more sets of signals.

    Parameters
    ----------
    elevation : (knots, signals), m
    residual : (rows, signals), posterior mean of the measurement noise
    innovation : (rows,), difference of each sample of the first signal from its prediction by all earlier samples
    offset_score : (bays, sensors), derivative of the first signal's log-likelihood with respect to a jump of each
        sensor's offset at the end of each bay
    log_likelihood : (signals,)
    """

    elevation: Array
    residual: Array
    innovation: Array
    offset_score: Array
    log_likelihood: Array


@dataclass(frozen=True)
class PosteriorVariances:
    """Posterior variances of the elevation, and the precisions for tests of single samples and offsets.

    Parameters
    ----------
    elevation : (knots,), m²
    precision : (rows,), variance of residual / noise variance; its inverse is the variance of a sample about its
        prediction by all other samples (de Jong 1988)
    offset_precision : (bays, sensors), variance of the ``offset_score``
    """

    elevation: Array
    precision: Array
    offset_precision: Array


@dataclass(frozen=True)
class SmoothingProblem:
    """A run with everything that the smoother needs.

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
        """Kalman gains of the problem without down-weighting."""
        return kalman_gains(self.run, self.spectrum, self.variance, self.start)


def initial_state(
    system: StateSpace, spectrum: Spectrum, run: DiscretisedRun, others: Array
) -> InitialState:
    """Prior of the first state.

    The vehicle is in quasi-static equilibrium on its paths; in addition each state has the variance of its steady
    response at the first speed, ∫ |X(Ω) - X_static(Ω)|² S(Ω) dΩ.

    Parameters
    ----------
    others : standard deviations of the states after q and q̇: unmodelled accelerations, filters, flicker and offsets
    """
    n, f = len(system.A), len(system.freedoms)
    stiffness = -system.A[f : 2 * f, :f]
    static_gain = np.linalg.solve(stiffness, system.B[f : 2 * f, 0])
    omega = np.geomspace(2 * np.pi / 1000.0, 2 * np.pi / 0.5, 600)
    states, paths = state_response(system, omega, run.start_speed)
    quasi_static = paths @ static_gain.T
    rate = 1j * omega[:, None] * run.start_speed
    dynamic = states[:, : 2 * f] - np.concatenate([quasi_static, rate * quasi_static], axis=1)
    power = np.abs(dynamic) ** 2 * spectrum.density(omega)[:, None]
    deviation = np.concatenate([np.sqrt(np.trapezoid(power, omega, axis=0)), others])
    gain = np.zeros((n, run.ring))
    for i, distance in enumerate(system.wheel_positions):
        value, slope = _ring_weights(run, run.start_position - distance)
        gain[:f] += np.outer(static_gain[:, i], value)
        gain[f : 2 * f] += np.outer(static_gain[:, i], run.start_speed * slope)
    order = (np.arange(run.ring) - run.first_knot) % run.ring
    coefficients = markov_process(spectrum, run.spacing).covariance(run.ring)[np.ix_(order, order)]
    return InitialState(coefficients, gain, deviation)


def kalman_gains(
    run: DiscretisedRun, spectrum: Spectrum, variance: Array, start: InitialState
) -> KalmanGains:
    """Covariance recursion forwards: the gains for any signals of this run.

    Parameters
    ----------
    variance : (rows,), white noise of each row, sensor's unit squared
    """
    process = markov_process(spectrum, run.spacing)
    P = start.covariance()
    size, rows, bays = len(P), len(run.rows), len(run.F)
    gains, innovation_variance = np.empty((rows, size)), np.empty(rows)
    knots = np.empty((bays, size))
    kernels.covariances(
        P, process.a1, process.a2, process.innovation, run.F, run.G, run.Q, run.walk, run.slots,
        run.rows, variance, run.first_row, run.newest,
        gains, innovation_variance, knots,
    )  # fmt: skip
    return KalmanGains(run, process, variance, start, gains, innovation_variance, knots, P)


def innovations(gains: KalmanGains, signals: Array) -> Array:
    """Innovations of the signals (rows, m): difference from the prediction by all earlier samples, (rows, m)."""
    return _filter(gains, signals)[0]


def smooth(gains: KalmanGains, signals: Array) -> SmootherResult:
    """Posterior mean of the profile at every knot, for each of the signals (rows, m)."""
    residual, knots, last = _filter(gains, signals)
    innovation = residual[:, 0].copy()
    S = gains.innovation_variance
    likelihood = -0.5 * (np.sum(np.log(2 * np.pi * S)) + np.sum(residual**2 / S[:, None], axis=0))
    run, process = gains.run, gains.process
    score = np.empty((len(run.F), run.offsets))
    kernels.smoothed(
        process.a1, process.a2, run.F, run.G, run.slots, run.rows, run.first_row, run.newest,
        gains.gains, gains.innovation_variance, gains.variance, gains.knot_covariance,
        residual, knots, score,
    )  # fmt: skip
    elevation = np.concatenate([knots, _window(run) @ last])
    return SmootherResult(elevation, residual, innovation, score, likelihood)


def posterior_variances(gains: KalmanGains) -> PosteriorVariances:
    """Posterior variance of the elevation at every knot, and the precisions of samples and offsets."""
    run, process = gains.run, gains.process
    knots, precision = np.empty(len(run.F)), np.empty(len(run.rows))
    offsets = np.empty((len(run.F), run.offsets))
    kernels.variances(
        process.a1, process.a2, run.F, run.G, run.slots, run.rows, run.first_row, run.newest,
        gains.gains, gains.innovation_variance, gains.knot_covariance, knots, precision,
        offsets,
    )  # fmt: skip
    window = _window(run)
    last = np.einsum("ki,ij,kj->k", window, gains.last_covariance, window)
    return PosteriorVariances(np.concatenate([knots, last]), precision, offsets)


def prior_samples(
    gains: KalmanGains, count: int, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Samples of the prior: profiles (knots, count) in m, and noisy signals (rows, count) of runs over them."""
    run, process = gains.run, gains.process
    bays = len(run.F)
    states = gains.start.samples(generator, count)
    entering = np.sqrt(process.innovation) * generator.standard_normal((bays, count))
    acceleration_noise = generator.standard_normal((bays, run.Q.shape[1], count))
    walk_steps = np.sqrt(run.walk)[:, :, None] * generator.standard_normal((*run.walk.shape, count))
    signals, knots = np.empty((len(run.rows), count)), np.empty((bays, count))
    simulation_kernels.simulated(
        states, process.a1, process.a2, entering, acceleration_noise, walk_steps, run.F, run.G, run.Q,
        run.slots, run.rows,
        run.first_row, run.newest, signals, knots,
    )  # fmt: skip
    signals += np.sqrt(gains.variance)[:, None] * generator.standard_normal(signals.shape)
    return np.concatenate([knots, _window(run) @ states]), signals


def error_samples(gains: KalmanGains, count: int, generator: np.random.Generator) -> Array:
    """Samples of the posterior error, (knots, count) in m: r_s - smooth(y_s) with (r_s, y_s) from the prior.

    The posterior mean plus such a sample is a sample of the profile from the posterior.
    """
    profiles, signals = prior_samples(gains, count, generator)
    return profiles - smooth(gains, signals).elevation


def _filter(gains: KalmanGains, signals: Array) -> tuple[Array, Array, Array]:
    run, process = gains.run, gains.process
    innovations = np.array(signals, dtype=np.float64, order="C")
    means = np.zeros((gains.knot_covariance.shape[1], innovations.shape[1]))
    knots = np.empty((len(run.F), innovations.shape[1]))
    kernels.filtered(
        means, process.a1, process.a2, run.F, run.G, run.slots, run.rows, run.first_row,
        run.newest, gains.gains, innovations, knots,
    )  # fmt: skip
    return innovations, knots, means


def _window(run: DiscretisedRun) -> Array:
    """Rows that map [x; c] to the knots of the last window after the oldest one, (ring - 3, n + ring)."""
    n, oldest = run.F.shape[1], run.newest + len(run.F) - run.ring
    rows = np.zeros((run.ring - 3, n + run.ring))
    for i, row in enumerate(rows):
        for k, weight in enumerate((1.0, 4.0, 1.0)):
            row[n + (oldest + 1 + i + k) % run.ring] = weight / 6.0
    return rows


def _ring_weights(run: DiscretisedRun, position: float) -> tuple[Array, Array]:
    """Weights of r and r' at ``position`` over the positions of the ring."""
    value, slope, curvature = np.empty((3, COLUMNS))
    base = int(np.floor(position / run.spacing))
    spline_weights(position, run.spacing, base, value, slope, curvature)
    positions = (base + np.arange(COLUMNS)) % run.ring
    weights = np.zeros((2, run.ring))
    np.add.at(weights[0], positions, value)
    np.add.at(weights[1], positions, slope)
    return weights[0], weights[1]

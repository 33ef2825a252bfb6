"""State-space model of a train's position and of the errors of its position sources (theory, section 12).

State at each node, with W the strength of a random walk:

    q   distance that the wheel would have rolled without slip at the assumed scale, m
    v   speed, dq/dt, m/s
    a   acceleration, dv/dt, a random walk, m/s²
    Σ   wheel slip, a random walk over the distance, m
    D   distance of the train less q, dD/dt = v δ, m
    δ   logarithm of the true over the assumed wheel scale, a random walk
    b   bias of the GNSS fixes, a first-order Gauss-Markov process, m
    o   length error of a line that is known only from GNSS fixes, a random walk, m

The acceleration's random walk belongs to q, not to the distance q + D: otherwise a run with many changes of the
acceleration would make a smaller wheel more likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.chain import GaussMarkovChain, wiener_acceleration
from trackprofile.positioning.position_observations import (
    PositionObservations,
    Source,
    StandstillInterval,
)
from trackprofile.preprocessing.motion import ACCELERATION_WALK

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Q, V, A, SLIP, D, SCALE, BIAS, LENGTH_ERROR = range(8)
"""Indices of the states."""

NODE_INTERVAL = 1.0
"""s, longest interval between nodes, unless that makes more than `MAX_NODES_PER_OBSERVATION`."""

MAX_NODES_PER_OBSERVATION = 50

POSITION_STD = 1000.0
"""m, prior standard deviation of the initial position, and of the slip while the odometer fails."""

SPEED_STD = 30.0
"""m/s, prior standard deviation of the initial speed."""

ACCELERATION_STD = 1.0
"""m/s², prior standard deviation of the initial acceleration, and of its change at the ends of a standstill."""

SLIP_WALK = 0.01
"""m/√m, random walk of a rolling wheel against the rail: its rolling radius changes by some 0.01 % over some 100 m with
its lateral displacement on the rail."""

SCALE_WALK = 3e-6
"""1/√s, random walk of the logarithm of the wheel scale by wear and temperature."""

GNSS_BIAS_STD = 1.5
"""m, typical standard deviation of the bias of GNSS fixes."""

GNSS_BIAS_TIME = 100.0
"""s, correlation time of the bias of GNSS fixes."""

LENGTH_WALK = 0.15
"""m/√s, random walk of the length error of a line that is known only from GNSS fixes."""

LONG_GAP_ERROR = 0.1
"""Standard deviation of the length error over the length of a long gap between fixes, in a curve."""

SHORT_GAP_ERROR = 4.6e-8
"""1/m², the same over the cube of the length of a short gap: 1 % of the error in a curve of 300 m radius."""

STANDSTILL_STD = 1e-3
"""m/s, standard deviation of the speed at standstill."""

_OBSERVED_STATES = {
    Source.GNSS_POSITION: (Q, D, BIAS, LENGTH_ERROR),
    Source.GNSS_SPEED: (V,),
    Source.ODOMETRY: (Q, SLIP),
    Source.DISPLAYED_SPEED: (V,),
    Source.POST: (Q, D),
    Source.STANDSTILL: (V,),
}


@dataclass(frozen=True)
class PositionPrior:
    """Prior of the initial state and the values about which the model is linearised.

    Parameters
    ----------
    scale_std : standard deviation of the logarithm of the wheel's true over its nominal diameter; 0: no wheel
    start, start_std : position at the first node and its standard deviation, m
    own_line : whether the line is known only from GNSS fixes, and not in long gaps between them
    anchored : whether this line starts at the first fix; else its origin is unknown by `POSITION_STD`
    bias_std : standard deviation of the bias of GNSS fixes, m
    bias_stated : whether that is known; else the data determine it
    scale : assumed wheel scale, true over nominal diameter
    """

    scale_std: float
    start: float
    start_std: float
    own_line: bool = False
    anchored: bool = True
    bias_std: float = GNSS_BIAS_STD
    bias_stated: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class ObservationRows:
    """Observations of all sources in the order of time.

    Parameters
    ----------
    time : (n,), times of the nodes, s
    source, node, value, variance, stated : (rows,), see `PositionObservations`; node of each row
    ends_standstill : (n - 1,), whether a standstill starts or ends in the step
    odometer_fails : (n - 1,), whether the odometer fails in the step
    """

    time: Array
    source: NDArray[np.object_]
    node: NDArray[np.int64]
    value: Array
    variance: Array
    stated: Mask
    ends_standstill: Mask
    odometer_fails: Mask

    def measured_by(self, source: Source) -> Mask:
        """Rows of one source, (rows,)."""
        return self.source == source


@dataclass(frozen=True)
class WheelIntervals:
    """Intervals of time, s, in which the wheel does not turn.

    Parameters
    ----------
    standstills : in which the train does not move either
    failures : in which the train moves and the odometer fails
    """

    standstills: Sequence[StandstillInterval] = ()
    failures: Sequence[StandstillInterval] = ()


def observation_rows(
    observations: Sequence[PositionObservations],
    intervals: WheelIntervals,
    span: tuple[float, float],
) -> ObservationRows:
    """All observations, and zero speeds at standstill, at the nodes.

    Parameters
    ----------
    observations : at most one per source
    span : first and last time for which the position is wanted, s
    """
    time = _nodes([one.time for one in observations], span)
    standing = np.zeros(len(time), bool)
    ends, fails = np.zeros(len(time) - 1, bool), np.zeros(len(time) - 1, bool)
    for interval in intervals.standstills:
        standing |= (time >= interval[0]) & (time <= interval[1])
        for end in interval:
            ends |= (time[1:] > end - NODE_INTERVAL) & (time[:-1] < end + NODE_INTERVAL)
    for start, end in intervals.failures:
        fails |= (time[1:] > start) & (time[:-1] < end)
    count = np.count_nonzero(standing)
    zero_speed = PositionObservations(
        Source.STANDSTILL, time[standing], np.zeros(count), np.full(count, STANDSTILL_STD**2)
    )
    every = [*observations, zero_speed]
    node = np.searchsorted(time, np.concatenate([one.time for one in every]))
    order = np.argsort(node, kind="stable")
    source = np.concatenate([np.full(len(one.time), one.source, object) for one in every])
    stated = np.concatenate([np.full(len(one.time), one.stated) for one in every])
    value = np.concatenate([one.value for one in every])
    variance = np.concatenate([one.variance for one in every])
    return ObservationRows(
        time, source[order], node[order], value[order], variance[order], stated[order], ends, fails
    )


def _nodes(times: Sequence[Array], span: tuple[float, float]) -> Array:
    """Times of the nodes, s: those of all observations and a regular grid."""
    start = min(span[0], *(float(one[0]) for one in times if len(one)))
    end = max(span[1], *(float(one[-1]) for one in times if len(one)))
    limit = MAX_NODES_PER_OBSERVATION * sum(map(len, times))
    count = 2 + int(min((end - start) / NODE_INTERVAL, limit))
    return np.unique(np.concatenate([np.linspace(start, end, count), *times]))


def position_chain(
    rows: ObservationRows, prior: PositionPrior, speed: Array, slip: Array, jerk: Array
) -> tuple[GaussMarkovChain, Array]:
    """Model linearised about a speed.

    Parameters
    ----------
    speed : (n,), at the nodes, m/s
    slip, jerk : (n - 1,), variances of a jump of the slip, m², and of the acceleration, (m/s²)², at the end of
        each step

    Returns
    -------
    chain
    values : (rows,), observations as the chain's states predict them
    """
    dt = np.diff(rows.time)
    distance = 0.5 * (speed[1:] + speed[:-1]) * dt
    F, noise = _transitions(dt, distance, prior)
    if prior.own_line:
        noise[:, LENGTH_ERROR, LENGTH_ERROR] = LENGTH_WALK**2 * dt + _gap_variance(rows, distance)
    noise[:, SLIP, SLIP] += slip + POSITION_STD**2 * rows.odometer_fails
    noise[:, A, A] += (
        jerk + ACCELERATION_STD**2 * np.minimum(dt / NODE_INTERVAL, 1.0) * rows.ends_standstill
    )
    values, h = rows.value.copy(), np.zeros((len(rows.node), 8))
    for source, states in _OBSERVED_STATES.items():
        h[np.ix_(rows.measured_by(source), states)] = 1.0
    gnss_speed = rows.measured_by(Source.GNSS_SPEED)
    h[gnss_speed, SCALE] = speed[rows.node[gnss_speed]]
    odometry = rows.measured_by(Source.ODOMETRY)
    values[odometry | rows.measured_by(Source.DISPLAYED_SPEED)] *= prior.scale
    mean, P = _initial_state(prior, float(speed[0]))
    if odometry.any():
        first = int(np.argmax(odometry))
        mean[SLIP] = values[first] - np.sum(distance[: rows.node[first]])
        P[SLIP, SLIP] = POSITION_STD**2
    return GaussMarkovChain(mean[:, None], P, F, noise, rows.node, h), values


def _initial_state(prior: PositionPrior, speed: float) -> tuple[Array, Array]:
    """Mean, (8,), and covariance, (8, 8), of the state at the first node, without the slip."""
    mean, P = np.zeros(8), np.zeros((8, 8))
    mean[V], P[V, V], P[A, A] = speed, SPEED_STD**2, ACCELERATION_STD**2
    mean[D], P[D, D] = prior.start, prior.start_std**2
    mean[SCALE], P[SCALE, SCALE] = -np.log(prior.scale), prior.scale_std**2
    P[BIAS, BIAS] = prior.bias_std**2
    P[LENGTH_ERROR, LENGTH_ERROR] = POSITION_STD**2 * (prior.own_line and not prior.anchored)
    return mean, P


def _transitions(dt: Array, distance: Array, prior: PositionPrior) -> tuple[Array, Array]:
    """Transition matrices and noise covariances of the steps, (steps, 8, 8) each."""
    F = np.tile(np.eye(8), (len(dt), 1, 1))
    noise = np.zeros_like(F)
    F[:, :3, :3], noise[:, :3, :3] = wiener_acceleration(dt, ACCELERATION_WALK)
    F[:, D, SCALE] = distance
    F[:, BIAS, BIAS] = np.exp(-dt / GNSS_BIAS_TIME)
    if prior.scale_std > 0.0:
        noise[:, SLIP, SLIP] = SLIP_WALK**2 * np.abs(distance)
        noise[:, SCALE, SCALE] = SCALE_WALK**2 * dt
    noise[:, BIAS, BIAS] = prior.bias_std**2 * (1.0 - F[:, BIAS, BIAS] ** 2)
    return F, noise


def _gap_variance(rows: ObservationRows, distance: Array) -> Array:
    """Variance, (steps,) m², of the length of a line in the gaps between the GNSS fixes that define it."""
    fixes = np.unique(rows.node[rows.measured_by(Source.GNSS_POSITION)])
    steps = np.arange(len(distance))
    gap = np.searchsorted(fixes, steps, side="right")
    length = np.bincount(gap, distance, minlength=len(fixes) + 1)
    error = np.minimum(LONG_GAP_ERROR * length, SHORT_GAP_ERROR * length**3)
    # The line ends at the first and at the last fix.
    error[[0, -1]] = 0.0
    return (error[gap] ** 2) * distance / np.maximum(length[gap], 1e-9)

"""A discretised run: the motion of the train in steps and bays, with one measurement row per valid sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.kalman.transition_kernels import COLUMNS, bay_transitions
from trackprofile.models.discretisation import step_table
from trackprofile.models.kinematics import Motion
from trackprofile.models.statespace import StateSpace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_STEP = 0.05
"""Maximum step, s: longer steps are divided, so that the paths remain cubics and the step table small."""


@dataclass(frozen=True)
class TimeSteps:
    """The motion divided into steps that cross at most one knot each.

    Parameters
    ----------
    interval : (steps,), s
    position, speed, acceleration : (steps + 1,), of the leading wheel, m, m/s, m/s²; the first is the start
    sample : (steps,), sample at the end of the step, or -1
    first_step : (bays + 1,), first step of each bay
    """

    interval: Array
    position: Array
    speed: Array
    acceleration: Array
    sample: Indices
    first_step: Indices


@dataclass(frozen=True)
class DiscretisedRun:
    """Transitions and measurement rows of a run; see :mod:`trackprofile.kalman.transition_kernels`.

    Parameters
    ----------
    F, G : (bays, n, n), (bays, n, columns), x ← F x + G c over each bay
    Q : (bays, n, n), covariance that unmodelled accelerations add by the end of each bay; (bays, 0, 0) without them
    bases : (bays, wheels), index of the first coefficient that each wheel reaches
    slots : (bays, columns), position of these coefficients in the state
    rows : (rows, n + columns), measurement rows over the state at the start of the bay
    first_row : (bays + 1,), first row of each bay
    samples, sensors : (rows,), sample and sensor of each row
    bay_position : (bays,), position of the leading wheel at the start of each bay, m
    spacing : distance between knots, m
    ring : number of coefficients in the state
    newest : index of the newest coefficient in the first bay
    start_position, start_speed : of the leading wheel, m, m/s
    walk : (bays, flicker + offsets), variance that flicker and offsets, the last states, gain in each bay
    offsets : number of offsets, one per sensor
    """

    F: Array
    G: Array
    Q: Array
    bases: Indices
    slots: Indices
    rows: Array
    first_row: Indices
    samples: Indices
    sensors: Indices
    bay_position: Array
    spacing: float
    ring: int
    newest: int
    start_position: float
    start_speed: float
    walk: Array
    offsets: int

    @property
    def first_knot(self) -> int:
        """Index of the first knot; its position is ``first_knot * spacing`` m."""
        return self.newest - self.ring + 1

    @property
    def knots(self) -> int:
        """Number of knots of the run."""
        return len(self.F) + self.ring - 3

    @property
    def knot_position(self) -> Array:
        """Position of every knot, (knots,) m."""
        return self.spacing * (self.first_knot + np.arange(self.knots, dtype=np.float64))


@dataclass(frozen=True)
class OffsetWalk:
    """Random walk of the offsets: ``duration`` (bays,) in s, and ``rate`` (sensors,) in the sensor's unit per √s."""

    duration: Array
    rate: Array


def discretise_run(
    system: StateSpace, motion: Motion, valid: NDArray[np.bool_], spacing: float
) -> DiscretisedRun:
    """Divide the motion into bays and compute the matrices of each bay.

    Parameters
    ----------
    motion : of the leading wheel, n samples
    valid : (n, sensors), samples that become measurement rows
    spacing : between knots, m
    """
    steps = time_steps(motion, spacing)
    wheels = system.wheel_positions
    ring = 5 + int(np.ceil(np.max(wheels) / spacing))
    samples, sensors = np.nonzero(valid)
    step_of_sample = np.flatnonzero(steps.sample >= 0)
    bay_of_sample = np.searchsorted(steps.first_step, step_of_sample, side="right") - 1
    count = len(steps.first_step) - 1
    first_row = np.searchsorted(bay_of_sample[samples], np.arange(count + 1)).astype(np.int64)
    n, columns = len(system.A), COLUMNS * len(wheels)
    F, G = np.empty((count, n, n)), np.empty((count, n, columns))
    Q = np.zeros((count, n, n) if system.disturbance.size else (count, 0, 0))
    rows = np.empty((len(samples), n + columns))
    first_position = steps.position[steps.first_step[:-1], None]
    bases = np.floor((first_position - wheels) / spacing).astype(np.int64)
    reached = (bases[:, :, None] + np.arange(COLUMNS)).reshape(count, columns)
    table = step_table(system, float(np.max(steps.interval)))
    newest = int(np.floor(steps.position[0] / spacing)) + 3
    bay_transitions(
        table.motion, table.noise, table.spacing, system.C, system.D, wheels, spacing,
        steps.interval, steps.position, steps.speed, steps.acceleration, steps.sample,
        steps.first_step, first_row, np.stack([samples, sensors], axis=1), bases,
        F, G, Q, rows,
    )  # fmt: skip
    return DiscretisedRun(
        F, G, Q, bases, n + reached % ring, rows, first_row, samples, sensors, first_position[:, 0],
        spacing, ring, newest,
        float(steps.position[0]), float(steps.speed[0]), _flicker_walk(system, F), len(system.C),
    )  # fmt: skip


def with_offset_variance(run: DiscretisedRun, variance: Array) -> DiscretisedRun:
    """The run with an additional variance of the offset walk, (bays, sensors)."""
    walk = run.walk.copy()
    walk[:, -run.offsets :] += variance
    return replace(run, walk=walk)


def _flicker_walk(system: StateSpace, F: Array) -> Array:
    """Variance that flicker gains in each bay to stay stationary, σ² (1 - e^(-2ωt)); 0 for the offsets."""
    count, offsets = len(system.flicker), len(system.C)
    states = np.arange(count) + len(system.A) - offsets - count
    walk = np.zeros((len(F), count + offsets))
    walk[:, :count] = system.flicker * (1.0 - np.square(F[:, states, states]))
    return walk


def time_steps(motion: Motion, spacing: float) -> TimeSteps:
    """Steps between the samples, divided where they are longer than ``MAX_STEP`` or cross several knots.

    The first step has zero length: it ends at the first sample.
    """
    bay = np.floor(motion.distance / spacing).astype(np.int64)
    crossed = np.diff(bay)
    # Equal parts of a step that crosses c knots are shorter than a bay if there are c + 1 of them.
    parts = np.where(crossed > 1, crossed + 1, 1)
    parts = np.maximum(parts, np.ceil(np.diff(motion.time) / MAX_STEP).astype(np.int64))
    parts = np.maximum(parts, np.ceil(np.diff(motion.distance) / spacing - 1e-9).astype(np.int64))
    parts = np.maximum(parts, 1)
    end = np.concatenate([[0], np.cumsum(parts)])
    grid = np.arange(end[-1] + 1)
    position = np.interp(grid, end, motion.distance)
    speed = np.interp(grid, end, motion.speed)
    acceleration = np.interp(grid, end, motion.acceleration)
    interval = np.concatenate(
        [[0.0], _intervals(np.diff(position), speed, np.diff(motion.time), parts)]
    )
    sample = np.full(len(grid), -1, np.int64)
    sample[end] = np.arange(len(end))
    entering = 1 + np.flatnonzero(np.diff(np.floor(position / spacing)) > 0)
    first_step = np.concatenate([[0], entering, [len(grid)]]).astype(np.int64)
    position, speed, acceleration = (
        np.concatenate([values[:1], values]) for values in (position, speed, acceleration)
    )
    return TimeSteps(interval, position, speed, acceleration, sample, first_step)


def _intervals(lengths: Array, speed: Array, durations: Array, parts: Indices) -> Array:
    """Durations of the parts of each step, by the mean speed of their ends, scaled to the recorded duration."""
    mean = 0.5 * (speed[1:] + speed[:-1])
    moving = (lengths > 0) & (mean > 0)
    guess = np.where(moving, lengths / np.where(moving, mean, 1.0), 1.0)
    start = np.concatenate([[0], np.cumsum(parts)[:-1]])
    return guess * np.repeat(durations / np.add.reduceat(guess, start), parts)

"""A ride: the train's motion cut into steps and bays, with one measurement row per valid sample."""

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

LONGEST_STEP = 0.05
"""s: longer steps are cut, so that the paths stay cubics and the step table small."""


@dataclass(frozen=True)
class TimeSteps:
    """The motion cut into steps that cross at most one knot each.

    ``position``, ``speed``, ``acceleration`` (steps + 1,) begin with the start; ``interval`` (steps,) in s;
    ``sample`` (steps,) is the sample at a step's end, or -1; ``first_step`` (bays + 1,) starts each bay.
    """

    interval: Array
    position: Array
    speed: Array
    acceleration: Array
    sample: Indices
    first_step: Indices


@dataclass(frozen=True)
class DiscretisedRun:
    """All that the recursions need of a ride; see :mod:`trackprofile.kalman.transition_kernels`.

    ``bases`` (bays, wheels) are the indices of the first coefficients that the wheels reach.
    ``Q`` (bays, n, n) is what unmodelled accelerations add by the end of each bay, empty (bays, 0, 0) where there
    are none. ``samples`` and ``sensors`` (rows,) say which sample and sensor each row is;
    ``bay_position`` (bays,) is where the leading wheel starts each bay, m; knots are counted from
    ``first_knot`` and lie ``spacing`` m apart. The last of the n states are the sensors' flicker and then their
    ``offsets``, as many as there are sensors: ``walk`` (bays, flicker + offsets) is the variance that they gain in each
    bay.
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
        """Index of the first knot: it stands at ``first_knot * spacing`` m."""
        return self.newest - self.ring + 1

    @property
    def knots(self) -> int:
        """How many knots the ride determines or passes."""
        return len(self.F) + self.ring - 3

    @property
    def knot_position(self) -> Array:
        """Position of every knot, (knots,) m."""
        return self.spacing * (self.first_knot + np.arange(self.knots, dtype=np.float64))


@dataclass(frozen=True)
class OffsetWalk:
    """Of the offsets: ``duration`` (bays,) in s, and ``rate`` (sensors,) in the sensor's unit per √s."""

    duration: Array
    rate: Array


def discretise_run(
    system: StateSpace, motion: Motion, valid: NDArray[np.bool_], spacing: float
) -> DiscretisedRun:
    """Cut the motion into bays and compute each bay's matrices.

    Parameters
    ----------
    motion : of the leading wheel, n samples
    valid : (n, sensors), which samples count
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
        float(steps.position[0]), float(steps.speed[0]), _walking(system, F), len(system.C),
    )  # fmt: skip


def with_offset_variance(ride: DiscretisedRun, variance: Array) -> DiscretisedRun:
    """The ride with offsets that walk by that variance more, (bays, sensors)."""
    walk = ride.walk.copy()
    walk[:, -ride.offsets :] += variance
    return replace(ride, walk=walk)


def _walking(system: StateSpace, F: Array) -> Array:
    """What flicker gains in each bay so that its variance stays, σ² (1 - e^(-2ωt)); offsets are constant so far."""
    count, offsets = len(system.flicker), len(system.C)
    states = np.arange(count) + len(system.A) - offsets - count
    walk = np.zeros((len(F), count + offsets))
    walk[:, :count] = system.flicker * (1.0 - np.square(F[:, states, states]))
    return walk


def time_steps(motion: Motion, spacing: float) -> TimeSteps:
    """Steps between the samples, cut where they are longer than ``LONGEST_STEP`` or cross several knots.

    The first step has no length: it ends at the first sample.
    """
    bay = np.floor(motion.distance / spacing).astype(np.int64)
    crossed = np.diff(bay)
    # Equal parts of a step that crosses c knots are shorter than a bay if there are c + 1 of them.
    parts = np.where(crossed > 1, crossed + 1, 1)
    parts = np.maximum(parts, np.ceil(np.diff(motion.time) / LONGEST_STEP).astype(np.int64))
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
    """Times of the parts of each step: at the mean speed of its ends, together as long as recorded."""
    mean = 0.5 * (speed[1:] + speed[:-1])
    moving = (lengths > 0) & (mean > 0)
    guess = np.where(moving, lengths / np.where(moving, mean, 1.0), 1.0)
    start = np.concatenate([[0], np.cumsum(parts)[:-1]])
    return guess * np.repeat(durations / np.add.reduceat(guess, start), parts)

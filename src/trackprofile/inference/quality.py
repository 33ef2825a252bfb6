"""Quality flags of every knot of an inferred profile."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from trackprofile.bands import D1, Band, edge_distance
from trackprofile.contracts import Quality
from trackprofile.inference.observations import KNOT_SPACING, Observations
from trackprofile.inference.problem import Model, leading_wheel_motion
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.models.spectrum import Spectrum, markov_process
from trackprofile.models.vehicle import Vehicle
from trackprofile.preprocessing.faults import GAP_RATIO

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SLOW = 3.0
"""Speed below which the accelerations of long waves are smaller than any sensor's drift, m/s."""

UNINFORMED = 0.7
"""Share of the prior's standard deviation in D1 from which a knot counts as not measured."""

INNOVATION_RATIO = 3.0
"""RMS of normalised innovations from which the signals count as unexpected."""

UNEXPLAINED = 0.3
"""Share of a signal's RMS that the residual must exceed: a small misfit of a quiet sensor does no harm."""

WINDOW = 2.5
"""Distance to each side over which innovations and residuals are averaged, m."""

REACH = 4 * KNOT_SPACING
"""Distance to each side of a sample for which it is informative, m."""


def quality(
    position: Array, bands: Mapping[str, Array], data: Observations, model: Model, *, unexplained: Mask,
    faulty: Mask, ends: tuple[float, float],
) -> NDArray[np.int16]:  # fmt: skip
    """Flags of every knot, (knots,).

    Parameters
    ----------
    position : (knots,), m
    bands : standard deviation in each band, (knots,), m
    unexplained : (samples, sensors), see :func:`unexplained_samples`
    faulty : (samples, sensors), left out or down-weighted
    ends : of the whole run, m
    """
    run = leading_wheel_motion(data, model).distance
    flags = np.zeros(len(position), np.int16)
    flags[~reached(position, run[data.valid.any(axis=1)], model.vehicle, None)] |= Quality.GAP
    if "D1" in bands:
        unmeasured = _prior_deviation(model.spectrum, D1)
        flags[bands["D1"] > UNINFORMED * unmeasured] |= Quality.UNCERTAIN
    edge = edge_distance(D1)
    flags[(position < ends[0] + edge) | (position > ends[1] - edge)] |= Quality.EDGE
    flags[np.interp(position, run, data.motion.speed) < SLOW] |= Quality.SLOW
    for flag, mask in (
        (Quality.SATURATED, data.saturated),
        (Quality.UNEXPLAINED, unexplained),
        (Quality.FAULTY, faulty),
    ):
        for i, sensor in enumerate(model.sensors):
            flags[reached(position, run[mask[:, i]], model.vehicle, sensor.body)] |= flag
    for valid, sensor in zip(data.valid.T, model.sensors, strict=True):
        flags[reached(position, inside_gaps(run[valid]), model.vehicle, sensor.body)] |= (
            Quality.FAULTY
        )
    return flags


def inside_gaps(sampled: Array) -> Array:
    """Positions in gaps between samples at ``sampled``, (m,) increasing, in m: beyond ``REACH`` of both ends.

    Examples
    --------
    >>> inside_gaps(np.array([0.0, 0.5, 1.0, 4.0, 4.5]))
    array([2.  , 2.25, 2.5 , 2.75, 3.  ])
    """
    apart = np.diff(sampled)
    gaps = (
        np.flatnonzero(apart > max(2 * REACH, GAP_RATIO * float(np.median(apart))))
        if len(apart)
        else []
    )
    inside = [
        np.arange(sampled[k] + REACH, sampled[k + 1] - REACH + 1e-9, KNOT_SPACING) for k in gaps
    ]
    return np.concatenate([np.zeros(0), *inside])


def unexplained_samples(
    data: Observations, run: DiscretisedRun, normalised: Array, *, residual: Array, counted: Mask
) -> Mask:
    """Samples, (samples, sensors), near which the model does not explain the signals.

    Within ``WINDOW`` of them the RMS of the normalised innovations exceeds ``INNOVATION_RATIO``, and the RMS of the
    residual exceeds ``UNEXPLAINED`` of the signal's; either alone does little harm.

    Parameters
    ----------
    normalised : (rows,), innovations over their expected standard deviations
    residual : (rows,), measured minus reproduced, in the signals' unit
    counted : (rows,), False for single outliers of the sensor
    """
    shape = data.signals.shape
    innovations, residuals = np.zeros(shape), np.zeros(shape)
    innovations[run.samples, run.sensors] = counted * np.square(normalised)
    residuals[run.samples, run.sensors] = counted * np.square(residual)
    used = np.zeros(shape)
    used[run.samples, run.sensors] = counted
    at = data.motion.distance
    low, high = np.searchsorted(at, at - WINDOW), np.searchsorted(at, at + WINDOW, side="right")

    def nearby(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, shape[1])), np.cumsum(values, axis=0)])
        return sums[high] - sums[low]

    count = np.maximum(nearby(used), 1.0)
    power = np.sum(used * np.square(data.signals - _means(data, used)), axis=0)
    power = power / np.maximum(used.sum(axis=0), 1.0)
    unexpected = nearby(innovations) > INNOVATION_RATIO**2 * count
    return unexpected & (nearby(residuals) > UNEXPLAINED**2 * power * count)


def _means(data: Observations, used: Array) -> Array:
    return np.sum(used * data.signals, axis=0) / np.maximum(used.sum(axis=0), 1.0)


def reached(position: Array, sampled: Array, vehicle: Vehicle, part: str | None) -> Mask:
    """Positions within ``REACH`` of where a wheel that carries the part (None: any wheel) ran at a sample.

    Parameters
    ----------
    position : (n,), m
    sampled : (m,), position of the leading wheel at the samples, increasing, m
    """
    near = np.zeros(len(position), bool)
    if not len(sampled):
        return near
    carriers = _supporting(vehicle, part) if part else {wheel.name for wheel in vehicle.wheels}
    for wheel in vehicle.wheels:
        if wheel.name not in carriers:
            continue
        at = np.concatenate([[-np.inf], sampled - wheel.position, [np.inf]])
        after = np.searchsorted(at, position)
        near |= np.minimum(at[after] - position, position - at[after - 1]) <= REACH
    return near


def _supporting(vehicle: Vehicle, part: str) -> set[str]:
    """The part, and all parts that support it."""
    parts, waiting = {part}, [part]
    while waiting:
        upper = waiting.pop()
        lower = {link.lower for link in vehicle.links if link.upper == upper} - parts
        parts |= lower
        waiting += lower
    return parts


def _prior_deviation(spectrum: Spectrum, band: Band) -> float:
    """Standard deviation of the prior in a band, m."""
    process = markov_process(spectrum, KNOT_SPACING)
    omega = np.linspace(2 * np.pi / band.longest, 2 * np.pi / band.shortest, 400)
    turn = np.exp(-1j * omega * KNOT_SPACING)
    density = process.innovation / np.abs(1 - process.a1 * turn - process.a2 * turn**2) ** 2
    return float(np.sqrt(np.trapezoid(density, omega) * KNOT_SPACING / np.pi))

"""How far each place of an inferred profile can be trusted: its flags, and why."""

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
from trackprofile.preprocessing.faults import GAP

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SLOW = 3.0
"""m/s, below which accelerations of the track's long waves drown in any sensor's drift."""

UNINFORMED = 0.7
"""Share of the prior's standard deviation in D1 from which a place counts as not measured."""

SURPRISE = 3.0
"""Standard deviations by which the innovations have to be beyond what the model expects."""

UNEXPLAINED = 0.3
"""Share of a signal's root mean square that has to be left: a small misfit of a silent sensor harms nobody."""

NEAR = 2.5
"""m to each side, over which surprise and what is left are taken."""

FELT = 4 * KNOT_SPACING
"""m to each side of a sample that it tells of."""


def quality(
    place: Array, bands: Mapping[str, Array], data: Observations, model: Model, ride: DiscretisedRun, unexplained: Mask,
    faulty: Mask, ends: tuple[float, float],
) -> NDArray[np.int16]:  # fmt: skip
    """Flags of every knot.

    Parameters
    ----------
    place : (knots,), m
    bands : standard deviations in each, (knots,), m
    unexplained : (samples, sensors), see :func:`unexplained_samples`
    faulty : (samples, sensors), left out or weighted down
    ends : of the whole ride, m
    """
    run = leading_wheel_motion(data, model).distance
    flags = np.zeros(len(place), np.int16)
    flags[~felt_at(place, run[data.valid.any(axis=1)], model.vehicle, None)] |= Quality.GAP
    if "D1" in bands:
        unmeasured = _prior_spread(model.spectrum, ride, D1)
        flags[bands["D1"] > UNINFORMED * unmeasured] |= Quality.UNCERTAIN
    edge = edge_distance(D1)
    flags[(place < ends[0] + edge) | (place > ends[1] - edge)] |= Quality.EDGE
    flags[np.interp(place, run, data.motion.speed) < SLOW] |= Quality.SLOW
    for flag, marked in (
        (Quality.SATURATED, data.saturated),
        (Quality.UNEXPLAINED, unexplained),
        (Quality.FAULTY, faulty),
    ):
        for i, sensor in enumerate(model.sensors):
            flags[felt_at(place, run[marked[:, i]], model.vehicle, sensor.body)] |= flag
    for valid, sensor in zip(data.valid.T, model.sensors, strict=True):
        flags[felt_at(place, missed(run[valid]), model.vehicle, sensor.body)] |= Quality.FAULTY
    return flags


def missed(sampled: Array) -> Array:
    """Places inside gaps of samples that stand at ``sampled``, (m,) rising, in m: farther than usual from both sides.

    Examples
    --------
    >>> missed(np.array([0.0, 0.5, 1.0, 4.0, 4.5]))
    array([2.  , 2.25, 2.5 , 2.75, 3.  ])
    """
    apart = np.diff(sampled)
    gaps = (
        np.flatnonzero(apart > max(2 * FELT, GAP * float(np.median(apart)))) if len(apart) else []
    )
    inside = [
        np.arange(sampled[k] + FELT, sampled[k + 1] - FELT + 1e-9, KNOT_SPACING) for k in gaps
    ]
    return np.concatenate([np.zeros(0), *inside])


def unexplained_samples(
    data: Observations, ride: DiscretisedRun, surprise: Array, left: Array, counted: Mask
) -> Mask:
    """Samples, (samples, sensors), around which the model does not explain what was measured.

    Within ``NEAR`` of them the innovations are ``SURPRISE`` times as large as the model expects them, and what the
    smoothed profile leaves is more than ``UNEXPLAINED`` of the signal: either alone is a small matter.

    Parameters
    ----------
    surprise : (rows,), innovations in their standard deviations
    left : (rows,), measured less reproduced, in the signals' unit
    counted : (rows,), False for single samples that the sensor is to blame for
    """
    shape = data.signals.shape
    surprises, rest = np.zeros(shape), np.zeros(shape)
    surprises[ride.samples, ride.sensors] = counted * np.square(surprise)
    rest[ride.samples, ride.sensors] = counted * np.square(left)
    used = np.zeros(shape)
    used[ride.samples, ride.sensors] = counted
    at = data.motion.distance
    low, high = np.searchsorted(at, at - NEAR), np.searchsorted(at, at + NEAR, side="right")

    def nearby(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, shape[1])), np.cumsum(values, axis=0)])
        return sums[high] - sums[low]

    count = np.maximum(nearby(used), 1.0)
    usual = np.sum(used * np.square(data.signals - _means(data, used)), axis=0)
    usual = usual / np.maximum(used.sum(axis=0), 1.0)
    surprised = nearby(surprises) > SURPRISE**2 * count
    return surprised & (nearby(rest) > UNEXPLAINED**2 * usual * count)


def _means(data: Observations, used: Array) -> Array:
    return np.sum(used * data.signals, axis=0) / np.maximum(used.sum(axis=0), 1.0)


def felt_at(place: Array, sampled: Array, vehicle: Vehicle, part: str | None) -> Mask:
    """Where a wheel that carries the part (None: any wheel) ran within ``FELT`` of a sample.

    Parameters
    ----------
    place : (n,), m
    sampled : (m,), where the leading wheel stood at the samples, rising, m
    """
    felt = np.zeros(len(place), bool)
    if not len(sampled):
        return felt
    carriers = _below(vehicle, part) if part else {wheel.name for wheel in vehicle.wheels}
    for wheel in vehicle.wheels:
        if wheel.name not in carriers:
            continue
        at = np.concatenate([[-np.inf], sampled - wheel.position, [np.inf]])
        after = np.searchsorted(at, place)
        felt |= np.minimum(at[after] - place, place - at[after - 1]) <= FELT
    return felt


def _below(vehicle: Vehicle, part: str) -> set[str]:
    """The part, and all that it stands on."""
    found, waiting = {part}, [part]
    while waiting:
        upper = waiting.pop()
        lower = {link.lower for link in vehicle.links if link.upper == upper} - found
        found |= lower
        waiting += lower
    return found


def _prior_spread(spectrum: Spectrum, ride: DiscretisedRun, band: Band) -> float:
    """Standard deviation of the prior in a band, m."""
    process = markov_process(spectrum, ride.spacing)
    omega = np.linspace(2 * np.pi / band.longest, 2 * np.pi / band.shortest, 400)
    turn = np.exp(-1j * omega * ride.spacing)
    density = process.innovation / np.abs(1 - process.a1 * turn - process.a2 * turn**2) ** 2
    return float(np.sqrt(np.trapezoid(density, omega) * ride.spacing / np.pi))

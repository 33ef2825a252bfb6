"""Decomposition of a recording into the mean of both rails and their difference (cross level).

The mean of a left and a right signal depends on the mean profile m, their difference on the cross level c. On a vehicle
that is symmetric about its longitudinal axis the two are independent, since noises of equal density left and right have
independent sums and differences. Each is inferred separately by the same smoother, on the vehicle and on the rolling
vehicle (:mod:`trackprofile.models.roll`), and r_L = m + c/2, r_R = m - c/2. Where the noise densities differ, the
errors of m and c are correlated: the uncertainty of either rail then assumes the worse sign.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd

from trackprofile.bands import D2
from trackprofile.contracts import Quality, Rail, RailLevel
from trackprofile.errors import DataError
from trackprofile.inference.blocks import BlockResult
from trackprofile.inference.observations import Observations
from trackprofile.models.roll import (
    RailMode,
    RollVehicle,
    SensorPair,
    missing_roll_parameters,
    noise_correlation,
    rail_modes,
    sensor_pairs,
)
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Installation, Sensor, Uncertainty
from trackprofile.models.track import PointTrack, RigidTrack
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

MIN_COMMON_SHARE = 0.5
"""Minimum share of the samples of either side that are valid on both, for two sensors to be a pair."""

OPPOSITE_CORRELATION = 0.3
"""Size of a negative correlation of a pair in D2 from which one sensor has the wrong sign: independent rails give 0."""

SIGNIFICANCE = 3.0
"""Standard deviations by which that correlation must differ from 0."""

SEGMENT_LENGTH = 256
"""Length of a spectral segment, m."""


@dataclass(frozen=True)
class RailDecomposition:
    """A recording decomposed into the mean of both rails and their difference.

    Parameters
    ----------
    recorded : observations of the sensors on board
    mean, difference : observations of either mode; None where the sensors do not determine the difference
    modes : virtual sensors of mean and difference
    noise_correlation : largest correlation of the noise of mean and difference over the pairs
    """

    recorded: Observations
    mean: Observations
    difference: Observations | None
    modes: tuple[RailMode, RailMode]
    noise_correlation: float = 0.0

    def sensor_signals(self, mean: Array, difference: Array | None) -> dict[str, Array]:
        """Signals of each sensor on board by name, from those of mean and difference, (samples, sensors) each."""
        parts = [(self.modes[0], mean)]
        if difference is not None:
            parts.append((self.modes[1], difference))
        signals = {}
        for i, one in enumerate(self.recorded.sensors):
            needed = sum(np.count_nonzero(mode.weights[i]) for mode in self.modes)
            terms = [
                mode.shares[k, i] * values[:, k]
                for mode, values in parts
                for k in np.flatnonzero(mode.weights[i])
            ]
            if len(terms) == needed:
                signals[one.name] = np.sum(terms, axis=0)
        return signals


def decompose_rails(
    data: Observations, vehicle: Vehicle, track: PointTrack, installation: Installation
) -> RailDecomposition:
    """Decompose a recording into the parts that the mean and the difference of both rails cause.

    Raises
    ------
    DataError
        Where only roll was measured, or the two sensors of a pair have opposite signs.
    """
    pairs, sides = _sides(data, installation)
    mean, difference = rail_modes(sides, pairs, vehicle.contact_spacing)
    mean_data = _mean(data, pairs, mean)
    if not difference.sensors:
        return RailDecomposition(data, mean_data, None, (mean, difference))
    unknown = missing_roll_parameters(vehicle, track)
    if unknown:
        wheels = {one.name for one in vehicle.wheels if isinstance(track, RigidTrack)}
        difference = difference.select([one.body in wheels for one in difference.sensors])
        note = _unknown(unknown, vehicle, per_rail=bool(difference.sensors))
        mean_data = replace(mean_data, notes=(*mean_data.notes, note))
    if not difference.sensors:
        return RailDecomposition(data, mean_data, None, (mean, difference))
    of_difference = replace(_combined(data, difference), faults=(), notes=())
    correlation = max(
        (abs(noise_correlation(sides[p.left], sides[p.right], p)) for p in pairs), default=0.0
    )
    return RailDecomposition(data, mean_data, of_difference, (mean, difference), correlation)


def mean_observations(
    data: Observations, vehicle: Vehicle, installation: Installation
) -> Observations:
    """The part of a recording that the mean of both rails causes; all of it where no sensor has a lateral offset.

    Raises
    ------
    DataError
        As :func:`decompose_rails`.
    """
    pairs, sides = _sides(data, installation)
    return _mean(data, pairs, rail_modes(sides, pairs, vehicle.contact_spacing)[0])


def _sides(data: Observations, installation: Installation) -> tuple[list[SensorPair], list[Sensor]]:
    """The pairs of a recording, and its sensors, each of a calibrated pair with the noise of one of two sides."""
    pairs = [
        pair for pair in sensor_pairs(data.sensors) if _common_share(data, pair) >= MIN_COMMON_SHARE
    ]
    for pair in pairs:
        _check_signs(data, pair)
    both = {number for pair in pairs for number in (pair.left, pair.right)}
    return pairs, [
        _one_side(one) if i in both and _is_calibrated(one, installation) else one
        for i, one in enumerate(data.sensors)
    ]


def _mean(data: Observations, pairs: list[SensorPair], mode: RailMode) -> Observations:
    if not mode.sensors:
        raise DataError(
            "Only roll was measured, which determines the difference of both rails but not their mean; add a vertical "
            "acceleration or a pitch rate."
        )
    notes = (
        *data.notes, *_unpaired(data, pairs),
        *(_left_out(data, pair) for pair in pairs if not _always_common(data, pair)),
    )  # fmt: skip
    combined = data if mode.sensors == data.sensors else _combined(data, mode)
    return replace(combined, notes=notes)


def difference_installation(
    installation: Installation, vehicle: Vehicle, car: RollVehicle, data: Observations
) -> Installation:
    """The part of a calibration that applies to the difference: position, and the parameters that act in roll."""
    first = car.bodies[0].name if car.bodies else None
    on_body = any(
        (one.body, one.quantity) == (first, VERTICAL_ACCELERATION) for one in data.sensors
    )
    uncertainty = installation.uncertainty
    if uncertainty is not None:
        lost = {one.name for one in vehicle.parameters} - {one.name for one in car.parameters}
        kept = [
            i
            for i, name in enumerate(uncertainty.names)
            if name not in lost and not name.startswith(("position of ", "tilt of "))
        ]
        rows = tuple(tuple(uncertainty.covariance[i][j] for j in kept) for i in kept)
        uncertainty = Uncertainty(tuple(uncertainty.names[i] for i in kept), rows)
    unmodelled = installation.unmodelled if on_body else None
    return replace(installation, unmodelled=unmodelled, uncertainty=uncertainty)


def rail_levels(
    mean: BlockResult, difference: BlockResult, noise_correlation: float
) -> Mapping[Rail, RailLevel]:
    """Elevation and standard deviation of left rail, right rail and difference, m.

    var r = var m + var c / 4 + |ρ| √(var m · var c), with ρ the correlation of the noise of mean and difference; ρ = 1
    where faulty samples were down-weighted, which may be those of one side only.
    """
    faulty = ((mean.flags | difference.flags) & Quality.FAULTY) != 0
    correlation = np.where(faulty, 1.0, noise_correlation)

    def side(m: Array, c: Array) -> Array:
        return np.sqrt(m**2 + 0.25 * c**2 + correlation * m * c)

    bands = {
        name: side(mean.bands[name], difference.bands[name])
        for name in mean.bands
        if name in difference.bands
    }
    deviation = side(mean.standard_deviation, difference.standard_deviation)
    half = 0.5 * difference.elevation
    return {
        Rail.LEFT: RailLevel(mean.elevation + half, deviation, bands),
        Rail.RIGHT: RailLevel(mean.elevation - half, deviation, bands),
        Rail.DIFFERENCE: RailLevel(
            difference.elevation, difference.standard_deviation, difference.bands
        ),
    }


def _common_share(data: Observations, pair: SensorPair) -> float:
    """Share of the samples of either side that are valid on both."""
    left, right = data.valid[:, pair.left], data.valid[:, pair.right]
    return float(np.count_nonzero(left & right) / max(np.count_nonzero(left | right), 1))


def _always_common(data: Observations, pair: SensorPair) -> bool:
    return bool(np.array_equal(data.valid[:, pair.left], data.valid[:, pair.right]))


def _names(data: Observations, pair: SensorPair) -> str:
    return f"{data.sensors[pair.left].name!r} and {data.sensors[pair.right].name!r}"


def _left_out(data: Observations, pair: SensorPair) -> str:
    single = data.valid[:, pair.left] != data.valid[:, pair.right]
    at = data.motion.distance[single]
    return (
        f"only one of {_names(data, pair)} is valid in {len(at)} samples from {at[0]:.0f} to {at[-1]:.0f} m: they are "
        "left out, since one side alone determines neither the mean nor the difference"
    )


def _unpaired(data: Observations, pairs: list[SensorPair]) -> list[str]:
    """A sentence for each accelerometer with a lateral offset that has no partner."""
    paired = {number for pair in pairs for number in (pair.left, pair.right)}
    return [
        f"{one.name!r} is mounted {abs(one.lateral):g} m to the {'left' if one.lateral > 0 else 'right'} and has no "
        "partner on the other side at the same position, of the same bandwidth and valid at the same time: the "
        "acceleration that roll adds to it is taken for profile"
        for i, one in enumerate(data.sensors)
        if one.lateral and one.quantity == VERTICAL_ACCELERATION and i not in paired
    ]


def _unknown(unknown: tuple[str, ...], vehicle: Vehicle, *, per_rail: bool) -> str:
    named = ", ".join(unknown[:3]) + (f" and {len(unknown) - 3} more" if len(unknown) > 3 else "")
    what = (
        "the rails are separated by the sensors on wheelsets alone"
        if per_rail
        else "no profile per rail"
    )  # fmt: skip
    return f"{what}: vehicle {vehicle.name!r} does not state {named}"


def _check_signs(data: Observations, pair: SensorPair) -> None:
    """Refuse a pair that measures long waves, in which both rails move together, with opposite signs."""
    good = data.valid[:, pair.left] & data.valid[:, pair.right]
    metre = np.floor(data.motion.distance[good]).astype(np.intp)
    metre -= metre[0]
    count = np.bincount(metre)
    passed, size = np.flatnonzero(count), min(SEGMENT_LENGTH, len(count))
    if size < 2 * D2.longest:
        return
    signals = [
        np.interp(
            np.arange(len(count)), passed,
            np.bincount(metre, data.signals[good, number])[passed] / count[passed],
        )
        for number in (pair.left, pair.right)
    ]  # fmt: skip
    f = np.fft.rfftfreq(size)
    long = (f > 1 / D2.longest) & (f < 1 / D2.shortest)
    both, left, right = (
        float(np.sum(np.real(csd(one, other, 1.0, "hann", size, detrend="linear")[1])[long]))
        for one, other in (signals, 2 * signals[:1], 2 * signals[1:])
    )
    independent = np.count_nonzero(long) * len(count) / size
    threshold = max(OPPOSITE_CORRELATION, float(np.tanh(SIGNIFICANCE / np.sqrt(independent))))
    if both < -threshold * np.sqrt(left * right):
        raise DataError(
            f"The signs of {_names(data, pair)} contradict each other: where one measures upwards the other measures "
            "downwards; find out which is mounted upside down (at rest an accelerometer reads gravity upwards), and "
            "change its sign in the recording."
        )


def _is_calibrated(sensor: Sensor, installation: Installation) -> bool:
    return any(
        (one.quantity, one.body) == (sensor.quantity, sensor.body) for one in installation.sensors
    )


def _one_side(sensor: Sensor) -> Sensor:
    """One of two sensors whose mean has the calibrated noise: √2 times as noisy."""
    root = float(np.sqrt(2.0))
    noise = sensor.noise_density
    return replace(
        sensor,
        noise_density=None if noise is None else root * noise,
        offset=root * sensor.offset_standard_deviation,
        drift=root * sensor.drift_rate,
        flicker=None if sensor.flicker is None else root * sensor.flicker,
    )


def _combined(data: Observations, mode: RailMode) -> Observations:
    """Observations of a mode's virtual sensors, valid where all sensors that contribute are."""
    used = mode.weights != 0.0
    valid = ~(~data.valid @ used)
    squares = np.square(mode.weights)
    parts = np.square(mode.weights / np.sum(np.abs(mode.weights), axis=0))
    doubts = np.sqrt(np.square(data.gain_doubt) @ parts)
    return replace(
        data,
        sensors=mode.sensors,
        signals=np.where(valid, data.signals @ mode.weights, 0.0),
        valid=valid,
        step=np.sqrt(np.square(data.step) @ squares).astype(np.float32),
        saturated=data.saturated @ used,
        faulty=data.faulty @ used,
        gain_doubt=tuple(map(float, doubts)),
        by_gravity=tuple(map(bool, ~(~np.array(data.by_gravity) @ used))),
    )

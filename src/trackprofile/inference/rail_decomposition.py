"""Both rails apart: what sensors left and right have in common is the mean's, what they differ by the cross level's.

On a car that is alike on both sides the two are independent: noises of equal density left and right have independent
sums and differences. So each is inferred by itself, by the same smoother, on the car and on the rolling car
(:mod:`trackprofile.models.roll`), and r_L = m + c/2, r_R = m - c/2. Where noises are not alike the errors of m and c
hang together: then the uncertainty of either rail allows for the worse sign.
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

TOGETHER = 0.5
"""Share of the samples of either side at which both are good, from which two sensors are a pair."""

AGAINST = 0.3
"""Size of a negative correlation of a pair in D2 from which one of them is turned round: even rails that have nothing
in common make it 0."""

SURELY = 3.0
"""Standard deviations that it has to be away from 0."""

PIECE = 256
"""m, over which spectra are taken for that."""


@dataclass(frozen=True)
class RailDecomposition:
    """A recording, taken apart.

    Parameters
    ----------
    recorded : as the sensors have it
    mean, difference : what of it is the mean's, and the difference's; None where that is not told
    halves : the sensors of both
    shared : correlation of the noise of mean and difference, of the pair where it is greatest
    """

    recorded: Observations
    mean: Observations
    difference: Observations | None
    halves: tuple[RailMode, RailMode]
    shared: float = 0.0

    def of_sensors(self, mean: Array, difference: Array | None) -> dict[str, Array]:
        """Signals of each sensor on board, by its name, from those of mean and difference, (samples, sensors) each."""
        parts = [(self.halves[0], mean)]
        if difference is not None:
            parts.append((self.halves[1], difference))
        found = {}
        for i, one in enumerate(self.recorded.sensors):
            needed = sum(np.count_nonzero(half.weights[i]) for half in self.halves)
            terms = [
                half.shares[k, i] * values[:, k]
                for half, values in parts
                for k in np.flatnonzero(half.weights[i])
            ]
            if len(terms) == needed:
                found[one.name] = np.sum(terms, axis=0)
        return found


def decompose_rails(
    data: Observations, vehicle: Vehicle, track: PointTrack, installation: Installation
) -> RailDecomposition:
    """Take a recording apart into what the mean of both rails makes, and what their difference does.

    Raises
    ------
    DataError
        Where nothing but roll was measured, or the two of a pair contradict each other.
    """
    pairs, sides = _sides(data, installation)
    mean, difference = rail_modes(sides, pairs, vehicle.contact_spacing)
    of_mean = _of_mean(data, pairs, mean)
    if not difference.sensors:
        return RailDecomposition(data, of_mean, None, (mean, difference))
    unknown = missing_roll_parameters(vehicle, track)
    if unknown:
        wheels = {one.name for one in vehicle.wheels if isinstance(track, RigidTrack)}
        difference = difference.select([one.body in wheels for one in difference.sensors])
        said = _unknown(unknown, vehicle, told=bool(difference.sensors))
        of_mean = replace(of_mean, notes=(*of_mean.notes, said))
    if not difference.sensors:
        return RailDecomposition(data, of_mean, None, (mean, difference))
    of_both = replace(_combined(data, difference), faults=(), notes=())
    shared = max(
        (abs(noise_correlation(sides[p.left], sides[p.right], p)) for p in pairs), default=0.0
    )
    return RailDecomposition(data, of_mean, of_both, (mean, difference), shared)


def mean_observations(
    data: Observations, vehicle: Vehicle, installation: Installation
) -> Observations:
    """What of a recording the mean of both rails makes; the recording itself where no sensor stands to one side.

    Raises
    ------
    DataError
        As of :func:`by_rail`.
    """
    pairs, sides = _sides(data, installation)
    return _of_mean(data, pairs, rail_modes(sides, pairs, vehicle.contact_spacing)[0])


def _sides(data: Observations, installation: Installation) -> tuple[list[SensorPair], list[Sensor]]:
    """The pairs of a recording, and its sensors, those of a pair as one of two sides."""
    pairs = [pair for pair in sensor_pairs(data.sensors) if _together(data, pair) >= TOGETHER]
    for pair in pairs:
        _check_signs(data, pair)
    both = {number for pair in pairs for number in (pair.left, pair.right)}
    return pairs, [
        _one_side(one) if i in both and _is_calibrated(one, installation) else one
        for i, one in enumerate(data.sensors)
    ]


def _of_mean(data: Observations, pairs: list[SensorPair], half: RailMode) -> Observations:
    if not half.sensors:
        raise DataError(
            "Only roll was measured, which tells the difference of both rails and not their mean; add a vertical "
            "acceleration or a pitch rate."
        )
    notes = (
        *data.notes, *_alone(data, pairs),
        *(_left_out(data, pair) for pair in pairs if not _always(data, pair)),
    )  # fmt: skip
    changed = data if half.sensors == data.sensors else _combined(data, half)
    return replace(changed, notes=notes)


def difference_installation(
    installation: Installation, vehicle: Vehicle, car: RollVehicle, data: Observations
) -> Installation:
    """What of a calibration holds of the difference: where the train is, and what roll feels of the vehicle."""
    first = car.bodies[0].name if car.bodies else None
    on_body = any(
        (one.body, one.quantity) == (first, VERTICAL_ACCELERATION) for one in data.sensors
    )
    sure = installation.uncertainty
    if sure is not None:
        lost = {one.name for one in vehicle.parameters} - {one.name for one in car.parameters}
        kept = [
            i
            for i, name in enumerate(sure.names)
            if name not in lost and not name.startswith(("position of ", "tilt of "))
        ]
        rows = tuple(tuple(sure.covariance[i][j] for j in kept) for i in kept)
        sure = Uncertainty(tuple(sure.names[i] for i in kept), rows)
    return replace(
        installation, unmodelled=installation.unmodelled if on_body else None, uncertainty=sure
    )


def rail_levels(
    mean: BlockResult, difference: BlockResult, shared: float
) -> Mapping[Rail, RailLevel]:
    """Elevation and uncertainty of left, right and difference: var r = var m + var c / 4 + |ρ| √(var m · var c).

    ρ is the correlation of the noise of mean and difference; 1 where faulty samples were weighted down, which may
    have been those of one side.
    """
    doubtful = ((mean.flags | difference.flags) & Quality.FAULTY) != 0
    together = np.where(doubtful, 1.0, shared)

    def side(m: Array, c: Array) -> Array:
        return np.sqrt(m**2 + 0.25 * c**2 + together * m * c)

    bands = {
        name: side(mean.bands[name], difference.bands[name])
        for name in mean.bands
        if name in difference.bands
    }
    spread, half = side(mean.spread, difference.spread), 0.5 * difference.elevation
    return {
        Rail.LEFT: RailLevel(mean.elevation + half, spread, bands),
        Rail.RIGHT: RailLevel(mean.elevation - half, spread, bands),
        Rail.DIFFERENCE: RailLevel(difference.elevation, difference.spread, difference.bands),
    }


def _together(data: Observations, pair: SensorPair) -> float:
    """Share of the samples of either side at which both are good."""
    left, right = data.valid[:, pair.left], data.valid[:, pair.right]
    return float(np.count_nonzero(left & right) / max(np.count_nonzero(left | right), 1))


def _always(data: Observations, pair: SensorPair) -> bool:
    return bool(np.array_equal(data.valid[:, pair.left], data.valid[:, pair.right]))


def _names(data: Observations, pair: SensorPair) -> str:
    return f"{data.sensors[pair.left].name!r} and {data.sensors[pair.right].name!r}"


def _left_out(data: Observations, pair: SensorPair) -> str:
    lonely = data.valid[:, pair.left] != data.valid[:, pair.right]
    at = data.motion.distance[lonely]
    return (
        f"only one of {_names(data, pair)} is good in {len(at)} samples from {at[0]:.0f} to {at[-1]:.0f} m: they are "
        "left out, for alone they tell neither the mean nor the difference"
    )


def _alone(data: Observations, pairs: list[SensorPair]) -> list[str]:
    """Sentences on accelerometers to one side that have no partner."""
    paired = {number for pair in pairs for number in (pair.left, pair.right)}
    return [
        f"{one.name!r} stands {abs(one.lateral):g} m to the {'left' if one.lateral > 0 else 'right'} without another "
        "on the other side, at the same place, of the same bandwidth and good with it: what roll adds to it is read as "
        "profile"
        for i, one in enumerate(data.sensors)
        if one.lateral and one.quantity == VERTICAL_ACCELERATION and i not in paired
    ]


def _unknown(unknown: tuple[str, ...], vehicle: Vehicle, *, told: bool) -> str:
    named = ", ".join(unknown[:3]) + (f" and {len(unknown) - 3} more" if len(unknown) > 3 else "")
    what = (
        "both rails are told apart by the sensors on wheelsets alone" if told else "no profile per rail"
    )  # fmt: skip
    return f"{what}: vehicle {vehicle.name!r} does not state {named}"


def _check_signs(data: Observations, pair: SensorPair) -> None:
    """Refuse two that feel long waves, in which both rails go up and down together, in opposite directions."""
    good = data.valid[:, pair.left] & data.valid[:, pair.right]
    metre = np.floor(data.motion.distance[good]).astype(np.intp)
    metre -= metre[0]
    count = np.bincount(metre)
    passed, size = np.flatnonzero(count), min(PIECE, len(count))
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
    told = np.count_nonzero(long) * len(count) / size
    least = max(AGAINST, float(np.tanh(SURELY / np.sqrt(told))))
    if both < -least * np.sqrt(left * right):
        raise DataError(
            f"The signs of {_names(data, pair)} contradict each other: what the one feels upwards the other feels "
            "downwards; find out which is turned round (at rest an accelerometer reads gravity upwards), and turn it "
            "in the recording."
        )


def _is_calibrated(sensor: Sensor, installation: Installation) -> bool:
    return any(
        (one.quantity, one.body) == (sensor.quantity, sensor.body) for one in installation.sensors
    )


def _one_side(sensor: Sensor) -> Sensor:
    """One of two whose mean reads as a calibration found it: √2 times as noisy."""
    root = float(np.sqrt(2.0))
    noise = sensor.noise_density
    return replace(
        sensor,
        noise_density=None if noise is None else root * noise,
        offset=root * sensor.offset_standard_deviation,
        drift=root * sensor.drift_rate,
        flicker=None if sensor.flicker is None else root * sensor.flicker,
    )


def _combined(data: Observations, half: RailMode) -> Observations:
    """The readings of one half's sensors, good where all that they are made of are."""
    used = half.weights != 0.0
    valid = ~(~data.valid @ used)
    squares = np.square(half.weights)
    parts = np.square(half.weights / np.sum(np.abs(half.weights), axis=0))
    doubts = np.sqrt(np.square(data.gain_doubt) @ parts)
    return replace(
        data,
        sensors=half.sensors,
        signals=np.where(valid, data.signals @ half.weights, 0.0),
        valid=valid,
        step=np.sqrt(np.square(data.step) @ squares).astype(np.float32),
        saturated=data.saturated @ used,
        faulty=data.faulty @ used,
        gain_doubt=tuple(map(float, doubts)),
        by_gravity=tuple(map(bool, ~(~np.array(data.by_gravity) @ used))),
    )

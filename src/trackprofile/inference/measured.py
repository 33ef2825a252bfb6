"""What was measured, brought to what the smoother needs: motion of the leading wheel, sensors, signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.bands import runs
from trackprofile.contracts import Channel, channels
from trackprofile.errors import DataError, ModelError
from trackprofile.inference.ride import Ride, build_ride
from trackprofile.inference.smoother import Filter, Start, prepare, start_of_ride
from trackprofile.motion import Motion, along_track, motion, recorded_step
from trackprofile.sensor import VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.spectrum import Spectrum
from trackprofile.statespace import FILTER_STATES, StateSpace, state_space
from trackprofile.track import PointTrack, RigidTrack, Track
from trackprofile.vehicle import Vehicle

Array = NDArray[np.float64]

KNOT_SPACING = 0.25
"""m between the spline's knots: EN 13848-2 asks for a sampling distance of at most this."""

USUAL = Spectrum("level from the data", 1.5e-6, 0.0206, 0.4, "shape of FRA, knee of ")
"""Where the search for the prior starts: between FRA 6 and a good main line."""

LOCAL = 50.0
"""m to each side over which the strength of a signal is taken."""

FLAT = 3
"""Samples in a row."""

TINY = 1e-30
"""Of a signal that is constant, which then has no local strength either."""


@dataclass(frozen=True)
class Measured:
    """A recording, ready for any vehicle.

    Parameters
    ----------
    motion : of the point whose distance was recorded, n samples
    sensors : one per channel
    signals, valid : (n, sensors)
    step : (sensors,), in which each signal was recorded, 0 if as good as continuous
    saturated : (n, sensors), samples at the end of a sensor's range, which are not valid
    limits : (sensors,), Hz, above which nothing is left of a signal; None: all is there
    low_pass : per sensor, Hz, of a second-order Butterworth that the signal went through after it was recorded
    """

    motion: Motion
    sensors: tuple[Sensor, ...]
    signals: Array
    valid: NDArray[np.bool_]
    step: Array
    saturated: NDArray[np.bool_]
    limits: Array | None = None
    low_pass: tuple[float | None, ...] = ()


def measured(recording: xr.Dataset, installation: Installation) -> Measured:
    """Take a recording apart; calibrated sensors replace what the recording says of them."""
    parts = channels(recording)
    valid = np.stack([np.asarray(channel.valid, bool) for channel in parts], axis=1)
    signals = np.stack([channel.values for channel in parts], axis=1)
    saturated = np.stack(
        [at_end_of_range(channel.values, v) for channel, v in zip(parts, valid.T, strict=True)],
        axis=1,
    )
    valid &= ~saturated
    steps = [recorded_step(channel.values[valid[:, i]]) for i, channel in enumerate(parts)]
    sensors = tuple(_sensor(channel, installation.sensors) for channel in parts)
    return Measured(
        motion(recording), sensors, np.where(valid, signals, 0.0), valid, np.array(steps), saturated
    )


def at_end_of_range(values: Array, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Samples, (n,), at the end of a sensor's range: the greatest or the least of all, ``FLAT`` times or more in a row.

    A signal that is recorded in coarse steps stays at its greatest value too, but comes there and leaves by single
    steps; one that is cut off arrives with its whole slope.

    Examples
    --------
    >>> signal = np.sin(np.arange(40) / 3.0)
    >>> int(at_end_of_range(signal, np.ones(40, bool)).sum())
    0
    >>> int(at_end_of_range(np.clip(signal, -2.0, 0.8), np.ones(40, bool)).sum())
    8
    """
    found = np.zeros(len(values), bool)
    known = values[valid]
    step = recorded_step(known)
    for end in (np.max(known), np.min(known)) if len(known) else ():
        for run in runs(valid & (values == end)):
            beside = [
                values[i] for i in (run.start - 1, run.stop) if 0 <= i < len(values) and valid[i]
            ]
            far = max((abs(value - end) for value in beside), default=0.0)
            if run.stop - run.start >= FLAT and far > 1.5 * step:
                found[run] = True
    return found


def _sensor(channel: Channel, calibrated: Sequence[Sensor]) -> Sensor:
    for sensor in calibrated:
        if (sensor.quantity, sensor.body) == (channel.quantity, channel.body):
            return replace(sensor, name=channel.name)
    return Sensor(
        channel.name, channel.quantity, channel.body, channel.position, channel.noise_density,
        bandwidth=channel.bandwidth,
    )  # fmt: skip


def loading(track: Track) -> str:
    """What a profile found on that track is: without give, the path of the wheels is all there is to find."""
    return "loaded" if isinstance(track, RigidTrack) else "unloaded"


@dataclass(frozen=True)
class Model:
    """Everything that the likelihood of a recording depends on.

    All noise densities are given; ``unmodelled`` and ``distance_scale`` are those of
    :class:`trackprofile.sensor.Installation`.
    """

    vehicle: Vehicle
    track: PointTrack
    sensors: tuple[Sensor, ...]
    origin: float
    unmodelled: float
    spectrum: Spectrum
    distance_scale: float = 1.0


def moved(data: Measured, model: Model) -> Motion:
    """How the leading wheel moved along the track."""
    return along_track(data.motion, model.origin, model.distance_scale)


def own_acceleration(sensors: Sequence[Sensor], motion: Motion) -> Array:
    """What tilted sensors read of the train's own acceleration, (n, sensors)."""
    return np.outer(motion.acceleration, [sensor.gain_across for sensor in sensors])


def filtered_sensors(data: Measured, model: Model) -> tuple[Sensor, ...]:
    """The model's sensors, with the low-passes that the signals went through."""
    if not data.low_pass:
        return model.sensors
    return tuple(
        replace(sensor, bandwidth=frequency) if frequency else sensor
        for sensor, frequency in zip(model.sensors, data.low_pass, strict=True)
    )


def ride_of(data: Measured, model: Model) -> tuple[StateSpace, Ride]:
    """The ride of the model's vehicle through the recorded motion.

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    """
    along = moved(data, model)
    run, length = along.distance[-1] - along.distance[0], model.vehicle.length
    if run < max(length, 4 * KNOT_SPACING):
        raise DataError(
            f"The recording covers {run:.1f} m, but from the first to the last wheel of "
            f"{model.vehicle.name!r} there are {length:.1f} m; record a longer stretch."
        )
    loud = loudness(data)
    shaking = unmodelled_deviation(data, model)
    system = state_space(
        model.vehicle, model.track, filtered_sensors(data, model), shaking, tuple(loud)
    )
    ride = build_ride(system, along, data.valid, KNOT_SPACING)
    if system.disturbance.shape[1] > 0:
        local = np.interp(ride.bay_position, along.distance, local_loudness(data, loud))
        ride = replace(ride, Q=ride.Q * np.square(local)[:, None, None])
    return system, _with_drift(ride, along, model.sensors)


def _with_drift(ride: Ride, motion: Motion, sensors: Sequence[Sensor]) -> Ride:
    """The offsets, last of the states, walk by drift² · duration in each bay."""
    drift = np.array([sensor.drift or 0.0 for sensor in sensors])
    if not np.any(drift > 0.0):
        return ride
    entered = np.interp(ride.bay_position, motion.distance, motion.time)
    duration = np.diff(entered, append=motion.time[-1])
    offsets = np.arange(-len(sensors), 0)
    Q = ride.Q.copy() if ride.Q.size else np.zeros_like(ride.F)
    Q[:, offsets, offsets] += np.outer(np.maximum(duration, 0.0), drift**2)
    return replace(ride, Q=Q)


def loudness(data: Measured) -> Array:
    """Root mean square of each signal about its mean, (sensors,)."""
    columns = range(data.signals.shape[1])
    return np.array([np.std(data.signals[data.valid[:, i], i]) for i in columns], dtype=np.float64)


def local_loudness(data: Measured, loud: Array) -> Array:
    """Root mean square of the signals within ``LOCAL`` m of each sample, in units of the whole recording's.

    What a rigid, linear car leaves out grows with what excites it.
    """
    mean = np.array([np.mean(data.signals[v, i]) for i, v in enumerate(data.valid.T)])
    squares = np.where(data.valid, np.square((data.signals - mean) / np.maximum(loud, TINY)), 0.0)
    power = np.concatenate([[0.0], np.cumsum(np.sum(squares, axis=1))])
    count = np.concatenate([[0], np.cumsum(np.sum(data.valid, axis=1))])
    at = data.motion.distance
    low, high = np.searchsorted(at, at - LOCAL), np.searchsorted(at, at + LOCAL, side="right")
    mean_power = (power[high] - power[low]) / np.maximum(count[high] - count[low], 1)
    return np.asarray(np.sqrt(mean_power), np.float64)


def unmodelled_deviation(data: Measured, model: Model) -> float:
    """Standard deviation of the unmodelled acceleration, m/s²: a share of what is measured on the first body."""
    if model.unmodelled == 0.0:
        return 0.0
    i = shaken_channel(model.vehicle, data.sensors)
    if i is None:
        raise ModelError(
            f"Unmodelled acceleration is a share of what is measured on {model.vehicle.bodies[0].name!r}, where the "
            "recording has no accelerometer; set unmodelled to 0 in the installation."
        )
    return float(model.unmodelled * loudness(data)[i])


def shaken_channel(vehicle: Vehicle, sensors: Sequence[Sensor]) -> int | None:
    """Index of the first accelerometer on the vehicle's first body, if there is one."""
    for i, sensor in enumerate(sensors):
        if (sensor.body, sensor.quantity) == (vehicle.bodies[0].name, VERTICAL_ACCELERATION):
            return i
    return None


def prepared_filter(data: Measured, model: Model, ride: Ride, start: Start) -> Filter:
    """The smoother for that ride, with each sample's noise."""
    return prepare(ride, model.spectrum, row_variance(data, model, ride), start)


def start_of(data: Measured, model: Model, system: StateSpace, ride: Ride) -> Start:
    """The prior of the first state, with the spread of unmodelled accelerations, low-passes, residuals, offsets."""
    loud = loudness(data)
    most = float(np.max(local_loudness(data, loud)))
    residuals = [
        one.residual.share * v if one.residual else 0.0
        for one, v in zip(model.sensors, loud, strict=True)
    ]
    behind = filtered_sensors(data, model)
    low_passes = [v if one.bandwidth else 0.0 for one, v in zip(behind, loud, strict=True)]
    kinds = system.disturbance.shape[1] - sum(value > 0 for value in residuals)
    filters = [most * unmodelled_deviation(data, model)] * kinds
    filters += [most * float(value) for value in residuals if value]
    filters += [float(value) for value in low_passes if value]
    offsets = [sensor.offset_standard_deviation for sensor in model.sensors]
    others = np.array([*np.repeat(filters, FILTER_STATES), *offsets])
    return start_of_ride(system, model.spectrum, ride, others)


def row_variance(data: Measured, model: Model, ride: Ride) -> Array:
    """Noise of each row: N² · max(1/(2 Δt), bandwidth), and step²/12 where recorded in steps.

    Sampled more slowly than its own filter passes, a sensor folds all its noise into each sample.
    """
    interval = np.gradient(data.motion.time)
    variance = np.empty((len(interval), len(model.sensors)))
    for i, sensor in enumerate(model.sensors):
        if sensor.noise_density is None:
            raise DataError(f"Channel {sensor.name!r}: its noise density is not known.")
        passed = np.maximum(0.5 / interval, sensor.bandwidth or 0.0)
        if data.limits is not None:
            passed = np.minimum(passed, data.limits[i])
        variance[:, i] = sensor.noise_density**2 * passed + data.step[i] ** 2 / 12.0
    return variance[ride.samples, ride.sensors]


def row_signals(data: Measured, model: Model, ride: Ride) -> Array:
    """The measured signals by row, without the train's own acceleration in tilted sensors, (rows, 1)."""
    own = own_acceleration(model.sensors, moved(data, model))
    return (data.signals - own)[ride.samples, ride.sensors][:, None]

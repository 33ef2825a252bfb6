"""What was measured, brought to what the smoother needs: motion of the leading wheel, sensors, signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Channel, channels
from trackprofile.contracts.validation import steps_of
from trackprofile.errors import DataError, ModelError
from trackprofile.kalman.smoother import InitialState, KalmanGains, initial_state, kalman_gains
from trackprofile.kalman.time_steps import (
    DiscretisedRun,
    OffsetWalk,
    discretise_run,
    with_offset_variance,
)
from trackprofile.models.kinematics import Motion, along_track
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.statespace import FILTER_STATES, StateSpace, state_space
from trackprofile.models.track import PointTrack, RigidTrack, Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.positioning.sources import PLACED
from trackprofile.preprocessing.clock import MENDED
from trackprofile.preprocessing.fault_detectors import outlying, resolution
from trackprofile.preprocessing.faults import (
    GAP,
    LEFT_OUT,
    Fault,
    FaultKind,
    find_faults,
    samples_of,
)
from trackprofile.preprocessing.motion import motion
from trackprofile.preprocessing.mounting import MountingCorrection, correct_mounting

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KNOT_SPACING = 0.25
"""m between the spline's knots: EN 13848-2 asks for a sampling distance of at most this."""

DEFAULT_SPECTRUM = Spectrum("level from the data", 1.5e-6, 0.0206, 0.4, "shape of FRA, knee of ")
"""Where the search for the prior starts: between FRA 6 and a good main line."""

LOCAL = 50.0
"""m to each side over which the strength of a signal is taken."""

TINY = 1e-30
"""Of a signal that is constant, which then has no local strength either."""


@dataclass(frozen=True)
class Observations:
    """A recording, ready for any vehicle.

    Parameters
    ----------
    motion : of the point whose distance was recorded, n samples
    sensors : one per channel
    signals, valid : (n, sensors)
    step : (n, sensors), in which each sample was recorded, 0 if as good as continuous
    saturated : (n, sensors), samples at the end of a sensor's range, which are not valid
    faulty : (n, sensors), samples with any other fault
    faults : what was found wrong, by samples of the whole recording
    notes : on what was mended
    gain_doubt : per sensor, relative standard deviation of a gain that the mounting made uncertain
    loud : (sensors,), root mean square of each signal about its mean over the whole recording; None: of these samples
    limits : (sensors,), Hz, above which nothing is left of a signal; None: all is there
    low_pass : per sensor, Hz, of a second-order Butterworth that the signal went through after it was recorded
    by_gravity : per sensor, whether gravity told which way is up
    turned : whether the vehicle's last wheel leads; the sensors are then those of
        :func:`trackprofile.models.vehicle.turned_round`
    """

    motion: Motion
    sensors: tuple[Sensor, ...]
    signals: Array
    valid: NDArray[np.bool_]
    step: NDArray[np.float32]
    saturated: Mask
    faulty: Mask
    faults: tuple[Fault, ...] = ()
    notes: tuple[str, ...] = ()
    gain_doubt: tuple[float, ...] = ()
    loud: Array | None = None
    limits: Array | None = None
    low_pass: tuple[float | None, ...] = ()
    by_gravity: tuple[bool, ...] = ()
    turned: bool = False

    @property
    def taken(self) -> Array:
        """The signals, (n, sensors); NaN where they are not valid."""
        return np.where(self.valid, self.signals, np.nan)

    def part(self, rows: slice | Mask) -> Observations:
        """The same of some samples only."""
        m = self.motion
        motion = Motion(m.time[rows], m.distance[rows], m.speed[rows], m.acceleration[rows])
        return replace(
            self, motion=motion, signals=self.signals[rows], valid=self.valid[rows],
            step=self.step[rows], saturated=self.saturated[rows], faulty=self.faulty[rows],
        )  # fmt: skip


def observations(recording: xr.Dataset, installation: Installation) -> Observations:
    """Take a recording apart; calibrated sensors replace what the recording says of them.

    Samples with a fault that leaves nothing of them are not valid; gravity is taken off.

    Raises
    ------
    DataError
        Where nothing of any channel is left.
    """
    faults, count = find_faults(recording), recording.sizes["sample"]
    parts, lost = _alive(channels(recording), faults, count)
    valid = np.stack([np.asarray(channel.valid, bool) for channel in parts], axis=1)

    def marked(kinds: frozenset[FaultKind]) -> Mask:
        return np.stack([samples_of(faults, one.name, count, kinds) for one in parts], axis=1)

    valid &= ~marked(LEFT_OUT)
    upright = [correct_mounting(one, good) for one, good in zip(parts, valid.T, strict=True)]
    signals = np.stack([one.values for one in upright], axis=1)
    steps = np.zeros(signals.shape, np.float32)
    for i, channel in enumerate(parts):
        steps[valid[:, i], i] = resolution(channel.values[valid[:, i]])
    return Observations(
        motion(recording),
        tuple(_sensor(channel, installation.sensors) for channel in parts),
        np.where(valid, signals, 0.0),
        valid,
        steps,
        marked(frozenset({FaultKind.SATURATED})),
        marked(frozenset(FaultKind) - {FaultKind.SATURATED}),
        (*faults, *_mounted(parts, upright, count)),
        (
            *(step for step in steps_of(recording) if step.startswith((MENDED, PLACED))),
            *lost,
            *(one.said for one in upright if one.said),
        ),
        gain_doubt=tuple(one.doubt for one in upright),
        by_gravity=tuple(one.by_gravity for one in upright),
    )


def _alive(
    parts: Sequence[Channel], faults: Sequence[Fault], count: int
) -> tuple[list[Channel], list[str]]:
    """The channels of which anything is left, and sentences on the others."""
    alive, lost = [], []
    for one in parts:
        if np.any(np.asarray(one.valid, bool) & ~samples_of(faults, one.name, count, LEFT_OUT)):
            alive.append(one)
        else:
            kinds = sorted({str(fault.kind) for fault in faults if fault.channel == one.name})
            lost.append(f"nothing is left of {one.name!r} ({', '.join(kinds)}): it is not used")
    if not alive:
        raise DataError(f"No channel can be used: {'; '.join(lost)}; record again.")
    return alive, lost


def _mounted(
    parts: Sequence[Channel], upright: Sequence[MountingCorrection], count: int
) -> Iterator[Fault]:
    for channel, one in zip(parts, upright, strict=True):
        if one.said:
            yield Fault(FaultKind.MOUNTING, channel.name, 0, count - 1, one.said)


def _sensor(channel: Channel, calibrated: Sequence[Sensor]) -> Sensor:
    for sensor in calibrated:
        if (sensor.quantity, sensor.body) == (channel.quantity, channel.body):
            return replace(sensor, name=channel.name, lateral=channel.lateral)
    return Sensor(
        channel.name, channel.quantity, channel.body, channel.position, channel.noise_density,
        bandwidth=channel.bandwidth, flicker=channel.flicker, lateral=channel.lateral,
    )  # fmt: skip


def loading(track: Track) -> str:
    """What a profile found on that track is: without give, the path of the wheels is all there is to find."""
    return "loaded" if isinstance(track, RigidTrack) else "unloaded"


@dataclass(frozen=True)
class Model:
    """Everything that the likelihood of a recording depends on.

    All noise densities are given; ``unmodelled`` and ``distance_scale`` are those of
    :class:`trackprofile.models.sensor.Installation`.
    """

    vehicle: Vehicle
    track: PointTrack
    sensors: tuple[Sensor, ...]
    origin: float
    unmodelled: float
    spectrum: Spectrum
    distance_scale: float = 1.0


def leading_wheel_motion(data: Observations, model: Model) -> Motion:
    """How the leading wheel moved along the track."""
    return along_track(data.motion, model.origin, model.distance_scale)


def tilt_acceleration(sensors: Sequence[Sensor], motion: Motion) -> Array:
    """What tilted sensors read of the train's own acceleration, (n, sensors)."""
    return np.outer(motion.acceleration, [sensor.gain_across for sensor in sensors])


def filtered_sensors(data: Observations, model: Model) -> tuple[Sensor, ...]:
    """The model's sensors, with the low-passes that the signals went through."""
    if not data.low_pass:
        return model.sensors
    return tuple(
        replace(sensor, bandwidth=frequency) if frequency else sensor
        for sensor, frequency in zip(model.sensors, data.low_pass, strict=True)
    )


def ride_of(data: Observations, model: Model) -> tuple[StateSpace, DiscretisedRun]:
    """The ride of the model's vehicle through the recorded motion.

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    """
    along = leading_wheel_motion(data, model)
    run, length = along.distance[-1] - along.distance[0], model.vehicle.length
    if run < max(length, 4 * KNOT_SPACING):
        raise DataError(
            f"The recording covers {run:.1f} m, but from the first to the last wheel of "
            f"{model.vehicle.name!r} there are {length:.1f} m; record a longer stretch."
        )
    loud = signal_rms(data)
    shaking = unmodelled_deviation(data, model)
    system = state_space(
        model.vehicle, model.track, filtered_sensors(data, model), shaking, tuple(loud)
    )
    ride = discretise_run(system, along, data.valid, KNOT_SPACING)
    if system.disturbance.shape[1] > 0:
        local = np.interp(ride.bay_position, along.distance, local_signal_rms(data, loud))
        ride = replace(ride, Q=ride.Q * np.square(local)[:, None, None])
    walk = walk_of(ride, along, model.sensors)
    return system, with_offset_variance(ride, np.outer(walk.duration, walk.rate**2))


def walk_of(ride: DiscretisedRun, motion: Motion, sensors: Sequence[Sensor]) -> OffsetWalk:
    """How the offsets, last of the states, walk through the bays of a ride."""
    entered = np.interp(ride.bay_position, motion.distance, motion.time)
    duration = np.maximum(np.diff(entered, append=motion.time[-1]), 0.0)
    return OffsetWalk(duration, np.array([sensor.drift_rate for sensor in sensors]))


def signal_rms(data: Observations) -> Array:
    """Root mean square of each signal about its mean, (sensors,)."""
    if data.loud is not None:
        return data.loud
    pairs = zip(data.signals.T, outlier_free(data).T, strict=True)
    return np.array([np.std(values[good]) for values, good in pairs], dtype=np.float64)


def outlier_free(data: Observations) -> Mask:
    """Valid samples, (n, sensors), without those so far off that they would make all others look weak."""
    good = data.valid.copy()
    for values, here in zip(data.signals.T, good.T, strict=True):
        here[here] = ~outlying(values[here])
    return good


def local_signal_rms(data: Observations, loud: Array) -> Array:
    """Root mean square of the signals within ``LOCAL`` m of each sample, in units of the whole recording's.

    What a rigid, linear car leaves out grows with what excites it.
    """
    good = outlier_free(data)
    mean = np.array([np.mean(data.signals[here, i]) for i, here in enumerate(good.T)])
    squares = np.where(good, np.square((data.signals - mean) / np.maximum(loud, TINY)), 0.0)
    power = np.concatenate([[0.0], np.cumsum(np.sum(squares, axis=1))])
    count = np.concatenate([[0], np.cumsum(np.sum(good, axis=1))])
    at = data.motion.distance
    low, high = np.searchsorted(at, at - LOCAL), np.searchsorted(at, at + LOCAL, side="right")
    mean_power = (power[high] - power[low]) / np.maximum(count[high] - count[low], 1)
    return np.asarray(np.sqrt(mean_power), np.float64)


def unmodelled_deviation(data: Observations, model: Model) -> float:
    """Standard deviation of the unmodelled acceleration, m/s²: a share of what is measured on the first body."""
    if model.unmodelled == 0.0:
        return 0.0
    i = first_body_channel(model.vehicle, data.sensors)
    if i is None:
        raise ModelError(
            f"Unmodelled acceleration is a share of what is measured on {model.vehicle.bodies[0].name!r}, where the "
            "recording has no accelerometer; set unmodelled to 0 in the installation."
        )
    return float(model.unmodelled * signal_rms(data)[i])


def first_body_channel(vehicle: Vehicle, sensors: Sequence[Sensor]) -> int | None:
    """Index of the first accelerometer on the vehicle's first body, if there is one."""
    for i, sensor in enumerate(sensors):
        if (sensor.body, sensor.quantity) == (vehicle.bodies[0].name, VERTICAL_ACCELERATION):
            return i
    return None


def prepared_filter(
    data: Observations, model: Model, ride: DiscretisedRun, start: InitialState
) -> KalmanGains:
    """The smoother for that ride, with each sample's noise."""
    return kalman_gains(ride, model.spectrum, row_variance(data, model, ride), start)


def start_of(
    data: Observations, model: Model, system: StateSpace, ride: DiscretisedRun
) -> InitialState:
    """The prior of the first state, with the spread of unmodelled accelerations, filters, flicker and offsets."""
    loud = signal_rms(data)
    most = float(np.max(local_signal_rms(data, loud)))
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
    others = np.array([*np.repeat(filters, FILTER_STATES), *np.sqrt(system.flicker), *offsets])
    return initial_state(system, model.spectrum, ride, others)


def row_variance(data: Observations, model: Model, ride: DiscretisedRun) -> Array:
    """Noise of each row: N² · max(1/(2 Δt), bandwidth), and step²/12 where recorded in steps.

    Sampled more slowly than its own filter passes, a sensor folds all its noise into each sample.
    """
    variance = np.empty(data.signals.shape)
    for i, sensor in enumerate(model.sensors):
        if sensor.noise_density is None:
            raise DataError(f"Channel {sensor.name!r}: its noise density is not known.")
        interval = sampling_intervals(data.motion.time, data.valid[:, i])
        passed = np.maximum(0.5 / interval, sensor.bandwidth or 0.0)
        if data.limits is not None:
            passed = np.minimum(passed, data.limits[i])
        variance[:, i] = (
            sensor.noise_density**2 * passed + np.square(data.step[:, i], dtype=np.float64) / 12.0
        )
    return variance[ride.samples, ride.sensors]


def sampling_intervals(time: Array, valid: Mask) -> Array:
    """Interval at which a sensor was sampled, (n,) in s: half the time between the valid samples beside each.

    Beside a gap it is that of the other side; 1 where the sample is not valid.

    Examples
    --------
    >>> sampling_intervals(np.array([0.0, 0.1, 0.2, 0.3, 0.9, 1.0]), np.ones(6, bool))
    array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    """
    interval = np.ones(len(time))
    at = time[valid]
    if len(at) < 2:
        return interval
    apart = np.diff(at)
    before, after = np.r_[apart[0], apart], np.r_[apart, apart[-1]]
    gap = np.maximum(before, after) > GAP * np.minimum(before, after)
    interval[valid] = np.where(gap, np.minimum(before, after), 0.5 * (before + after))
    return interval


def row_signals(data: Observations, model: Model, ride: DiscretisedRun) -> Array:
    """The measured signals by row, without the train's own acceleration in tilted sensors, (rows, 1)."""
    own = tilt_acceleration(model.sensors, leading_wheel_motion(data, model))
    return (data.signals - own)[ride.samples, ride.sensors][:, None]

"""A run made ready for the smoother: transition, initial state, noise, signals and offset walk as one object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import DataError, ModelError
from trackprofile.inference.observations import (
    KNOT_SPACING,
    Observations,
    first_body_channel,
    local_signal_rms,
    signal_rms,
)
from trackprofile.kalman.smoother import InitialState, SmoothingProblem, initial_state
from trackprofile.kalman.time_steps import (
    DiscretisedRun,
    OffsetWalk,
    discretise_run,
    with_offset_variance,
)
from trackprofile.models.kinematics import Motion, along_track
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.statespace import FILTER_STATES, StateSpace, state_space
from trackprofile.models.track import PointTrack, RigidTrack, Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.preprocessing.faults import GAP_RATIO

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Model:
    """Everything that the likelihood of a recording depends on.

    Parameters
    ----------
    vehicle, track, sensors : what the signals pass through; all noise densities are known
    origin : m, leading wheel ahead of the point whose distance was recorded
    unmodelled, distance_scale : as in :class:`trackprofile.models.sensor.Installation`
    spectrum : prior of the profile
    """

    vehicle: Vehicle
    track: PointTrack
    sensors: tuple[Sensor, ...]
    origin: float
    unmodelled: float
    spectrum: Spectrum
    distance_scale: float = 1.0


@dataclass(frozen=True)
class _Discretised:
    """The part of a problem that noise level, offset drift and prior leave unchanged."""

    system: StateSpace
    run: DiscretisedRun
    motion: Motion


@dataclass(frozen=True)
class _SignalLevel:
    """``rms`` (sensors,) of each signal, and ``local`` (samples,), the relative RMS around each sample."""

    rms: Array
    local: Array


def smoothing_problem(data: Observations, model: Model) -> SmoothingProblem:
    """What the smoother takes for these observations under this model.

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle, or a noise density is not known.
    """
    return problem_builder(data)(model)


def problem_builder(data: Observations) -> Callable[[Model], SmoothingProblem]:
    """A function that gives the smoothing problem of these observations for any model.

    The transition of every bay and the measurement rows depend on vehicle, track and sensors, but not on white noise,
    drift and prior: they are kept for the two models used last.
    """
    rms = signal_rms(data)
    level = _SignalLevel(rms, local_signal_rms(data, rms))
    discretised = lru_cache(maxsize=2)(lambda structure: _discretised(data, level, structure))

    def build(model: Model) -> SmoothingProblem:
        fixed = discretised(_structure(model))
        walk = _offset_walk(fixed.run, fixed.motion, model.sensors)
        return SmoothingProblem(
            with_offset_variance(fixed.run, np.outer(walk.duration, walk.rate**2)),
            model.spectrum,
            row_variance(data, model, fixed.run),
            _initial_state(data, level, model, fixed),
            _row_signals(data, model, fixed),
            walk,
        )

    return build


def _structure(model: Model) -> Model:
    """The model without what discretisation does not depend on; flicker takes more states the clearer it is."""
    sensors = tuple(
        one if one.flicker else replace(one, noise_density=None, drift=None, offset=None)
        for one in model.sensors
    )
    return replace(model, sensors=sensors, spectrum=None)  # type: ignore[arg-type]


def _discretised(data: Observations, level: _SignalLevel, model: Model) -> _Discretised:
    motion = leading_wheel_motion(data, model)
    run_length, length = motion.distance[-1] - motion.distance[0], model.vehicle.length
    if run_length < max(length, 4 * KNOT_SPACING):
        raise DataError(
            f"The recording covers {run_length:.1f} m, but from the first to the last wheel of "
            f"{model.vehicle.name!r} there are {length:.1f} m; record a longer stretch."
        )
    system = state_space(
        model.vehicle, model.track, _filtered_sensors(data, model),
        _unmodelled_deviation(level, data, model), tuple(level.rms),
    )  # fmt: skip
    run = discretise_run(system, motion, data.valid, KNOT_SPACING)
    if system.disturbance.shape[1] > 0:
        local = np.interp(run.bay_position, motion.distance, level.local)
        run = replace(run, Q=run.Q * np.square(local)[:, None, None])
    return _Discretised(system, run, motion)


def leading_wheel_motion(data: Observations, model: Model) -> Motion:
    """How the leading wheel moved along the track."""
    return along_track(data.motion, model.origin, model.distance_scale)


def loading(track: Track) -> str:
    """ "loaded" or "unloaded": on a rigid track the path of the wheels is all that can be inferred."""
    return "loaded" if isinstance(track, RigidTrack) else "unloaded"


def _filtered_sensors(data: Observations, model: Model) -> tuple[Sensor, ...]:
    """The model's sensors, with the low-passes that the signals went through."""
    if not data.low_pass:
        return model.sensors
    return tuple(
        replace(sensor, bandwidth=frequency) if frequency else sensor
        for sensor, frequency in zip(model.sensors, data.low_pass, strict=True)
    )


def _offset_walk(run: DiscretisedRun, motion: Motion, sensors: Sequence[Sensor]) -> OffsetWalk:
    """Random walk of the sensor offsets, the last of the states, through the bays of a run."""
    entered = np.interp(run.bay_position, motion.distance, motion.time)
    duration = np.maximum(np.diff(entered, append=motion.time[-1]), 0.0)
    return OffsetWalk(duration, np.array([sensor.drift_rate for sensor in sensors]))


def _unmodelled_deviation(level: _SignalLevel, data: Observations, model: Model) -> float:
    """Standard deviation of the unmodelled acceleration, m/s²: a share of the RMS measured on the first body."""
    if model.unmodelled == 0.0:
        return 0.0
    i = first_body_channel(model.vehicle, data.sensors)
    if i is None:
        raise ModelError(
            f"Unmodelled acceleration is a share of what is measured on {model.vehicle.bodies[0].name!r}, where the "
            "recording has no accelerometer; set unmodelled to 0 in the installation."
        )
    return float(model.unmodelled * level.rms[i])


def _initial_state(
    data: Observations, level: _SignalLevel, model: Model, fixed: _Discretised
) -> InitialState:
    """Prior of the first state, with standard deviations of unmodelled accelerations, filters, flicker and offsets."""
    system, rms = fixed.system, level.rms
    largest = float(np.max(level.local))
    residuals = [
        one.residual.share * v if one.residual else 0.0
        for one, v in zip(model.sensors, rms, strict=True)
    ]
    filtered = _filtered_sensors(data, model)
    low_passes = [v if one.bandwidth else 0.0 for one, v in zip(filtered, rms, strict=True)]
    kinds = system.disturbance.shape[1] - sum(value > 0 for value in residuals)
    filters = [largest * _unmodelled_deviation(level, data, model)] * kinds
    filters += [largest * float(value) for value in residuals if value]
    filters += [float(value) for value in low_passes if value]
    offsets = [sensor.offset_standard_deviation for sensor in model.sensors]
    others = np.array([*np.repeat(filters, FILTER_STATES), *np.sqrt(system.flicker), *offsets])
    return initial_state(system, model.spectrum, fixed.run, others)


def row_variance(data: Observations, model: Model, run: DiscretisedRun) -> Array:
    """Noise of each row: N² · max(1/(2 Δt), bandwidth), and step²/12 where recorded in steps.

    Sampled more slowly than its own filter passes, a sensor folds all its noise into each sample.
    """
    variance = np.empty(data.signals.shape)
    for i, sensor in enumerate(model.sensors):
        if sensor.noise_density is None:
            raise DataError(f"Channel {sensor.name!r}: its noise density is not known.")
        interval = sampling_intervals(data.motion.time, data.valid[:, i])
        passed = np.maximum(0.5 / interval, sensor.bandwidth or 0.0)
        if data.usable_bandwidth is not None:
            passed = np.minimum(passed, data.usable_bandwidth[i])
        variance[:, i] = (
            sensor.noise_density**2 * passed + np.square(data.step[:, i], dtype=np.float64) / 12.0
        )
    return variance[run.samples, run.sensors]


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
    gap = np.maximum(before, after) > GAP_RATIO * np.minimum(before, after)
    interval[valid] = np.where(gap, np.minimum(before, after), 0.5 * (before + after))
    return interval


def tilt_acceleration(sensors: Sequence[Sensor], motion: Motion) -> Array:
    """Longitudinal acceleration of the train as tilted sensors read it, (n, sensors)."""
    return np.outer(motion.acceleration, [sensor.longitudinal_gain for sensor in sensors])


def _row_signals(data: Observations, model: Model, fixed: _Discretised) -> Array:
    """Measured signals by row, without the longitudinal acceleration that tilted sensors read, (rows, 1)."""
    tilt = tilt_acceleration(model.sensors, fixed.motion)
    return (data.signals - tilt)[fixed.run.samples, fixed.run.sensors][:, None]

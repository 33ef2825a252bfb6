"""A recording converted to the smoother's inputs: motion, sensors, valid signals and their quantisation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Channel, channels
from trackprofile.contracts.validation import provenance_steps
from trackprofile.errors import DataError
from trackprofile.models.kinematics import Motion
from trackprofile.models.sensor import VERTICAL_ACCELERATION, Installation, Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.vehicle import Vehicle
from trackprofile.positioning.sources import POSITION_PREFIX
from trackprofile.preprocessing.clock import REPAIR_PREFIX
from trackprofile.preprocessing.fault_detectors import outlying, resolution
from trackprofile.preprocessing.faults import (
    EXCLUDED_KINDS,
    Fault,
    FaultKind,
    fault_mask,
    find_faults,
)
from trackprofile.preprocessing.motion import motion
from trackprofile.preprocessing.mounting import MountingCorrection, correct_mounting

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KNOT_SPACING = 0.25
"""Distance between the spline's knots, m: EN 13848-2 requires a sampling distance of at most this."""

DEFAULT_SPECTRUM = Spectrum("level from the data", 1.5e-6, 0.0206, 0.4, "shape of FRA, corner of ")
"""Where the search for the prior starts: between FRA 6 and a good main line."""

LOCAL_EXTENT = 50.0
"""Distance to each side over which the local RMS of a signal is taken, m."""

TINY = 1e-30
"""In place of the RMS of a constant signal."""


@dataclass(frozen=True)
class Observations:
    """A recording, ready for any vehicle.

    Parameters
    ----------
    motion : of the point whose distance was recorded, n samples
    sensors : one per channel
    signals, valid : (n, sensors), SI units
    step : (n, sensors), quantisation step of each sample, 0 where it is practically continuous
    saturated : (n, sensors), samples at the end of a sensor's range, which are not valid
    faulty : (n, sensors), samples with any other fault
    faults : faults of the recording, by samples of the whole recording
    notes : on repairs
    gain_doubt : per sensor, relative standard deviation of a gain that the mounting made uncertain
    rms : (sensors,), root mean square of each signal about its mean over the whole recording; None: of these samples
    usable_bandwidth : (sensors,), Hz, above which a signal was removed; None: nothing was removed
    low_pass : per sensor, Hz, of a second-order Butterworth that was applied after recording
    by_gravity : per sensor, whether gravity determined which way is up
    turned : whether the vehicle's last wheel leads; the sensors are then those of
        :func:`trackprofile.models.vehicle.reversed_vehicle`
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
    rms: Array | None = None
    usable_bandwidth: Array | None = None
    low_pass: tuple[float | None, ...] = ()
    by_gravity: tuple[bool, ...] = ()
    turned: bool = False

    @property
    def used(self) -> Array:
        """The signals, (n, sensors); NaN where they are not valid."""
        return np.where(self.valid, self.signals, np.nan)

    def part(self, rows: slice | Mask) -> Observations:
        """The observations of some samples only."""
        m = self.motion
        motion = Motion(m.time[rows], m.distance[rows], m.speed[rows], m.acceleration[rows])
        return replace(
            self, motion=motion, signals=self.signals[rows], valid=self.valid[rows],
            step=self.step[rows], saturated=self.saturated[rows], faulty=self.faulty[rows],
        )  # fmt: skip


def observations(recording: xr.Dataset, installation: Installation) -> Observations:
    """Observations of a recording; calibrated sensors replace those that the recording describes.

    Samples with a fault that makes them useless are not valid; gravity is removed.

    Raises
    ------
    DataError
        Where no channel has a usable sample.
    """
    faults, count = find_faults(recording), recording.sizes["sample"]
    parts, unused = _usable_channels(channels(recording), faults, count)
    valid = np.stack([np.asarray(channel.valid, bool) for channel in parts], axis=1)

    def has_fault(kinds: frozenset[FaultKind]) -> Mask:
        return np.stack([fault_mask(faults, one.name, count, kinds) for one in parts], axis=1)

    valid &= ~has_fault(EXCLUDED_KINDS)
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
        has_fault(frozenset({FaultKind.SATURATED})),
        has_fault(frozenset(FaultKind) - {FaultKind.SATURATED}),
        (*faults, *_mounting_faults(parts, upright, count)),
        (
            *(
                step
                for step in provenance_steps(recording)
                if step.startswith((REPAIR_PREFIX, POSITION_PREFIX))
            ),
            *unused,
            *(one.note for one in upright if one.note),
        ),
        gain_doubt=tuple(one.gain_std for one in upright),
        by_gravity=tuple(one.by_gravity for one in upright),
    )


def signal_rms(data: Observations) -> Array:
    """Root mean square of each signal about its mean, without outliers, (sensors,)."""
    if data.rms is not None:
        return data.rms
    pairs = zip(data.signals.T, outlier_free(data).T, strict=True)
    return np.array([np.std(values[good]) for values, good in pairs], dtype=np.float64)


def outlier_free(data: Observations) -> Mask:
    """Valid samples, (n, sensors), without those so far off that they would dominate the RMS."""
    good = data.valid.copy()
    for values, mask in zip(data.signals.T, good.T, strict=True):
        mask[mask] = ~outlying(values[mask])
    return good


def local_signal_rms(data: Observations, rms: Array) -> Array:
    """Root mean square of the signals within ``LOCAL_EXTENT`` of each sample, relative to ``rms``, (n,).

    What a rigid, linear vehicle model leaves out grows with the excitation.
    """
    good = outlier_free(data)
    mean = np.array([np.mean(data.signals[mask, i]) for i, mask in enumerate(good.T)])
    squares = np.where(good, np.square((data.signals - mean) / np.maximum(rms, TINY)), 0.0)
    power = np.concatenate([[0.0], np.cumsum(np.sum(squares, axis=1))])
    count = np.concatenate([[0], np.cumsum(np.sum(good, axis=1))])
    at = data.motion.distance
    low = np.searchsorted(at, at - LOCAL_EXTENT)
    high = np.searchsorted(at, at + LOCAL_EXTENT, side="right")
    mean_power = (power[high] - power[low]) / np.maximum(count[high] - count[low], 1)
    return np.asarray(np.sqrt(mean_power), np.float64)


def first_body_channel(vehicle: Vehicle, sensors: Sequence[Sensor]) -> int | None:
    """Index of the first accelerometer on the vehicle's first body, if there is one."""
    for i, sensor in enumerate(sensors):
        if (sensor.body, sensor.quantity) == (vehicle.bodies[0].name, VERTICAL_ACCELERATION):
            return i
    return None


def _usable_channels(
    parts: Sequence[Channel], faults: Sequence[Fault], count: int
) -> tuple[list[Channel], list[str]]:
    """The channels with a usable sample, and a sentence for each of the others."""
    usable, notes = [], []
    for one in parts:
        if np.any(
            np.asarray(one.valid, bool) & ~fault_mask(faults, one.name, count, EXCLUDED_KINDS)
        ):
            usable.append(one)
        else:
            kinds = sorted({str(fault.kind) for fault in faults if fault.channel == one.name})
            notes.append(
                f"{one.name!r} is not used: none of its samples is usable ({', '.join(kinds)})"
            )
    if not usable:
        raise DataError(f"No channel can be used: {'; '.join(notes)}; record again.")
    return usable, notes


def _mounting_faults(
    parts: Sequence[Channel], upright: Sequence[MountingCorrection], count: int
) -> Iterator[Fault]:
    for channel, one in zip(parts, upright, strict=True):
        if one.note:
            yield Fault(FaultKind.MOUNTING, channel.name, 0, count - 1, one.note)


def _sensor(channel: Channel, calibrated: Sequence[Sensor]) -> Sensor:
    for sensor in calibrated:
        if (sensor.quantity, sensor.body) == (channel.quantity, channel.body):
            return replace(sensor, name=channel.name, lateral=channel.lateral)
    return Sensor(
        channel.name, channel.quantity, channel.body, channel.position, channel.noise_density,
        bandwidth=channel.bandwidth, flicker=channel.flicker, lateral=channel.lateral,
    )  # fmt: skip

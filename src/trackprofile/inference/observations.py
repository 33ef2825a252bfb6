"""What was measured, brought to what the smoother needs: motion of the leading wheel, sensors, signals."""

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
from trackprofile.positioning.sources import PLACED
from trackprofile.preprocessing.clock import MENDED
from trackprofile.preprocessing.fault_detectors import outlying, resolution
from trackprofile.preprocessing.faults import (
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
            *(step for step in provenance_steps(recording) if step.startswith((MENDED, PLACED))),
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


def first_body_channel(vehicle: Vehicle, sensors: Sequence[Sensor]) -> int | None:
    """Index of the first accelerometer on the vehicle's first body, if there is one."""
    for i, sensor in enumerate(sensors):
        if (sensor.body, sensor.quantity) == (vehicle.bodies[0].name, VERTICAL_ACCELERATION):
            return i
    return None

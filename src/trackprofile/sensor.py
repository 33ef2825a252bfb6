"""Sensors: what is measured, where on the vehicle, and with which noise."""

from __future__ import annotations

from dataclasses import dataclass

from trackprofile.errors import ModelError

VERTICAL_ACCELERATION = "vertical acceleration"
PITCH_RATE = "pitch rate"
UNITS = {VERTICAL_ACCELERATION: "m/s2", PITCH_RATE: "rad/s"}

# Wide enough for an uncalibrated MEMS part, narrow enough to keep an offset apart from the track:
# 10 mg and 0.6 °/s (facts: zero-g and zero-rate offsets of the parts listed there).
OFFSET = {VERTICAL_ACCELERATION: 0.1, PITCH_RATE: 0.01}


@dataclass(frozen=True)
class Sensor:
    """One measured quantity at one place of the vehicle.

    Parameters
    ----------
    name : of the recording's channel
    quantity : "vertical acceleration" (m/s², up) or "pitch rate" (rad/s, nose-up)
    body : the body, or the wheel, that carries it
    position : m ahead of that body's centre
    noise_density : one-sided, in m/s²/√Hz or rad/s/√Hz; None where it is not known
    bandwidth : Hz, where the sensor's own filter cuts off; None: the sampling sets it
    offset : standard deviation of the unknown offset at the start, m/s² or rad/s; None: a usual one
    drift : of that offset, a random walk, m/s² or rad/s per √s; its noise exceeds the white one below
        drift/(√2 π noise_density) Hz. None: the offset is constant

    Examples
    --------
    >>> Sensor("acceleration", "vertical acceleration", "leading bogie", noise_density=2.5e-4).position
    0.0
    """

    name: str
    quantity: str
    body: str
    position: float = 0.0
    noise_density: float | None = None
    bandwidth: float | None = None
    offset: float | None = None
    drift: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in UNITS:
            raise ModelError(
                f"sensor {self.name!r} measures {self.quantity!r}; known are {', '.join(UNITS)}"
            )
        if self.noise_density is not None and not self.noise_density > 0:
            raise ModelError(f"sensor {self.name!r} needs a noise density above 0 or none at all")
        if self.bandwidth is not None and not self.bandwidth > 0:
            raise ModelError(f"sensor {self.name!r} needs a bandwidth above 0 Hz or none at all")

        if self.drift is not None and not self.drift >= 0:
            raise ModelError(f"sensor {self.name!r} needs a drift of at least 0 or none at all")

    @property
    def offset_standard_deviation(self) -> float:
        """The stated spread of the offset, or the usual one of that quantity."""
        return OFFSET[self.quantity] if self.offset is None else self.offset


@dataclass(frozen=True)
class Installation:
    """How sensors sit on a vehicle, and what its model leaves unexplained, as a calibration finds it.

    Parameters
    ----------
    origin : m by which the leading wheel stands ahead of the recorded distance
    sensors : calibrated sensors; each replaces what a recording says of the channel with its quantity and body
    unmodelled : root mean square of the first body's unmodelled acceleration, as a share of what is measured there;
        None where unknown
    """

    origin: float = 0.0
    sensors: tuple[Sensor, ...] = ()
    unmodelled: float | None = None

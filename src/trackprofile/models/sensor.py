"""Sensors: what is measured, where on the vehicle, and with which noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

VERTICAL_ACCELERATION = "vertical acceleration"
PITCH_RATE = "pitch rate"
ROLL_RATE = "roll rate"
UNITS = {VERTICAL_ACCELERATION: "m/s2", PITCH_RATE: "rad/s", ROLL_RATE: "rad/s"}

# Wide enough for an uncalibrated MEMS part, narrow enough to keep an offset apart from the track:
# 10 mg and 0.6 °/s (facts: zero-g and zero-rate offsets of the parts listed there).
DEFAULT_OFFSET = {VERTICAL_ACCELERATION: 0.1, PITCH_RATE: 0.01, ROLL_RATE: 0.01}

# What parts of that price do in a minute as they warm up: 0.8 mm/s² (80 µg) and 8 °/h (facts: bias instabilities and
# temperature coefficients). At 10 m/s it takes nothing from waves up to 70 m.
DEFAULT_DRIFT = {VERTICAL_ACCELERATION: 1e-4, PITCH_RATE: 5e-6, ROLL_RATE: 5e-6}


@dataclass(frozen=True)
class Residual:
    """What a vehicle's model leaves of a signal beyond noise: coloured, and as strong as the signal.

    Its density has one hump, S(f) = 4ζ f0 f² σ² / (π ((f0² - f²)² + (2ζ f0 f)²)) , of variance σ² = (share · rms)²,
    rms that of the signal.

    Parameters
    ----------
    share : of the signal's root mean square
    frequency : f0, Hz, where the hump stands
    damping : ζ, of which the hump is 2ζ f0 wide
    """

    share: float
    frequency: float
    damping: float = 0.5

    def __post_init__(self) -> None:
        for name in ("share", "frequency", "damping"):
            if not getattr(self, name) > 0:
                raise ModelError(f"a residual needs a {name} above 0, got {getattr(self, name):g}")


@dataclass(frozen=True)
class Sensor:
    """One measured quantity at one place of the vehicle.

    Parameters
    ----------
    name : of the recording's channel
    quantity : "vertical acceleration" (m/s², up), "pitch rate" (rad/s, nose-up) or "roll rate" (rad/s, left side up)
    body : the body, or the wheel, that carries it
    position : m ahead of that body's centre
    lateral : m to the left of that body's middle
    noise_density : one-sided, in m/s²/√Hz or rad/s/√Hz; None where it is not known
    bandwidth : Hz, where the sensor's own filter cuts off; None: the sampling sets it
    offset : standard deviation of the unknown offset at the start, m/s² or rad/s; None: a usual one
    drift : of that offset, a random walk, m/s² or rad/s per √s; its noise exceeds the white one below
        drift/(√2 π noise_density) Hz. None: a usual one
    flicker : F, the root of the one-sided density F²/f of the 1/f noise at 1 Hz, m/s²/√Hz or rad/s/√Hz; the floor
        σ of an Allan deviation ("bias instability") is √(2 ln 2) F where no other noise adds to it
        (IEEE Std 952, annex C, there with B² = π F²). None: none is stated
    gain : reading per quantity
    tilt : rad nose-up, of an accelerometer in the vehicle's vertical plane: it reads
        gain (cos(tilt) z̈ + sin(tilt) s̈), s̈ the train's own acceleration
    residual : what the vehicle's model leaves of the signal; None where that is not known

    Examples
    --------
    >>> Sensor("acceleration", "vertical acceleration", "leading bogie", noise_density=2.5e-4).position
    0.0
    """

    name: str
    quantity: str
    body: str
    position: float = 0.0
    lateral: float = field(default=0.0, kw_only=True)
    noise_density: float | None = None
    bandwidth: float | None = None
    offset: float | None = None
    drift: float | None = None
    flicker: float | None = None
    gain: float = 1.0
    tilt: float = 0.0
    residual: Residual | None = None

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
        if self.flicker is not None and not 0 <= self.flicker < np.inf:
            raise ModelError(
                f"sensor {self.name!r} needs a flicker of at least 0 or none at all, got {self.flicker}"
            )
        if not (abs(self.gain) > 0 and abs(self.tilt) < 1.5):
            raise ModelError(
                f"sensor {self.name!r} needs a gain other than 0 and a tilt within 1.5 rad, "
                f"got {self.gain:g} and {self.tilt:g}"
            )

    @property
    def effective_gain(self) -> float:
        """Reading per quantity along the vehicle's axis; a tilt in that plane leaves a pitch rate as it is."""
        tilted = self.quantity == VERTICAL_ACCELERATION
        return float(self.gain * np.cos(self.tilt)) if tilted else self.gain

    @property
    def longitudinal_gain(self) -> float:
        """Reading per longitudinal acceleration."""
        tilted = self.quantity == VERTICAL_ACCELERATION
        return float(self.gain * np.sin(self.tilt)) if tilted else 0.0

    @property
    def offset_standard_deviation(self) -> float:
        """The stated spread of the offset, or the usual one of that quantity."""
        return DEFAULT_OFFSET[self.quantity] if self.offset is None else self.offset

    @property
    def drift_rate(self) -> float:
        """The stated drift, or the usual one of that quantity."""
        return DEFAULT_DRIFT[self.quantity] if self.drift is None else self.drift


def sensor_noise_density(sensor: Sensor, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """The one-sided power spectral density of what a sensor adds by its own statement.

    S(f) = N² + F²/f + 2 D²/(2πf)², with white noise N, flicker F and drift D; what is not stated is 0.

    Parameters
    ----------
    frequency : any shape, above 0, Hz

    Returns
    -------
    of that shape, (m/s²)²/Hz or (rad/s)²/Hz

    Examples
    --------
    >>> floor = Sensor("floor", "vertical acceleration", "body", noise_density=3e-4, flicker=4e-4)
    >>> np.sqrt(sensor_noise_density(floor, np.array([1.0])))
    array([0.0005])
    """
    white, flicker, drift = (
        one or 0.0 for one in (sensor.noise_density, sensor.flicker, sensor.drift)
    )
    return white**2 + flicker**2 / frequency + 2 * (drift / (2 * np.pi * frequency)) ** 2


@dataclass(frozen=True)
class Uncertainty:
    """How sure a calibration is of its parameters.

    Parameters
    ----------
    names : of the p parameters
    covariance : (p, p), of their logarithms; of the values themselves where they may be negative
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Installation:
    """How sensors sit on a vehicle, and what its model leaves unexplained, as a calibration finds it.

    Parameters
    ----------
    origin : m by which the leading wheel stands ahead of the recorded distance
    sensors : calibrated sensors; each replaces what a recording says of the channel with its quantity and body
    unmodelled : root mean square of the first body's unmodelled acceleration, as a share of what is measured there;
        None where unknown
    distance_scale : true per recorded distance: the wheel's diameter over the one that the odometer assumes
    uncertainty : of the vehicle's and these parameters; None where nothing is known of it
    """

    origin: float = 0.0
    sensors: tuple[Sensor, ...] = ()
    unmodelled: float | None = None
    distance_scale: float = 1.0
    uncertainty: Uncertainty | None = None

"""Sensors: measured quantity, location on the vehicle, noise, and installation."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackprofile.errors import ModelError

VERTICAL_ACCELERATION = "vertical acceleration"
PITCH_RATE = "pitch rate"
ROLL_RATE = "roll rate"
UNITS = {VERTICAL_ACCELERATION: "m/s2", PITCH_RATE: "rad/s", ROLL_RATE: "rad/s"}

DEFAULT_OFFSET = {VERTICAL_ACCELERATION: 0.1, PITCH_RATE: 0.01, ROLL_RATE: 0.01}
"""Default standard deviation of a sensor's unknown offset, m/s² or rad/s: 10 mg and 0.6 °/s.

Wide enough for an uncalibrated MEMS sensor (zero-g and zero-rate offsets of common parts), and narrow enough to
separate an offset from the track."""

DEFAULT_DRIFT = {VERTICAL_ACCELERATION: 1e-4, PITCH_RATE: 5e-6, ROLL_RATE: 5e-6}
"""Default random walk of the offset, m/s² or rad/s per √s: 0.8 mm/s² (80 µg) and 8 °/h per minute.

This is what MEMS sensors drift in a minute while they warm up (bias instabilities and temperature coefficients). At
10 m/s it does not affect wavelengths up to 70 m."""


@dataclass(frozen=True)
class Residual:
    """Coloured model error of a sensor's signal, proportional to the signal's root mean square (RMS).

    Its one-sided density has one peak, S(f) = 4ζ f0 f² σ² / (π ((f0² - f²)² + (2ζ f0 f)²)), with the variance
    σ² = (share · RMS of the signal)².

    Parameters
    ----------
    share : standard deviation of the residual as a share of the signal's RMS
    frequency : f0, frequency of the peak, Hz
    damping : ζ, the peak is 2ζ f0 wide
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
    """One sensor: the measured quantity, its location on the vehicle, and its noise.

    Parameters
    ----------
    name : name of the recording's channel
    quantity : "vertical acceleration" (m/s², up), "pitch rate" (rad/s, nose-up) or "roll rate" (rad/s, left side up)
    body : name of the body or wheelset that carries the sensor
    position : longitudinal position ahead of the body's centre, m
    lateral : lateral position to the left of the body's centre line, m
    noise_density : one-sided white noise density, m/s²/√Hz or rad/s/√Hz; None where unknown
    bandwidth : cut-off frequency of the sensor's own low-pass, Hz; None: no low-pass below the sampling's
    offset : standard deviation of the unknown offset at the start, m/s² or rad/s; None: `DEFAULT_OFFSET`
    drift : random walk of the offset, m/s² or rad/s per √s; it exceeds the white noise below
        drift/(√2 π noise_density) Hz. None: `DEFAULT_DRIFT`
    flicker : F, square root of the one-sided density F²/f of the 1/f noise at 1 Hz, m/s²/√Hz or rad/s/√Hz. The
        minimum σ of an Allan deviation ("bias instability") is √(2 ln 2) F where no other noise adds to it
        (IEEE Std 952, annex C, there with B² = π F²). None: not stated
    gain : reading per quantity, dimensionless
    tilt : nose-up tilt of an accelerometer in the vehicle's vertical plane, rad: it reads
        gain (cos(tilt) z̈ + sin(tilt) s̈), where s̈ is the train's longitudinal acceleration
    residual : coloured model error of the signal; None where unknown

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
                f"sensor {self.name!r}: unknown quantity {self.quantity!r}; use one of {', '.join(UNITS)}"
            )
        if self.noise_density is not None and not self.noise_density > 0:
            raise ModelError(
                f"sensor {self.name!r} needs a noise density above 0, got {self.noise_density:g}; omit it if unknown"
            )
        if self.bandwidth is not None and not self.bandwidth > 0:
            raise ModelError(
                f"sensor {self.name!r} needs a bandwidth above 0 Hz, got {self.bandwidth:g}; omit it if unknown"
            )
        if self.drift is not None and not self.drift >= 0:
            raise ModelError(
                f"sensor {self.name!r} needs a drift of at least 0, got {self.drift:g}; omit it if unknown"
            )
        if self.flicker is not None and not 0 <= self.flicker < np.inf:
            raise ModelError(
                f"sensor {self.name!r} needs a finite flicker of at least 0, got {self.flicker}; omit it if unknown"
            )
        if not (abs(self.gain) > 0 and abs(self.tilt) < 1.5):
            raise ModelError(
                f"sensor {self.name!r} needs a gain other than 0 and a tilt within 1.5 rad, "
                f"got {self.gain:g} and {self.tilt:g}"
            )

    @property
    def effective_gain(self) -> float:
        """Reading per quantity: gain · cos(tilt) for an accelerometer, the gain for a rate sensor."""
        tilted = self.quantity == VERTICAL_ACCELERATION
        return float(self.gain * np.cos(self.tilt)) if tilted else self.gain

    @property
    def longitudinal_gain(self) -> float:
        """Reading per longitudinal acceleration: gain · sin(tilt) for an accelerometer, 0 for a rate sensor."""
        tilted = self.quantity == VERTICAL_ACCELERATION
        return float(self.gain * np.sin(self.tilt)) if tilted else 0.0

    @property
    def offset_standard_deviation(self) -> float:
        """Standard deviation of the offset, m/s² or rad/s: the stated one or the default of the quantity."""
        return DEFAULT_OFFSET[self.quantity] if self.offset is None else self.offset

    @property
    def drift_rate(self) -> float:
        """Random walk of the offset, m/s² or rad/s per √s: the stated one or the default of the quantity."""
        return DEFAULT_DRIFT[self.quantity] if self.drift is None else self.drift


def sensor_noise_density(sensor: Sensor, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """One-sided power spectral density of a sensor's stated noise.

    S(f) = N² + F²/f + 2 D²/(2πf)², with white noise N, flicker F and drift D; a value that is not stated counts as 0.

    Parameters
    ----------
    frequency : any shape, above 0, Hz

    Returns
    -------
    same shape, (m/s²)²/Hz or (rad/s)²/Hz

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
    """Covariance of calibrated parameters.

    Parameters
    ----------
    names : names of the p parameters
    covariance : (p, p), of their logarithms, or of the values themselves where these may be negative
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Installation:
    """Calibrated installation of the sensors on a vehicle, and the model error of the vehicle.

    Parameters
    ----------
    origin : distance of the leading wheel ahead of the recorded distance, m
    sensors : calibrated sensors; each replaces the recording's description of the channel with its quantity and body
    unmodelled : root mean square of the first body's unmodelled acceleration, as a share of the measured one;
        None where unknown
    distance_scale : true per recorded distance: wheel diameter over the diameter that the odometer assumes
    uncertainty : covariance of the vehicle's and these parameters; None where unknown
    """

    origin: float = 0.0
    sensors: tuple[Sensor, ...] = ()
    unmodelled: float | None = None
    distance_scale: float = 1.0
    uncertainty: Uncertainty | None = None

"""calibrate: the vehicle, the sensors' places and the noise, from a stretch whose profile is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from trackprofile.errors import DataError, UndeterminedError
from trackprofile.inference import recursions
from trackprofile.inference.bay_kernels import COLUMNS
from trackprofile.inference.likelihood import (
    Maximum,
    Progress,
    fisher_information,
    log_likelihood,
    maximise,
)
from trackprofile.inference.measured import (
    KNOT_SPACING,
    Measured,
    Model,
    measured,
    prepared_filter,
    ride_of,
    row_signals,
    shaken_channel,
    start_of,
)
from trackprofile.inference.noise import USUAL
from trackprofile.inference.parameters import Parameter, changed, free_parameters, value_of
from trackprofile.inference.ride import Ride
from trackprofile.inference.smoother import Start, innovations
from trackprofile.motion import Motion
from trackprofile.sensor import Installation
from trackprofile.spectrum import markov, scaled
from trackprofile.track import RigidTrack, Track
from trackprofile.vehicle import Vehicle

Array = NDArray[np.float64]

SEARCHED_ORIGINS = 15.0
"""m around the stated origin in which it is looked for before anything else is fitted."""

UNDETERMINED = 0.7
"""Share of its prior's spread from which a parameter counts as not told by the data."""


@dataclass(frozen=True)
class Estimated:
    """One parameter as found: value and standard error in ``unit``, and where it started."""

    name: str
    unit: str
    start: float
    value: float
    standard_error: float


@dataclass(frozen=True)
class Calibration:
    """What a calibration found.

    Parameters
    ----------
    vehicle, installation : as ``infer`` takes them
    estimates : the fitted parameters
    correlation : (estimates, estimates), of their errors
    log_likelihood : of the recordings, given the reference
    notes : what was held and why, in sentences
    """

    vehicle: Vehicle
    installation: Installation
    estimates: tuple[Estimated, ...]
    correlation: Array
    log_likelihood: float
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: the estimates by name, correlations and notes."""
        return {
            "parameters": {
                one.name: {
                    "value": one.value,
                    "standard_error": one.standard_error,
                    "unit": one.unit,
                    "start": one.start,
                }
                for one in self.estimates
            },
            "correlation": self.correlation.tolist(),
            "log_likelihood": self.log_likelihood,
            "notes": list(self.notes),
        }


def calibrate(
    recording: xr.Dataset | Sequence[xr.Dataset],
    reference: xr.Dataset,
    vehicle: Vehicle,
    *,
    installation: Installation | None = None,
    track: Track | None = None,
    parameters: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Fit named parameters to recordings of a stretch whose profile is known.

    The reference is the profile's prior mean; what it leaves of the signals goes through the same likelihood as
    in ``infer``, with unmodelled accelerations, sensor noise and the reference's own error found along with the
    parameters. Each parameter has a prior about its start (log-normal where it is positive).

    Parameters
    ----------
    recording : one or more, of the same vehicle
    reference : the profile contract
    vehicle, installation : where the fit starts
    parameters : names to fit; None takes all, and holds those that the data cannot tell
    progress : told the stage and its share done

    Raises
    ------
    DataError
        Where the reference does not cover a recording.
    UndeterminedError
        Where the data cannot tell one of the ``parameters``.
    """
    installation = installation or Installation()
    progress = progress or (lambda stage, share: None)
    recordings = [recording] if isinstance(recording, xr.Dataset) else list(recording)
    known = KnownProfile.of(reference)
    data = [known.covered(measured(one, installation), vehicle, installation.origin) for one in recordings]
    start = _started(data, vehicle, track or RigidTrack(), installation)
    free = free_parameters(start, parameters)
    progress("finding the origin", 0.0)
    start = _with_best_origin(data, known, start, free)
    free, notes = _told(data, known, start, free, asked=parameters is not None)
    found = _fitted(data, known, start, free, progress)
    while parameters is None and (lost := _untold(found, free)) is not None:
        notes.append(_held(free[lost]))
        free = [one for i, one in enumerate(free) if i != lost]
        found = _fitted(data, known, start, free, progress)
    _require_told(found, free)
    return _calibration(start, free, found, installation, tuple(notes))


@dataclass(frozen=True)
class KnownProfile:
    """A reference as spline coefficients: ``coefficients[i]`` is that of index ``first + i``."""

    coefficients: Array
    first: int
    begin: float
    end: float

    @staticmethod
    def of(reference: xr.Dataset) -> KnownProfile:
        """The spline through the reference at its knots; DataError where it has gaps."""
        distance, elevation = reference["distance"].to_numpy(), reference["elevation"].to_numpy()
        if not np.all(np.isfinite(elevation)):
            raise DataError("The reference has gaps in its elevation; choose a stretch without with --from and --to.")
        first = int(np.ceil(distance[0] / KNOT_SPACING))
        last = int(np.floor(distance[-1] / KNOT_SPACING))
        at_knots = np.interp(np.arange(first, last + 1) * KNOT_SPACING, distance, elevation)
        return KnownProfile(_spline_through(at_knots), first - 1, float(distance[0]), float(distance[-1]))

    def covered(self, data: Measured, vehicle: Vehicle, origin: float) -> Measured:
        """The part of a recording whose wheels run on the reference, wherever the origin is searched."""
        at = data.motion.distance + origin
        low = self.begin + vehicle.length + SEARCHED_ORIGINS + 1.0
        inside = (at >= low) & (at <= self.end - SEARCHED_ORIGINS - 1.0)
        if np.sum(inside) < 2 or np.ptp(at[inside]) < 2 * vehicle.length:
            raise DataError(
                f"The reference ({self.begin:.0f} m to {self.end:.0f} m) covers less than two lengths of the vehicle "
                f"of the recording ({at[0]:.0f} m to {at[-1]:.0f} m); the fit needs {SEARCHED_ORIGINS:.0f} m "
                f"more at each end: choose another stretch or reference."
            )
        m = data.motion
        part = Motion(m.time[inside], m.distance[inside], m.speed[inside], m.acceleration[inside])
        return replace(data, motion=part, signals=data.signals[inside], valid=data.valid[inside])

    def response(self, ride: Ride, start: Start) -> Array:
        """The signals (rows, 1) of a ride over the reference, from standing on it quasi-statically."""
        places = (ride.bases[:, :, None] + np.arange(COLUMNS) - self.first).reshape(len(ride.bases), -1)
        places = np.clip(places, 0, len(self.coefficients) - 1)
        window = np.arange(ride.first_knot, ride.first_knot + ride.ring)
        below = np.empty(ride.ring)
        below[window % ride.ring] = self.coefficients[np.clip(window - self.first, 0, len(self.coefficients) - 1)]
        signals = np.empty(len(ride.rows))
        recursions.responded(
            start.stance @ below, self.coefficients, ride.F, ride.G, places, ride.rows, ride.first_row, signals
        )
        return signals[:, None]


def _spline_through(values: Array) -> Array:
    """Coefficients of the cubic B-spline through values at its knots; one more at each end, straight there."""
    n = len(values)
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = 1 / 6, 4 / 6, 1 / 6
    # r'' = 0 at the ends: c_0 = 2 c_1 - c_2, so that the first row reads c_1 = r.
    bands[1, 0] = bands[1, -1] = 1.0
    bands[0, 1] = bands[2, -2] = 0.0
    inner = solve_banded((1, 1), bands, values)
    return np.concatenate([[2 * inner[0] - inner[1]], inner, [2 * inner[-1] - inner[-2]]])


def _started(data: list[Measured], vehicle: Vehicle, track: Track, installation: Installation) -> Model:
    """The model where the fit starts: a tenth of the signal unexplained, where nothing is known."""
    first = data[0]
    sensors = []
    for i, sensor in enumerate(first.sensors):
        rms = float(np.std(first.signals[first.valid[:, i], i]))
        guess = sensor.noise_density or 0.02 * rms / np.sqrt(10.0)
        sensors.append(replace(sensor, noise_density=guess))
    on_body = shaken_channel(vehicle, first.sensors) is not None
    unmodelled = (installation.unmodelled or 0.1) if on_body else 0.0
    error_of_reference = scaled(USUAL, 0.01)
    return Model(vehicle, track, tuple(sensors), installation.origin, unmodelled, error_of_reference)


def _innovations(data: list[Measured], known: KnownProfile, model: Model) -> tuple[Array, Array]:
    """Innovations and their variances of all recordings, given the reference."""
    parts = []
    for one in data:
        system, ride = ride_of(one, model)
        start = start_of(one, replace(model, spectrum=USUAL), system, ride)
        signals = row_signals(one, ride) - known.response(ride, start)
        order = (np.arange(ride.ring) - ride.first_knot) % ride.ring
        around = markov(model.spectrum, ride.spacing).covariance(ride.ring)[np.ix_(order, order)]
        prepared = prepared_filter(one, model, ride, replace(start, coefficients=around))
        parts.append((innovations(prepared, signals)[:, 0], prepared.innovation_variance))
    return np.concatenate([e for e, _ in parts]), np.concatenate([S for _, S in parts])


def _with_best_origin(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter]
) -> Model:
    """The origin with the highest likelihood on a grid: it has many local maxima, a wave apart."""
    if not any(one.name == "origin" for one in free):
        return start
    # Off the knots: where all samples of a distance-sampled recording lie on knots, round-off decides their bays.
    shifts = np.arange(-SEARCHED_ORIGINS, SEARCHED_ORIGINS, 1.0) + 0.45 * KNOT_SPACING
    trials = [replace(start, origin=start.origin + shift) for shift in shifts]
    heights = [log_likelihood(*_innovations(data, known, trial)) for trial in trials]
    return trials[int(np.argmax(heights))]


def _function_of(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter]
) -> Callable[[Array], tuple[Array, Array]]:
    return lambda at: _innovations(data, known, changed(start, free, at))


def _fitted(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter], progress: Progress
) -> Maximum:
    centre = np.array([value_of(start, one) for one in free])
    precision = np.array([one.spread**-2 for one in free])
    function = _function_of(data, known, start, free)
    return maximise(function, centre, centre, precision, lambda share: progress("fitting", share))


def _told(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter], asked: bool
) -> tuple[list[Parameter], list[str]]:
    """Leave out, one by one, what the data cannot tell at the start; refuse if it was asked for."""
    at = np.array([value_of(start, one) for one in free])
    _, information, _ = fisher_information(_function_of(data, known, start, free), at)
    notes: list[str] = []
    while True:
        precision = np.array([one.spread**-2 for one in free])
        found = Maximum(at, information, precision, 0.0, True)
        lost = _untold(found, free)
        if lost is None:
            return free, notes
        if asked:
            _require_told(found, free)
        notes.append(_held(free[lost]))
        keep = [i for i in range(len(free)) if i != lost]
        free, at, information = [free[i] for i in keep], at[keep], information[np.ix_(keep, keep)]


def _untold(found: Maximum, free: list[Parameter]) -> int | None:
    """The parameter that the data tell least, if they tell it too little."""
    share = np.sqrt(np.diag(found.covariance)) / np.array([one.spread for one in free])
    share[[one.nuisance for one in free]] = 0.0
    worst = int(np.argmax(share))
    return worst if share[worst] > UNDETERMINED else None


def _require_told(found: Maximum, free: list[Parameter]) -> None:
    lost = _untold(found, free)
    if lost is None:
        return
    covariance = found.covariance
    partners = np.abs(covariance[lost]) / np.sqrt(covariance[lost, lost] * np.diag(covariance))
    partners[lost] = 0.0
    partner = free[int(np.argmax(partners))].name
    raise UndeterminedError(
        f"The data cannot tell {free[lost].name!r}: most like it acts {partner!r} (correlation "
        f"{np.max(partners):.2f}); leave one of them out, or add a recording at another speed."
    )


def _held(parameter: Parameter) -> str:
    return f"{parameter.name} is held at its start: the data cannot tell it"


def _calibration(
    start: Model, free: list[Parameter], found: Maximum, installation: Installation, notes: tuple[str, ...]
) -> Calibration:
    model = changed(start, free, found.parameters)
    covariance = found.covariance
    errors = np.sqrt(np.diag(covariance))
    shown = [i for i, one in enumerate(free) if not one.nuisance]
    estimates = []
    for i in shown:
        one = free[i]
        first, value = value_of(start, one), found.parameters[i]
        if one.positive:
            first, value = np.exp(first), np.exp(value)
        error = errors[i] * (value if one.positive else 1.0)
        estimates.append(Estimated(one.name, one.unit, float(first), float(value), float(error)))
    correlation = covariance[np.ix_(shown, shown)] / np.outer(errors[shown], errors[shown])
    if not found.converged:
        notes = (*notes, "the fit did not converge: its likelihood is flat or rough; add data or fix parameters")
    fitted = replace(installation, origin=model.origin, sensors=model.sensors, unmodelled=model.unmodelled)
    return Calibration(model.vehicle, fitted, tuple(estimates), correlation, found.log_likelihood, notes)

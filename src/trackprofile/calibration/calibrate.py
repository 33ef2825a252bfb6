"""calibrate: vehicle, sensor positions and noise from recordings, with or without a reference profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.calibration.bandwidth import SpectralFit, limit_bandwidth, spectral_fit
from trackprofile.calibration.datasets import calibration_runs, most_informative
from trackprofile.calibration.fitting import (
    Fit,
    FitRequest,
    disagreement,
    fit_mechanics,
    fit_noise,
    fit_parameters,
    most_likely,
)
from trackprofile.inference.marginal_likelihood import RunData
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import (
    DEFAULT_SPECTRUM,
    KNOT_SPACING,
    first_body_channel,
    signal_rms,
)
from trackprofile.inference.parameters import (
    ORIGIN,
    ModelParameter,
    calibrated_parameters,
    position_parameters,
    select_parameters,
    value_of,
    vehicle_parameters,
)
from trackprofile.inference.problem import Model
from trackprofile.inference.reference import ORIGIN_SEARCH
from trackprofile.models.receptance import point_track
from trackprofile.models.sensor import Installation, Sensor, Uncertainty
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import PointTrack, RigidTrack, Track
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

CORRELATION_LENGTH = 20.0
"""Distance over which residuals are correlated, m: a few periods of the body bounce."""

TYPICAL_UNMODELLED = 0.075
"""Unmodelled share of the acceleration of a body, as found with a reference on a real train."""

BANDWIDTH_TOLERANCE = 0.25
"""Relative change of the usable bandwidth after a fit from which the fit is repeated."""

MIN_BANDWIDTH = 2.0
"""Minimum usable bandwidth, Hz: the body bounce lies below."""

ONE_SENSOR = (
    "one sensor determines the vehicle only by what changes with speed, and only if the track's spectrum has the shape "
    "of the prior: state the prior if you know it"
)

MAX_DEVIATION = 3.0
"""Distance of an estimate from its start at which it contradicts the prior, standard deviations."""


@dataclass(frozen=True)
class ParameterEstimate:
    """Estimate of one parameter: value, standard error and start, in ``unit``."""

    name: str
    unit: str
    start: float
    value: float
    standard_error: float


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration.

    Parameters
    ----------
    vehicle, installation : inputs of ``infer``
    estimates : the fitted parameters
    correlation : (estimates, estimates), of the errors
    log_likelihood : of the recordings, given the reference
    notes : held parameters, assumptions and doubts, one sentence each
    start : the model about which the priors stand
    fit : of vehicle and positions
    spectral_fits : per sensor, the part of its spectrum that the track explains through the fitted vehicle
    """

    vehicle: Vehicle
    installation: Installation
    estimates: tuple[ParameterEstimate, ...]
    correlation: Array
    log_likelihood: float
    notes: tuple[str, ...]
    start: Model
    fit: Fit
    spectral_fits: tuple[SpectralFit, ...]

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
    vehicle: Vehicle,
    reference: xr.Dataset | None = None,
    *,
    installation: Installation | None = None,
    track: Track | None = None,
    prior: Spectrum | None = None,
    parameters: Sequence[str] | None = None,
    keep_undetermined: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Estimate the parameters of vehicle and installation from recordings, at the maximum of the posterior.

    First the vehicle and the sensor positions, with white noise alone: what a rigid, linear vehicle model leaves out is
    strongest where the signals are, and a coloured residual would absorb it. Over a known profile this is least squares
    of the signals. Over an unknown profile it is the likelihood of the signals under a profile of the prior's shape,
    whose level is estimated too; the signals are limited to the usable bandwidth, in which the track explains more of
    them than the noise.
    Then, with these held, the noise of the sensors and the unmodelled acceleration, where a reference determines them:
    the values under which the reference is most probable given the signals.
    Each parameter has a prior about its start (log-normal where it is positive); the standard errors allow for
    residuals that are correlated over ``CORRELATION_LENGTH``.

    Parameters
    ----------
    recording : one or more, of the same vehicle and sensors
    vehicle, installation : where the fit starts
    reference : the profile contract; None where the profile is unknown
    track : under the wheels; None is a rigid track
    prior : shape of the unknown profile's spectrum, and where the search for its level starts, m²/(rad/m)
    parameters : names to estimate; None estimates all parameters of vehicle and positions, and holds those that the
        data do not determine
    keep_undetermined : estimate also parameters on which the data have less information than the prior
    progress : called with the stage and its completed share, dimensionless

    Raises
    ------
    DataError
        Where the reference covers none of the recordings, or their sensors differ.
    UndeterminedError
        Where the data do not determine one of the named ``parameters``, or none of all.
    """
    installation = installation or Installation()
    progress = progress or (lambda stage, share: None)
    recordings = [recording] if isinstance(recording, xr.Dataset) else list(recording)
    runs, notes = calibration_runs(recordings, reference, vehicle, installation)
    runs, selection = most_informative(runs)
    notes += selection
    given = _start(runs, vehicle, point_track(track or RigidTrack()), installation, prior)
    free = _free_parameters(given, parameters, with_origin=reference is not None)
    request, start = FitRequest(free, parameters is not None, keep_undetermined), given
    if reference is not None:
        progress("searching the origin", 0.0)
        start = _with_best_origin(runs, given, free)
    fit = _fit(runs, start, request, notes, progress)
    if len(start.sensors) == 1 and not any(one.known for one in runs):
        notes.append(ONE_SENSOR)
    model = _with_noise(runs, fit, installation, notes, progress)
    notes += _doubts(start, fit)
    parts, _ = spectral_fit([one.data for one in runs], fit.model)
    return _calibration(given, model, fit, installation, tuple(notes), tuple(parts))


def _fit(
    runs: list[RunData], start: Model, request: FitRequest, notes: list[str], progress: Progress
) -> Fit:
    """Fit in the usable bandwidth of the start, and again if that of the fitted vehicle differs."""
    limited, highest = _in_usable_band(runs, start)
    fit = fit_mechanics(limited, start, request, notes, progress)
    again, after = _in_usable_band(runs, fit.model)
    if any(abs(a - b) > BANDWIDTH_TOLERANCE * b for a, b in zip(after, highest, strict=True)):
        fit, highest = fit_parameters(again, start, fit.model, fit.free, progress), after
    notes += [
        f"usable bandwidth of {one.name}: {frequency:.1f} Hz, below which the track explains more of it than the noise"
        for one, frequency in zip(start.sensors, highest, strict=False)
    ]
    return fit


def _in_usable_band(runs: Sequence[RunData], model: Model) -> tuple[list[RunData], list[float]]:
    """The runs, those without a known profile limited to the usable bandwidth; and that bandwidth per sensor, Hz."""
    unknown = [one.data for one in runs if one.known is None]
    if not unknown:
        return list(runs), []
    highest = [max(one.highest, MIN_BANDWIDTH) for one in spectral_fit(unknown, model)[0]]
    return [
        one if one.known else replace(one, data=limit_bandwidth(one.data, highest)) for one in runs
    ], highest


def _free_parameters(
    start: Model, names: Sequence[str] | None, *, with_origin: bool
) -> list[ModelParameter]:
    """The parameters with these names; without names, those of vehicle and positions."""
    default = vehicle_parameters(start) + position_parameters(start)
    if not with_origin:
        default = [one for one in default if one.name != ORIGIN]
    if names is None:
        return default
    return select_parameters(calibrated_parameters(start), names)


def _rows_within(length: float, runs: Sequence[RunData]) -> int:
    """Average number of measurement rows per ``length`` m."""
    run = sum(one.length for one in runs)
    return round(length * sum(one.data.signals.size for one in runs) / run)


def _start(
    runs: Sequence[RunData], vehicle: Vehicle, track: PointTrack, installation: Installation,
    prior: Spectrum | None,
) -> Model:  # fmt: skip
    """The model where the fit starts: white noise only, and the level of an unknown profile."""
    first = runs[0].data
    rms = signal_rms(first)
    sensors = tuple(
        replace(one, noise_density=0.1 * float(size))
        for one, size in zip(first.sensors, rms, strict=True)
    )
    model = Model(
        vehicle, track, sensors, installation.origin, 0.0, prior or DEFAULT_SPECTRUM, installation.distance_scale
    )  # fmt: skip
    unknown = [one.data for one in runs if one.known is None]
    if not unknown:
        return model
    parts, spectrum = spectral_fit(unknown, model)
    if len(unknown) < len(runs):
        return replace(model, spectrum=spectrum)
    noisy = [_with_spectral_noise(*pair) for pair in zip(first.sensors, parts, strict=True)]
    return replace(model, sensors=tuple(noisy), spectrum=spectrum)


def _with_spectral_noise(sensor: Sensor, part: SpectralFit) -> Sensor:
    """The sensor with the noise density of its spectrum, at least the stated one."""
    density = float(np.sqrt(part.noise[0]))
    return replace(sensor, noise_density=max(density, sensor.noise_density or 0.0))


def _with_best_origin(
    runs: Sequence[RunData], start: Model, free: Sequence[ModelParameter]
) -> Model:
    """The origin with the highest likelihood on a grid: the likelihood has many local maxima."""
    if not any(one.name == ORIGIN for one in free):
        return start
    # Off the knots: where all samples of a distance-sampled recording lie on knots, round-off decides their bays.
    shifts = np.arange(-ORIGIN_SEARCH, ORIGIN_SEARCH, 1.0) + 0.45 * KNOT_SPACING
    known = [one for one in runs if one.known]
    return most_likely(known, [replace(start, origin=start.origin + shift) for shift in shifts])


def _with_noise(
    runs: Sequence[RunData], fit: Fit, installation: Installation, notes: list[str], progress: Progress
) -> Model:  # fmt: skip
    """The fitted model with noise and unmodelled acceleration."""
    on_body = first_body_channel(fit.model.vehicle, fit.model.sensors) is not None
    if any(one.known for one in runs):
        return fit_noise(runs, _noise_start(fit.model, installation, on_body=on_body), progress)
    if not on_body:
        return fit.model
    unmodelled = installation.unmodelled
    if unmodelled is None:
        unmodelled = TYPICAL_UNMODELLED
        notes.append(
            f"unmodelled acceleration is assumed to be {unmodelled:.1%} of the measured RMS: without a reference the "
            "data do not separate it from the track"
        )
    with_unmodelled = replace(fit.model, unmodelled=unmodelled)
    return fit_parameters(fit.runs, with_unmodelled, with_unmodelled, [], progress).model


def _noise_start(model: Model, installation: Installation, *, on_body: bool) -> Model:
    """Where the search for the noise starts: drift with a corner at 0.2 Hz, a tenth of the signal unmodelled."""
    drifting = tuple(replace(one, drift=one.drift or one.noise_density) for one in model.sensors)
    unmodelled = (installation.unmodelled or 0.1) if on_body else 0.0
    return replace(model, sensors=drifting, unmodelled=unmodelled)


def _doubts(start: Model, fit: Fit) -> list[str]:
    """Sentences on signs that the fit may be wrong."""
    notes = disagreement(fit)
    if not fit.maximum.converged:
        notes.append(
            "the fit did not converge: its likelihood is flat or rough; hold some parameters"
        )
    for one in fit.free:
        deviation = value_of(fit.model, one) - value_of(start, one)
        if abs(deviation) > MAX_DEVIATION * one.standard_deviation:
            notes.append(
                f"{one.name} = {one.get(fit.model):.4g} {one.unit} lies far outside its prior about "
                f"{one.get(start):.4g}: start from another vehicle, or hold it"
            )
    return notes


def _calibration(
    start: Model, model: Model, fit: Fit, installation: Installation, notes: tuple[str, ...],
    parts: tuple[SpectralFit, ...],
) -> Calibration:  # fmt: skip
    count = len(fit.free)
    covariance = fit.maximum.covariance(memory=_rows_within(CORRELATION_LENGTH, fit.runs))[
        :count, :count
    ]
    errors = np.sqrt(np.diag(covariance))
    estimates = []
    for one, error in zip(fit.free, errors, strict=True):
        first, value = one.get(start), one.get(fit.model)
        scale = value if one.positive else 1.0
        estimates.append(ParameterEstimate(one.name, one.unit, first, value, scale * float(error)))
    fitted = replace(
        installation, origin=model.origin, sensors=model.sensors, unmodelled=model.unmodelled,
        distance_scale=model.distance_scale,
        uncertainty=Uncertainty(
            tuple(one.name for one in fit.free), tuple(map(tuple, covariance.tolist()))
        ),
    )  # fmt: skip
    return Calibration(
        model.vehicle, fitted, tuple(estimates), covariance / np.outer(errors, errors),
        fit.maximum.slopes.log_likelihood, notes, start, fit, parts,
    )  # fmt: skip

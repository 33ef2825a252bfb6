"""calibrate: the vehicle, the sensors' places and the noise, from what was recorded; with a reference or without."""

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
    best_fit,
    disagreement,
    fit_mechanics,
    fit_noise,
    fit_parameters,
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

MEMORY = 20.0
"""m over which residuals hang together: a few periods of the body's bounce."""

TYPICAL_UNMODELLED = 0.075
"""Of what a body shows: what its rigid, linear model left where a reference told it."""

BAND_FOUND = 0.25
"""Share by which the usable band may change once the vehicle is fitted, before it is fitted again."""

LEAST_BAND = 2.0
"""Hz: the bounce of a body lies below."""

ONE_SENSOR = (
    "one sensor tells the vehicle by what changes with speed, and only if the track's spectrum has the shape of the "
    "prior: state it if you know it"
)

FAR = 3.0
"""Standard deviations of the prior, from which an estimate counts as at the edge of it."""


@dataclass(frozen=True)
class ParameterEstimate:
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
    start : the model about which the priors stand
    fit : of vehicle and places
    explained : per sensor, what of its signal the track explains through the fitted vehicle
    """

    vehicle: Vehicle
    installation: Installation
    estimates: tuple[ParameterEstimate, ...]
    correlation: Array
    log_likelihood: float
    notes: tuple[str, ...]
    start: Model
    fit: Fit
    explained: tuple[SpectralFit, ...]

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
    anyway: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Fit named parameters to recordings, by maximising the posterior; a reference is only more data.

    First the vehicle and the sensors' places with white noise alone: what a rigid, linear car leaves out is
    strongest where the signals are, and must not be explained away by colouring the residual. Over a known profile
    that is least squares of the signals. Over an unknown one it is the likelihood of the signals under a profile of
    the prior's shape, whose level is fitted too; of the signals only what lies in the usable band is taken, in which
    the track explains more of them than the noise does.
    Then, with those held, the noise of the sensors and the unmodelled acceleration, where a reference tells them: as
    makes it most probable, given the signals.
    Each parameter has a prior about its start (log-normal where it is positive, with the vehicle's ``spread``); the
    standard errors allow for residuals that hang together over ``MEMORY`` m.

    Parameters
    ----------
    recording : one or more, of the same vehicle and sensors
    vehicle, installation : where the fit starts
    reference : the profile contract; None where the profile is unknown
    track : what the wheels stand on; None is a rigid track
    prior : shape of the unknown profile's spectrum, and where the search for its level starts
    parameters : names to fit; None takes all of the vehicle and the places, and holds those that the data cannot tell
    anyway : keep also what the data tell less than the prior does
    progress : told the stage and its share done

    Raises
    ------
    DataError
        Where the reference covers none of the recordings, or these have different sensors.
    UndeterminedError
        Where the data cannot tell one of the ``parameters``, or none of all.
    """
    installation = installation or Installation()
    progress = progress or (lambda stage, share: None)
    recordings = [recording] if isinstance(recording, xr.Dataset) else list(recording)
    passes, notes = calibration_runs(recordings, reference, vehicle, installation)
    passes, said = most_informative(passes)
    notes += said
    given = _started(passes, vehicle, point_track(track or RigidTrack()), installation, prior)
    wanted, start = _to_fit(given, parameters, with_origin=reference is not None), given
    if reference is not None:
        progress("finding the origin", 0.0)
        start = _with_best_origin(passes, given, wanted)
    fit = _fit(passes, start, wanted, parameters is not None, anyway, notes, progress)
    if len(start.sensors) == 1 and not any(one.known for one in passes):
        notes.append(ONE_SENSOR)
    model = _with_noise(passes, fit, installation, notes, progress)
    notes += _doubts(start, fit)
    parts, _ = spectral_fit([one.data for one in passes], fit.model)
    return _calibration(given, model, fit, installation, tuple(notes), tuple(parts))


def _fit(
    passes: list[RunData], start: Model, wanted: list[ModelParameter], asked: bool, anyway: bool,
    notes: list[str], progress: Progress,
) -> Fit:  # fmt: skip
    """Fit in the band that the start shows to be usable, and again if the fitted vehicle shows another."""
    cut, highest = _in_band(passes, start)
    fit = fit_mechanics(
        cut, start, wanted, asked=asked, anyway=anyway, notes=notes, progress=progress
    )
    again, after = _in_band(passes, fit.model)
    if any(abs(a - b) > BAND_FOUND * b for a, b in zip(after, highest, strict=True)):
        fit, highest = fit_parameters(again, start, fit.model, fit.free, progress), after
    notes += [
        f"usable band of {one.name}: up to {frequency:.1f} Hz, where the track explains more of it than noise does"
        for one, frequency in zip(start.sensors, highest, strict=False)
    ]
    return fit


def _in_band(passes: Sequence[RunData], model: Model) -> tuple[list[RunData], list[float]]:
    """The passes, those without a known profile cut to the usable band; and the band's ends, Hz, one per sensor."""
    unknown = [one.data for one in passes if one.known is None]
    if not unknown:
        return list(passes), []
    highest = [max(one.highest, LEAST_BAND) for one in spectral_fit(unknown, model)[0]]
    return [
        one if one.known else replace(one, data=limit_bandwidth(one.data, highest))
        for one in passes
    ], highest


def _to_fit(
    start: Model, names: Sequence[str] | None, *, with_origin: bool
) -> list[ModelParameter]:
    """Those of the names; without names, what is unknown of every vehicle."""
    usual = vehicle_parameters(start) + position_parameters(start)
    if not with_origin:
        usual = [one for one in usual if one.name != ORIGIN]
    if names is None:
        return usual
    return select_parameters(calibrated_parameters(start), names)


def _rows_within(length: float, passes: Sequence[RunData]) -> int:
    """Measurement rows per ``length`` m, on average over the recordings."""
    run = sum(one.length for one in passes)
    return round(length * sum(one.data.signals.size for one in passes) / run)


def _started(
    passes: Sequence[RunData], vehicle: Vehicle, track: PointTrack, installation: Installation,
    prior: Spectrum | None,
) -> Model:  # fmt: skip
    """The model where the fit starts: white noise alone, and the level of an unknown profile."""
    first = passes[0].data
    spread = signal_rms(first)
    sensors = tuple(
        replace(one, noise_density=0.1 * float(size))
        for one, size in zip(first.sensors, spread, strict=True)
    )
    model = Model(
        vehicle, track, sensors, installation.origin, 0.0, prior or DEFAULT_SPECTRUM, installation.distance_scale
    )  # fmt: skip
    unknown = [one.data for one in passes if one.known is None]
    if not unknown:
        return model
    parts, spectrum = spectral_fit(unknown, model)
    if len(unknown) < len(passes):
        return replace(model, spectrum=spectrum)
    noisy = [_noise(*pair) for pair in zip(first.sensors, parts, strict=True)]
    return replace(model, sensors=tuple(noisy), spectrum=spectrum)


def _noise(sensor: Sensor, part: SpectralFit) -> Sensor:
    """The sensor with the noise that its signal shows; not less than it states."""
    found = float(np.sqrt(part.noise[0]))
    return replace(sensor, noise_density=max(found, sensor.noise_density or 0.0))


def _with_best_origin(
    passes: Sequence[RunData], start: Model, free: Sequence[ModelParameter]
) -> Model:
    """The origin with the highest likelihood on a grid: it has many local maxima, a wave apart."""
    if not any(one.name == ORIGIN for one in free):
        return start
    # Off the knots: where all samples of a distance-sampled recording lie on knots, round-off decides their bays.
    shifts = np.arange(-ORIGIN_SEARCH, ORIGIN_SEARCH, 1.0) + 0.45 * KNOT_SPACING
    known = [one for one in passes if one.known]
    return best_fit(known, [replace(start, origin=start.origin + shift) for shift in shifts])


def _with_noise(
    passes: Sequence[RunData], fit: Fit, installation: Installation, notes: list[str], progress: Progress
) -> Model:  # fmt: skip
    """The noise, and what the vehicle's model leaves out, for the fitted vehicle."""
    on_body = first_body_channel(fit.model.vehicle, fit.model.sensors) is not None
    if any(one.known for one in passes):
        return fit_noise(passes, _noisy(fit.model, installation, on_body=on_body), progress)
    if not on_body:
        return fit.model
    unmodelled = installation.unmodelled
    if unmodelled is None:
        unmodelled = TYPICAL_UNMODELLED
        notes.append(
            f"unmodelled acceleration is taken to be {unmodelled:.1%} of what the body shows: without a reference it "
            "is not told apart from the track"
        )
    shaken = replace(fit.model, unmodelled=unmodelled)
    return fit_parameters(fit.passes, shaken, shaken, [], progress).model


def _noisy(model: Model, installation: Installation, *, on_body: bool) -> Model:
    """Where the search for the noise starts: drift with a corner at 0.2 Hz, a tenth of the signal unmodelled."""
    drifting = tuple(replace(one, drift=one.drift or one.noise_density) for one in model.sensors)
    unmodelled = (installation.unmodelled or 0.1) if on_body else 0.0
    return replace(model, sensors=drifting, unmodelled=unmodelled)


def _doubts(start: Model, fit: Fit) -> list[str]:
    """Sentences on what speaks against the fit."""
    notes = disagreement(fit)
    if not fit.found.converged:
        notes.append(
            "the fit did not converge: its likelihood is flat or rough; hold some parameters"
        )
    for one in fit.free:
        off = value_of(fit.model, one) - value_of(start, one)
        if abs(off) > FAR * one.standard_deviation:
            notes.append(
                f"{one.name} went to {one.get(fit.model):.4g} {one.unit}, far outside its prior about "
                f"{one.get(start):.4g}: start from another vehicle, or hold it"
            )
    return notes


def _calibration(
    start: Model, model: Model, fit: Fit, installation: Installation, notes: tuple[str, ...],
    parts: tuple[SpectralFit, ...],
) -> Calibration:  # fmt: skip
    count = len(fit.free)
    covariance = fit.found.covariance(memory=_rows_within(MEMORY, fit.passes))[:count, :count]
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
        fit.found.slopes.log_likelihood, notes, start, fit, parts,
    )  # fmt: skip

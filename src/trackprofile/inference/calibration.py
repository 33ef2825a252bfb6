"""calibrate: the vehicle, the sensors' places and the noise, from a stretch whose profile is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize

from trackprofile.errors import UndeterminedError
from trackprofile.inference.evidence import innovations_given, innovations_of
from trackprofile.inference.known import SEARCHED_ORIGINS, KnownProfile
from trackprofile.inference.likelihood import (
    Maximum,
    Progress,
    log_likelihood,
    maximise,
    slopes,
)
from trackprofile.inference.measured import (
    KNOT_SPACING,
    USUAL,
    Measured,
    Model,
    measured,
    shaken_channel,
)
from trackprofile.inference.parameters import (
    ORIGIN,
    Parameter,
    changed,
    mechanical_parameters,
    noise_parameters,
    value_of,
)
from trackprofile.receptance import point_track
from trackprofile.sensor import Installation
from trackprofile.spectrum import scaled
from trackprofile.track import PointTrack, RigidTrack, Track
from trackprofile.vehicle import Vehicle

Array = NDArray[np.float64]

MEMORY = 20.0
"""m over which residuals hang together: a few periods of the body's bounce."""

FIRST_MOVE = 0.5
"""Of each logarithm of a noise, with which its search begins."""

LITTLE, NOTHING = 1.0, 0.01
"""Information of a direction, in units of the prior's: less than the prior's own; next to none."""

INVOLVED = 0.3
"""Share of an undetermined direction from which a parameter counts as part of it."""


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

    First the vehicle and the sensors' places, by least squares on the signals: what a rigid, linear car leaves
    out is strongest where the signals are, and must not be explained away by colouring the residual. Then, with
    those held, the noise of the sensors and the unmodelled acceleration: as makes the reference most probable,
    given the signals.
    Each parameter has a prior about its start (log-normal where it is positive); the standard errors allow for
    residuals that hang together over ``MEMORY`` m.

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
    data = [
        known.covered(measured(one, installation), vehicle, installation.origin)
        for one in recordings
    ]
    start = _started(data, vehicle, point_track(track or RigidTrack()), installation)
    every = mechanical_parameters(start, parameters)
    progress("finding the origin", 0.0)
    beginning = _with_best_origin(data, known, start, every)
    free, notes = _told(data, known, beginning, every, asked=parameters is not None)
    asked = parameters is not None
    fitted, free, found = _fit_mechanics(data, known, beginning, free, asked, notes, progress)
    complete = _fit_noise(data, known, _noisy(data, fitted, installation), progress)
    if not found.converged:
        notes.append(
            "the fit did not converge: its likelihood is flat or rough; hold some parameters"
        )
    covariance = found.covariance(memory=_rows_within(MEMORY, data))
    return _calibration(start, complete, free, found, covariance, installation, tuple(notes))


def _rows_within(length: float, data: list[Measured]) -> int:
    """Measurement rows per ``length`` m, on average over the recordings."""
    run = sum(float(np.ptp(one.motion.distance)) for one in data)
    return round(length * sum(one.signals.size for one in data) / run)


def _started(
    data: list[Measured], vehicle: Vehicle, track: PointTrack, installation: Installation
) -> Model:
    """The model where the fit starts: white noise alone, a tenth of the signal, and a reference without error."""
    first = data[0]
    sensors = [
        replace(sensor, noise_density=0.1 * float(np.std(first.signals[first.valid[:, i], i])))
        for i, sensor in enumerate(first.sensors)
    ]
    exact = scaled(USUAL, 1e-9)
    return Model(vehicle, track, tuple(sensors), installation.origin, 0.0, exact)


def _noisy(data: list[Measured], model: Model, installation: Installation) -> Model:
    """Where the search for the noise starts: drift with a corner at 0.2 Hz, a tenth of the signal unmodelled."""
    drifting = tuple(replace(one, drift=one.drift or one.noise_density) for one in model.sensors)
    on_body = shaken_channel(model.vehicle, data[0].sensors) is not None
    unmodelled = (installation.unmodelled or 0.1) if on_body else 0.0
    return replace(model, sensors=drifting, unmodelled=unmodelled)


def _with_best_origin(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter]
) -> Model:
    """The origin with the highest likelihood on a grid: it has many local maxima, a wave apart."""
    if not any(one.name == ORIGIN for one in free):
        return start
    # Off the knots: where all samples of a distance-sampled recording lie on knots, round-off decides their bays.
    shifts = np.arange(-SEARCHED_ORIGINS, SEARCHED_ORIGINS, 1.0) + 0.45 * KNOT_SPACING
    trials = [replace(start, origin=start.origin + shift) for shift in shifts]
    heights = [log_likelihood(*innovations_given(data, known, trial)) for trial in trials]
    return trials[int(np.argmax(heights))]


def _function_of(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter]
) -> Callable[[Array], tuple[Array, Array]]:
    return lambda at: innovations_given(data, known, changed(start, free, at))


def _fitted(
    data: list[Measured], known: KnownProfile, centre: Model, start: Model, free: list[Parameter],
    progress: Callable[[float], None],
) -> Maximum:  # fmt: skip
    """The maximum over ``free``, from ``start``, with the prior about ``centre``."""
    at, about = (np.array([value_of(model, one) for one in free]) for model in (start, centre))
    precision = np.array([one.spread**-2 for one in free])
    return maximise(_function_of(data, known, start, free), at, about, precision, progress)


def _fit_mechanics(
    data: list[Measured], known: KnownProfile, beginning: Model, free: list[Parameter], asked: bool,
    notes: list[str], progress: Progress,
) -> tuple[Model, list[Parameter], Maximum]:  # fmt: skip
    """Fit vehicle and places; hold what the data turn out not to tell, and fit the rest again."""
    model = beginning
    while True:
        every = [*free, *noise_parameters(model)]
        found = _fitted(
            data,
            known,
            beginning,
            model,
            every,
            lambda share: progress("fitting the vehicle", share),
        )
        model = changed(model, every, found.parameters)
        lost = _untold(found.slopes.information[: len(free), : len(free)], free, LITTLE)
        if lost is None:
            return model, free, found
        if asked:
            raise _undetermined(free, lost)
        worst = lost[0]
        notes.append(_held(free, lost))
        model = changed(model, [free[worst]], np.array([value_of(beginning, free[worst])]))
        free = [one for i, one in enumerate(free) if i != worst]


def _fit_noise(
    data: list[Measured], known: KnownProfile, model: Model, progress: Progress
) -> Model:
    """The noise under which the reference is most probable, given the signals.

    log p(r|y) = log p(y|r) - log p(y) + log p(r), of which the last does not depend on the noise. Unlike
    p(y|r) alone, the difference is not swayed by what in the signals tells nothing of the track.
    """
    noise = noise_parameters(model)
    centre = np.array([value_of(model, one) for one in noise])
    precision = np.array([one.spread**-2 for one in noise])

    def improbability(at: Array) -> float:
        trial = changed(model, noise, at)
        given = log_likelihood(*innovations_given(data, known, trial))
        free = log_likelihood(*innovations_of(data, replace(trial, spectrum=known.spectrum)))
        return free - given + 0.5 * float(np.sum(precision * (at - centre) ** 2))

    progress("fitting the noise", 0.0)
    simplex = np.vstack([centre, centre + FIRST_MOVE * np.eye(len(centre))])
    found = minimize(
        improbability, centre, method="Nelder-Mead",
        options={"xatol": 0.05, "fatol": 0.3, "initial_simplex": simplex},
    )  # fmt: skip
    progress("fitting the noise", 1.0)
    return changed(model, noise, found.x)


def _told(
    data: list[Measured], known: KnownProfile, start: Model, free: list[Parameter], asked: bool
) -> tuple[list[Parameter], list[str]]:
    """Leave out, one by one, what no fit could tell, whatever the values; refuse if it was asked for."""
    at = np.array([value_of(start, one) for one in free])
    information = slopes(_function_of(data, known, start, free), at).information
    notes: list[str] = []
    while (lost := _untold(information, free, NOTHING)) is not None:
        if asked:
            raise _undetermined(free, lost)
        notes.append(_held(free, lost))
        keep = [i for i in range(len(free)) if i != lost[0]]
        free, information = [free[i] for i in keep], information[np.ix_(keep, keep)]
    return free, notes


def _untold(information: Array, free: list[Parameter], least: float) -> list[int] | None:
    """Parameters of the direction that the data tell least, the most involved first; None if it is told.

    A direction is told if its eigenvalue of the information, in units of the prior's, exceeds ``least``.
    """
    spread = np.array([one.spread for one in free])
    values, directions = np.linalg.eigh(information * np.outer(spread, spread))
    if values[0] > least:
        return None
    share = np.abs(directions[:, 0])
    # The first of those that share a direction alike: masses stand first, and only their ratios are told.
    worst = int(np.flatnonzero(share > 0.8 * np.max(share))[0])
    others = [int(i) for i in np.argsort(-share) if share[i] > INVOLVED and i != worst]
    return [worst, *others]


def _undetermined(free: list[Parameter], lost: list[int]) -> UndeterminedError:
    names = ", ".join(repr(free[i].name) for i in lost)
    if len(lost) == 1:
        return UndeterminedError(
            f"The data do not tell {names}: leave it out, or add recordings that excite it."
        )
    return UndeterminedError(
        f"The data tell {names} only together, not each: leave one of them out, or add recordings at other speeds."
    )


def _held(free: list[Parameter], lost: list[int]) -> str:
    name, others = free[lost[0]].name, ", ".join(free[i].name for i in lost[1:])
    return f"{name} is held at its start: the data do not tell it" + (
        f" apart from {others}" if others else ""
    )


def _calibration(
    start: Model, model: Model, free: list[Parameter], found: Maximum, covariance: Array,
    installation: Installation, notes: tuple[str, ...],
) -> Calibration:  # fmt: skip
    covariance = covariance[: len(free), : len(free)]
    errors = np.sqrt(np.diag(covariance))
    estimates = []
    for i, one in enumerate(free):
        first, value, error = value_of(start, one), float(found.parameters[i]), float(errors[i])
        if one.positive:
            first, value = float(np.exp(first)), float(np.exp(value))
            error *= value
        estimates.append(Estimated(one.name, one.unit, first, value, error))
    correlation = covariance / np.outer(errors, errors)
    fitted = replace(
        installation, origin=model.origin, sensors=model.sensors, unmodelled=model.unmodelled
    )
    return Calibration(
        model.vehicle, fitted, tuple(estimates), correlation, found.slopes.log_likelihood, notes
    )

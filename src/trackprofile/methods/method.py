"""The protocol of a method, the registry of methods, and `infer`.

A method estimates a profile from a recording. To add one, write a module of this package with one function,

    def my_method(recording, vehicle, *, installation=None, track=None, seed=0, progress=None, my_setting=1.0):
        ...
        return result           # any object with the attributes of `MethodResult`

and add one line to ``METHODS``. `infer(..., method="my-method")` and `trackprofile infer --method my-method` then run
it. The module is imported on first use.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.models.sensor import Installation
from trackprofile.models.track import Track
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]


class MethodResult(Protocol):
    """Result of a method.

    Parameters
    ----------
    profile : the profile contract
    used_signals : by channel, (samples,), the signal used: upright and without gravity; NaN where it was not used
    reproduced : by channel, (samples,), the model's signal for the profile; NaN where it was not computed
    sample_distance : (samples,), position of the leading wheel, m
    notes : assumptions and problems, one sentence each
    figures : statistics of the estimation, by name
    """

    @property
    def profile(self) -> xr.Dataset: ...
    @property
    def used_signals(self) -> Mapping[str, Array]: ...
    @property
    def reproduced(self) -> Mapping[str, Array]: ...
    @property
    def sample_distance(self) -> Array: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def figures(self) -> Mapping[str, float]: ...


class Method(Protocol):
    """A method: a function with these arguments, and its own settings as further keyword-only arguments.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    installation : installation of the sensors, from a calibration; None uses the recording's description
    track : track under the wheels; None is a rigid track
    seed : seed of all random numbers
    progress : called with the stage and the share done
    """

    def __call__(
        self,
        recording: xr.Dataset,
        vehicle: Vehicle,
        *,
        installation: Installation | None = None,
        track: Track | None = None,
        seed: int = 0,
        progress: Progress | None = None,
        **settings: Any,
    ) -> MethodResult: ...


@dataclass(frozen=True)
class MethodEntry:
    """A registered method.

    Parameters
    ----------
    module, function : where it is defined
    summary : one sentence, for help texts and tables
    source : publication
    """

    module: str
    function: str
    summary: str
    source: str


METHODS: dict[str, MethodEntry] = {
    "smoother": MethodEntry(
        "trackprofile.inference.infer",
        "estimate",
        "optimal smoother with a Markov prior of the profile; gives the uncertainty of every point and band",
        "docs/theory.md, section 7",
    ),
    "cross-entropy": MethodEntry(
        "trackprofile.methods.cross_entropy.estimator",
        "cross_entropy",
        "cross-entropy search of the profile, window by window; gives no uncertainty",
        "O'Brien, Bowe, Quirke, Cantero 2017, doi 10.1177/0954409716664936",
    ),
}
"""The registered methods by name."""

COMMON = frozenset({"recording", "vehicle", "installation", "track", "seed", "progress"})
"""Arguments that every method has."""


def load_method(name: str) -> Method:
    """Import a method by name.

    Raises
    ------
    ModelError
        Where there is no method of that name.

    Examples
    --------
    >>> load_method("cross-entropy").__name__
    'cross_entropy'
    """
    if name not in METHODS:
        raise ModelError(f"there is no method {name!r}; use one of {', '.join(METHODS)}")
    entry = METHODS[name]
    return getattr(import_module(entry.module), entry.function)


def method_settings(name: str) -> tuple[str, ...]:
    """The names of a method's own settings.

    Examples
    --------
    >>> method_settings("cross-entropy")
    ('search', 'evaluation')
    """
    return tuple(
        one for one in inspect.signature(load_method(name)).parameters if one not in COMMON
    )


def check_settings(name: str, settings: Mapping[str, object]) -> None:
    """Check that a method has all of the given settings.

    Raises
    ------
    ModelError
        Where the method does not have one of them.

    Examples
    --------
    >>> check_settings("cross-entropy", {"search": None})
    """
    known = method_settings(name)
    for one in settings:
        if one not in known:
            raise ModelError(
                f"the method {name!r} has no setting {one!r}; its settings are {', '.join(known)}"
            )


def infer(
    recording: xr.Dataset,
    vehicle: Vehicle,
    *,
    method: str = "smoother",
    installation: Installation | None = None,
    track: Track | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Estimate the longitudinal profile of the track from a recording.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    method : a name in ``METHODS``
    installation : installation of the sensors, from a calibration; None uses the recording's description
    track : track under the wheels; None is a rigid track
    seed : seed of all random numbers
    progress : called with the stage and the share done
    settings : settings of the method: of the smoother those of `trackprofile.inference.infer.estimate`, of
        cross-entropy those of `trackprofile.methods.cross_entropy.estimator.cross_entropy`

    Returns
    -------
    the profile contract: elevation (m) every 0.25 m along the run of the leading wheel, with the standard deviation
    (m) of every point and band where the method gives it; with sensors left and right or of roll also the elevation
    of each rail and their difference

    Raises
    ------
    DataError
        Where the recording cannot be used, such as one shorter than the vehicle.
    ModelError
        Where the vehicle lacks the body of a sensor, or the method is unknown or lacks a setting.

    Examples
    --------
    >>> from trackprofile.demo import simulated
    >>> from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
    >>> vehicle, _ = read_vehicle("velaro")
    >>> recording, _ = simulated(
    ...     vehicle, read_track("zhai"), read_sensors("bogie-25ug"), read_spectrum("german-low"), 60.0, 1)
    >>> profile = infer(recording, vehicle, track=read_track("zhai"))
    >>> profile.attrs["kind"]
    'posterior'
    """
    check_settings(method, settings)
    return load_method(method)(
        recording, vehicle, installation=installation, track=track, seed=seed, progress=progress,
        **settings,
    ).profile  # fmt: skip

"""The protocol of a method, and `infer`, which chooses one.

A method estimates a profile from a recording. To add one, write a module of this package with a settings class and a
function,

    @dataclass(frozen=True)
    class MySettings:
        installation: Installation = field(default_factory=Installation)
        track: Track = field(default_factory=RigidTrack)
        seed: int = 0
        my_setting: float = 1.0

    def my_method(recording, vehicle, settings=None, *, progress=None):
        ...
        return result           # any object with the attributes of `MethodResult`

and add one entry to `trackprofile.methods.registry`. `trackprofile.infer(..., method="my-method")` then runs it. The
module is imported only when its method is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from importlib import import_module
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.errors import ModelError
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.methods.registry import METHODS, MethodEntry
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]


class MethodResult(Protocol):
    """Result of a method.

    Parameters
    ----------
    profile : the profile contract
    used_signals : by channel, (samples,), upright and without gravity, m/s² or rad/s; NaN where a sample is not used
    reproduced : by channel, (samples,), the model's signal for the profile, m/s² or rad/s; NaN where not computed
    sample_distance : (samples,), position of the leading wheel, m
    notes : assumptions and problems, one sentence each
    figures : statistics of the estimation, by name

    A method that can end early also has ``stopped``, the reason as text, empty where it did not.
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


class EstimationMethod(Protocol):
    """A function that estimates a profile.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    settings : an object of the method's settings class; None uses the defaults
    progress : called with the stage and the share done
    """

    def __call__(
        self,
        recording: xr.Dataset,
        vehicle: Vehicle,
        settings: Any = None,
        *,
        progress: Progress | None = None,
    ) -> MethodResult: ...


def load_method(name: str) -> EstimationMethod:
    """Import the function of a method.

    Raises
    ------
    ModelError
        Where there is no method of that name.

    Examples
    --------
    >>> load_method("cross-entropy").__name__
    'cross_entropy'
    """
    return _imported(_entry(name).function)


def setting_names(name: str) -> tuple[str, ...]:
    """Names of a method's settings.

    Examples
    --------
    >>> setting_names("cross-entropy")
    ('installation', 'track', 'search', 'evaluation', 'seed')
    """
    return tuple(one.name for one in fields(_imported(_entry(name).settings)))


def method_settings(name: str, values: Mapping[str, Any]) -> Any:
    """Settings of a method from values by name; None stands for the default.

    Raises
    ------
    ModelError
        Where there is no method of that name, or the method does not have one of the settings.

    Examples
    --------
    >>> method_settings("cross-entropy", {"seed": 3, "search": None}).seed
    3
    """
    known = setting_names(name)
    for one in values:
        if one not in known:
            raise ModelError(
                f"the method {name!r} has no setting {one!r}; its settings are {', '.join(known)}"
            )
    settings = _imported(_entry(name).settings)
    return settings(**{key: value for key, value in values.items() if value is not None})


def _entry(name: str) -> MethodEntry:
    if name not in METHODS:
        raise ModelError(f"there is no method {name!r}; use one of {', '.join(METHODS)}")
    return METHODS[name]


def _imported(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


def infer(
    recording: xr.Dataset,
    vehicle: Vehicle,
    *,
    method: str = "smoother",
    progress: Progress | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Longitudinal profile of the track from the signals that a vehicle's sensors recorded.

    The default method is the optimal smoother (theory, section 7): the posterior mean of a spline with a Markov prior
    given all valid samples, with its standard deviation at every point and, from posterior samples, in each of the
    bands D1, D2 and D3.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    method : name of a method in `trackprofile.methods.registry`
    progress : called with the stage and its completed share, dimensionless
    settings : settings of the method by name, such as ``installation``, ``track`` and ``seed``: for the smoother the
        fields of `trackprofile.inference.settings.InferenceSettings`, for cross-entropy those of
        `trackprofile.methods.cross_entropy.search_settings.CrossEntropySettings`. None stands for the default

    Returns
    -------
    the profile contract: elevation (m) every 0.25 m where the leading wheel ran; with sensors left and right, or of
    roll, also the elevation of each rail and their difference

    Raises
    ------
    DataError
        Where the recording cannot be used, such as one shorter than the vehicle.
    ModelError
        Where the vehicle lacks the body that a sensor is mounted on, or the method or a setting is unknown.

    Examples
    --------
    >>> from trackprofile.demo import simulated
    >>> from trackprofile.io.model_toml import read_sensors, read_spectrum, read_track, read_vehicle
    >>> vehicle, track = read_vehicle("velaro")[0], read_track("zhai")
    >>> sensors, spectrum = read_sensors("bogie-25ug"), read_spectrum("german-low")
    >>> recording, _ = simulated(vehicle, track, sensors, spectrum, length=60.0, seed=1)
    >>> infer(recording, vehicle, track=track).attrs["kind"]
    'posterior'
    """
    chosen = method_settings(method, settings)
    return load_method(method)(recording, vehicle, chosen, progress=progress).profile

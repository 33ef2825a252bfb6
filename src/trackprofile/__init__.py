"""Railway track profiles, with their uncertainty, from what an ordinary train's sensors record.

    recording = trackprofile.read("run.toml")
    profile = trackprofile.infer(recording, vehicle)
    trackprofile.write(profile, "profile.nc")

A recording and a profile are ``xarray.Dataset``s (see `trackprofile.contracts`); everything else
is a verb on them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trackprofile.assessment.assess import assess as assess
    from trackprofile.assessment.compare import compare as compare
    from trackprofile.assessment.trend import trend as trend
    from trackprofile.calibration.calibrate import calibrate as calibrate
    from trackprofile.inference.accuracy_bound import accuracy_bound as accuracy_bound
    from trackprofile.inference.infer import infer as infer
    from trackprofile.io import read as read
    from trackprofile.io import write as write
    from trackprofile.models.sensor import Sensor as Sensor
    from trackprofile.models.spectrum import Spectrum as Spectrum
    from trackprofile.models.track import ElasticTrack as ElasticTrack
    from trackprofile.models.track import LayeredTrack as LayeredTrack
    from trackprofile.models.track import RigidTrack as RigidTrack
    from trackprofile.models.vehicle import Vehicle as Vehicle
    from trackprofile.reporting.report import report as report
    from trackprofile.simulation.simulate import simulate as simulate

__version__ = "0.1.0"

_HOMES = {
    "ElasticTrack": "models.track",
    "LayeredTrack": "models.track",
    "RigidTrack": "models.track",
    "Sensor": "models.sensor",
    "Spectrum": "models.spectrum",
    "Vehicle": "models.vehicle",
    "assess": "assessment.assess",
    "calibrate": "calibration.calibrate",
    "trend": "assessment.trend",
    "compare": "assessment.compare",
    "infer": "inference.infer",
    "accuracy_bound": "inference.accuracy_bound",
    "read": "io",
    "report": "reporting.report",
    "simulate": "simulation.simulate",
    "write": "io",
}

__all__ = [
    "ElasticTrack",
    "LayeredTrack",
    "RigidTrack",
    "Sensor",
    "Spectrum",
    "Vehicle",
    "__version__",
    "accuracy_bound",
    "assess",
    "calibrate",
    "compare",
    "infer",
    "read",
    "report",
    "simulate",
    "trend",
    "write",
]


# Names load on first use (PEP 562), so that `trackprofile --help` answers at once.
def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'trackprofile' has no attribute {name!r}")
    return getattr(import_module(f"trackprofile.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])

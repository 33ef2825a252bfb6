"""Settings of an inference: what it depends on besides the recording and the vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field

from trackprofile.models.sensor import Installation
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import RigidTrack, Track


@dataclass(frozen=True)
class InferenceSettings:
    """What an inference depends on besides the recording and the vehicle.

    Parameters
    ----------
    installation : of the sensors, from a calibration
    track : under the wheels
    prior : spectrum of the profile (mean of both rails) before anything is measured; None estimates its level from the
        data. The prior of the rails' difference is always estimated from the data
    samples : number of posterior samples for the standard deviations of the bands; None: 128, fewer for a long run, at
        least 24
    seed : of the posterior samples
    full_track_correction : remove what the full model of a layered track adds to the signals beyond its reduced model,
        once: repetition amplifies waves of one sleeper bay
    estimate_load : estimate the mass of the first body, with a prior about the vehicle's stated mass
    """

    installation: Installation = field(default_factory=Installation)
    track: Track = field(default_factory=RigidTrack)
    prior: Spectrum | None = None
    samples: int | None = None
    seed: int = 0
    full_track_correction: bool = False
    estimate_load: bool = False

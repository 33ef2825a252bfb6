"""What the full model of a layered track makes the sensors read beyond the reduced one, on the same profile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from trackprofile.errors import ModelError
from trackprofile.inference.observations import Observations
from trackprofile.inference.problem import Model, leading_wheel_motion
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import Sampled
from trackprofile.models.track import LayeredTrack, Track
from trackprofile.simulation.simulate import RunSettings, sensor_signal, simulate
from trackprofile.simulation.speed_schedule import RecordedMotion

Array = NDArray[np.float64]

STEP = 5e-4
"""s: at 2 ms the contact of wheel and rail is 16 % wrong on a short dip (theory, section 4)."""

RUN_IN = 100.0
"""m before the recording, on which both models settle."""


def full_track_residual(
    data: Observations, model: Model, track: Track, place: Array, elevation: Array
) -> Array:
    """Full minus reduced model, at each sample and sensor, (n, sensors).

    Both simulations run over the same profile from the same start, so that what they begin with cancels.

    Parameters
    ----------
    track : layered; ``model.track`` is what stands for it
    place, elevation : (knots,), m, of the profile that both run over

    Raises
    ------
    ModelError
        Where the track is not layered: there is nothing beyond.
    DataError
        Where the train stops.
    """
    if not isinstance(track, LayeredTrack):
        raise ModelError(
            "Only a layered track can be corrected for; choose one, or ask for no correction."
        )
    along = leading_wheel_motion(data, model)
    profile = _extended(place, elevation, along.distance, model.vehicle.length)
    motion = RecordedMotion(along.time, along.distance, along.speed, RUN_IN)
    run = RunSettings(float(along.distance[0]), float(along.distance[-1]), motion, run_in=RUN_IN)
    read = []
    for on in (track, model.track):
        made = simulate(model.vehicle, on, profile, run, newmark(STEP))
        signals = [sensor_signal(made, model.vehicle, sensor) for sensor in model.sensors]
        at = np.clip(along.distance, made.position[0], made.position[-1])
        read.append(CubicSpline(made.position, np.stack(signals, axis=1))(at))
    return np.asarray(read[0] - read[1], np.float64)


def _extended(place: Array, elevation: Array, moved: Array, length: float) -> Sampled:
    """The profile, level beyond its ends as far as the wheels run."""
    spacing = place[1] - place[0]
    before = int(np.ceil((place[0] - moved[0] + RUN_IN + length) / spacing)) + 2
    after = max(int(np.ceil((moved[-1] - place[-1]) / spacing)) + 2, 2)
    first, last = np.full(before, elevation[0]), np.full(after, elevation[-1])
    whole = np.arange(-before, len(place) + after) * spacing + place[0]
    return Sampled(whole, np.concatenate([first, elevation, last]))

"""Difference of the sensor signals between the full model of a layered track and its reduced model."""

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
"""Time step of the simulations, s: at 2 ms the wheel-rail contact is 16 % wrong on a short dip (theory, section 4)."""

RUN_IN = 100.0
"""Distance before the recording on which both models reach a steady state, m."""


def full_track_residual(
    data: Observations, model: Model, track: Track, position: Array, elevation: Array
) -> Array:
    """Signals of the full minus the reduced track model, at each sample and sensor, (n, sensors).

    Both simulations run over the same profile from the same initial state, so that its effect cancels.

    Parameters
    ----------
    track : layered; ``model.track`` is its reduced model
    position, elevation : (knots,), m, profile under both simulations

    Raises
    ------
    ModelError
        Where the track is not layered.
    DataError
        Where the train stops.
    """
    if not isinstance(track, LayeredTrack):
        raise ModelError(
            "The full track correction needs a layered track; choose one, or leave the correction out."
        )
    along = leading_wheel_motion(data, model)
    profile = _extended(position, elevation, along.distance, model.vehicle.length)
    drive = RecordedMotion(along.time, along.distance, along.speed, RUN_IN)
    run = RunSettings(float(along.distance[0]), float(along.distance[-1]), drive, run_in=RUN_IN)
    signals_of = []
    for on in (track, model.track):
        simulated = simulate(model.vehicle, on, profile, run, newmark(STEP))
        signals = [sensor_signal(simulated, model.vehicle, sensor) for sensor in model.sensors]
        at = np.clip(along.distance, simulated.position[0], simulated.position[-1])
        signals_of.append(CubicSpline(simulated.position, np.stack(signals, axis=1))(at))
    return np.asarray(signals_of[0] - signals_of[1], np.float64)


def _extended(position: Array, elevation: Array, wheel: Array, length: float) -> Sampled:
    """The profile, extended level beyond its ends as far as the wheels run."""
    spacing = position[1] - position[0]
    before = int(np.ceil((position[0] - wheel[0] + RUN_IN + length) / spacing)) + 2
    after = max(int(np.ceil((wheel[-1] - position[-1]) / spacing)) + 2, 2)
    first, last = np.full(before, elevation[0]), np.full(after, elevation[-1])
    whole = np.arange(-before, len(position) + after) * spacing + position[0]
    return Sampled(whole, np.concatenate([first, elevation, last]))

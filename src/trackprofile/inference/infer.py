"""infer: from a recording to the profile, with the uncertainty of every point and every band."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.bands import FILTER_NAME
from trackprofile.contracts import append_provenance, build_profile, with_rails
from trackprofile.inference.blocks import (
    BlockResult,
    BlockSettings,
    cut_into_blocks,
    default_sample_count,
    join_blocks,
    solve_block,
)
from trackprofile.inference.channel_assignment import assign_channels
from trackprofile.inference.hyperparameters import find_hyperparameters
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import (
    KNOT_SPACING,
    Observations,
    observations,
    signal_rms,
)
from trackprofile.inference.orientation import orient
from trackprofile.inference.outliers import describe_faults
from trackprofile.inference.position_uncertainty import (
    correct_wheel_scale,
    position_standard_deviation,
)
from trackprofile.inference.problem import Model, leading_wheel_motion, loading
from trackprofile.inference.rail_decomposition import (
    RailDecomposition,
    difference_installation,
    rail_levels,
)
from trackprofile.inference.sensitivity import with_gain_uncertainty
from trackprofile.inference.settings import InferenceSettings
from trackprofile.models.receptance import point_track
from trackprofile.models.roll import roll_track, roll_vehicle_for_sensors
from trackprofile.models.track import ElasticTrack, LayeredTrack, PointTrack, Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.preprocessing.faults import Fault

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """Result of an inference.

    Parameters
    ----------
    profile : the profile contract
    used_signals : by channel, (samples,), upright and without gravity; NaN where left out
    reproduced : by channel, (samples,), signal that profile, offset and unmodelled acceleration explain; NaN where the
        sample is invalid
    sample_distance : (samples,), position of the leading wheel, m
    model : with the noise and the prior that were used
    notes : estimates and assumptions, one sentence each
    log_likelihood : of the recording
    faults : faults of the recording, left out or down-weighted
    """

    profile: xr.Dataset
    used_signals: Mapping[str, Array]
    reproduced: Mapping[str, Array]
    sample_distance: Array
    model: Model
    notes: tuple[str, ...]
    log_likelihood: float
    faults: tuple[Fault, ...] = ()

    @property
    def figures(self) -> dict[str, float]:
        """Figures of merit by name."""
        return {"log_likelihood": self.log_likelihood}


def estimate(
    recording: xr.Dataset,
    vehicle: Vehicle,
    settings: InferenceSettings | None = None,
    *,
    progress: Progress | None = None,
    checkpoint: MutableMapping[int, BlockResult] | None = None,
) -> Estimate:
    """Estimate the longitudinal profile of the track with the optimal smoother (theory, section 7).

    The posterior mean of a spline with a Markov prior given all valid samples, with its standard deviation at every
    point and, from posterior samples, in each of the bands D1, D2 and D3.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    settings : installation, track, prior, samples and corrections; None uses the defaults
    progress : called with the stage and its completed share, dimensionless
    checkpoint : blocks that an earlier call with the same arguments has solved; receives the others

    Returns
    -------
    the profile, the reproduced signals, the faults and the model

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    ModelError
        Where the vehicle lacks the body that a sensor is mounted on.
    """
    settings = settings or InferenceSettings()
    progress = progress or (lambda stage, share: None)
    checkpoint = {} if checkpoint is None else checkpoint
    installation, scale_notes = correct_wheel_scale(settings.installation, recording)
    settings = replace(settings, installation=installation)
    data = observations(recording, installation)
    rails, vehicle = orient(data, recording, vehicle, point_track(settings.track), installation)
    mean = _smooth(rails.mean, vehicle, settings, _Blocks(checkpoint, 0, progress))
    difference = None
    if rails.difference is not None:
        car, of_difference = _difference_settings(vehicle, settings, rails, mean)
        data = assign_channels(rails.difference, car, point_track(of_difference.track))
        blocks = _Blocks(
            checkpoint, mean.blocks, lambda stage, share: progress(f"{stage}, difference", share)
        )
        difference = _smooth(data, car, of_difference, blocks, estimate_corner=True)
    positions, position_notes = position_standard_deviation(
        mean.result.position, mean.sample_distance, recording
    )
    mean = replace(mean, notes=(*scale_notes, *position_notes, *mean.notes))
    return _combine(rails, mean, difference, positions, settings.track, vehicle)


@dataclass(frozen=True)
class _Blocks:
    """Where the solved blocks of one smoother run are kept, from number ``first`` on, and who hears of its progress."""

    checkpoint: MutableMapping[int, BlockResult]
    first: int
    progress: Progress


@dataclass(frozen=True)
class _Smoothed:
    """Smoother result for the mean or the difference of the rails, in so many ``blocks``; ``step`` for provenance."""

    result: BlockResult
    data: Observations
    model: Model
    sample_distance: Array
    notes: tuple[str, ...]
    step: str
    blocks: int

    @property
    def reproduced(self) -> Array:
        """Signals that the model explains, (samples, sensors)."""
        return self.data.signals - self.result.residual


def _smooth(
    data: Observations,
    vehicle: Vehicle,
    settings: InferenceSettings,
    blocks: _Blocks,
    *,
    estimate_corner: bool = False,
) -> _Smoothed:
    """Estimate the hyperparameters, then run the smoother block by block."""
    installation, track = settings.installation, settings.track
    calibrated = installation.uncertainty is not None
    model, notes = find_hyperparameters(
        data, vehicle, settings, blocks.progress, estimate_corner=estimate_corner
    )
    if any(data.gain_doubt):
        uncertainty = with_gain_uncertainty(installation.uncertainty, data)
        installation = replace(installation, uncertainty=uncertainty)
        notes += (
            "the uncertainty of the gain of a tilted sensor is included in that of the profile",
        )
    distance = leading_wheel_motion(data, model).distance
    cuts = cut_into_blocks(distance)
    samples = settings.samples or default_sample_count(cuts)
    block_settings = BlockSettings(
        model, installation, track, samples, settings.seed, settings.full_track_correction,
        (float(distance[0]), float(distance[-1])),
    )  # fmt: skip
    data = replace(data, rms=signal_rms(data))
    result = join_blocks(_solve_blocks(data, distance, block_settings, blocks))
    notes = (
        *data.notes, *describe_faults((*data.faults, *result.faults), distance), *notes,
        *_describe_reduction(track, model.track, settings.full_track_correction),
    )  # fmt: skip
    if calibrated:
        notes += ("the uncertainty of the calibrated vehicle is included in that of the profile",)
    step = (
        f"infer: smoother, knots every {KNOT_SPACING} m, {samples} samples, seed {settings.seed}; "
        f"bands: {FILTER_NAME}"
    )
    return _Smoothed(result, data, model, distance, notes, step, len(cuts))


def _difference_settings(
    vehicle: Vehicle, settings: InferenceSettings, rails: RailDecomposition, mean: _Smoothed
) -> tuple[Vehicle, InferenceSettings]:
    """The rolling car with the load that was estimated, and the settings for it; no full track model rolls."""
    assert rails.difference is not None
    support = point_track(settings.track)
    car = roll_vehicle_for_sensors(mean.model.vehicle, support, rails.modes[1].sensors)
    installation = difference_installation(settings.installation, vehicle, car, rails.difference)
    return car, replace(
        settings, installation=installation, track=roll_track(support), prior=None,
        full_track_correction=False, estimate_load=False,
    )  # fmt: skip


def _combine(
    rails: RailDecomposition, mean: _Smoothed, difference: _Smoothed | None, positions: Array | None,
    track: Track, vehicle: Vehicle,
) -> Estimate:  # fmt: skip
    """The profile of the mean, and of both rails where their difference is determined."""
    result, notes, remarks = mean.result, mean.notes, mean.result.notes
    profile = build_profile(
        result.position,
        result.elevation,
        kind="posterior",
        method="smoother",
        standard_deviation=result.standard_deviation,
        band_standard_deviations=result.bands,
        quality=result.flags,
        loading=loading(track),
        vehicle=vehicle.name,
        distance_deviation=positions,
    )
    faults, likelihood = (*mean.data.faults, *result.faults), result.log_likelihood
    if difference is not None:
        across = difference.result
        notes += tuple(f"difference of the rails: {note}" for note in difference.notes)
        remarks = tuple(dict.fromkeys((*remarks, *across.notes)))
        faults, likelihood = (*faults, *across.faults), likelihood + across.log_likelihood
        profile = with_rails(
            profile, rail_levels(result, across, rails.noise_correlation), across.flags
        )
    return Estimate(
        append_provenance(profile, "; ".join([mean.step, *notes])),
        rails.sensor_signals(mean.data.used, None if difference is None else difference.data.used),
        rails.sensor_signals(
            mean.reproduced, None if difference is None else difference.reproduced
        ),
        mean.sample_distance,
        mean.model,
        (*notes, *remarks),
        likelihood,
        faults,
    )


def _solve_blocks(
    data: Observations, distance: Array, settings: BlockSettings, blocks: _Blocks
) -> list[BlockResult]:
    """All blocks of a run, solved, or taken from the checkpoint."""
    cuts = cut_into_blocks(distance)

    def report(stage: str, share: float, number: int) -> None:
        blocks.progress(stage, (number + share) / len(cuts) if stage == "smoothing" else share)

    results = []
    for block in cuts:
        result = blocks.checkpoint.get(blocks.first + block.number)
        if result is None:
            result = solve_block(data, block, settings, partial(report, number=block.number))
            if len(cuts) > 1:
                blocks.checkpoint[blocks.first + block.number] = result
        results.append(result)
        blocks.progress("smoothing", (block.number + 1) / len(cuts))
    return results


def _describe_reduction(track: Track, reduced: PointTrack, corrected: bool) -> tuple[str, ...]:
    """A sentence on the point track to which a layered track is reduced."""
    if not (isinstance(track, LayeredTrack) and isinstance(reduced, ElasticTrack)):
        return ()
    return (
        f"track {track.name!r} is reduced to {reduced.stiffness / 1e6:.1f} MN/m, "
        f"{reduced.damping / 1e3:.1f} kN s/m and {reduced.mass:.0f} kg under each wheel"
        + (", corrected by the full model" if corrected else ""),
    )

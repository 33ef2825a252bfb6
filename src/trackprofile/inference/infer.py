"""infer: from a recording to the profile, with the uncertainty of every point and band."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.bands import FILTER_NAME
from trackprofile.contracts import build_profile, with_provenance, with_rails
from trackprofile.inference.blocks import (
    Block,
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
from trackprofile.inference.observations import KNOT_SPACING, Observations, observations, signal_rms
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
from trackprofile.models.receptance import point_track
from trackprofile.models.roll import roll_track, roll_vehicle_for_sensors
from trackprofile.models.sensor import Installation
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.track import ElasticTrack, LayeredTrack, PointTrack, RigidTrack, Track
from trackprofile.models.vehicle import Vehicle
from trackprofile.preprocessing.faults import Fault

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """What infer found.

    Parameters
    ----------
    profile : the profile contract
    taken : by channel, (samples,), its signal as it was taken: upright, without gravity; NaN where left out
    reproduced : by channel, (samples,), what profile, offset and unmodelled acceleration explain; NaN where invalid
    sample_distance : (samples,), m, where the leading wheel stood
    model : with the noise and prior that were used
    notes : what was found or assumed, in sentences
    log_likelihood : of the recording
    faults : what was found wrong with the recording, and left out or weighted down
    """

    profile: xr.Dataset
    taken: Mapping[str, Array]
    reproduced: Mapping[str, Array]
    sample_distance: Array
    model: Model
    notes: tuple[str, ...]
    log_likelihood: float
    faults: tuple[Fault, ...] = ()

    @property
    def figures(self) -> dict[str, float]:
        """What says how well it went, by name."""
        return {"log_likelihood": self.log_likelihood}


def infer(
    recording: xr.Dataset,
    vehicle: Vehicle,
    *,
    installation: Installation | None = None,
    track: Track | None = None,
    prior: Spectrum | None = None,
    draws: int | None = None,
    seed: int = 0,
    correct: bool = False,
    load: bool = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """The track's longitudinal profile from what a vehicle's sensors recorded.

    The optimal smoother (theory, section 7): the mean of the posterior of a spline with a Markov prior, given
    all samples marked valid, with its standard deviation at every point and, from posterior draws, in each of
    the bands D1, D2 and D3.

    Parameters
    ----------
    recording : the recording contract
    vehicle : the vehicle that carries the sensors
    installation : of the sensors, from a calibration; None takes the recording's word
    track : what the wheels stand on; None is a rigid track
    prior : spectrum of the profile, the mean of both rails, before anything is measured; None finds its level from the
        data. That of the rails' difference is always found from the data
    draws : number of posterior draws behind the bands' standard deviations; None: 128, for a long ride down to 24
    seed : of the draws
    correct : take off what the full model of a layered track makes of the profile beyond the point track that
        stands for it; once, for the waves of a sleeper bay would grow with each repetition
    load : find what the first body weighs on the day, about what the vehicle states
    progress : told the stage and its share done

    Returns
    -------
    the profile contract: elevation (m) every 0.25 m where the leading wheel ran; with sensors left and right, or of
    roll, also that of each rail and their difference

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    ModelError
        Where the vehicle does not have what a sensor stands on.
    """
    return estimate(
        recording, vehicle, installation=installation, track=track, prior=prior, draws=draws,
        seed=seed, correct=correct, load=load, progress=progress,
    ).profile  # fmt: skip


def estimate(
    recording: xr.Dataset,
    vehicle: Vehicle,
    *,
    installation: Installation | None = None,
    track: Track | None = None,
    prior: Spectrum | None = None,
    draws: int | None = None,
    seed: int = 0,
    correct: bool = False,
    load: bool = False,
    progress: Progress | None = None,
    kept: MutableMapping[int, BlockResult] | None = None,
) -> Estimate:
    """As :func:`infer`, with the reproduced signals and what was found on the way.

    ``kept`` holds the blocks that an earlier call with the same arguments has solved, and is given the others.
    """
    installation, track = installation or Installation(), track or RigidTrack()
    progress = progress or (lambda stage, share: None)
    kept = {} if kept is None else kept
    installation, scaled = correct_wheel_scale(installation, recording)
    data = observations(recording, installation)
    sides, vehicle = orient(data, recording, vehicle, point_track(track), installation)
    ride = _SmootherSettings(vehicle, installation, track, draws, seed, correct)
    mean = _inferred(sides.mean, ride, prior, kept, 0, progress, load=load)
    difference = None
    if sides.difference is not None:
        ride = _of_difference(ride, sides, mean)
        difference = _inferred(
            assign_channels(sides.difference, ride.vehicle, point_track(ride.track)), ride, None, kept,
            mean.blocks, lambda stage, share: progress(f"{stage}, difference", share), knee=True,
        )  # fmt: skip
    places, located = position_standard_deviation(mean.piece.place, mean.run, recording)
    mean = replace(mean, notes=(*scaled, *located, *mean.notes))
    return _together(sides, mean, difference, places, track, vehicle)


@dataclass(frozen=True)
class _SmootherSettings:
    """What the smoother is told of one half of a recording; see :func:`infer`."""

    vehicle: Vehicle
    installation: Installation
    track: Track
    draws: int | None
    seed: int
    correct: bool


@dataclass(frozen=True)
class _Inferred:
    """What it found: in how many ``blocks``, from ``data``, at the samples' places ``run``; ``step`` says how."""

    piece: BlockResult
    data: Observations
    model: Model
    run: Array
    notes: tuple[str, ...]
    step: str
    blocks: int

    @property
    def reproduced(self) -> Array:
        """(samples, sensors)"""
        return self.data.signals - self.piece.left


def _inferred(
    data: Observations, ride: _SmootherSettings, prior: Spectrum | None,
    kept: MutableMapping[int, BlockResult], first: int, progress: Progress, *, load: bool = False, knee: bool = False,
) -> _Inferred:  # fmt: skip
    """The smoother on one half; its blocks are kept from number ``first`` on.

    Of the load and the knee of the prior is found what is asked for.
    """
    installation, track = ride.installation, ride.track
    calibrated = installation.uncertainty is not None
    model, notes = find_hyperparameters(
        data, ride.vehicle, point_track(track), installation, prior, progress, load=load, knee=knee
    )
    if any(data.gain_doubt):
        installation = replace(
            installation, uncertainty=with_gain_uncertainty(installation.uncertainty, data)
        )
        notes += ("the uncertainty of a gain that an angle made is in that of the profile",)
    run = leading_wheel_motion(data, model).distance
    blocks = cut_into_blocks(run)
    draws = ride.draws or default_sample_count(blocks)
    ends = (float(run[0]), float(run[-1]))
    task = BlockSettings(model, installation, track, draws, ride.seed, ride.correct, ends)
    data = replace(data, loud=signal_rms(data))
    found = join_blocks(_pieces(data, blocks, task, kept, first, progress))
    notes = (
        *data.notes, *describe_faults((*data.faults, *found.faults), run), *notes,
        *_reduction(track, model.track, ride.correct),
    )  # fmt: skip
    if calibrated:
        notes += ("the uncertainty of the calibrated vehicle is in that of the profile",)
    step = f"infer: smoother, knots every {KNOT_SPACING} m, {draws} draws, seed {ride.seed}; bands: {FILTER_NAME}"
    return _Inferred(found, data, model, run, notes, step, len(blocks))


def _of_difference(
    ride: _SmootherSettings, sides: RailDecomposition, mean: _Inferred
) -> _SmootherSettings:
    """On the rolling car, loaded as it was found to be; a full model of the track that rolls there is none."""
    assert sides.difference is not None
    support = point_track(ride.track)
    car = roll_vehicle_for_sensors(mean.model.vehicle, support, sides.halves[1].sensors)
    installation = difference_installation(ride.installation, ride.vehicle, car, sides.difference)
    return replace(
        ride, vehicle=car, installation=installation, track=roll_track(support), correct=False
    )


def _together(
    sides: RailDecomposition, mean: _Inferred, difference: _Inferred | None, places: Array | None, track: Track,
    vehicle: Vehicle,
) -> Estimate:  # fmt: skip
    """The profile of the mean, and beside it those of both rails where the difference is told."""
    found, notes, remarks = mean.piece, mean.notes, mean.piece.notes
    profile = build_profile(
        found.place,
        found.elevation,
        kind="posterior",
        method="smoother",
        standard_deviation=found.spread,
        band_standard_deviations=found.bands,
        quality=found.flags,
        loading=loading(track),
        vehicle=vehicle.name,
        distance_deviation=places,
    )
    faults, likelihood = (*mean.data.faults, *found.faults), found.log_likelihood
    if difference is not None:
        across = difference.piece
        notes += tuple(f"difference of the rails: {note}" for note in difference.notes)
        remarks = tuple(dict.fromkeys((*remarks, *across.notes)))
        faults, likelihood = (*faults, *across.faults), likelihood + across.log_likelihood
        profile = with_rails(profile, rail_levels(found, across, sides.shared), across.flags)
    return Estimate(
        with_provenance(profile, "; ".join([mean.step, *notes])),
        sides.of_sensors(mean.data.taken, None if difference is None else difference.data.taken),
        sides.of_sensors(mean.reproduced, None if difference is None else difference.reproduced),
        mean.run,
        mean.model,
        (*notes, *remarks),
        likelihood,
        faults,
    )


def _pieces(
    data: Observations, blocks: Sequence[Block], task: BlockSettings,
    kept: MutableMapping[int, BlockResult], first: int, progress: Progress,
) -> list[BlockResult]:  # fmt: skip
    """All blocks of a ride, solved, or taken from what was kept of an earlier one from number ``first`` on."""

    def describe_faults(stage: str, share: float, number: int) -> None:
        progress(stage, (number + share) / len(blocks) if stage == "smoothing" else share)

    pieces = []
    for block in blocks:
        piece = kept.get(first + block.number)
        if piece is None:
            piece = solve_block(data, block, task, partial(describe_faults, number=block.number))
            if len(blocks) > 1:
                kept[first + block.number] = piece
        pieces.append(piece)
        progress("smoothing", (block.number + 1) / len(blocks))
    return pieces


def _reduction(track: Track, reduced: PointTrack, correct: bool) -> tuple[str, ...]:
    """What stands for a layered track, in words."""
    if not (isinstance(track, LayeredTrack) and isinstance(reduced, ElasticTrack)):
        return ()
    return (
        f"track {track.name!r} stands under each wheel as {reduced.stiffness / 1e6:.1f} MN/m, "
        f"{reduced.damping / 1e3:.1f} kN s/m and {reduced.mass:.0f} kg"
        + (", corrected by the full model" if correct else ""),
    )

"""A long ride in blocks that overlap: bounded memory, and each block by itself, so that work can be taken up again.

A profile's memory is short: what lies ``OVERLAP`` beyond a block's end says nothing of it that any band would show.
Each block is smoothed with so much of its neighbours, and over ``FADE`` at their joint two blocks are faded into each
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from trackprofile.bands import BANDS, D3, Band, band_pass, edge_distance
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.inference.observations import Observations
from trackprofile.inference.outliers import outlier_faults, outlier_mask, single_outliers
from trackprofile.inference.problem import Model, smoothing_problem
from trackprofile.inference.quality import quality, unexplained_samples
from trackprofile.inference.sensitivity import vehicle_sensitivity
from trackprofile.inference.track_correction import full_track_residual
from trackprofile.kalman.robust import RobustResult, smooth_robustly
from trackprofile.kalman.smoother import prior_draws, smooth
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.models.sensor import Installation
from trackprofile.models.track import Track
from trackprofile.preprocessing.faults import Fault

Array = NDArray[np.float64]

LENGTH = 6000.0
"""m of a block: some 0.6 GB."""

DRAWN = 512e3
"""m of track in all draws of the error, behind the uncertainty of the bands."""

FEWEST_DRAWS, MOST_DRAWS = 24, 128
"""However long or short the ride."""

FADE = 400.0
"""m over which one block goes over into the next."""

OVERLAP = 500.0
"""m of its neighbours that a block sees: the reach of the longest band's filter, and half the fade."""

assert edge_distance(D3) + FADE / 2 <= OVERLAP


@dataclass(frozen=True)
class BlockSettings:
    """What is the same for all blocks; see :func:`trackprofile.inference.infer.infer`.

    ``ends`` : m, where the leading wheel stood at the first and the last sample
    """

    model: Model
    installation: Installation
    track: Track
    draws: int
    seed: int
    correct: bool
    ends: tuple[float, float]


@dataclass(frozen=True)
class Block:
    """Samples ``rows`` of a recording, of which its ``own`` and the profile from ``begin`` to ``end`` m are kept."""

    number: int
    rows: slice
    own: slice
    begin: float
    end: float


@dataclass(frozen=True)
class BlockResult:
    """What a block found.

    Parameters
    ----------
    place, elevation, spread : (knots,), m
    bands : by name, (knots,), m
    flags : (knots,)
    left : (own samples, sensors), what the model leaves of them, NaN where invalid
    faults : by samples of the whole recording
    log_likelihood : of its own samples
    notes : in sentences
    """

    place: Array
    elevation: Array
    spread: Array
    bands: dict[str, Array]
    flags: NDArray[np.int16]
    left: Array
    faults: tuple[Fault, ...]
    log_likelihood: float
    notes: tuple[str, ...]


def cut_into_blocks(distance: Array) -> list[Block]:
    """Blocks of a ride, by where the leading wheel stood at its samples, (n,) in m; one where that is enough.

    Examples
    --------
    >>> [(one.begin, one.end, one.own) for one in cut(np.arange(0.0, 12001.0))]
    [(0.0, 6200.0, slice(0, 6000, None)), (5800.0, 12000.0, slice(6000, 12001, None))]
    """
    run = distance[-1] - distance[0]
    count = max(1, round(run / LENGTH))
    edges = np.linspace(distance[0], distance[-1], count + 1)
    own = [0, *map(int, np.searchsorted(distance, edges[1:-1])), len(distance)]
    return [
        Block(
            number,
            slice(*map(int, np.searchsorted(distance, [begin - OVERLAP, end + OVERLAP + 1e-9]))),
            slice(own[number], own[number + 1]),
            float(begin) - (FADE / 2 if number > 0 else 0.0),
            float(end) + (FADE / 2 if number < count - 1 else 0.0),
        )
        for number, (begin, end) in enumerate(pairwise(edges))
    ]


def default_sample_count(blocks: Sequence[Block]) -> int:
    """How many draws a ride of these blocks takes: the shorter, the fewer waves it has to average over.

    Examples
    --------
    >>> [usual_draws(cut(np.array([0.0, run]))) for run in (1000.0, 8000.0, 100e3)]
    [128, 64, 24]
    """
    if len(blocks) > 1:
        return FEWEST_DRAWS
    length = max(blocks[0].end - blocks[0].begin, 1.0)
    return round(min(max(DRAWN / length, FEWEST_DRAWS), MOST_DRAWS))


def solve_block(
    data: Observations, block: Block, task: BlockSettings, progress: Progress
) -> BlockResult:
    """The smoother on one block.

    Raises
    ------
    DataError
        Where the recording is shorter than the vehicle.
    """
    data = data.part(block.rows)
    model = task.model
    problem = smoothing_problem(data, model)
    progress("smoothing", 0.2)
    run, place = problem.run, problem.run.knot_position
    settled = smooth_robustly(problem)
    if task.correct:
        beyond = full_track_residual(
            data, model, task.track, place, settled.smoothed.elevation[:, 0]
        )
        # What the full model explains is no fault of a sensor: all is judged anew without it.
        signals = problem.signals - beyond[run.samples, run.sensors][:, None]
        settled = smooth_robustly(replace(problem, signals=signals))
    progress("smoothing", 0.5)
    generator = np.random.default_rng([task.seed, block.number])
    profiles, simulated = prior_draws(settled.prepared, task.draws, generator)
    errors = profiles - smooth(settled.prepared, simulated).elevation
    progress("smoothing", 0.8)
    elevation = settled.smoothed.elevation[:, 0]
    slopes = vehicle_sensitivity(data, model, task.installation, place, elevation, progress)
    # The vehicle errs in the same way in all blocks.
    directions = np.random.default_rng(task.seed).standard_normal((slopes.shape[1], task.draws))
    bands, notes = band_spreads(errors + slopes @ directions, run.spacing)
    known = np.maximum(settled.variances.elevation, 0.0)
    found = outlier_faults(settled.weights, data, model, run)
    flags = quality(
        place, bands, data, model, run, _unexplained(data, run, settled, problem.variance),
        data.faulty | outlier_mask(found, data, model), task.ends,
    )  # fmt: skip
    kept = slice(*map(int, np.searchsorted(place, [block.begin, block.end + 1e-9])))
    left, likelihood = _of_its_own(data, block, run, settled)
    return BlockResult(
        place[kept],
        elevation[kept],
        np.sqrt(known + np.sum(slopes**2, axis=1))[kept],
        {name: values[kept] for name, values in bands.items()},
        flags[kept],
        left,
        tuple(_of_the_whole(found, block)),
        likelihood,
        notes,
    )


def join_blocks(pieces: Sequence[BlockResult]) -> BlockResult:
    """The profile of all blocks, faded from each to the next."""
    first = pieces[0]
    if len(pieces) == 1:
        return first
    place = np.unique(np.concatenate([piece.place for piece in pieces]))
    starts = [int(np.searchsorted(place, piece.place[0])) for piece in pieces]
    weights = [_weight(pieces, i) for i in range(len(pieces))]

    def faded(values: Sequence[Array]) -> Array:
        total = np.zeros(len(place))
        for start, weight, own in zip(starts, weights, values, strict=True):
            total[start : start + len(own)] += weight * own
        return total

    flags = np.zeros(len(place), np.int16)
    for start, weight, piece in zip(starts, weights, pieces, strict=True):
        here = slice(start, start + len(weight))
        flags[here] = np.where(weight >= 0.5, piece.flags, flags[here])
    names = [name for name in first.bands if all(name in piece.bands for piece in pieces)]
    return BlockResult(
        place,
        faded([piece.elevation for piece in pieces]),
        faded([piece.spread for piece in pieces]),
        {name: faded([piece.bands[name] for piece in pieces]) for name in names},
        flags,
        np.concatenate([piece.left for piece in pieces]),
        tuple(fault for piece in pieces for fault in piece.faults),
        sum(piece.log_likelihood for piece in pieces),
        tuple(dict.fromkeys(note for piece in pieces for note in piece.notes)),
    )


def band_spreads(errors: Array, spacing: float) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Standard deviation of the error in each band along the track, from draws (knots, draws)."""
    length = (len(errors) - 1) * spacing
    spreads, notes = {}, []
    for band in BANDS:
        if length < band.longest:
            notes.append(
                f"{length:.0f} m are too short for {band.name}, which has waves up to {band.longest:.0f} m"
            )
            continue
        spreads[band.name] = _local_rms(band_pass(errors.T, spacing, band), spacing, band)
    return spreads, tuple(notes)


def _local_rms(draws: Array, spacing: float, band: Band) -> Array:
    """Root mean square over the draws, and along one longest wavelength to make up for their number."""
    count = max(1, round(band.longest / spacing))
    return np.sqrt(uniform_filter1d(np.mean(draws**2, axis=0), count, mode="nearest"))


def _unexplained(
    data: Observations, ride: DiscretisedRun, settled: RobustResult, variance: Array
) -> NDArray[np.bool_]:
    """Samples around which the model does not explain what was measured, whatever weight they were given."""
    prepared, smoothed = settled.prepared, settled.smoothed
    expected = prepared.innovation_variance - prepared.variance + variance
    surprise = smoothed.innovation / np.sqrt(expected)
    counted = ~single_outliers(settled.weights, ride)
    return unexplained_samples(data, ride, surprise, smoothed.residual[:, 0], counted)


def _of_its_own(
    data: Observations, block: Block, ride: DiscretisedRun, settled: RobustResult
) -> tuple[Array, float]:
    """What the model leaves of a block's own samples, and their log-likelihood."""
    first = block.own.start - block.rows.start
    own = slice(first, first + block.own.stop - block.own.start)
    left = np.full(data.signals.shape, np.nan)
    left[ride.samples, ride.sensors] = settled.smoothed.residual[:, 0]
    inside = (ride.samples >= own.start) & (ride.samples < own.stop)
    e, S = settled.smoothed.innovation[inside], settled.prepared.innovation_variance[inside]
    return left[own], -0.5 * float(np.sum(np.log(2 * np.pi * S) + e**2 / S))


def _of_the_whole(faults: Sequence[Fault], block: Block) -> Iterator[Fault]:
    """Faults of a block's own samples, by samples of the whole recording."""
    for fault in faults:
        first = max(fault.first + block.rows.start, block.own.start)
        last = min(fault.last + block.rows.start, block.own.stop - 1)
        if first <= last:
            yield replace(fault, first=first, last=last)


def _weight(pieces: Sequence[BlockResult], number: int) -> Array:
    """Of one piece, at each of its places: 1 but for the joints, over which it goes to 0."""
    place = pieces[number].place
    weight = np.ones(len(place))
    if number > 0:
        end = pieces[number - 1].place[-1]
        weight *= _step((place - place[0]) / (end - place[0]))
    if number < len(pieces) - 1:
        begin = pieces[number + 1].place[0]
        weight *= _step((place[-1] - place) / (place[-1] - begin))
    return weight


def _step(share: Array) -> Array:
    """From 0 to 1 as u³ (10 - 15 u + 6 u²), which bends nowhere so that a band would show it; 1 - that backwards."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

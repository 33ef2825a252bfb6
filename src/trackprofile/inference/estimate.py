"""infer: from a recording to the profile, with the uncertainty of every point and band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from trackprofile.bands import BANDS, FILTER_NAME, Band, band_pass
from trackprofile.conditioning.faults import Fault
from trackprofile.contracts import build_profile, channels, with_provenance
from trackprofile.inference.correction import beyond_reduced
from trackprofile.inference.doubted import doubted, marked, single_outliers, told
from trackprofile.inference.likelihood import Progress
from trackprofile.inference.measured import (
    KNOT_SPACING,
    Measured,
    Model,
    loading,
    measured,
    moved,
    ride_of,
    row_signals,
    row_variance,
    start_of,
    walk_of,
)
from trackprofile.inference.noise import find_noise
from trackprofile.inference.quality import quality, unexplained_samples
from trackprofile.inference.ride import Ride
from trackprofile.inference.robust import settle
from trackprofile.inference.sensitivity import by_the_vehicle
from trackprofile.inference.smoother import innovations, prior_draws, smooth
from trackprofile.receptance import point_track
from trackprofile.sensor import Installation
from trackprofile.spectrum import Spectrum
from trackprofile.track import ElasticTrack, LayeredTrack, PointTrack, RigidTrack, Track
from trackprofile.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """What infer found.

    Parameters
    ----------
    profile : the profile contract
    reproduced : by channel, (samples,), what profile, offset and unmodelled acceleration explain; NaN where invalid
    sample_distance : (samples,), m, where the leading wheel stood
    model : with the noise and prior that were used
    notes : what was found or assumed, in sentences
    log_likelihood : of the recording
    faults : what was found wrong with the recording, and left out or weighted down
    """

    profile: xr.Dataset
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
    draws: int = 64,
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
    prior : spectrum of the profile before anything is measured; None finds its level and knee from the data
    draws : number of posterior draws behind the bands' standard deviations
    seed : of the draws
    correct : take off what the full model of a layered track makes of the profile beyond the point track that
        stands for it; once, for the waves of a sleeper bay would grow with each repetition
    load : find what the first body weighs on the day, about what the vehicle states
    progress : told the stage and its share done

    Returns
    -------
    the profile contract: elevation (m) every 0.25 m where the leading wheel ran

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
    draws: int = 64,
    seed: int = 0,
    correct: bool = False,
    load: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """As :func:`infer`, with the reproduced signals and what was found on the way."""
    installation, track = installation or Installation(), track or RigidTrack()
    progress = progress or (lambda stage, share: None)
    data = measured(recording, installation)
    found, notes = find_noise(
        data, vehicle, point_track(track), installation, prior, progress, load=load
    )
    system, ride = ride_of(data, found)
    progress("smoothing", 0.2)
    variance, signals = row_variance(data, found, ride), row_signals(data, found, ride)
    start = start_of(data, found, system, ride)
    walk = walk_of(ride, moved(data, found), found.sensors)
    settled = settle(ride, found.spectrum, variance, start, signals, walk)
    prepared, residual = settled.prepared, settled.smoothed.residual[:, 0]
    progress("smoothing", 0.5)
    generator = np.random.default_rng(seed)
    profiles, simulated = prior_draws(prepared, draws, generator)
    simulated = smooth(prepared, simulated).elevation
    expected = prepared.innovation_variance - prepared.variance + variance
    surprise = innovations(prepared, signals)[:, 0] / np.sqrt(expected)
    counted = ~single_outliers(settled.weights, ride)
    unexplained = unexplained_samples(data, ride, surprise, residual, counted)
    faults = doubted(settled.weights, data, found, ride)
    progress("smoothing", 0.8)
    place = ride.spacing * (ride.first_knot + np.arange(ride.knots, dtype=np.float64))
    elevation = settled.smoothed.elevation[:, 0]
    slopes = by_the_vehicle(data, found, installation, place, elevation, progress)
    errors = profiles - simulated + slopes @ generator.standard_normal((slopes.shape[1], draws))
    known = np.maximum(settled.variances.elevation, 0.0)
    spread = np.sqrt(known + np.sum(slopes**2, axis=1))
    if correct:
        beyond = beyond_reduced(data, found, track, place, elevation)
        rows = beyond[ride.samples, ride.sensors][:, None]
        elevation = elevation - smooth(prepared, rows).elevation[:, 0]
    run = moved(data, found).distance
    inside = slice(*np.searchsorted(place, [run[0], run[-1] + 1e-9]))
    bands, skipped = band_spreads(errors, ride.spacing)
    profile = build_profile(
        place[inside],
        elevation[inside],
        kind="posterior",
        method="smoother",
        standard_deviation=spread[inside],
        band_standard_deviations={name: values[inside] for name, values in bands.items()},
        quality=quality(
            place,
            bands,
            data,
            found,
            ride,
            unexplained,
            data.faulty | marked(faults, data, found),
        )[inside],
        loading=loading(track),
        vehicle=vehicle.name,
    )
    faults = (*data.faults, *faults)
    notes = (*data.notes, *told(faults, run), *notes, *_reduction(track, found.track, correct))
    if slopes.size:
        notes += ("the uncertainty of the calibrated vehicle is in that of the profile",)
    step = f"infer: smoother, knots every {KNOT_SPACING} m, {draws} draws, seed {seed}; bands: {FILTER_NAME}"
    profile = with_provenance(profile, "; ".join([step, *notes]))
    progress("smoothing", 1.0)
    return Estimate(
        profile,
        _reproduced(recording, data, ride, residual),
        run,
        found,
        (*notes, *skipped),
        float(settled.smoothed.log_likelihood[0]),
        faults,
    )


def _reduction(track: Track, reduced: PointTrack, correct: bool) -> tuple[str, ...]:
    """What stands for a layered track, in words."""
    if not (isinstance(track, LayeredTrack) and isinstance(reduced, ElasticTrack)):
        return ()
    return (
        f"track {track.name!r} stands under each wheel as {reduced.stiffness / 1e6:.1f} MN/m, "
        f"{reduced.damping / 1e3:.1f} kN s/m and {reduced.mass:.0f} kg"
        + (", corrected by the full model" if correct else ""),
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


def _reproduced(
    recording: xr.Dataset, data: Measured, ride: Ride, residual: Array
) -> dict[str, Array]:
    """Measured less what the model leaves, by channel."""
    left = np.full(data.signals.shape, np.nan)
    left[ride.samples, ride.sensors] = residual
    return {
        channel.name: data.signals[:, i] - left[:, i]
        for i, channel in enumerate(channels(recording))
    }

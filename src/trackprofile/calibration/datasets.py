"""Recordings of a calibration, each with the reference profile where it covers the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, zip_longest

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trackprofile.errors import DataError
from trackprofile.inference.marginal_likelihood import RunData
from trackprofile.inference.observations import Observations, observations
from trackprofile.inference.orientation import expect_as_described
from trackprofile.inference.outliers import describe_observations
from trackprofile.inference.rail_decomposition import mean_observations
from trackprofile.inference.reference import KnownProfile
from trackprofile.models.sensor import Installation
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

STRETCH = 500.0
"""Length of the stretches that long recordings are cut into, m."""

MAX_LENGTH = 2500.0
"""Total length of stretches without a known profile, m; more adds little information."""

MIN_SPEED = 3.0
"""Minimum speed of a stretch, m/s: below it accelerations are smaller than the drift of any sensor."""


def calibration_runs(
    recordings: Sequence[xr.Dataset],
    reference: xr.Dataset | None,
    vehicle: Vehicle,
    installation: Installation,
) -> tuple[list[RunData], list[str]]:
    """Each recording with the reference where it covers it, and a sentence for each recording that it does not.

    Raises
    ------
    DataError
        Where the recordings differ in their sensors, or the reference covers none of them.
    """
    for one in recordings:
        expect_as_described(one, "a calibration")
    data = [
        mean_observations(observations(one, installation), vehicle, installation)
        for one in recordings
    ]
    for i, one in enumerate(data[1:], start=2):
        _expect_same_sensors(data[0], one, i)
    notes = [
        f"recording {i}: {one}" if len(data) > 1 else one
        for i, each in enumerate(data, start=1)
        for one in describe_observations(each)
    ]
    if reference is None:
        return [RunData(one, number=i) for i, one in enumerate(data, start=1)], notes
    known, runs = KnownProfile.from_reference(reference), list[RunData]()
    for i, one in enumerate(data, start=1):
        try:
            runs.append(RunData(known.covered(one, vehicle, installation.origin), known, i))
        except DataError as error:
            if len(data) == 1:
                raise
            runs.append(RunData(one, number=i))
            notes.append(f"recording {i} is used without the reference: {error}")
    if all(one.known is None for one in runs):
        raise DataError(
            f"The reference covers none of the {len(data)} recordings; leave it out, or choose another. {notes[-1]}"
        )
    return runs, notes


def _expect_same_sensors(first: Observations, other: Observations, number: int) -> None:
    names, others = ([one.name for one in each.sensors] for each in (first, other))
    if names != others:
        raise DataError(
            f"Recording {number} has the channels {', '.join(others)}, the first {', '.join(names)}: recordings "
            "that are calibrated together must have the same sensors; calibrate them separately."
        )


def most_informative(
    runs: Sequence[RunData], max_length: float = MAX_LENGTH
) -> tuple[list[RunData], list[str]]:
    """Runs with a known profile, and the most informative stretches of the others; a sentence if any is left out.

    A stretch is informative by its signal level and its speed: from each quarter of the speeds the stretches with the
    largest signals are taken in turn.

    Parameters
    ----------
    max_length : total length of stretches without a known profile, m
    """
    fixed = [one for one in runs if one.known]
    others = [one for one in runs if one.known is None]
    total = sum(one.length for one in others)
    if total <= max_length:
        return [*fixed, *others], []
    pieces = [piece for one in others for piece in _stretches(one) if _speed(piece) > MIN_SPEED]
    pieces.sort(key=_speed)
    quarters = [sorted(part, key=_signal_level) for part in _split(pieces, 4)]
    in_turn = [one for each in zip_longest(*map(reversed, quarters)) for one in each if one]
    selected = in_turn[: round(max_length / STRETCH)]
    note = f"{sum(one.length for one in selected):.0f} m of {total:.0f} m were used: the most informative stretches"
    return [*fixed, *selected], [note]


def shortened(runs: Sequence[RunData], length: float) -> list[RunData]:
    """The middle part of each run, together ``length`` m: enough to approach the maximum quickly."""
    share = length / sum(one.length for one in runs)
    if share >= 0.7:
        return list(runs)
    return [_middle(one, share * one.length) for one in runs]


def _middle(one: RunData, length: float) -> RunData:
    at = one.data.motion.distance
    centre = 0.5 * (at[0] + at[-1])
    return _between(one, centre - 0.5 * length, centre + 0.5 * length)


def _stretches(one: RunData) -> list[RunData]:
    at = one.data.motion.distance
    edges = np.arange(at[0], at[-1] - 0.5 * STRETCH, STRETCH)
    return [_between(one, a, a + STRETCH) for a in edges]


def _between(one: RunData, begin: float, end: float) -> RunData:
    data = one.data
    rows = slice(*np.searchsorted(data.motion.distance, [begin, end]))
    return replace(one, data=data.part(rows))


def _speed(one: RunData) -> float:
    return float(np.median(one.data.motion.speed))


def _signal_level(one: RunData) -> float:
    return float(np.sum(np.std(one.data.signals, axis=0)))


def _split(pieces: list[RunData], count: int) -> list[list[RunData]]:
    edges = [round(i * len(pieces) / count) for i in range(count + 1)]
    return [pieces[a:b] for a, b in pairwise(edges)]

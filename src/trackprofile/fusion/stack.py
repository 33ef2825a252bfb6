"""Passes side by side on one grid: what each says of every wave at every place, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, uniform_filter1d

from trackprofile.bands import resample
from trackprofile.contracts import Quality, known_elevation
from trackprofile.fusion.pass_alignment import AlignedPass
from trackprofile.fusion.spectral_bands import (
    LENGTHS,
    OMEGA,
    POWER,
    STEP,
    SpectralDecomposition,
    decompose_spectrum,
    stated_by,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOGETHER = 50.0
"""m within which passes that begin or end there are taken to begin or end together."""

UNDONE = 0.25
"""Share of a wave that an estimate has to hold, for the prior's part in it to be undone: else it would be blown up."""

_FLAWED = Quality.UNCONVERGED | Quality.SATURATED | Quality.UNEXPLAINED
_FAINT = 0.05  # share of a wave that is taken to be held at least
_BEYOND = 4.0  # times the prior's density, from which what is there cannot be of it
_FEATHER = 300.0  # m over which a pass fades in where passes are first put together


@dataclass(frozen=True, eq=False)
class PassStack:
    """Passes on the line's grid.

    Parameters
    ----------
    passes : n of them
    distance, spacing : of the grid (m) [m]
    places : at which spectra and weights are held (k) [m]
    level : of each pass, NaN where it says nothing (n, m) [m]
    flags : sums of `Quality` (n, m)
    stated : spectrum of each pass's error (n, waves, k) [m²/(rad/m)]
    prior : of the track, before each pass (n, waves) [m²/(rad/m)]
    slack : variance of each pass's place (n, k) [m²]
    inside : how far each pass goes on to both sides without a gap or flaw (n, k) [m]
    reference : a first guess of the line, NaN where no pass says anything (m) [m]
    cut, cut_reference : the waves of each pass, and of the reference in the same pieces
    whole : the waves of the reference
    """

    passes: tuple[AlignedPass, ...]
    distance: Array
    places: Array
    level: Array
    flags: NDArray[np.int16]
    stated: Array
    prior: Array
    slack: Array
    inside: Array
    reference: Array
    cut: tuple[SpectralDecomposition, ...]
    cut_reference: tuple[SpectralDecomposition, ...]
    whole: SpectralDecomposition

    @property
    def spacing(self) -> float:
        """Of the grid [m]."""
        return float(self.distance[1] - self.distance[0])

    def along(self, values: Array) -> Array:
        """What is held at the places (..., k), on the grid (..., m)."""
        rows = values.reshape(-1, self.places.size)
        found = np.stack([np.interp(self.distance, self.places, row) for row in rows])
        return found.reshape(*values.shape[:-1], self.distance.size)

    def cover(self, wave: int) -> Array:
        """Share of its weight that each pass has in a wave, less where it ends sooner than others (n, k)."""
        ramp = np.sin(0.5 * np.pi * np.minimum(self.inside / LENGTHS[wave], 1.0)) ** 2
        best = ramp.max(axis=0)
        return ramp / np.where(best > 0, best, 1.0)

    def undone(self, wave: int) -> bool:
        """Whether the prior's part in the estimates is undone: where half of the passes hold enough of a wave."""
        return float(np.median(self._held(wave).mean(axis=1))) >= UNDONE

    def gain(self, wave: int) -> Array:
        """Share of the wave that each pass's estimate holds, 1 - P/S (n, k) [-]; 1 where that is not undone."""
        held = self._held(wave)
        return held if self.undone(wave) else np.ones_like(held)

    def before(self, wave: int) -> float:
        """Density of the track before any pass [m²/(rad/m)]; infinite where the passes' part of it is not undone."""
        return float(np.median(self.prior[:, wave])) if self.undone(wave) else np.inf

    def alike(self, wave: int) -> Array:
        """Density of the part of each pass's error that is the prior's doing, (1 - G) P, where that is not undone.

        It is the same in all passes (n, k) [m²/(rad/m)].
        """
        left = (1.0 - self._held(wave)) * self.stated[:, wave]
        return np.zeros_like(left) if self.undone(wave) else left

    def _held(self, wave: int) -> Array:
        return np.maximum(1.0 - self.stated[:, wave] / self.prior[:, wave, None], _FAINT)

    def beside(self, wave: int) -> Array:
        """What each pass says beyond the reference, m_i - G_i r (n, m) [m]."""
        held = self.along(self.gain(wave))
        # Most passes have the same pieces.
        line = {
            id(one): one.wave(wave) for one in {id(one): one for one in self.cut_reference}.values()
        }
        found = np.stack(
            [
                own.wave(wave) - share * line[id(of)]
                for own, of, share in zip(self.cut, self.cut_reference, held, strict=True)
            ]
        )
        return np.where(np.isfinite(self.level), found, 0.0)

    def strength(self, wave: int) -> Array:
        """Density of the reference in a wave, near each place (k) [m²/(rad/m)]."""
        square = self.whole.wave(wave) ** 2
        known = np.isfinite(self.reference).astype(np.float64)
        width = 2 * LENGTHS[wave] / self.spacing
        share = np.maximum(smooth(known, width), 1e-3)
        return np.interp(self.places, self.distance, smooth(square, width) / share) / POWER[wave]

    def misplaced(self, wave: int) -> Array:
        """Density of the error of places that are unsure: (dz/dx)² δ² (n, k) [m²/(rad/m)]."""
        return OMEGA[wave] ** 2 * self.strength(wave) * self.slack

    def about(self, reference: Array) -> PassStack:
        """The same with another guess of the line."""
        return replace(
            self,
            reference=reference,
            cut_reference=_cut_alike(reference, np.isfinite(self.level), self.spacing),
            whole=decompose_spectrum(reference, self.spacing),
        )


def smooth(values: Array, width: float) -> Array:
    """Means along the last axis over a width in points, three times over."""
    size = int(np.clip(round(width), 1, values.shape[-1]))
    for _ in range(3):
        values = uniform_filter1d(values, size, axis=-1, mode="nearest")
    return values


def stack_passes(passes: Sequence[AlignedPass]) -> PassStack:
    """Put passes on one grid from where the first ones begin to where the last ones end.

    Long waves of passes differ by millimetres: where one goes on alone for a few metres, the line would have a step.

    Raises
    ------
    DataError : a pass does not state its standard deviation.
    """
    spacing = min(float(np.median(np.diff(one.of.profile["distance"]))) for one in passes)
    ends = [one.of.profile["distance"].to_numpy()[[0, -1]] for one in passes]
    if len(passes) == 1:
        first, last = ends[0]
        distance = np.linspace(first, last, round(float(last - first) / spacing) + 1)
    else:
        starts, stops = np.array(ends).T
        first = np.ceil(starts[starts < starts.min() + TOGETHER].max() / spacing - 1e-9)
        last = np.floor(stops[stops > stops.max() - TOGETHER].min() / spacing + 1e-9)
        distance = spacing * np.arange(first, last + 1)
    places = np.linspace(
        distance[0], distance[-1], max(2, round(float(np.ptp(distance)) / STEP) + 1)
    )
    level = np.stack([_on(one, distance) for one in passes])
    flags = np.stack([_flags_on(one, distance) for one in passes])
    known = np.isfinite(level)
    spacing = float(distance[1] - distance[0])
    said = [stated_by(one.of.profile, places, one.of.name) for one in passes]
    stated = np.stack([_evened(one.error, places) for one in said])
    inside = np.stack(
        [_inside(k & ((f & _FLAWED) == 0), spacing) for k, f in zip(known, flags, strict=True)]
    )
    reference = _first_guess(level, inside, stated)
    cut = tuple(decompose_spectrum(one, spacing) for one in level)
    return PassStack(
        passes=tuple(passes),
        distance=distance,
        places=places,
        level=level,
        flags=flags,
        stated=stated,
        prior=_prior(cut, known, np.stack([one.prior for one in said])),
        slack=np.stack([one.unsure(places) ** 2 for one in passes]),
        inside=np.stack([np.interp(places, distance, one) for one in inside]),
        reference=reference,
        cut=cut,
        cut_reference=_cut_alike(reference, known, spacing),
        whole=decompose_spectrum(reference, spacing),
    )


def _on(one: AlignedPass, distance: Array) -> Array:
    own = one.of.profile["distance"].to_numpy()
    level = known_elevation(one.of.profile)
    if own.size == distance.size and np.abs(own - distance).max() < 1e-6:
        return level
    return resample(own, level, distance)


def _flags_on(one: AlignedPass, distance: Array) -> NDArray[np.int16]:
    own = one.of.profile["distance"].to_numpy()
    nearest = np.searchsorted((own[1:] + own[:-1]) / 2, distance)
    return one.of.profile["quality"].to_numpy().astype(np.int16)[nearest]


def _inside(good: Mask, spacing: float) -> Array:
    """Distance to the nearest point that is not good, beyond the ends nothing is [m]."""
    padded = np.concatenate([[False], good, [False]])
    return spacing * np.asarray(distance_transform_edt(padded))[1:-1]


def _first_guess(level: Array, inside: Array, stated: Array) -> Array:
    """Mean of the passes, weighted by what they know of the shorter waves, each fading in from its ends."""
    knows = 1.0 / np.median(stated[:, LENGTHS < 25.0], axis=2).mean(axis=1)
    weight = knows[:, None] * np.maximum(np.minimum(inside / _FEATHER, 1.0), 1e-6)
    weight = np.where(np.isfinite(level), weight, 0.0)
    total = weight.sum(axis=0)
    mean = np.sum(weight * np.nan_to_num(level), axis=0) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, mean, np.nan)


def _evened(density: Array, places: Array) -> Array:
    """Each wave's density along the line, in the logarithmic mean over its length (waves, k)."""
    step = float(places[1] - places[0])
    return np.stack(
        [
            np.exp(smooth(np.log(one), length / step))
            for one, length in zip(density, LENGTHS, strict=True)
        ]
    )


def _prior(cut: Sequence[SpectralDecomposition], known: Mask, prior: Array) -> Array:
    """Density of the track before each pass (n, waves); what a pass shows, where that is far beyond what it stands for.

    A profile whose long waves were taken out states too little of the whole.
    """
    shown = np.array(
        [
            [np.mean(one.wave(wave)[here] ** 2) for wave in range(LENGTHS.size)]
            for one, here in zip(cut, known, strict=True)
        ]
    )
    return np.where(shown / POWER > _BEYOND * prior, shown / POWER, prior)


def _cut_alike(reference: Array, known: Mask, spacing: float) -> tuple[SpectralDecomposition, ...]:
    """The reference in the pieces of each pass: its ends then mislead both alike."""
    made: dict[bytes, SpectralDecomposition] = {}
    for here in known:
        if here.tobytes() not in made:
            made[here.tobytes()] = decompose_spectrum(np.where(here, reference, np.nan), spacing)
    return tuple(made[here.tobytes()] for here in known)

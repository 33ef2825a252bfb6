"""How far to trust what passes state: the variances that make their differences most probable.

In every wave and stretch the passes' estimates, each divided by the standard deviation that it states,
have the covariance Σ = diag(λ) + H D Hᵀ, with λ_i the variance of pass i over the stated, and for each
vehicle v what its passes share, of a variance ξ_v in units of the track's own, and what changes with
time. The level itself is free, so that the likelihood is that of differences (Patterson and Thompson
1971); each variance is multiplied by the root of what the data ask for over what is there (Zhou, Hu,
Zhou and Lange 2019), until nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.fusion.spectral_bands import LENGTHS, POWER, WIDTH, Range
from trackprofile.fusion.stack import PassStack

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

BELIEF = 10.0
"""Independent waves as which it counts that a pass is as loud as is usual among them."""

STRETCH, WAVES_LONG = 250.0, 8.0
"""Length of a stretch at least [m], and in its longest waves."""

MOST = 5_000_000
"""Products of two passes in one wave: of more, stretches evenly along the line are taken."""

_ROUNDS = 200
_SETTLED = 1e-4  # greatest relative change of a variance in a round
_NONE = 1e-12  # of the track's own variance


@dataclass(frozen=True, eq=False)
class CovarianceCells:
    """What the passes say in the waves of one range, stretch by stretch.

    Parameters
    ----------
    product : mean of the products of two passes' estimates beyond the reference, over what they state (c, n, n) [-]
    told : 1/N of each pass, 0 where it says too little (c, n) [1/(m²/(rad/m))]
    strength : density of the track (c) [m²/(rad/m)]
    count : independent waves behind it (c)
    start, end : of each stretch (c) [m]
    wave : number of each (c)
    """

    product: Array
    told: Array
    strength: Array
    count: Array
    start: Array
    end: Array
    wave: Indices

    @property
    def there(self) -> Mask:
        """Which passes speak (c, n)."""
        return self.told > 0

    def of(self, heard: Mask) -> CovarianceCells:
        """Only of the passes that are heard, everywhere (n) or here and there (c, n)."""
        return replace(self, told=np.where(heard, self.told, 0.0))


@dataclass(frozen=True, eq=False)
class Factors:
    """Of one range of waves.

    Parameters
    ----------
    louder : λ of each pass in each wave (n, waves of the range)
    counts : independent waves behind each (n, waves of the range)
    shared : ξ of each vehicle (vehicles)
    change : variance of the rate over the track's own, in each cell (c) [1/day²]
    """

    louder: Array
    counts: Array
    shared: Array
    change: Array


def covariance_cells(laid: PassStack, part: Range) -> CovarianceCells:
    """Cut the line into stretches, the longer the longer the waves, and take the products of the passes in each."""
    length = max(STRETCH, WAVES_LONG * float(LENGTHS[part.waves][-1]))
    pieces = max(1, round(float(np.ptp(laid.distance)) / length))
    edges = np.linspace(0, laid.distance.size, pieces + 1).round().astype(int)
    most = max(1, MOST // len(laid.passes) ** 2)
    chosen = np.unique(np.linspace(0, pieces - 1, min(pieces, most)).round().astype(int))
    found = [_of_wave(laid, wave, edges, chosen) for wave in part.numbers]
    return CovarianceCells(*(np.concatenate(each) for each in zip(*found, strict=True)))


def _of_wave(laid: PassStack, wave: int, edges: Indices, chosen: Indices) -> tuple[Array, ...]:
    G = laid.gain(wave)
    error = laid.stated[:, wave] + G * laid.misplaced(wave)
    own = laid.beside(wave) / np.sqrt(laid.along(G * error) * POWER[wave])
    informed = np.asarray((laid.cover(wave) > 0.5) & (laid.inside > 0))
    strength = laid.strength(wave)
    products, told, strong, counts = [], [], [], []
    for number in chosen:
        here = slice(edges[number], edges[number + 1])
        low, high = laid.distance[here.start], laid.distance[here.stop - 1]
        places = slice(*np.searchsorted(laid.places, [low, high]))
        if places.stop == places.start:
            places = slice(places.start, places.start + 1)
        there = np.asarray(informed[:, places].all(axis=1))
        part = np.where(there[:, None], own[:, here], 0.0)
        products.append(part @ part.T / part.shape[1])
        told.append(np.where(there, (G / error)[:, places].mean(axis=1), 0.0))
        strong.append(strength[places].mean())
        counts.append(2 * WIDTH[wave] * laid.spacing * part.shape[1])
    starts, ends = laid.distance[edges[chosen]], laid.distance[edges[chosen + 1] - 1]
    waves = np.full(chosen.size, wave)
    return (
        np.array(products),
        np.array(told),
        np.array(strong),
        np.array(counts),
        starts,
        ends,
        waves,
    )


def factors(of: CovarianceCells, days: Array, vehicle: Indices, tied: Indices) -> Factors:
    """The most probable variances.

    Most track stands and some moves, so that the variance of rates is that of each stretch.

    Parameters
    ----------
    days : about their mean (n)
    vehicle : of each pass, by number (n)
    tied : number of the variance that each vehicle has, some sharing one; empty where there is no telling
    """
    waves, of_wave = np.unique(of.wave, return_inverse=True)
    stretch, of_stretch = np.unique(of.start, return_inverse=True)
    each, along = (np.eye(size)[which].T * of.count for size, which in
                   ((waves.size, of_wave), (stretch.size, of_stretch)))  # fmt: skip
    pooled = (tied[:, None] == tied).astype(np.float64)
    least = _NONE / max(float(np.ptp(days)), 1.0) ** 2
    # All begin alike, or the first to grow would take what is another's.
    begin = (
        1.0 / max(float(np.median((of.told * of.strength[:, None])[of.there])), 1.0)
        if of.there.any()
        else 1.0
    )
    louder, shared = np.ones((waves.size, days.size)), np.full(tied.size, begin)
    change = np.full(stretch.size, begin / max(float(np.ptp(days)), 1.0) ** 2)
    for _ in range(_ROUNDS):
        P, H = projection(of, days, vehicle, louder[of_wave], change[of_stretch], shared)
        W = P @ of.product @ P
        quadratic, trace = (each @ np.einsum("cii->ci", one) for one in (W, P))
        usual = _usual(louder, trace > 0)
        new = np.sqrt((quadratic * louder**2 + BELIEF * usual) / (trace + BELIEF / louder))
        asked, there = ((H * (one @ H)).sum(axis=1) for one in (W, P))
        change *= _grown(along @ asked[:, 0], along @ there[:, 0])
        shared *= _grown(*(pooled @ (of.count @ one[:, 1:]) for one in (asked, there)))
        change, shared = np.maximum(change, least), np.maximum(shared, _NONE)
        moved, louder = np.abs(np.log(new / louder)).max(initial=0.0), new
        if moved < _SETTLED:
            break
    return Factors(louder.T, (each @ of.there).T, shared, change[of_stretch])


def _usual(louder: Array, told: Mask) -> Array:
    """What is usual in each wave (waves, 1): the median of the passes, drawn to 1 by as much as one more pass would."""
    count = told.sum(axis=1, keepdims=True)
    ordered = np.sort(np.where(told, np.log(louder), np.inf), axis=1)
    halves = [
        np.take_along_axis(ordered, np.maximum(at, 0), axis=1)
        for at in ((count - 1) // 2, count // 2)
    ]
    middle = np.where(count > 0, 0.5 * (halves[0] + halves[1]), 0.0)
    return np.exp(count / (count + 1) * middle)


def _grown(asked: Array, there: Array) -> Array:
    """Factor by which a variance grows; 0 where nothing tells it."""
    return np.where(there > 0, np.sqrt(asked / np.where(there > 0, there, 1.0)), 0.0)


def projection(
    of: CovarianceCells, days: Array, vehicle: Indices, louder: Array, change: Array, shared: Array
) -> tuple[Array, Array]:
    """P = Σ⁻¹ - Σ⁻¹ l (lᵀ Σ⁻¹ l)⁻¹ lᵀ Σ⁻¹ (c, n, n), and the columns of change and vehicles, H (c, n, 1 + vehicles).

    The level's own column l is √a, as every estimate is in units of what it states.

    Parameters
    ----------
    louder : λ (c, n)
    change, shared : variances of the rate (c) and of vehicles (vehicles), over the track's own
    """
    root = np.sqrt(of.told)
    size = np.sqrt(of.strength)[:, None] * root
    by_time = (np.sqrt(change)[:, None] * size * days)[:, :, None]
    by_vehicle = size[:, :, None] * np.sqrt(shared) * (vehicle[:, None] == np.arange(shared.size))
    H = np.concatenate([by_time, by_vehicle], axis=2)
    level = root / np.maximum(root.max(axis=1, keepdims=True), 1e-300)
    every = np.concatenate([level[:, :, None], H], axis=2)
    scaled = (of.there / louder)[:, :, None] * every
    J = np.swapaxes(every, 1, 2) @ scaled
    own = np.ones(J.shape[-1])
    own[0] = 1e-12  # the level is free
    J += np.diag(own)
    inverse = np.eye(days.size) * (of.there / louder)[:, None, :]
    return inverse - scaled @ np.linalg.solve(J, np.swapaxes(scaled, 1, 2)), H

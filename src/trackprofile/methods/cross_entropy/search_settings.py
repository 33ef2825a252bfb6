"""Settings of the cross-entropy search: those of Tables 5 and 6 of the paper, and those that it leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import Enum

from trackprofile.errors import ModelError
from trackprofile.models.sensor import Installation
from trackprofile.models.track import RigidTrack, Track


class Objective(Enum):
    """The objective function by which trial profiles are ranked."""

    SIGNAL = "signal"
    """O, the misfit of the whole signal of the window (equation 10)."""
    SCAN = "scan"
    """O_t, the misfit of each elevation's own scan, at which the leading wheel reaches it (equation 11)."""


class Variant(Enum):
    """The statistics of the elite from which the next generation is drawn."""

    LITERAL = "literal"
    """Mean and standard deviation of each elevation, as in the paper."""
    COVARIANCE = "covariance"
    """Mean and full covariance, smoothed over the generations."""


class Evaluation(Enum):
    """How the signals of a trial profile are computed; both agree to round-off."""

    AFFINE = "affine"
    """By the window's affine map y_free + G x (theory, section 5)."""
    SIMULATION = "simulation"
    """By one simulation per trial profile."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the cross-entropy search.

    Parameters
    ----------
    length : length of profile inferred per phase, m; None: one elevation per recorded sample
    unknowns : number of elevations per phase, m in the paper
    mean : mean of the first elevation of the first generation, m
    standard_deviation : standard deviation of the first generation, m
    population : number of trial profiles per generation
    elite : share of the population in the elite
    threshold : sum of the squared changes of the means below which a run has converged, m²
    objective, variant : see `Objective` and `Variant`
    agreement : maximum relative difference of two runs that agree, in the root of the sum of squares of the elevations
        (for covariance: of their rise above the last decided elevation)
    smoothing : weight of the previous covariance
    generations, runs : maximum numbers, after which the phase is flagged as not converged

    Raises
    ------
    ModelError
        Where a number is out of range, or the elite has fewer than two profiles.
    """

    length: float | None
    unknowns: int
    mean: float
    standard_deviation: float
    population: int
    elite: float
    threshold: float
    objective: Objective
    variant: Variant = Variant.COVARIANCE
    agreement: float = 0.05
    smoothing: float = 0.6
    generations: int = 300
    runs: int = 20

    def __post_init__(self) -> None:
        positive = ("standard_deviation", "threshold", "agreement", "generations")
        lowest = dict.fromkeys(positive, 0.0) | {"unknowns": 1, "runs": 1, "smoothing": -1e-300}
        highest = {"elite": 1.0, "smoothing": 1.0}
        for name in (one.name for one in fields(self)):
            value = getattr(self, name)
            low, high = lowest.get(name, -math.inf), highest.get(name, math.inf)
            if isinstance(value, int | float) and not low < value < high:
                raise ModelError(
                    f"search: {name} must lie between {low:g} and {high:g}, got {value:g}"
                )
        if self.length is not None and not self.length > 0:
            raise ModelError(f"search: length must be above 0 m, got {self.length:g} m")
        if self.elite_size < 2:
            raise ModelError(
                f"search: an elite of {self.elite:g} of {self.population} profiles has fewer than two; "
                f"use a population of at least {math.ceil(1.5 / max(self.elite, 1e-9)):d}"
            )

    @property
    def elite_size(self) -> int:
        """k, the number of profiles in the elite.

        Examples
        --------
        >>> TABLE_5.elite_size, TABLE_6.elite_size
        (15, 10)
        """
        return round(self.elite * self.population)


TABLE_5 = SearchSettings(0.25, 10, 0.0, 0.5e-3, 150, 0.1, 1e-15, Objective.SIGNAL)
"""Settings for Model A. The paper's threshold has no unit; read as mm² it gives the paper's number of generations."""

TABLE_6 = SearchSettings(0.833, 10, 0.0, 1e-3, 100, 0.1, 5e-17, Objective.SCAN)
"""Settings for Model B."""


@dataclass(frozen=True)
class CrossEntropySettings:
    """Settings of the cross-entropy method.

    Parameters
    ----------
    installation : installation of the sensors, from a calibration
    track : track under the wheels
    search : settings of the search; None uses Table 5 of the paper for one channel and Table 6 for several
    evaluation : how the signals of the trial profiles are computed
    seed : seed of the random trial profiles
    """

    installation: Installation = field(default_factory=Installation)
    track: Track = field(default_factory=RigidTrack)
    search: SearchSettings | None = None
    evaluation: Evaluation = Evaluation.AFFINE
    seed: int = 0

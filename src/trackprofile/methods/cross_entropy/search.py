"""How the cross-entropy method searches: what Tables 5 and 6 of the paper set, and what it leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum

from trackprofile.errors import ModelError


class Objective(Enum):
    """By what trial profiles are judged."""

    SIGNAL = "signal"
    """O, the whole signal of the window (equation 10)."""
    SCAN = "scan"
    """O_t, each elevation by the scan at which the leading wheel reaches it (equation 11)."""


class Variant(Enum):
    """What of the elite the next generation is drawn from."""

    LITERAL = "literal"
    """Mean and standard deviation of each elevation, as the paper's text says."""
    COVARIANCE = "covariance"
    """Mean and covariance, which is mixed with the one before."""


class Evaluation(Enum):
    """How the signals of a trial profile are computed; the same to rounding."""

    MAP = "map"
    """By the window's affine map y_free + G x (theory, section 5)."""
    SIMULATION = "simulation"
    """By a simulation for each profile."""


@dataclass(frozen=True)
class Search:
    """Settings of the cross-entropy method.

    Parameters
    ----------
    length : of profile inferred per phase, m; None: one elevation to a scan as it was recorded
    unknowns : elevations per phase, m in the paper
    mean : of the first elevation of the first generation, m
    standard_deviation : of the first generation, m
    population : trial profiles per generation
    elite : their best share
    threshold : of the sum of the squared changes of the means, m², below which a run has converged
    objective, variant : see there
    agreement : share of the elevations (of their rise, for covariance) by which two runs may differ and be the same,
        in the root of the sum of squares
    smoothing : share of the covariance before that is kept
    generations, runs : at most, before a phase is given up and its metres flagged

    Raises
    ------
    ModelError
        Where a number is impossible, or the elite too small to have a spread.
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
        for name in (field.name for field in fields(self)):
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
                f"search: an elite of {self.elite:g} of {self.population} profiles has no spread; "
                f"take a population of at least {math.ceil(1.5 / max(self.elite, 1e-9)):d}"
            )

    @property
    def elite_size(self) -> int:
        """k, the number of profiles in an elite.

        Examples
        --------
        >>> TABLE_5.elite_size, TABLE_6.elite_size
        (15, 10)
        """
        return round(self.elite * self.population)


TABLE_5 = Search(0.25, 10, 0.0, 0.5e-3, 150, 0.1, 1e-15, Objective.SIGNAL)
"""For Model A. The paper's threshold has no unit; in mm² it gives the paper's number of generations."""

TABLE_6 = Search(0.833, 10, 0.0, 1e-3, 100, 0.1, 5e-17, Objective.SCAN)
"""For Model B."""

"""Settings of the cross-entropy search as TOML: one table of the paper, and the settings that differ from it.

like = "table-6"                # or "table-5": the table that gives the default of every other key
length = "0.5 m"                # length of profile per phase; "as recorded": one elevation per recorded sample
unknowns = 10                   # number of elevations per phase
mean = "0 mm"                   # mean of the first generation
standard_deviation = "1 mm"     # standard deviation of the first generation
population = 100                # number of trial profiles per generation
elite = 0.1                     # share of the population in the elite
threshold = "5e-11 mm2"         # sum of the squared changes of the means below which a run has converged
objective = "scan"              # or "signal"
variant = "covariance"          # or "literal"
agreement = 0.05                # maximum relative difference of two runs that agree
smoothing = 0.6                 # weight of the previous covariance
generations = 300               # maximum number of generations per run
runs = 20                       # maximum number of runs per phase
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator

from trackprofile.errors import FileError, ModelError
from trackprofile.io.scenario_tables import Length, si_value
from trackprofile.io.toml_document import Strict, load
from trackprofile.methods.cross_entropy.search_settings import (
    TABLE_5,
    TABLE_6,
    Objective,
    SearchSettings,
    Variant,
)

SEARCHES = {"table-5": TABLE_5, "table-6": TABLE_6}
AS_RECORDED = "as recorded"


class SearchTable(Strict):
    """The keys of a search TOML; the module's docstring explains each."""

    like: Literal["table-5", "table-6"]
    length: Literal["as recorded"] | Length | None = None
    unknowns: int | None = None
    mean: Length | None = None
    standard_deviation: Length | None = None
    population: int | None = None
    elite: float | None = None
    threshold: Annotated[float, BeforeValidator(partial(si_value, "area"))] | None = None
    objective: Literal["signal", "scan"] | None = None
    variant: Literal["literal", "covariance"] | None = None
    agreement: float | None = None
    smoothing: float | None = None
    generations: int | None = None
    runs: int | None = None


def read_search(name_or_path: str | Path) -> SearchSettings:
    """Read the settings of the cross-entropy search.

    Parameters
    ----------
    name_or_path : ``table-5``, ``table-6`` or the path of a TOML; the module's docstring shows one

    Raises
    ------
    FileError : the file does not exist, or has an unknown key or a number out of range.

    Examples
    --------
    >>> read_search("table-6").population
    100
    """
    path = Path(name_or_path)
    if str(name_or_path) in SEARCHES:
        return SEARCHES[str(name_or_path)]
    if not path.is_file():
        raise FileError(
            f"{name_or_path}: no such file; give the path of a TOML, or one of {', '.join(SEARCHES)}."
        )
    values = load(path, SearchTable).model_dump(exclude_none=True)
    if values.get("length") == AS_RECORDED:
        values["length"] = None
    for name, kind in (("objective", Objective), ("variant", Variant)):
        if name in values:
            values[name] = kind(values[name])
    try:
        return replace(SEARCHES[values.pop("like")], **values)
    except ModelError as error:
        raise FileError(f"{path}: {error}.") from error

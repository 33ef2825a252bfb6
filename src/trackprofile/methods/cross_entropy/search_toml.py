"""Settings of the cross-entropy method as a person writes them in TOML: a table of the paper, and what differs.

like = "table-6"                # or table-5
length = "0.5 m"                # of profile inferred per phase; "as recorded": one elevation to a scan
unknowns = 10                   # elevations per phase
mean = "0 mm"                   # of the first generation, and its
standard_deviation = "1 mm"
population = 100
elite = 0.1                     # share of the population
threshold = "5e-11 mm2"         # of the sum of the squared changes of the means
objective = "scan"              # or "signal"
variant = "covariance"          # or "literal"
agreement = 0.05                # within which two runs are the same
smoothing = 0.6                 # share of the covariance before that is kept
generations = 300               # at most, and
runs = 20
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator

from trackprofile.errors import FileError, ModelError
from trackprofile.io.scenario_tables import Length, si
from trackprofile.io.toml_document import Strict, load
from trackprofile.methods.cross_entropy.search import TABLE_5, TABLE_6, Objective, Search, Variant

SEARCHES = {"table-5": TABLE_5, "table-6": TABLE_6}
AS_RECORDED = "as recorded"


class SearchTable(Strict):
    like: Literal["table-5", "table-6"]
    length: Literal["as recorded"] | Length | None = None
    unknowns: int | None = None
    mean: Length | None = None
    standard_deviation: Length | None = None
    population: int | None = None
    elite: float | None = None
    threshold: Annotated[float, BeforeValidator(partial(si, "area"))] | None = None
    objective: Literal["signal", "scan"] | None = None
    variant: Literal["literal", "covariance"] | None = None
    agreement: float | None = None
    smoothing: float | None = None
    generations: int | None = None
    runs: int | None = None


def read_search(name_or_path: str | Path) -> Search:
    """``table-5``, ``table-6`` or a TOML, as the module shows one.

    Raises
    ------
    FileError : there is no such file, or it has a wrong key or number.

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
            f"{name_or_path}: there is no such file; give the path of a TOML, or one of {', '.join(SEARCHES)}."
        )
    read = load(path, SearchTable).model_dump(exclude_none=True)
    if read.get("length") == AS_RECORDED:
        read["length"] = None
    for name, kind in (("objective", Objective), ("variant", Variant)):
        if name in read:
            read[name] = kind(read[name])
    try:
        return replace(SEARCHES[read.pop("like")], **read)
    except ModelError as error:
        raise FileError(f"{path}: {error}.") from error

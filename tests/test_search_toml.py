"""Settings of the search, as a person writes them."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackprofile.errors import FileError
from trackprofile.methods.cross_entropy.search_settings import TABLE_5, TABLE_6, Objective, Variant
from trackprofile.methods.cross_entropy.search_toml import read_search


def test_tables_of_the_paper_by_name() -> None:
    assert read_search("table-5") is TABLE_5
    assert read_search("table-6") is TABLE_6


def test_numbers_of_tables_5_and_6() -> None:
    five, six = TABLE_5, TABLE_6
    assert (five.length, five.unknowns, five.mean, five.standard_deviation) == (0.25, 10, 0, 5e-4)
    assert (five.population, five.elite_size, five.agreement) == (150, 15, 0.05)
    assert (six.length, six.unknowns, six.mean, six.standard_deviation) == (0.833, 10, 0, 1e-3)
    assert (six.population, six.elite_size, six.agreement) == (100, 10, 0.05)
    assert five.threshold == pytest.approx(1e-9 * 1e-6)
    assert six.threshold == pytest.approx(5e-11 * 1e-6)


def test_every_key_is_understood(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(
        'like = "table-6"\nlength = "as recorded"\nunknowns = 8\nmean = "1 mm"\n'
        'standard_deviation = "2 mm"\npopulation = 200\nelite = 0.2\nthreshold = "1e-6 mm2"\n'
        'objective = "signal"\nvariant = "literal"\nagreement = 0.01\nsmoothing = 0.4\n'
        "generations = 50\nruns = 4\n"
    )
    read = read_search(path)
    assert (read.length, read.unknowns, read.mean, read.standard_deviation) == (None, 8, 1e-3, 2e-3)
    assert (read.population, read.elite, read.threshold) == (200, 0.2, pytest.approx(1e-12))
    assert (read.objective, read.variant) == (Objective.SIGNAL, Variant.LITERAL)
    assert (read.agreement, read.smoothing, read.generations, read.runs) == (0.01, 0.4, 50, 4)


@pytest.mark.parametrize(
    ("line", "said"),
    [("population = 5", "population of at least"), ('threshold = "1 mm"', "area"),
     ("treshold = 1", "treshold"), ('variant = "best"', "variant"), ('length = "x"', "length")],
)  # fmt: skip
def test_wrong_settings_are_refused_by_name(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "search.toml"
    path.write_text(f'like = "table-5"\n{line}\n')
    with pytest.raises(FileError, match=said):
        read_search(path)

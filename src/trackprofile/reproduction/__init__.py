"""The paper reproduced, table by table and figure by figure: a page, and its numbers as CSV."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from trackprofile.errors import FileError
from trackprofile.inference.maximum_likelihood import Progress
from trackprofile.io.atomic import check_writable, whole_files
from trackprofile.reproduction import noise_study as noise
from trackprofile.reproduction import open_settings, searches
from trackprofile.reproduction import paper_tables as tables
from trackprofile.reproduction import reproduction_html as page
from trackprofile.reproduction.parts import PageSection

TITLE = "Longitudinal profile from vehicle-based inertial readings: the paper reproduced"
INTRODUCTION = (
    "O'Brien, Bowe, Quirke, Cantero: Determination of longitudinal profile of railway track using vehicle-based "
    "inertial readings. Journal of Rail and Rapid Transit 231 (2017) 518-534, doi 10.1177/0954409716664936.",
    "Made by: trackprofile reproduce. Each table's and figure's numbers lie beside this page as CSV. Ratios are ours "
    "to the paper's. Everything is simulated, as in the paper; seeds are fixed.",
)
PAGE = "index.html"


def reproduce(folder: str | Path, progress: Progress | None = None) -> tuple[Path, ...]:
    """Compute everything and write it: the page first, then the tables; all files, or none.

    Parameters
    ----------
    folder : is created
    progress : told which part is computed, and the share done

    Raises
    ------
    FileError : the folder cannot be written to, or holds a page that is not this one.
    """
    folder = Path(folder)
    _check(folder)
    sections = compute_sections(progress or (lambda stage, share: None))
    texts = {PAGE: page.html(TITLE, INTRODUCTION, sections)}
    for section in sections:
        texts |= page.files(section)
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / name for name in texts)
    with whole_files(*paths) as places:
        for place, text in zip(places, texts.values(), strict=True):
            place.write_text(text, encoding="utf-8")
    return paths


def compute_sections(progress: Progress) -> tuple[PageSection, ...]:
    """All sections, in the order of the page."""
    found: dict[str, tuple[PageSection, ...]] = {}
    taken: dict[str, tuple[str, float, float]] = {}

    def bell() -> tuple[PageSection, ...]:
        section, rates = searches.inverted_bell()
        for name, rate in rates.items():
            taken[f"O on Model A, {name}"] = ("Model A", rate, 1 / 30.0)
        return (section,)

    def noisy() -> tuple[PageSection, ...]:
        section, rates = noise.noisy_profiles()
        for name, rate in rates.items():
            taken[f"O_t on Model B, {name}"] = ("Model B", rate, 3.6 / 150.0)
        return (section,)

    parts: tuple[tuple[str, Callable[[], tuple[PageSection, ...]]], ...] = (
        ("tables", tables.settings),
        ("figure 3", lambda: (noise.profiles(),)),
        ("figures 10 to 12", searches.convergence),
        ("figure 13", bell),
        ("figure 14", lambda: (searches.random_profiles(),)),
        ("figures 15 and 16", noise.sensors),
        ("figure 17", noisy),
        ("figure 18", lambda: (noise.settlement_study(),)),
        ("left open", lambda: (open_settings.left_open(),)),
    )
    for number, (name, part) in enumerate(parts):
        progress("reproducing", number / len(parts))
        found[name] = part()
    progress("reproducing", 1.0)
    sections = [section for some in found.values() for section in some]
    return (*sections, tables.speed_section(taken))


def _check(folder: Path) -> None:
    there = folder / PAGE
    if folder.exists():
        check_writable(there)
    if there.exists() and TITLE not in there.read_text(encoding="utf-8", errors="replace")[:2000]:
        raise FileError(
            f"{there}: it is there already and is no reproduction; choose another folder."
        )

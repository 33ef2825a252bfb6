"""Reproduction of the paper, table by table and figure by figure: an HTML report, and its numbers as CSV."""

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
    "Made by: trackprofile reproduce. The numbers of each table and figure are in CSV files in the same folder. Ratios "
    "are our value over the paper's value. Everything is simulated, as in the paper; seeds are fixed.",
)
PAGE = "index.html"


def reproduce(folder: str | Path, progress: Progress | None = None) -> tuple[Path, ...]:
    """Compute all sections and write them: first the HTML report, then the CSV files; all files or none.

    Parameters
    ----------
    folder : folder for the files; created where it does not exist
    progress : called with the stage and the share done

    Returns
    -------
    the files written, the HTML report first

    Raises
    ------
    FileError : the folder cannot be written to, or has an index.html of something else.
    """
    folder = Path(folder)
    _check(folder)
    sections = compute_sections(progress or (lambda stage, share: None))
    texts = {PAGE: page.html(TITLE, INTRODUCTION, sections)}
    for section in sections:
        texts |= page.files(section)
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / name for name in texts)
    with whole_files(*paths) as temporary:
        for path, text in zip(temporary, texts.values(), strict=True):
            path.write_text(text, encoding="utf-8")
    return paths


def compute_sections(progress: Progress) -> tuple[PageSection, ...]:
    """All sections, in the order of the report."""
    results: dict[str, tuple[PageSection, ...]] = {}
    durations: dict[str, tuple[str, float, float]] = {}

    def bell() -> tuple[PageSection, ...]:
        section, rates = searches.inverted_bell()
        for name, rate in rates.items():
            durations[f"O on Model A, {name}"] = ("Model A", rate, 1 / 30.0)
        return (section,)

    def noisy() -> tuple[PageSection, ...]:
        section, rates = noise.noisy_profiles()
        for name, rate in rates.items():
            durations[f"O_t on Model B, {name}"] = ("Model B", rate, 3.6 / 150.0)
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
        ("open settings", lambda: (open_settings.open_settings_section(),)),
    )
    for number, (name, part) in enumerate(parts):
        progress("reproducing", number / len(parts))
        results[name] = part()
    progress("reproducing", 1.0)
    sections = [section for part in results.values() for section in part]
    return (*sections, tables.speed_section(durations))


def _check(folder: Path) -> None:
    page_path = folder / PAGE
    if folder.exists():
        check_writable(page_path)
    if (
        page_path.exists()
        and TITLE not in page_path.read_text(encoding="utf-8", errors="replace")[:2000]
    ):
        raise FileError(
            f"{page_path}: the file exists and is not a reproduction report; choose another folder."
        )

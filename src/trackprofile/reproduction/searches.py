"""Figures 10 to 14: how the search converges, and what it finds on Model A."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trackprofile.io.model_toml import read_spectrum
from trackprofile.methods.cross_entropy.estimator import CrossEntropyResult, Phase
from trackprofile.methods.cross_entropy.search_settings import (
    TABLE_5,
    TABLE_6,
    Objective,
    SearchSettings,
    Variant,
)
from trackprofile.reproduction.cases import (
    CLASSES,
    Case,
    bell,
    fine_signals,
    model_a,
    model_b,
    search_grid_signals,
)
from trackprofile.reproduction.paper_tables import median_generations
from trackprofile.reproduction.parts import Cell, FigurePanel, PageSection, Table, ratio
from trackprofile.reproduction.studies import (
    SearchStudy,
    accuracy_bounds,
    band_rms,
    fine_signals_with_lead,
    run_search,
    run_smoother,
    shortened,
)

Array = NDArray[np.float64]

SEEDS = 10
"""Searches of the bell, to say how far one result is luck."""

PHASES_OVER = 60.0
"""m over which phases are counted, before Model B's errors have grown."""


def convergence() -> tuple[PageSection, PageSection, PageSection]:
    """Figures 10 to 12."""
    on_a = shortened(model_a("fra-4"), 0.5 * PHASES_OVER)
    on_b = shortened(model_b("fra-4"), PHASES_OVER)
    ten = _both(on_a, replace(TABLE_5, population=100))
    eleven = _both(on_b, replace(TABLE_6, objective=Objective.SIGNAL))
    twelve = _both(on_b, TABLE_6)
    shares: list[tuple[Cell, ...]] = []
    for variant, done in twelve.items():
        share = median_generations(done, 0) / median_generations(eleven[variant], 0)
        what = f"{variant.value}: generations of the first run, O_t to O"
        shares.append((what, 13 / 31, share, share / (13 / 31)))
    kept = (
        "The covariance variant takes longer than the paper, because it keeps 0.6 of the covariance from generation to "
        "generation; with less it collapses before it arrives (see “Left open”)."
    )
    return (
        _section("figure-10", "Figure 10: objective O on Model A", ten, (25, 23), [],
                 "As in the paper's figure the population is 100 here.", kept),
        _section("figure-11", "Figure 11: objective O on Model B", eleven, (31, 20), [],
                 "O settles ten elevations at once: the elite shrinks only as fast as in the worst direction.", kept),
        _section("figure-12", "Figure 12: sub-objectives O_t on Model B", twelve, (13, 13), shares,
                 "Each elevation is judged by its own scan, which says most of it, and waits for no other: the literal "
                 "variant gains more by it here than in the paper, the covariance variant about as much.", kept),
    )  # fmt: skip


def _both(case: Case, settings: SearchSettings) -> dict[Variant, CrossEntropyResult]:
    signals = search_grid_signals(case)
    return {
        variant: run_search(case, signals, replace(settings, variant=variant)).found
        for variant in Variant
    }


def _section(
    key: str, title: str, done: dict[Variant, CrossEntropyResult], paper: tuple[int, int],
    more: list[tuple[Cell, ...]], *said: str,
) -> PageSection:  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    objective: dict[str, tuple[Array, Array]] = {}
    values: dict[str, tuple[Array, Array]] = {}
    for variant, found in done.items():
        for run, due in enumerate(paper):
            ours = median_generations(found, run)
            what = f"{variant.value}: generations of run {run + 1}, median of {len(found.phases)} phases"
            rows.append((what, due, ours, ratio(ours, due)))
        runs = found.figures["runs_per_phase"]
        rows.append((f"{variant.value}: runs per phase, mean", 2, runs, runs / 2))
        one = _typical(found)
        each = np.concatenate([run.objective for run in one.runs])
        generation = np.arange(1.0, len(each) + 1)
        objective[variant.value] = generation, each
        values[variant.value] = generation, 1e6 * np.concatenate([run.convergence for run in one.runs])  # fmt: skip
    panels = (
        FigurePanel("generation", "O of the best profile", objective, "y"),
        FigurePanel("generation", "convergence value, mm²", values, "y"),
    )
    drawn = "Drawn is a phase of two runs whose first has the median number of generations."
    heads = ("what", "paper", "ours", "ratio")
    return PageSection(key, title, (*said, drawn), Table(heads, (*rows, *more)), panels)


def _typical(found: CrossEntropyResult) -> Phase:
    """A phase of two runs whose first took the median number of generations, or nearly."""
    middle = median_generations(found, 0)
    return min(
        found.phases,
        key=lambda one: (len(one.runs) != 2, abs(len(one.runs[0].objective) - middle)),
    )


def inverted_bell() -> tuple[PageSection, dict[str, float]]:
    """Figure 13, and the s per metre of the variants."""
    case = bell()
    signals = search_grid_signals(case)
    literal, covariance = (
        run_search(case, signals, replace(TABLE_5, variant=variant)) for variant in Variant
    )
    worst = [
        1e3 * float(np.abs(run_search(case, signals, TABLE_5, seed=seed).error).max())
        for seed in range(SEEDS)
    ]
    fine = fine_signals(case)
    on_fine = run_search(case, fine, TABLE_5)
    smoother = run_smoother(case, fine_signals_with_lead(case))
    place, flat = smoother.place, smoother.error
    rows = (
        ("literal", *_against(1e3 * float(np.abs(literal.error).max()))),
        ("covariance", *_against(1e3 * float(np.abs(covariance.error).max()))),
        (f"covariance, median of {SEEDS} seeds", *_against(float(np.median(worst)))),
        (f"covariance, worst of {SEEDS} seeds", *_against(float(np.max(worst)))),
        ("covariance, signals of the fine simulation", *_against(1e3 * float(np.abs(on_fine.error).max()))),
        ("smoother, signals of the fine simulation, less a parabola", *_against(1e3 * float(np.abs(flat).max()))),
    )  # fmt: skip
    truth = case.irregularity.at(literal.place)[0]
    profiles = {
        "truth": (literal.place, 1e3 * truth),
        "literal": (literal.place, 1e3 * (truth + literal.error)),
        "covariance": (covariance.place, 1e3 * (truth + covariance.error)),
        "smoother": (place, 1e3 * (case.irregularity.at(place)[0] + flat)),
    }
    errors = {
        "literal": (literal.place, 1e3 * literal.error),
        "covariance": (covariance.place, 1e3 * covariance.error),
        "smoother": (place, 1e3 * flat),
    }
    panels = (
        FigurePanel("distance, m", "elevation, mm", profiles),
        FigurePanel("distance, m", "error, mm", errors),
        FigurePanel("distance, m", "bogie acceleration, m/s²", {"signal": (case.position, signals[:, 0])}),
    )  # fmt: skip
    text = (
        "The search is told that the vehicle stands on level track at the start, and that the sensor has no offset. "
        "The smoother is told neither: offset, slope and curvature over these 20 m, which no sensor with an unknown "
        "offset can tell, are taken off its error. Its recording has 100 m of track before and after, and it counts on "
        "noise of 1 µg/√Hz.",
    )
    heads = ("largest error", "paper, mm", "ours, mm", "ratio")
    title = "Figure 13: the inverted bell, Model A"
    section = PageSection("figure-13", title, text, Table(heads, rows), panels)
    return section, {"literal": literal.rate, "covariance": covariance.rate}


def _against(ours: float, paper: float = 0.018) -> tuple[float, float, float]:
    return paper, ours, ours / paper


def random_profiles() -> PageSection:
    """Figure 14."""
    rows: list[tuple[Cell, ...]] = []
    errors: dict[str, tuple[Array, Array]] = {}
    for grade in CLASSES:
        case = model_a(grade)
        signals = search_grid_signals(case)
        for variant in Variant:
            done = run_search(case, signals, replace(TABLE_5, variant=variant))
            rows.append(_row(f"{grade}, {variant.value}", done.place, done.error))
            errors[f"{grade}, {variant.value}"] = _thinned(done)
        smoother = run_smoother(case, fine_signals_with_lead(case))
        rows.append(_row(f"{grade}, smoother, less a parabola", smoother.place, smoother.error))
        errors[f"{grade}, smoother"] = smoother.place, 1e3 * np.abs(smoother.error)
        least = accuracy_bounds(case, read_spectrum(grade))
        rows.append((f"{grade}, limit at 1 µg/√Hz", None, None, least["D1"], least["D2"]))
    text = (
        "The paper shows curves and says “excellent”, and that the error drifts with the distance; it gives no "
        "numbers. The search runs on signals of its own model, the smoother on those of the fine simulation.",
    )
    heads = ("what", "largest error, mm", "error at the end, mm", "D1, mm", "D2, mm")
    panel = FigurePanel("distance, m", "size of the error, mm", errors, "y")
    title = "Figure 14: FRA classes 4 to 6, Model A"
    return PageSection("figure-14", title, text, Table(heads, tuple(rows)), (panel,))


def _row(what: str, place: Array, error: Array) -> tuple[Cell, ...]:
    bands = band_rms(place, error)
    return (
        what, 1e3 * float(np.abs(error).max()), 1e3 * float(error[-1]), bands["D1"], bands["D2"],
    )  # fmt: skip


def _thinned(done: SearchStudy, every: int = 4) -> tuple[Array, Array]:
    return done.place[::every], 1e3 * np.abs(done.error[::every])

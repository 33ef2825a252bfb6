"""Figures 10 to 14: convergence of the search, and its results on Model A."""

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
"""Number of searches of the bell with different random numbers."""

PHASES_OVER = 60.0
"""Length over which phases are counted, before errors on Model B have grown, m."""


def convergence() -> tuple[PageSection, PageSection, PageSection]:
    """The sections of Figures 10 to 12."""
    on_a = shortened(model_a("fra-4"), 0.5 * PHASES_OVER)
    on_b = shortened(model_b("fra-4"), PHASES_OVER)
    ten = _both(on_a, replace(TABLE_5, population=100))
    eleven = _both(on_b, replace(TABLE_6, objective=Objective.SIGNAL))
    twelve = _both(on_b, TABLE_6)
    shares: list[tuple[Cell, ...]] = []
    for variant, result in twelve.items():
        share = median_generations(result, 0) / median_generations(eleven[variant], 0)
        name = f"{variant.value}: generations of the first run, O_t to O"
        shares.append((name, 13 / 31, share, share / (13 / 31)))
    smoothing = (
        "The covariance variant takes more generations than the paper, because the previous covariance has the weight "
        "0.6; with a smaller weight it collapses before convergence (see “Settings that the paper leaves open”)."
    )
    return (
        _section("figure-10", "Figure 10: objective O on Model A", ten, (25, 23), [],
                 "The population is 100, as in the paper's figure.", smoothing),
        _section("figure-11", "Figure 11: objective O on Model B", eleven, (31, 20), [],
                 "O determines ten elevations at once: the elite shrinks only as fast as in the slowest direction.",
                 smoothing),
        _section("figure-12", "Figure 12: sub-objectives O_t on Model B", twelve, (13, 13), shares,
                 "Each elevation is ranked by its own scan, which depends on it most, independently of the others. The "
                 "literal variant gains more from it here than in the paper, the covariance variant about as much.",
                 smoothing),
    )  # fmt: skip


def _both(case: Case, settings: SearchSettings) -> dict[Variant, CrossEntropyResult]:
    signals = search_grid_signals(case)
    return {
        variant: run_search(case, signals, replace(settings, variant=variant)).result
        for variant in Variant
    }


def _section(
    key: str, title: str, results: dict[Variant, CrossEntropyResult], paper: tuple[int, int],
    more: list[tuple[Cell, ...]], *text: str,
) -> PageSection:  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    objective: dict[str, tuple[Array, Array]] = {}
    values: dict[str, tuple[Array, Array]] = {}
    for variant, result in results.items():
        for run, printed in enumerate(paper):
            ours = median_generations(result, run)
            name = f"{variant.value}: generations of run {run + 1}, median of {len(result.phases)} phases"
            rows.append((name, printed, ours, ratio(ours, printed)))
        runs = result.figures["runs_per_phase"]
        rows.append((f"{variant.value}: runs per phase, mean", 2, runs, runs / 2))
        one = _typical_phase(result)
        best = np.concatenate([run.objective for run in one.runs])
        generation = np.arange(1.0, len(best) + 1)
        objective[variant.value] = generation, best
        values[variant.value] = generation, 1e6 * np.concatenate([run.convergence for run in one.runs])  # fmt: skip
    panels = (
        FigurePanel("generation", "O of the best profile", objective, "y"),
        FigurePanel("generation", "convergence value, mm²", values, "y"),
    )
    shown = (
        "The figure shows a phase of two runs whose first run has the median number of generations."
    )
    heads = ("quantity", "paper", "ours", "ratio")
    return PageSection(key, title, (*text, shown), Table(heads, (*rows, *more)), panels)


def _typical_phase(result: CrossEntropyResult) -> Phase:
    """A phase of two runs whose first run has about the median number of generations."""
    median = median_generations(result, 0)
    return min(
        result.phases,
        key=lambda one: (len(one.runs) != 2, abs(len(one.runs[0].objective) - median)),
    )


def inverted_bell() -> tuple[PageSection, dict[str, float]]:
    """The section of Figure 13, and the computing time of each variant (s/m)."""
    case = bell()
    signals = search_grid_signals(case)
    literal, covariance = (
        run_search(case, signals, replace(TABLE_5, variant=variant)) for variant in Variant
    )
    maxima = [
        1e3 * float(np.abs(run_search(case, signals, TABLE_5, seed=seed).error).max())
        for seed in range(SEEDS)
    ]
    fine = fine_signals(case)
    on_fine = run_search(case, fine, TABLE_5)
    smoother = run_smoother(case, fine_signals_with_lead(case))
    position, flat = smoother.position, smoother.error
    rows = (
        ("literal", *_against(1e3 * float(np.abs(literal.error).max()))),
        ("covariance", *_against(1e3 * float(np.abs(covariance.error).max()))),
        (f"covariance, median of {SEEDS} seeds", *_against(float(np.median(maxima)))),
        (f"covariance, maximum of {SEEDS} seeds", *_against(float(np.max(maxima)))),
        ("covariance, signals of the fine simulation", *_against(1e3 * float(np.abs(on_fine.error).max()))),
        ("smoother, signals of the fine simulation, without parabola", *_against(1e3 * float(np.abs(flat).max()))),
    )  # fmt: skip
    truth = case.irregularity.at(literal.position)[0]
    profiles = {
        "truth": (literal.position, 1e3 * truth),
        "literal": (literal.position, 1e3 * (truth + literal.error)),
        "covariance": (covariance.position, 1e3 * (truth + covariance.error)),
        "smoother": (position, 1e3 * (case.irregularity.at(position)[0] + flat)),
    }
    errors = {
        "literal": (literal.position, 1e3 * literal.error),
        "covariance": (covariance.position, 1e3 * covariance.error),
        "smoother": (position, 1e3 * flat),
    }
    panels = (
        FigurePanel("distance, m", "elevation, mm", profiles),
        FigurePanel("distance, m", "error, mm", errors),
        FigurePanel("distance, m", "bogie acceleration, m/s²", {"signal": (case.position, signals[:, 0])}),
    )  # fmt: skip
    text = (
        "The search knows that the vehicle is at rest on level track at the start and that the sensor has no offset. "
        "The smoother knows neither: offset, slope and curvature over these 20 m, which a sensor with unknown offset "
        "cannot determine, are removed from its error. Its recording has 100 m more track before and after, and it "
        "assumes noise of 1 µg/√Hz.",
    )
    heads = ("maximum error", "paper, mm", "ours, mm", "ratio")
    title = "Figure 13: the inverted bell, Model A"
    section = PageSection("figure-13", title, text, Table(heads, rows), panels)
    return section, {"literal": literal.rate, "covariance": covariance.rate}


def _against(ours: float, paper: float = 0.018) -> tuple[float, float, float]:
    return paper, ours, ours / paper


def random_profiles() -> PageSection:
    """The section of Figure 14."""
    rows: list[tuple[Cell, ...]] = []
    errors: dict[str, tuple[Array, Array]] = {}
    for grade in CLASSES:
        case = model_a(grade)
        signals = search_grid_signals(case)
        for variant in Variant:
            study = run_search(case, signals, replace(TABLE_5, variant=variant))
            rows.append(_row(f"{grade}, {variant.value}", study.position, study.error))
            errors[f"{grade}, {variant.value}"] = _thinned(study)
        smoother = run_smoother(case, fine_signals_with_lead(case))
        rows.append(_row(f"{grade}, smoother, without parabola", smoother.position, smoother.error))
        errors[f"{grade}, smoother"] = smoother.position, 1e3 * np.abs(smoother.error)
        bounds = accuracy_bounds(case, read_spectrum(grade))
        rows.append(
            (f"{grade}, accuracy bound at 1 µg/√Hz", None, None, bounds["D1"], bounds["D2"])
        )
    text = (
        "The paper shows curves, calls them “excellent”, and states that the error drifts with distance; it gives no "
        "numbers. The search uses signals of its own model, the smoother those of the fine simulation.",
    )
    heads = ("method", "maximum error, mm", "error at the end, mm", "D1, mm", "D2, mm")
    panel = FigurePanel("distance, m", "absolute error, mm", errors, "y")
    title = "Figure 14: FRA classes 4 to 6, Model A"
    return PageSection("figure-14", title, text, Table(heads, tuple(rows)), (panel,))


def _row(name: str, position: Array, error: Array) -> tuple[Cell, ...]:
    bands = band_rms(position, error)
    return (
        name, 1e3 * float(np.abs(error).max()), 1e3 * float(error[-1]), bands["D1"], bands["D2"],
    )  # fmt: skip


def _thinned(study: SearchStudy, every: int = 4) -> tuple[Array, Array]:
    return study.position[::every], 1e3 * np.abs(study.error[::every])

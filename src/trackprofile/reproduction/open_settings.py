"""Settings that the paper leaves open: the choice made, and its measured effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackprofile.methods.cross_entropy.search_settings import TABLE_5, TABLE_6, Objective, Variant
from trackprofile.models.integrate import newmark, wilson
from trackprofile.reproduction.cases import bell, model_b, search_grid_signals
from trackprofile.reproduction.paper_tables import median_generations
from trackprofile.reproduction.parts import Cell, PageSection, Table
from trackprofile.reproduction.studies import error_growth, run_search, shortened

UNSTABLE = 60.0
"""Length over which the growth of an error is computed, m."""

SEEDS = 10
"""Number of searches with different random numbers."""


def open_settings_section() -> PageSection:
    """The settings, one row each, with the measurement that decided the choice."""
    rows = (*_growths(), *_thresholds(), *_smoothing(), *_assumed())
    text = (
        "The choices are based on what can be measured without the truth: the stability of the sequence of windows, "
        "which depends on the model only, and the number of generations of a run, which the paper reports.",
        "The growth of an error is the factor by which its short waves grow in 10 m, when every window is solved "
        "exactly and the state is carried over; 1 is neutral. Both wheels of the bogie move its centre equally, so "
        "acceleration at the centre cannot distinguish an error under the first wheel from the opposite error under "
        "the second. The pitch rate can, but with the weights of equation 12 the acceleration dominates.",
    )
    heads = (
        "setting",
        "choice",
        "alternative",
        "measured quantity",
        "result of the choice",
        "result of the alternative",
    )
    return PageSection("left-open", "Settings that the paper leaves open", text, Table(heads, rows))


def _growths() -> tuple[tuple[Cell, ...], ...]:
    case = shortened(model_b("fra-6"), UNSTABLE)
    first = error_growth(case, wilson(case.step), 10)
    acceleration, rate = case.sensors
    above_axle = replace(case, sensors=(replace(acceleration, position=1.25), rate))
    measured = "growth of an error in 10 m"
    return (
        ("integrator", "Wilson θ = 1.420815, as printed", "Newmark, average acceleration", measured, first,
         error_growth(case, newmark(case.step), 10)),
        ("weights", "1/RMS, as printed", "1/RMS³", measured, first, error_growth(case, wilson(case.step), 10, 3.0)),
        ("window", "10 elevations, as printed", "40 elevations", measured, first,
         error_growth(case, wilson(case.step), 40)),
        ("accelerometer", "at the bogie's centre, as printed", "above the leading axle", measured, first,
         error_growth(above_axle, wilson(case.step), 10)),
    )  # fmt: skip


def _thresholds() -> tuple[tuple[Cell, ...], ...]:
    quantity = "median number of generations of the first run of a phase"
    on_a, on_b = bell(), shortened(model_b("fra-4"), UNSTABLE)
    signal = replace(TABLE_6, objective=Objective.SIGNAL)
    rows: list[tuple[Cell, ...]] = []
    for name, case, settings, paper in (
        ("O on Model A", on_a, TABLE_5, 25),
        ("O on Model B", on_b, signal, 31),
        ("O_t on Model B", on_b, TABLE_6, 13),
    ):
        literal, signals = replace(settings, variant=Variant.LITERAL), search_grid_signals(case)
        in_metres = replace(literal, threshold=1e6 * settings.threshold)
        ours, other = (
            median_generations(run_search(case, signals, one).result, 0)
            for one in (literal, in_metres)
        )
        measured = f"{quantity} (paper: {paper})"
        rows.append((f"unit of the threshold, {name}", "mm²", "m²", measured, ours, other))
    return tuple(rows)


def _smoothing() -> tuple[tuple[Cell, ...], ...]:
    case, measured = bell(), f"maximum error on the bell over {SEEDS} seeds, mm"
    signals, maximum = search_grid_signals(case), {}
    for share in (0.6, 0.4):
        settings = replace(TABLE_5, smoothing=share)
        errors = [run_search(case, signals, settings, seed=seed).error for seed in range(SEEDS)]
        maximum[share] = 1e3 * float(np.abs(errors).max())
    return (
        ("weight of the previous covariance", "0.6", "0.4", measured, maximum[0.6], maximum[0.4]),
    )  # fmt: skip


def _assumed() -> tuple[tuple[Cell, ...], ...]:
    return tuple(
        (setting, chosen, "–", "–", None, None)
        for setting, chosen in (
            ("second term of equation 11", "squared: the print lacks the square, without which there is no minimum"),
            ("r' and r''", "backward differences of second order, so that no scan depends on elevations ahead"),
            ("two runs that agree", "within 5 % of the elevations (covariance variant: of their rise above the last "
             "decided one) in the root of the sum of squares, plus twice the root of the threshold"),
            ("result of a phase", "the mean of the two runs that agree"),
            ("standard deviation at a restart", "as at the start of the phase, 0.1 σ to σ"),
            ("first generation of later phases", "normal about the means carried over; the first is a random walk"),
            ("start", "static equilibrium on level track, from where the profile grows"),
        )
    )  # fmt: skip

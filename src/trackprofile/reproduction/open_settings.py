"""What the paper leaves open, what was chosen, and what that choice does, measured."""

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
"""m over which the growth of an error is looked at."""

SEEDS = 10


def left_open() -> PageSection:
    """The settings, one row each, with the measurement that they were chosen by."""
    rows = (*_growths(), *_thresholds(), *_smoothing(), *_assumed())
    text = (
        "Chosen by what can be measured without the truth: whether the sequence of windows is stable, which the model "
        "alone decides, and how many generations a run takes, which the paper reports.",
        "Growth is that of an error's short waves in 10 m, when every window is solved exactly and the state carried "
        "over: 1 is neutral. Both of the bogie's wheels move its centre alike, so acceleration there cannot tell an "
        "error under the first wheel from the opposite one under the second; only the pitch rate can, and weights by "
        "equation 12 let the acceleration decide.",
    )
    heads = ("setting", "chosen", "other", "measured", "chosen gives", "other gives")
    return PageSection("left-open", "Left open by the paper", text, Table(heads, rows))


def _growths() -> tuple[tuple[Cell, ...], ...]:
    case = shortened(model_b("fra-6"), UNSTABLE)
    first = error_growth(case, wilson(case.step), 10)
    acceleration, rate = case.sensors
    moved = replace(case, sensors=(replace(acceleration, position=1.25), rate))
    what = "growth of an error in 10 m"
    return (
        ("integrator", "Wilson θ = 1.420815, as printed", "Newmark, average acceleration", what, first,
         error_growth(case, newmark(case.step), 10)),
        ("weights", "1/RMS, as printed", "1/RMS³", what, first, error_growth(case, wilson(case.step), 10, 3.0)),
        ("window", "10 elevations, as printed", "40 elevations", what, first,
         error_growth(case, wilson(case.step), 40)),
        ("accelerometer", "at the bogie's centre, as printed", "above the leading axle", what, first,
         error_growth(moved, wilson(case.step), 10)),
    )  # fmt: skip


def _thresholds() -> tuple[tuple[Cell, ...], ...]:
    what = "generations of a phase's first run, median"
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
            median_generations(run_search(case, signals, one).found, 0)
            for one in (literal, in_metres)
        )
        measured = f"{what} (paper: {paper})"
        rows.append((f"unit of the threshold, {name}", "mm²", "m²", measured, ours, other))
    return tuple(rows)


def _smoothing() -> tuple[tuple[Cell, ...], ...]:
    case, what = bell(), f"worst error on the bell of {SEEDS} seeds, mm"
    signals, worst = search_grid_signals(case), {}
    for share in (0.6, 0.4):
        settings = replace(TABLE_5, smoothing=share)
        errors = [run_search(case, signals, settings, seed=seed).error for seed in range(SEEDS)]
        worst[share] = 1e3 * float(np.abs(errors).max())
    return (
        ("covariance kept from generation to generation", "0.6", "0.4", what, worst[0.6], worst[0.4]),
    )  # fmt: skip


def _assumed() -> tuple[tuple[Cell, ...], ...]:
    return tuple(
        (setting, chosen, "–", "–", None, None)
        for setting, chosen in (
            ("second term of equation 11", "squared: the print lacks the square, without which it has no minimum"),
            ("r' and r''", "backward differences of second order, so that no scan looks ahead"),
            ("two runs that agree", "within 5 % of the elevations, or, for the covariance variant, of their rise above "
             "the last decided one, in the root of the sum of squares; and twice the root of the threshold"),
            ("answer of a phase", "the mean of the two runs that agree"),
            ("spread at a restart", "as at the phase's start, 0.1 σ to σ"),
            ("first generation of later phases", "normal about the means carried over; only the very first is a walk"),
            ("start", "static equilibrium on level track; the profile grows from there"),
        )
    )  # fmt: skip

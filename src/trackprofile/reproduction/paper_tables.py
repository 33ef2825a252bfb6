"""Tables 1 to 6: the numbers printed in the paper, and those that this package uses."""

from __future__ import annotations

import numpy as np

from trackprofile.io.model_toml import read_spectrum, read_track, read_vehicle
from trackprofile.methods.cross_entropy.estimator import CrossEntropyResult
from trackprofile.methods.cross_entropy.search_settings import TABLE_5, TABLE_6, SearchSettings
from trackprofile.models.track import LayeredTrack
from trackprofile.models.vehicle import parameter_values
from trackprofile.reproduction.parts import PageSection, Table, comparison_table

PAPER_RATE = {"Model A": 45.0, "Model B": 100.0}
"""Computing time stated in the paper, s/m: "approximately 45 s/m", "over 100 s/m"."""


def settings() -> tuple[PageSection, ...]:
    """The sections of Tables 1 to 6."""
    return (_table_1(), _table_2(), _table_3(), _table_4(), *_tables_5_and_6())


def _table_1() -> PageSection:
    ours = parameter_values(read_vehicle("quarter-car")[0])
    printed = {
        "body mass": ("m_1, kg", 7900.0),
        "bogie mass": ("m_2, kg", 512.5),
        "secondary damping": ("c_1, N s/m", 15e3),
        "primary damping": ("c_2, N s/m", 5e3),
        "secondary stiffness": ("k_1, N/m", 7.3e5),
        "primary stiffness": ("k_2, N/m", 5e5),
    }
    rows = [(name, unit, paper, ours[name]) for name, (unit, paper) in printed.items()]
    return PageSection("table-1", "Table 1: Model A, the quarter car", (), comparison_table(rows))


def _table_2() -> PageSection:
    vehicle, _ = read_vehicle("velaro")
    ours = parameter_values(vehicle)
    printed = {
        "wheelset mass": ("m_w, kg", 1800.0),
        "bogie mass": ("m_b, kg", 3500.0),
        "body mass": ("m_v, kg", 47800.0),
        "bogie pitch inertia": ("I_b, kg m²", 1715.0),
        "body pitch inertia": ("I_v, kg m²", 1.96e6),
        "primary stiffness": ("k_p, N/m", 2.4e6),
        "secondary stiffness": ("k_s, N/m", 0.7e6),
        "primary damping": ("c_p, N s/m", 20e3),
        "secondary damping": ("c_s, N s/m", 40e3),
    }
    rows = [(name, unit, paper, ours[name]) for name, (unit, paper) in printed.items()]
    leading, trailing = vehicle.body("leading bogie"), vehicle.body("trailing bogie")
    first, second = vehicle.wheels[:2]
    rows += [
        ("distance between bogies", "L_v, m", 17.375, trailing.position - leading.position),
        ("distance between axles", "L_b, m", 2.5, second.position - first.position),
    ]
    return PageSection("table-2", "Table 2: Model B, the whole car", (), comparison_table(rows))


def _table_3() -> PageSection:
    track = read_track("zhai-layered")
    assert isinstance(track, LayeredTrack)
    support = track.support
    rows = [
        ("bending stiffness of the rail E_r I_r", "N m²", 2.059e11 * 3.217e-5, track.rail_bending_stiffness),
        ("mass of the rail", "μ_r, kg/m", 60.64, track.rail_mass),
        ("stiffness of the rail pad", "k_p, N/m", 6.5e7, support.pad_stiffness),
        ("damping of the rail pad", "c_p, N s/m", 7.5e4, support.pad_damping),
        ("mass of half a sleeper", "m_s, kg", 125.5, support.sleeper_mass),
        ("sleeper spacing", "L_s, m", 0.545, track.spacing),
        ("stiffness of the ballast", "k_ba, N/m", 137.75e6, support.ballast_stiffness),
        ("damping of the ballast", "c_ba, N s/m", 5.88e4, support.ballast_damping),
        ("mass of the ballast", "m_ba, kg", 531.4, support.ballast_mass),
        ("stiffness of the sub-ballast", "k_sb, N/m", 77.5e6, support.subballast_stiffness),
    ]  # fmt: skip
    text = ("The paper states no damping of the sub-ballast; it is 0 here.",)
    return PageSection("table-3", "Table 3: the track", text, comparison_table(rows))


def _table_4() -> PageSection:
    rows = []
    for grade, amplitude in (("4", 2.39e-5), ("5", 9.35e-6), ("6", 1.5e-6)):
        spectrum = read_spectrum(f"fra-{grade}")
        rows += [
            (f"class {grade}", "A_v, m² rad/m", amplitude, spectrum.amplitude),
            (f"class {grade}", "Ω_r, rad/m", 2.06e-2, spectrum.corner_low),
            (f"class {grade}", "Ω_c, rad/m", 0.825, spectrum.corner_high),
        ]
    text = (
        "The paper prints rad/s for Ω_r and Ω_c, and no unit for A_v; they are rad/m and m² rad/m. S(Ω) is "
        "one-sided in Ω, so that its integral over Ω above 0 is the variance.",
    )
    return PageSection("table-4", "Table 4: FRA classes", text, comparison_table(rows))


def _tables_5_and_6() -> tuple[PageSection, PageSection]:
    text = (
        "The threshold is printed without a unit; it is read as mm² here, for the reasons in “Settings that the paper "
        "leaves open”.",
    )
    printed = {5: (0.25, 10, 0.0, 0.5, 150, 0.1, 1e-9), 6: (0.833, 10, 0.0, 1.0, 100, 0.1, 5e-11)}
    sections = []
    for (number, paper), ours in zip(printed.items(), (TABLE_5, TABLE_6), strict=True):
        rows = [row for row in zip(*_rows(ours), paper, _values(ours), strict=True) if row[2] != 0]
        title = f"Table {number}: the search on Model {'A' if number == 5 else 'B'}"
        sections.append(PageSection(f"table-{number}", title, text, comparison_table(rows)))
    return sections[0], sections[1]


def _rows(search: SearchSettings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    names = (
        "length of profile per phase", "elevations per phase", "initial mean", "initial standard deviation",
        "population", "elite", "threshold",
    )  # fmt: skip
    return names, ("m", "–", "mm", "mm", "–", "–", "mm²")


def _values(search: SearchSettings) -> tuple[float, ...]:
    return (
        search.length or 0.0, search.unknowns, 1e3 * search.mean, 1e3 * search.standard_deviation,
        search.population, search.elite, 1e6 * search.threshold,
    )  # fmt: skip


def speed_section(durations: dict[str, tuple[str, float, float]]) -> PageSection:
    """Computing time per metre; ``durations`` has the model, our time and the train's running time (s/m) by case."""
    rows = [
        (name, PAPER_RATE[model], ours, ours / PAPER_RATE[model], train / ours)
        for name, (model, ours, train) in durations.items()
    ]
    heads = ("case", "paper, s/m", "ours, s/m", "ratio", "speed relative to the train")
    text = (
        "The paper: a 2.67 GHz processor, MATLAB, one simulation per trial profile. Here: one core, the affine map "
        "of each window. The times are those of this run on this machine.",
    )
    return PageSection("speed", "Speed", text, Table(heads, tuple(rows)))


def median_generations(result: CrossEntropyResult, run: int) -> float:
    """Median over the phases of the number of generations of their first (0), second (1), ... run."""
    return float(
        np.median([len(one.runs[run].objective) for one in result.phases if len(one.runs) > run])
    )

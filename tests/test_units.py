from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.errors import DataError, UnitError
from trackprofile.units import FACTORS, quantity, si_unit, to_si, unit_factor

finite = st.floats(-1e9, 1e9)
known = st.sampled_from([(unit, kind) for kind, units in FACTORS.items() for unit in units])


@pytest.mark.parametrize(
    ("value", "unit", "dimension", "si"),
    [
        (1435.0, "mm", "length", 1.435),
        (2.0, "km", "length", 2000.0),
        (12.0, "ms", "time", 0.012),
        (1.5, "h", "time", 5400.0),
        (7.0, "us", "time", 7e-6),
        (108.0, "km/h", "speed", 30.0),
        (60.0, "mph", "speed", 26.8224),
        (3.0, "m/s^2", "acceleration", 3.0),
        (3.0, "m/s2", "acceleration", 3.0),
        (20.0, "mm/s²", "acceleration", 0.02),
        (100.0, "mg", "acceleration", 0.980665),
        (180.0, "deg/s", "angular rate", math.pi),
        (90.0, "°/s", "angular rate", math.pi / 2),
        (4.0, "mrad/s", "angular rate", 0.004),
        (25.0, "ug", "acceleration", 25e-6 * 9.80665),
        (1.8, "t", "mass", 1800.0),
        (2.0, "t·m^2", "inertia", 2000.0),
        (2.4, "MN/m", "stiffness", 2.4e6),
        (20.0, "kN*s/m", "damping", 20e3),
        (0.0339, "cm² rad/m", "roughness", 3.39e-6),
    ],
)
def test_a_unit_has_its_si_value(value: float, unit: str, dimension: str, si: float) -> None:
    assert to_si(value, unit, dimension) == pytest.approx(si, rel=1e-14)


@pytest.mark.parametrize(
    ("one", "other", "dimension"),
    [
        ("m/s^2", "m/s²", "acceleration"),
        ("mm / s2", "mm/s²", "acceleration"),
        ("\u03bcs", "\u00b5s", "time"),  # Greek mu, micro sign
        ("\u00ba/s", "°/s", "angular rate"),  # ordinal sign
    ],
)
def test_spellings_of_one_unit_agree(one: str, other: str, dimension: str) -> None:
    assert unit_factor(one, dimension) == unit_factor(other, dimension)


@given(known, st.lists(finite, min_size=1, max_size=5), finite)
def test_conversion_is_linear(unit: tuple[str, str], values: list[float], factor: float) -> None:
    once = to_si(values, *unit)
    scaled = to_si(factor * np.array(values), *unit)
    # Below 1e-300 a double has fewer digits.
    np.testing.assert_allclose(scaled, factor * once, rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(once / unit_factor(*unit), values, rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize(
    ("unit", "dimension"),
    [("kg", "length"), ("km/h", "acceleration"), ("", "time"), ("M", "length"), ("mG", "speed")],
)
def test_a_unit_of_another_dimension_is_refused_with_the_accepted_units(
    unit: str, dimension: str
) -> None:
    with pytest.raises(UnitError) as caught:
        to_si(1.0, unit, dimension)
    assert isinstance(caught.value, DataError)
    message = str(caught.value)
    assert repr(unit) in message
    assert dimension in message
    assert all(accepted in message for accepted in FACTORS[dimension])


@given(st.sampled_from(sorted(FACTORS)))
def test_the_si_unit_of_a_dimension_has_the_factor_one(dimension: str) -> None:
    assert unit_factor(si_unit(dimension), dimension) == 1.0


@pytest.mark.parametrize("text", ["90 km/h", "90km/h", " 25.0 m/s ", "2.5e1 m/s"])
def test_a_quantity_is_a_number_and_its_unit(text: str) -> None:
    assert quantity(text, "speed") == pytest.approx(25.0, rel=1e-14)


@pytest.mark.parametrize("text", ["90", "km/h", "", "9.0.0 km/h", "1e999 km/h", "nan km/h"])
def test_text_without_a_quantity_is_refused_with_the_accepted_units(text: str) -> None:
    with pytest.raises(UnitError, match="km/h"):
        quantity(text, "speed")

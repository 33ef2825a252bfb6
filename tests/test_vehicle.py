"""The assembler against matrices written out by hand, and laws that any vehicle obeys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_vehicle
from trackprofile.models.vehicle import (
    HEAVE,
    PITCH,
    Body,
    Link,
    Vehicle,
    Wheel,
    assemble,
    parameter_values,
    with_parameters,
)


def velaro() -> Vehicle:
    return read_vehicle("velaro")[0]


def test_quarter_car_has_the_matrices_of_the_papers_equation_3() -> None:
    k1, k2, c1, c2 = 7.3e5, 5e5, 15e3, 5e3
    found = assemble(read_vehicle("quarter-car")[0])
    rows = [found.index("body", HEAVE), found.index("bogie", HEAVE)]
    pick = np.ix_(rows, rows)
    np.testing.assert_allclose(found.mass[pick], np.diag([7900.0, 512.5]))
    np.testing.assert_allclose(found.damping[pick], [[c1, -c1], [-c1, c1 + c2]])
    np.testing.assert_allclose(found.stiffness[pick], [[k1, -k1], [-k1, k1 + k2]])
    wheel = found.index("wheel", HEAVE)
    np.testing.assert_allclose(found.stiffness[rows, wheel], [0.0, -k2])
    np.testing.assert_allclose(found.damping[rows, wheel], [0.0, -c2])


def by_hand(
    primary: list[float], secondary: list[float], L: float, halves: list[float]
) -> np.ndarray:
    """The car's K (or C) over [body z, body pitch, bogies z, bogies pitch, wheels z], force by force.

    Bogies 1 (leading) and 2 stand L/2 ahead of and behind the body's centre, wheels halves[i] ahead of and
    behind their bogie's centre. Each row is the force or moment that a unit motion of a column calls up.
    """
    (p1, p2, p3, p4), (s1, s2), (b1, b2), a = primary, secondary, halves, L / 2
    K = np.zeros((10, 10))
    K[0, 0], K[0, 1], K[1, 1] = s1 + s2, a * (s1 - s2), a**2 * (s1 + s2)
    K[0, 2], K[0, 3], K[1, 2], K[1, 3] = -s1, -s2, -a * s1, a * s2
    K[2, 2], K[3, 3] = s1 + p1 + p2, s2 + p3 + p4
    K[2, 4], K[3, 5] = b1 * (p1 - p2), b2 * (p3 - p4)
    K[4, 4], K[5, 5] = b1**2 * (p1 + p2), b2**2 * (p3 + p4)
    K[2, 6], K[2, 7], K[3, 8], K[3, 9] = -p1, -p2, -p3, -p4
    K[4, 6], K[4, 7], K[5, 8], K[5, 9] = -b1 * p1, b1 * p2, -b2 * p3, b2 * p4
    K[6, 6], K[7, 7], K[8, 8], K[9, 9] = p1, p2, p3, p4
    return K + np.triu(K, 1).T


ORDER = [
    ("body", HEAVE), ("body", PITCH), ("leading bogie", HEAVE), ("trailing bogie", HEAVE),
    ("leading bogie", PITCH), ("trailing bogie", PITCH),
    *((f"wheel {i}", HEAVE) for i in (1, 2, 3, 4)),
]  # fmt: skip


def test_ten_degree_car_has_the_matrices_written_out_by_hand() -> None:
    found = assemble(velaro())
    rows = np.ix_(*[[found.index(*freedom) for freedom in ORDER]] * 2)
    masses = [47800, 1.96e6, 3500, 3500, 1715, 1715, 1800, 1800, 1800, 1800]
    np.testing.assert_allclose(found.mass[rows], np.diag(masses))
    K = by_hand([2.4e6] * 4, [0.7e6] * 2, 17.375, [1.25, 1.25])
    C = by_hand([20e3] * 4, [40e3] * 2, 17.375, [1.25, 1.25])
    np.testing.assert_allclose(found.stiffness[rows], K, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(found.damping[rows], C, rtol=1e-12, atol=1e-8)


def test_front_and_rear_of_unequal_bogies_are_not_mixed_up() -> None:
    L, b1, b2 = 15.0, 1.25, 1.5
    primary, secondary = [1e6, 2e6, 3e6, 4e6], [5e5, 7e5]
    front, rear = b1, b1 + L
    bodies = (
        Body("body", 4e4, 1e6, (front + rear) / 2),
        Body("leading bogie", 3e3, 2e3, front),
        Body("trailing bogie", 3e3, 2e3, rear),
    )
    places = [0.0, 2 * b1, rear - b2, rear + b2]
    wheels = tuple(Wheel(f"wheel {i + 1}", 1e3, place) for i, place in enumerate(places))
    links = (
        Link("s1", "body", "leading bogie", front, secondary[0], 0.0),
        Link("s2", "body", "trailing bogie", rear, secondary[1], 0.0),
        *(
            Link(f"p{i}", bodies[1 + i // 2].name, f"wheel {i + 1}", places[i], primary[i], 0.0)
            for i in range(4)
        ),
    )
    found = assemble(Vehicle("unequal", bodies, links, wheels))
    rows = np.ix_(*[[found.index(*freedom) for freedom in ORDER]] * 2)
    K = by_hand(primary, secondary, L, [b1, b2])
    np.testing.assert_allclose(found.stiffness[rows], K, rtol=1e-12, atol=1e-6)


def test_rigid_heave_and_pitch_call_up_no_force() -> None:
    vehicle = velaro()
    found = assemble(vehicle)
    places = {part.name: part.position for part in (*vehicle.bodies, *vehicle.wheels)}
    heave = np.array([float(motion == HEAVE) for _, motion in found.degrees_of_freedom])
    pitch = np.array(
        [1.0 if motion == PITCH else -places[part] for part, motion in found.degrees_of_freedom]
    )
    for motion in (heave, pitch):
        for matrix in (found.stiffness, found.damping):
            scale = np.abs(matrix) @ np.abs(motion)
            np.testing.assert_allclose(matrix @ motion, 0.0, atol=1e-12 * scale.max())


def test_eigenfrequencies_on_fixed_wheels_are_those_of_the_independent_program() -> None:
    # Its README states them to two decimals.
    found = assemble(velaro())
    free = [i for i, (part, _) in enumerate(found.degrees_of_freedom) if "wheel" not in part]
    K, M = found.stiffness[np.ix_(free, free)], found.mass[np.ix_(free, free)]
    hertz = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)) / (2 * np.pi)
    np.testing.assert_allclose(hertz, [0.80, 1.09, 6.32, 6.32, 10.52, 10.52], atol=0.0051)


@given(st.floats(0.2, 5.0))
def test_a_shared_parameter_changes_every_spring_that_takes_it(factor: float) -> None:
    vehicle = velaro()
    value = factor * parameter_values(vehicle)["primary stiffness"]
    changed = with_parameters(vehicle, {"primary stiffness": value})
    assert parameter_values(changed)["primary stiffness"] == value
    assert [link.stiffness for link in changed.links].count(value) >= 4
    assert with_parameters(changed, parameter_values(vehicle)) == vehicle


def test_contradictions_are_refused_in_one_sentence() -> None:
    vehicle = velaro()
    with pytest.raises(ModelError, match="no parameter 'colour'; it has"):
        with_parameters(vehicle, {"colour": 1.0})
    with pytest.raises(ModelError, match="no body 'roof'; it has 'body'"):
        vehicle.body("roof")
    with pytest.raises(ModelError, match="connects to 'nowhere'"):
        replace(vehicle, links=(replace(vehicle.links[0], lower="nowhere"), *vehicle.links[1:]))
    with pytest.raises(ModelError, match="2 parts named 'wheel 1'"):
        replace(vehicle, wheels=(vehicle.wheels[0], *vehicle.wheels))
    with pytest.raises(ModelError, match="must be above 0"):
        replace(vehicle, bodies=(replace(vehicle.bodies[0], mass=0.0), *vehicle.bodies[1:]))
    with pytest.raises(ModelError, match="which must be at 0 m"):
        replace(vehicle, wheels=vehicle.wheels[1:], links=())

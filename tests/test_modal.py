"""Natural frequencies against formulas, and those of the built-in vehicles against what their kind has."""

from __future__ import annotations

import numpy as np
import pytest

from trackprofile.io.model_toml import presets, read_vehicle
from trackprofile.models.modal import Mode, modes
from trackprofile.models.vehicle import Body, Link, Vehicle, Wheel, assemble, parameter_values
from trackprofile.units import STANDARD_GRAVITY

CARS = [name for name in presets("vehicle") if name != "quarter-car"]
# Hz, of the lowest bounce of the body; soft for comfort, stiff for locomotives and trams.
BOUNCE = (0.7, 1.9)
BOGIE = (4.0, 14.0)


def test_bounce_and_pitch_of_a_body_on_two_springs_follow_their_formulas() -> None:
    m, inertia, k, c, half = 30e3, 1.5e6, 6e5, 2e4, 8.0
    wheels = (Wheel("front", 0.0, 0.0), Wheel("back", 0.0, 2 * half))
    links = tuple(
        Link(f"spring {one.name}", "body", one.name, one.position, k, c) for one in wheels
    )
    found = modes(Vehicle("car", (Body("body", m, inertia, half),), links, wheels))
    bounce, pitch = np.sqrt(2 * k / m), half * np.sqrt(2 * k / inertia)
    by_name = {one.description: one for one in found}
    assert by_name["body heave"].frequency == pytest.approx(bounce / (2 * np.pi))
    assert by_name["body heave"].damping_ratio == pytest.approx(2 * c / (2 * m * bounce))
    assert by_name["body pitch"].frequency == pytest.approx(pitch / (2 * np.pi))
    assert by_name["body pitch"].damping_ratio == pytest.approx(
        2 * c * half**2 / (2 * inertia * pitch)
    )


def test_a_body_that_is_damped_beyond_swinging_creeps_back_at_two_rates() -> None:
    m, k, c = 1000.0, 1e4, 1e4
    wheel = Wheel("wheel", 0.0, 0.0)
    link = Link("spring", "body", "wheel", 0.0, k, c)
    found = modes(Vehicle("car", (Body("body", m),), (link,), (wheel,)))
    rates = np.sort(-np.roots([m, c, k]))
    assert [one.frequency for one in found] == pytest.approx(rates / (2 * np.pi))
    assert [one.damping_ratio for one in found] == pytest.approx([1.0, 1.0])


def test_undamped_frequencies_of_the_velaro_are_those_of_its_matrices() -> None:
    car = read_vehicle("velaro")[0]
    assembly = assemble(car)
    free = [i for i, (part, _) in enumerate(assembly.degrees_of_freedom) if "wheel" not in part]
    square = np.linalg.eigvals(
        np.linalg.solve(assembly.mass[np.ix_(free, free)], assembly.stiffness[np.ix_(free, free)])
    )
    undamped = np.sort(np.sqrt(square.real)) / (2 * np.pi)
    found = sorted(one.frequency for one in modes(car) if one.damping_ratio < 1)
    # Damping that is not proportional moves |λ| by its square only.
    assert found == pytest.approx(undamped, rel=0.05)


def _of(found: tuple[Mode, ...], part: str) -> list[Mode]:
    return [one for one in found if one.motions[0][0].endswith(part) and one.damping_ratio < 1]


@pytest.mark.parametrize("name", CARS)
def test_built_in_cars_swing_like_their_kind(name: str) -> None:
    car = read_vehicle(name)[0]
    found = modes(car)
    body = _of(found, "body")
    assert body
    assert all(BOUNCE[0] < one.frequency < BOUNCE[1] for one in body)
    assert all(0.05 < one.damping_ratio < 0.9 for one in body)
    assert any(BOGIE[0] < one.frequency < BOGIE[1] for one in _of(found, "bogie"))


@pytest.mark.parametrize("name", CARS)
def test_axle_loads_and_sources_of_built_in_cars_are_plausible(name: str) -> None:
    car = read_vehicle(name)[0]
    mass = sum(one.mass for one in (*car.bodies, *car.wheels))
    load = mass * STANDARD_GRAVITY / len(car.wheels)
    assert 50e3 < load < 225e3  # N: from a light tram to the 22.5 t of line category D
    assert set(parameter_values(car)) == {one.name for one in car.parameters}
    for one in car.parameters:
        assert one.source
        assert 0.05 <= one.log_std <= 1.0


def test_two_bogies_that_do_not_feel_each_other_pitch_alone() -> None:
    pitches = [
        mode.description
        for mode in modes(read_vehicle("velaro")[0])
        if "bogie pitch" in mode.description
    ]
    assert sorted(pitches) == ["leading bogie pitch", "trailing bogie pitch"]

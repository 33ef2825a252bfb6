"""Simulation compared with a track without window, closed-form solutions, energy balance, and linearity."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from narrowing import floats
from trackprofile.errors import ModelError
from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.models.integrate import newmark
from trackprofile.models.irregularity import Bell, Cosines, Flat, Irregularity, Sum
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor
from trackprofile.models.statespace import state_space, transfer_function
from trackprofile.models.track import ElasticTrack, LayeredTrack, RigidTrack, Support
from trackprofile.models.vehicle import Body, Link, Vehicle, Wheel, assemble
from trackprofile.simulation import layered
from trackprofile.simulation.mechanics import GRAVITY
from trackprofile.simulation.simulate import (
    RampedIrregularity,
    RunSettings,
    Simulation,
    sensor_signal,
    simulate,
)
from trackprofile.simulation.speed_schedule import SpeedSchedule, constant_speed

from .full_model import Passage, passage, whole_track

Array = NDArray[np.float64]
VELARO, QUARTER = read_vehicle("velaro")[0], read_vehicle("quarter-car")[0]
PAPER_TRACK = LayeredTrack(
    "paper", 2.059e11 * 3.217e-5, 60.64, 0.545,
    Support(65e6, 75e3, 125.5, 137.75e6, 58.8e3, 531.4, 77.5e6, 0.0),
)  # fmt: skip
V = 150 / 3.6
ON_BOGIE = (
    Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie", 0.4),
    Sensor("pitch rate", PITCH_RATE, "leading bogie"),
)


def relative_error(actual: Array, expected: Array) -> float:
    """L2 norm of the difference over that of the expected values about their mean."""
    return float(
        np.linalg.norm(actual - expected) / np.linalg.norm(expected - expected.mean(axis=0))
    )


# Comparison with a track without moving window.

SCHEDULES = {
    "steady": constant_speed(V),
    "braking, then accelerating": SpeedSchedule((0.0, 0.3, 0.6, 0.8), (V, V - 6, V + 2, V + 2)),
}
FIRST, START, END, DT = 70.0, 80.0, 105.0, 1e-3
DIP = Bell(0.002, 0.5, 88.0)


@cache
def whole_track_passage(name: str) -> Passage:
    """A passage over 150 m of track; every wheel stays at least 45 m from the ends."""
    schedule = SCHEDULES[name]
    steps = int(np.floor(schedule.duration(END - FIRST) / DT * (1 + 1e-12)))
    motion = schedule.at(floats(np.arange(steps + 1) * DT))
    motion[:, 0] += FIRST
    made = passage(
        VELARO,
        whole_track(PAPER_TRACK, 276),
        RampedIrregularity(DIP, FIRST, 5.0),
        motion,
        DT,
        GRAVITY,
    )
    kept = motion[1:, 0] >= START - 1e-9
    return Passage(made.bodies[:, kept], made.contact_force[kept], made.rail_deflection[kept])


def differences(name: str, margin: float) -> dict[str, float]:
    run = RunSettings(START, END, SCHEDULES[name], START - FIRST, margin=margin)
    window, whole = simulate(VELARO, PAPER_TRACK, DIP, run, newmark(DT)), whole_track_passage(name)
    heave, pitch = (window.freedoms.index(("leading bogie", way)) for way in ("heave", "pitch"))
    return {
        "acceleration": relative_error(window.acceleration[:, heave], whole.bodies[2][:, heave]),
        "pitch rate": relative_error(window.velocity[:, pitch], whole.bodies[1][:, pitch]),
        "contact force": relative_error(window.contact_force, whole.contact_force),
        "deflection": relative_error(window.rail_deflection, whole.rail_deflection),
    }


@pytest.mark.parametrize("name", SCHEDULES)
def test_window_without_added_damping_equals_the_whole_track(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(layered, "END_DAMPING_RATIO", 0.0)
    # Measured: 1e-6 with a margin of 40 m; with 50 m 4e-10, which is round-off: the ends have no effect.
    assert max(differences(name, 50.0).values()) < 3e-9


# Error of the window: its added damping starts 2 m from the wheels and slightly affects the track under them.
# Measured, steady and varying: acceleration 2.6e-4 and 2.4e-4, pitch rate 5.4e-5 and 5.1e-5, force 1.2e-3 and 1.3e-3,
# deflection 5.3e-4 and 5.6e-4. With 50 m: 4.3e-5, 9.2e-6, 2.0e-4, 8.9e-5: as margin^-1.6.
WINDOW_ERROR = {
    "acceleration": 4e-4, "pitch rate": 1e-4, "contact force": 2e-3, "deflection": 1e-3
}  # fmt: skip


@pytest.mark.parametrize("name", SCHEDULES)
def test_default_window_is_close_to_the_whole_track(name: str) -> None:
    near, far = differences(name, layered.MARGIN), differences(name, 50.0)
    for quantity, bound in WINDOW_ERROR.items():
        assert near[quantity] < bound, quantity
        assert far[quantity] < 0.25 * near[quantity], quantity


# Beams.


def probe(*places: float, load: float, at: float) -> Vehicle:
    """A vehicle of nearly massless wheels, with a force at the wheel ``at`` m behind the first.

    The spring of the force is so soft (1 kN/m) that a path of 1 mm changes the force by 1 N in 1e5.
    """
    wheels = tuple(Wheel(f"wheel {x:g}", 0.0, x) for x in places)
    bodies, links = [], []
    for wheel in wheels:
        heavy = wheel.position == at
        mass, stiffness = (load / GRAVITY, 1e3) if heavy else (1e-3, 1.0)
        bodies.append(Body(f"body {wheel.position:g}", mass))
        links.append(
            Link(f"link {wheel.position:g}", bodies[-1].name, wheel.name, 0.0, stiffness, 0.0)
        )
    return Vehicle("probe", tuple(bodies), tuple(links), wheels)


FOUNDATION, EI, P = 1e8, 6.6e6, 1e5  # N/m², N m², N


def winkler(rail_mass: float, damping: float, spacing: float = 0.1) -> LayeredTrack:
    """A beam on springs and dampers (per metre): pads on fixed sleepers (1e7 times as stiff)."""
    pads = Support(
        FOUNDATION * spacing, damping * spacing, 100.0, 1e14, 0.0, 100.0, 1e14, 0.0
    )  # fmt: skip
    return LayeredTrack("Winkler", EI, rail_mass, spacing, pads)


def at_standstill(vehicle: Vehicle, track: LayeredTrack, position: float) -> Simulation:
    """A vehicle at rest: ten steps at 1 mm/s, over 10 µm."""
    run = RunSettings(position, position + 1e-5, constant_speed(1e-3), run_in=0.0, margin=20.0)
    return simulate(vehicle, track, Flat(), run, newmark(1e-3))


@pytest.mark.parametrize("step", [1e-3, 2.5e-4, 5e-5])
def test_window_is_stable_with_short_bays_at_any_step(step: float) -> None:
    # Bays of 0.1 m have a stiffness of 8e10 N/m: one that joined a moving end would load it strongly.
    run = RunSettings(100.0, 102.0, constant_speed(80.0), run_in=80.0)
    made = simulate(probe(0.0, load=P, at=0.0), winkler(2000.0, 9e4), Flat(), run, newmark(step))
    assert np.ptp(made.rail_deflection) < 0.01 * np.abs(made.rail_deflection).max()


def test_point_load_on_a_beam_on_springs_agrees_with_winkler() -> None:
    beta = (FOUNDATION / (4 * EI)) ** 0.25
    places = np.array([0.0, 0.5, 1.0, 1.7, 2.4, 3.1])  # of which the wheel at 1.0 is loaded
    made = at_standstill(probe(*places, load=P, at=1.0), winkler(60.0, 0.0), 50.0)
    x = beta * np.abs(places - 1.0)
    expected = -P / (8 * EI * beta**3) * np.exp(-x) * (np.cos(x) + np.sin(x))
    # Springs 0.1 m apart in place of a bed: (β h)⁴/720 = 5e-7; the probes' weight, 1e-7 each, and sleepers, 1e-7.
    np.testing.assert_allclose(
        made.rail_deflection[0], expected, atol=3e-6 * np.abs(expected).max()
    )


def moving_winkler(xi: Array, speed: float, rail_mass: float, damping: float) -> Array:
    """w at the distance ξ ahead of a force P on EI w'''' + m v² w'' - c v w' + k w = P δ(ξ), by its roots."""
    polynomial = np.array([EI, 0.0, rail_mass * speed**2, -damping * speed, FOUNDATION])
    roots = np.roots(polynomial)
    slope = np.polyval(np.polyder(polynomial), roots)
    ahead = roots.real < 0
    waves = np.exp(np.multiply.outer(np.abs(xi), np.where(ahead, roots, -roots))) / slope
    shares = np.where(ahead, xi[:, None] >= 0, xi[:, None] < 0) * np.where(ahead, 1.0, -1.0)
    return P * np.sum(shares * waves, axis=1).real


RAIL_MASS = 2000.0
CRITICAL = (4 * FOUNDATION * EI / RAIL_MASS**2) ** 0.25
"""Critical speed, m/s: 160 with this heavy rail; at half of it the deflection differs much from the static one."""


def test_closed_form_of_the_moving_force_agrees_with_the_literature_without_damping() -> None:
    # Undamped: w = P / (8 EI β³ √(1-α²)) e^(-β √(1-α²) |ξ|) (cos γ|ξ| + √((1-α²)/(1+α²)) sin γ|ξ|), γ = β √(1+α²).
    xi, alpha = np.linspace(-4.0, 4.0, 17), 0.5
    beta = (FOUNDATION / (4 * EI)) ** 0.25
    down, across = beta * np.sqrt(1 - alpha**2), beta * np.sqrt(1 + alpha**2)
    x = np.abs(xi)
    known = np.exp(-down * x) * (np.cos(across * x) + down / across * np.sin(across * x))
    known *= P / (8 * EI * beta**2 * down)
    actual = moving_winkler(xi, alpha * CRITICAL, RAIL_MASS, 0.0)
    np.testing.assert_allclose(actual, known, atol=1e-12 * known.max())


def moving_force_error(step: float) -> float:
    """Maximum error of the deflection relative to the maximum deflection, over 2 m after a run-in of 80 m."""
    speed, damping = 0.5 * CRITICAL, 9e4
    places = 0.5 * np.arange(9)
    run = RunSettings(100.0, 102.0, constant_speed(speed), run_in=80.0)
    made = simulate(
        probe(*places, load=P, at=2.0), winkler(RAIL_MASS, damping), Flat(), run, newmark(step)
    )
    expected = -moving_winkler(floats(2.0 - places), speed, RAIL_MASS, damping)
    return float(np.abs(made.rail_deflection - expected).max() / np.abs(expected).max())


def test_moving_force_on_a_beam_on_springs_agrees_with_the_closed_form() -> None:
    coarse, fine = moving_force_error(1e-3), moving_force_error(5e-4)
    # The error of Newmark is (β v Δt)²/12 = 2.6e-4; the transient, e^(-c t/2m) = e^-22, and the variation of the
    # force on its soft spring, 2e-5, are smaller.
    assert fine < 2.6e-4
    assert coarse / fine == pytest.approx(4.0, rel=0.15)


# Literature: theory, section 3, for the track of Zhai et al. as in O'Brien et al. 2017.
@pytest.mark.parametrize(("bays", "stiffness"), [(100.0, 87.5e6), (100.5, 88.1e6)])
def test_point_stiffness_of_the_track_of_the_paper(bays: float, stiffness: float) -> None:
    made = at_standstill(probe(0.0, load=P, at=0.0), PAPER_TRACK, bays * PAPER_TRACK.spacing)
    # The source gives three digits.
    assert -P / made.rail_deflection[0, 0] == pytest.approx(stiffness, abs=0.05e6)


# Energy.


def energy_error(step: float) -> float:
    """Maximum error of the energy balance of a car on a rigid path, relative to its maximum gain of energy."""
    run = RunSettings(100.0, 140.0, constant_speed(V), run_in=40.0)
    made = simulate(VELARO, RigidTrack(), Bell(0.01, 1.0, 110.0), run, newmark(step))
    full = assemble(VELARO)
    heave = np.array([motion == "heave" for _, motion in full.degrees_of_freedom])
    x, rate = made.displacement, made.velocity
    weight = GRAVITY * np.diag(full.mass) * heave
    energy = 0.5 * np.sum(rate @ full.mass * rate + x @ full.stiffness * x, axis=1) + x @ weight
    paths = rate[:, -made.contact_force.shape[1] :]
    power = np.sum(made.contact_force * paths, axis=1) - np.sum(rate @ full.damping * rate, axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])
    gained = energy - energy[0]
    return float(np.abs(gained - work).max() / np.abs(gained).max())


def test_work_of_contact_minus_dissipation_equals_the_gain_of_energy() -> None:
    coarse, fine = energy_error(1e-3), energy_error(5e-4)
    # The trapezoidal rule for the work has an error of Δt²; a bell of 1 m takes 24 ms: (1/24)²/12 = 1.4e-4.
    assert coarse < 1e-3
    assert coarse / fine == pytest.approx(4.0, rel=0.05)


# Agreement between track models.


def stiffer(factor: float) -> LayeredTrack:
    """The paper's track with all stiffnesses and dampers multiplied by a factor, and the masses unchanged."""
    one = PAPER_TRACK.support
    support = replace(
        one,
        pad_stiffness=factor * one.pad_stiffness,
        pad_damping=factor * one.pad_damping,
        ballast_stiffness=factor * one.ballast_stiffness,
        ballast_damping=factor * one.ballast_damping,
        subballast_stiffness=factor * one.subballast_stiffness,
    )
    rail = factor * PAPER_TRACK.rail_bending_stiffness
    return replace(PAPER_TRACK, rail_bending_stiffness=rail, support=support)


def test_very_stiff_layers_agree_with_the_rigid_path() -> None:
    run, dip = RunSettings(100.0, 125.0, constant_speed(V), run_in=20.0), Bell(0.002, 1.0, 105.0)
    # The stiffest wheel-track mode is at 3.5 kHz, which requires steps below 57 µs.
    rigid, *layers = (
        simulate(VELARO, track, dip, run, newmark(5e-5))
        for track in (RigidTrack(), stiffer(1e2), stiffer(1e3), stiffer(1e4))
    )
    errors = [
        [
            relative_error(sensor_signal(made, VELARO, one), sensor_signal(rigid, VELARO, one))
            for one in ON_BOGIE
        ]
        + [relative_error(made.contact_force, rigid.contact_force)]
        for made in layers
    ]
    # Deflection is proportional to 1/stiffness; the next order, 1/stiffness², is a tenth of the force at first.
    falls = np.array(errors[:-1]) / errors[1:]
    np.testing.assert_allclose(falls, 10.0, rtol=0.2)
    assert np.max(errors[-1]) < 1e-3


def response(signal: Array, position: Array, omega: float) -> complex:
    """H with signal = Re H e^(iΩs) plus a constant, by least squares."""
    waves = np.column_stack(
        [np.cos(omega * position), -np.sin(omega * position), np.ones(len(position))]
    )
    (real, imaginary, _), *_ = np.linalg.lstsq(waves, signal, rcond=None)
    return complex(real, imaginary)


def wave(length: float, amplitude: float = 1e-3) -> Cosines:
    return Cosines(np.array([amplitude]), np.array([2 * np.pi / length]), np.zeros(1))


@pytest.mark.parametrize("track", [ElasticTrack(87.8e6, 36e3), ElasticTrack(87.8e6, 36e3, "", 300)])
@pytest.mark.parametrize("length", [4.0, 15.0])
def test_car_on_an_elastic_track_over_a_sine_agrees_with_the_state_space(
    track: ElasticTrack, length: float
) -> None:
    run = RunSettings(1000.0, 1060.0, constant_speed(40.0), run_in=900.0)
    made = simulate(VELARO, track, wave(length), run, newmark(2.5e-4))
    omega = 2 * np.pi / length
    exact = transfer_function(state_space(VELARO, track, ON_BOGIE), np.array([omega]), 40.0)[0]
    actual = [
        1e3 * response(sensor_signal(made, VELARO, one), made.position, omega) for one in ON_BOGIE
    ]
    # (ω Δt)²/12 = 2e-5 at 4 m and 63 rad/s, and a few times more where the response is steep in ω, as near its zeros.
    np.testing.assert_allclose(actual, exact, rtol=2e-4)


def test_quarter_car_over_a_sine_agrees_with_its_transfer_function() -> None:
    m1, m2, k1, k2, c1, c2, v = 7900.0, 512.5, 7.3e5, 5e5, 15e3, 5e3, 30.0
    omega = 2 * np.pi / 6.0
    s = 1j * omega * v
    # m1 s² u1 = (k1 + c1 s) (u2 - u1);  m2 s² u2 = (k2 + c2 s) (r - u2) - (k1 + c1 s) (u2 - u1)
    secondary, primary = k1 + c1 * s, k2 + c2 * s
    body = secondary / (m1 * s**2 + secondary)
    bogie = primary / (m2 * s**2 + primary + secondary * (1 - body))
    run = RunSettings(1500.0, 1530.0, constant_speed(v), run_in=1400.0)
    made = simulate(QUARTER, RigidTrack(), wave(6.0), run, newmark(2.5e-4))
    actual = [
        1e3
        * response(made.acceleration[:, made.freedoms.index((part, "heave"))], made.position, omega)
        for part in ("body", "bogie")
    ]
    # (ω Δt)²/12 = 5e-6 at 31 rad/s, about ten times that near the bogie's resonance.
    np.testing.assert_allclose(actual, [s**2 * bogie * body, s**2 * bogie], rtol=1e-4)


def test_wheel_on_a_rigid_path_at_varying_speed_has_the_acceleration_of_its_path() -> None:
    schedule = SpeedSchedule((0.0, 1.0, 2.0, 3.0), (30.0, 20.0, 35.0, 35.0))
    made = simulate(
        VELARO, RigidTrack(), wave(7.0), RunSettings(60.0, 120.0, schedule, 20.0), newmark(1e-3)
    )
    first = np.argmin(
        np.abs(schedule.at(floats(np.arange(2000) * 1e-3))[:, 0] + 40.0 - made.position[0])
    )
    distance, v, a = schedule.at(made.time + first * 1e-3).T
    np.testing.assert_allclose(distance + 40.0, made.position, rtol=1e-12)
    for i, wheel in enumerate(VELARO.wheels):
        r, slope, bend = wave(7.0).at(made.position - wheel.position)
        full = made.position - wheel.position > 50.0  # where the irregularity has its full size
        z = -len(VELARO.wheels) + i
        for actual, expected in (
            (made.displacement, r), (made.velocity, v * slope), (made.acceleration, v**2 * bend + a * slope),
        ):  # fmt: skip
            # Both are the same formulas, up to round-off of phases of about 100 rad.
            np.testing.assert_allclose(actual[full, z], expected[full], atol=1e-12 * 40**2)


# Contact.


def test_mean_contact_force_is_the_static_load() -> None:
    length = 20 * PAPER_TRACK.spacing
    start = 100 * length
    run = RunSettings(start, start + 4 * length, constant_speed(length / 0.3), run_in=40 * length)
    made = simulate(VELARO, PAPER_TRACK, wave(length, 5e-4), run, newmark(2.5e-4))
    static = (47800 + 2 * 3500 + 4 * 1800) * GRAVITY / 4
    # Over three whole waves of 20 bays, long after the start. z̈ is discontinuous at a node, which causes an error of
    # the mean of 60 samples per bay: measured 1.1e-5, and 1.7e-4 with 15 per bay, for any length of the run-in.
    mean = made.contact_force[:3600].mean(axis=0)
    np.testing.assert_allclose(mean, static, rtol=3e-5)
    assert (
        np.ptp(made.contact_force) > 0.01 * static
    )  # the force must vary for the mean to be a test


def test_only_a_run_with_lift_off_has_a_note() -> None:
    run = RunSettings(100.0, 115.0, constant_speed(V), run_in=20.0)
    deep, shallow = (
        simulate(VELARO, PAPER_TRACK, Bell(depth, 0.5, 105.0), run, newmark(1e-3))
        for depth in (0.02, 0.0005)
    )
    assert shallow.notes == ()
    assert shallow.contact_force.min() > 0
    first = deep.position[np.argmax(np.any(deep.contact_force < 0, axis=1))]
    assert deep.contact_force.min() < 0
    assert f"first at 'wheel 1' with the leading wheel at {first:.2f} m" in deep.notes[0]


def test_invalid_runs_are_rejected() -> None:
    run = RunSettings(100.0, 110.0, constant_speed(V))
    for wrong, message in (
        (replace(run, end=90.0), "an end beyond its start, got 100 m to 90 m"),
        (replace(run, end=100.0), "an end beyond its start"),
        (replace(run, margin=4.9), r"at least 5 m of track .* got 4\.9 m"),
        (replace(run, run_in=-1.0), "run-in of at least 0 m"),
        (replace(run, every=0), "at least 1 step per recorded step, got 0"),
    ):
        with pytest.raises(ModelError, match=message):
            simulate(VELARO, PAPER_TRACK, Flat(), wrong, newmark(1e-3))


def test_vehicles_without_support_are_rejected() -> None:
    run, wheel = RunSettings(100.0, 110.0, constant_speed(V)), (Wheel("wheel", 100.0, 0.0),)
    loose = Vehicle(
        "loose", (Body("body", 1e3), Body("roof", 10.0)), (Link("spring", "body", "wheel", 0.0, 1e6, 1e3),), wheel
    )  # fmt: skip
    with pytest.raises(ModelError, match="no link supports the heave of 'roof'; add a link"):
        simulate(loose, PAPER_TRACK, Flat(), run, newmark(1e-3))
    turning = Vehicle(
        "turning", (Body("body", 1e3, 1e3),), (Link("spring", "body", "wheel", 0.0, 1e6, 1e3),), wheel
    )  # fmt: skip
    with pytest.raises(ModelError, match="no link supports the pitch of 'body'"):
        simulate(turning, RigidTrack(), Flat(), run, newmark(1e-3))
    with pytest.raises(ModelError, match="wheel on an elastic track needs a mass"):
        simulate(QUARTER, read_track("zhai"), Flat(), run, newmark(1e-3))


# Linearity.

TRACKS = (RigidTrack(), ElasticTrack(87.8e6, 36e3), PAPER_TRACK)
BELLS = st.builds(
    Bell, st.floats(-0.01, 0.01), st.floats(0.3, 5.0), st.floats(95.0, 105.0)
)  # fmt: skip


def signals(track: RigidTrack | ElasticTrack | LayeredTrack, irregularity: Irregularity) -> Array:
    """All recorded quantities, in columns."""
    schedule = SpeedSchedule((0.0, 0.2, 0.4), (V, V - 2, V + 2))
    run = RunSettings(100.0, 108.0, schedule, run_in=10.0)
    made = simulate(VELARO, track, irregularity, run, newmark(1e-3))
    parts = (
        made.displacement, made.velocity, made.acceleration, made.contact_force, made.rail_deflection
    )  # fmt: skip
    return np.hstack(parts)


@cache
def level_response(index: int) -> Array:
    return signals(TRACKS[index], Flat())


@settings(max_examples=20)
@given(st.sampled_from(range(3)), BELLS, BELLS)
def test_response_minus_that_of_level_track_is_linear(index: int, one: Bell, other: Bell) -> None:
    track, level = TRACKS[index], level_response(index)
    twice = replace(one, depth=-2 * one.depth)
    separate = -2 * (signals(track, one) - level) + (signals(track, other) - level)
    together = signals(track, Sum((twice, other))) - level
    # The static displacement x of 0.5 m gives ẍ a round-off of 4/Δt² ε x = 4e-10 m/s², which is at most 4e-11 m over
    # 0.4 s. Forces have it multiplied by masses of up to 1e4 kg. Signals are some 1e-3 m, 0.1 m/s, 1 m/s² and 1e4 N.
    freedoms, wheels = len(VELARO.wheels) + 6, len(VELARO.wheels)
    rounding = np.array([1e-10, 1e-8, 1e-6, 1e-2, 1e-10])
    scale = np.repeat(rounding, [freedoms, freedoms, freedoms, wheels, wheels])
    np.testing.assert_allclose(together / scale, separate / scale, rtol=1e-9, atol=1.0)

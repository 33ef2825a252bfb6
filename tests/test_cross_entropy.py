"""The paper's method: on small seeded cases, against the direct solution, and in what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Channel, Quality, build_recording
from trackprofile.errors import DataError, ModelError
from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.methods.cross_entropy import cross_entropy_kernels as kernels
from trackprofile.methods.cross_entropy.estimator import (
    INTERRUPTED,
    SearchRun,
    cross_entropy,
    optimise,
    sensor_weights,
    solve_phase,
)
from trackprofile.methods.cross_entropy.forward_model import forward_model
from trackprofile.methods.cross_entropy.search import (
    TABLE_5,
    TABLE_6,
    Evaluation,
    Objective,
    Search,
    Variant,
)
from trackprofile.models.integrate import wilson
from trackprofile.models.irregularity import Bell
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor

Array = NDArray[np.float64]

QUARTER_CAR, _ = read_vehicle("quarter-car")
VELARO, _ = read_vehicle("velaro")
BALLASTED = read_track("zhai-layered")
BOGIE = (Sensor("acceleration", VERTICAL_ACCELERATION, "bogie"),)
LEADING = (
    Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie"),
    Sensor("pitch", PITCH_RATE, "leading bogie"),
)


def ridden(whole: bool, length: float) -> tuple[xr.Dataset, Array]:
    """What is recorded over a bell, by the model that the search uses, and its elevations."""
    vehicle, track, sensors = (
        (VELARO, BALLASTED, LEADING) if whole else (QUARTER_CAR, read_track("rigid"), BOGIE)
    )
    speed, step = (150 / 3.6, 2e-3) if whole else (30.0, 0.025 / 30.0)
    count = round(length / speed / step)
    time = np.linspace(0.0, step * count, count + 1)
    car = forward_model(
        vehicle, track, sensors, wilson(step), speed * time, np.full(count + 1, speed)
    )
    r = Bell(depth=1e-3, width=0.5, centre=0.5 * length).at(car.place)[0]
    r[: car.before] = 0.0
    y = np.vstack([np.zeros(len(sensors)), car.signals(r, 0, count)])
    parts = [Channel(s.name, y[:, i], s.quantity, s.body, 0.0) for i, s in enumerate(sensors)]
    recording = build_recording(
        parts, time=time, distance=speed * time, speed=np.full(count + 1, speed)
    )
    return recording, r[car.before :]


@pytest.fixture(scope="module")
def on_rigid_rail() -> tuple[xr.Dataset, Array]:
    return ridden(whole=False, length=4.0)


@pytest.fixture(scope="module")
def on_ballast() -> tuple[xr.Dataset, Array]:
    return ridden(whole=True, length=8.0)


def worst(found: xr.Dataset, truth: Array) -> float:
    return float(np.abs(found["elevation"].to_numpy() - truth).max())


def test_bell_of_model_a_is_found(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    recording, truth = on_rigid_rail
    found = cross_entropy(recording, QUARTER_CAR)
    assert worst(found.profile, truth) < 1e-6
    assert found.profile.attrs["kind"] == "point"
    assert found.profile.attrs["loading"] == "loaded"
    assert not found.stopped
    assert np.all(found.profile["quality"] == 0)
    signal = recording["acceleration"].to_numpy()
    np.testing.assert_allclose(
        found.reproduced["acceleration"][1:], signal[1:], atol=1e-3 * np.abs(signal).max()
    )


@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize("objective", Objective)
def test_bell_of_model_b_is_found(
    on_ballast: tuple[xr.Dataset, Array], variant: Variant, objective: Objective
) -> None:
    recording, truth = on_ballast
    search = replace(TABLE_6, variant=variant, objective=objective)
    found = cross_entropy(recording, VELARO, track=BALLASTED, search=search)
    assert found.profile.attrs["loading"] == "unloaded"
    loose = variant is Variant.LITERAL and objective is Objective.SIGNAL
    assert worst(found.profile, truth) < (5e-4 if loose else 1e-6)


def test_same_seed_same_bits_another_seed_others(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    recording, _ = on_rigid_rail
    first, again, other = (
        cross_entropy(recording, QUARTER_CAR, seed=seed).profile["elevation"].to_numpy()
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_map_and_simulation_give_the_same_elite(on_ballast: tuple[xr.Dataset, Array]) -> None:
    short = on_ballast[0].isel(sample=slice(0, 32))
    search = replace(TABLE_6, population=40, threshold=1e-10)
    by_map, simulated = (
        cross_entropy(short, VELARO, track=BALLASTED, search=search, evaluation=way)
        for way in Evaluation
    )
    assert [len(one.runs) for one in by_map.phases] == [len(one.runs) for one in simulated.phases]
    np.testing.assert_allclose(
        by_map.profile["elevation"], simulated.profile["elevation"], rtol=0, atol=1e-9
    )


def window(sensors: int = 1, m: int = 6) -> tuple[Array, Array, Array]:
    """A triangular map (sensors, m, m), the elevations that it is asked for, and what they give."""
    generator = np.random.default_rng(4)
    gain = np.tril(generator.normal(0.0, 1.0, (sensors, m, m))) + 2.0 * np.eye(m)
    x = np.cumsum(generator.normal(0.0, 5e-4, m))
    return gain, x, gain @ x


SMALL = replace(TABLE_5, unknowns=6, length=None)


def searched(search: Search, seed: int = 0) -> tuple[Array, SearchRun, Array]:
    gain, x, due = window()
    one = np.ones(1)
    start = np.diag(np.full(6, search.standard_deviation**2))
    generator = np.random.default_rng(seed)
    mean, run = optimise(
        lambda tried: kernels.misfits(gain, tried, due, one), np.zeros(6), start, search, generator
    )
    return mean, run, x


@pytest.mark.parametrize("seed", range(5))
def test_long_run_ends_at_the_direct_triangular_solution(seed: int) -> None:
    mean, run, _ = searched(replace(SMALL, threshold=1e-26), seed)
    gain, _, due = window()
    direct = np.linalg.solve(gain[0], due[0])
    assert run.converged
    np.testing.assert_allclose(mean, direct, rtol=0, atol=1e-11)


def test_lower_threshold_takes_longer_and_comes_closer() -> None:
    runs = [searched(replace(SMALL, threshold=t)) for t in (1e-9, 1e-12, 1e-15, 1e-18)]
    lengths = [len(run.objective) for _, run, _ in runs]
    errors = [float(np.linalg.norm(mean - x)) for mean, _, x in runs]
    assert lengths == sorted(set(lengths))
    assert errors == sorted(errors, reverse=True)


def test_smoothing_slows_the_search_and_keeps_the_spread() -> None:
    lengths = [len(searched(replace(SMALL, smoothing=s))[1].objective) for s in (0.3, 0.6, 0.8)]
    assert lengths == sorted(set(lengths))


def test_larger_population_brings_a_better_first_generation() -> None:
    best = [
        np.mean([searched(replace(SMALL, population=n), seed)[1].objective[0] for seed in range(9)])
        for n in (30, 300, 3000)
    ]
    assert best == sorted(best, reverse=True)


def test_smaller_elite_converges_sooner() -> None:
    lengths = [len(searched(replace(SMALL, elite=e))[1].objective) for e in (0.1, 0.2, 0.4)]
    assert lengths == sorted(lengths)


def test_initial_mean_near_the_answer_starts_better() -> None:
    gain, x, due = window()
    misfits = lambda tried: kernels.misfits(gain, tried, due, np.ones(1))  # noqa: E731
    start = np.diag(np.full(6, SMALL.standard_deviation**2))
    first = [
        optimise(misfits, mean, start, SMALL, np.random.default_rng(0))[1].objective[0]
        for mean in (x, x + 5e-3)
    ]
    assert first[0] < 0.1 * first[1]


def test_fewer_unknowns_make_more_phases(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    recording, truth = on_rigid_rail
    search = replace(TABLE_5, unknowns=6, length=None)
    found = cross_entropy(recording, QUARTER_CAR, search=search)
    assert {one.kept for one in found.phases[:-1]} == {3}
    assert worst(found.profile, truth) < 1e-6


def test_wider_start_takes_longer() -> None:
    lengths = [
        len(searched(replace(SMALL, standard_deviation=s))[1].objective) for s in (1e-4, 1e-3, 1e-2)
    ]
    assert lengths == sorted(lengths)


def test_agreement_decides_how_often_a_phase_is_begun_anew() -> None:
    gain, _, due = window()
    misfits = lambda tried: kernels.misfits(gain, tried, due, np.ones(1))  # noqa: E731
    rough = replace(SMALL, threshold=1e-9, variant=Variant.LITERAL)

    def runs(agreement: float) -> int:
        search, generator = replace(rough, agreement=agreement), np.random.default_rng(0)
        return len(solve_phase(misfits, np.zeros(6), 0.0, search, generator, walk=True)[1])

    assert runs(10.0) == 2
    assert runs(1e-9) > 2


@pytest.mark.parametrize(
    ("variant", "alike"), [(Variant.LITERAL, False), (Variant.COVARIANCE, True)]
)
def test_covariance_variant_takes_as_long_on_a_hill_as_in_a_valley(
    variant: Variant, alike: bool
) -> None:
    """Elevations have no natural zero, but the paper's 5 % of them does."""
    gain, _, due = window()
    search = replace(SMALL, threshold=1e-9, variant=variant, agreement=1e-3)

    def runs(level: float) -> int:
        raised = due + gain @ np.full(6, level)
        misfits = lambda tried: kernels.misfits(gain, tried, raised, np.ones(1))  # noqa: E731
        generator = np.random.default_rng(0)
        return len(solve_phase(misfits, np.full(6, level), level, search, generator, walk=True)[1])

    assert (runs(0.0) == runs(1.0)) is alike


def test_first_generation_is_a_random_walk() -> None:
    x = kernels.draw_random_walks(np.random.default_rng(0), 40_000, np.full(4, 1e-3), 2e-3)
    np.testing.assert_allclose(x.mean(axis=0), 1e-3, atol=1e-4)
    np.testing.assert_allclose(x.var(axis=0), 4e-6 * np.arange(1, 5), rtol=0.05)


def test_drawn_profiles_have_their_covariance() -> None:
    root = np.tril(np.random.default_rng(1).normal(0.0, 1e-3, (4, 4)))
    x = kernels.draw_normal(np.random.default_rng(0), 200_000, np.arange(4.0), root @ root.T)
    np.testing.assert_allclose(np.cov(x.T), root @ root.T, atol=0.02 * np.abs(root @ root.T).max())


def test_elites_are_the_best_by_the_whole_signal_or_by_each_scan() -> None:
    misfit = np.array([[0.0, 9.0], [5.0, 1.0], [2.0, 2.0], [6.0, 6.0]])
    np.testing.assert_array_equal(kernels.elite_by_total(misfit, 2), [[2, 1], [2, 1]])
    np.testing.assert_array_equal(kernels.elite_by_scan(misfit, 2), [[0, 2], [1, 2]])


@pytest.mark.parametrize("size", [1, 2, 10, 100])
def test_least_values_are_those_of_a_stable_sort(size: int) -> None:
    values = np.random.default_rng(size).integers(0, 30, 100).astype(np.float64)
    np.testing.assert_array_equal(
        kernels.smallest(values, size), np.argsort(values, kind="stable")[:size]
    )


def test_elite_moments_are_those_of_numpy() -> None:
    x = np.random.default_rng(2).normal(size=(20, 3))
    elite = np.tile(np.arange(5), (3, 1))
    np.testing.assert_allclose(kernels.elite_mean(x, elite), x[:5].mean(axis=0))
    np.testing.assert_allclose(kernels.elite_covariance(x, elite), np.cov(x[:5].T))
    np.testing.assert_allclose(
        kernels.elite_variances(x, elite), np.diag(x[:5].var(axis=0, ddof=1))
    )


def test_misfits_are_weighted_squares() -> None:
    gain, x, due = window(sensors=2)
    tried = np.vstack([x, x + 1e-3])
    expected = 0.2 * (tried @ gain[0].T - due[0]) ** 2 + 0.8 * (tried @ gain[1].T - due[1]) ** 2
    np.testing.assert_allclose(
        kernels.misfits(gain, tried, due, np.array([0.2, 0.8])), expected, atol=1e-18
    )


def test_weights_are_the_papers() -> None:
    signals = np.array([[3.0, 0.5], [-3.0, -0.5]])
    weight = sensor_weights(signals)
    assert weight[0] == pytest.approx(0.5 / 3.5)  # RMS_R / (RMS_A + RMS_R)
    assert weight.sum() == pytest.approx(1.0)


def test_phases_keep_half_and_cover_all(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    found = cross_entropy(on_rigid_rail[0], QUARTER_CAR)
    starts = [one.first for one in found.phases]
    assert starts == list(range(0, 5 * len(starts), 5))
    assert sum(one.kept for one in found.phases) == found.profile.sizes["distance"] == 160


def test_limit_of_generations_flags_the_metres(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    search = replace(TABLE_5, generations=5, runs=2)
    found = cross_entropy(on_rigid_rail[0], QUARTER_CAR, search=search)
    assert np.all((found.profile["quality"] & Quality.UNCONVERGED) != 0)
    assert any("did not converge" in note for note in found.notes)


def test_interrupt_returns_what_is_done(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    recording, _ = on_rigid_rail

    def tired(stage: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    found = cross_entropy(recording, QUARTER_CAR, progress=tired)
    whole = cross_entropy(recording, QUARTER_CAR)
    count = found.profile.sizes["distance"]
    assert found.stopped == INTERRUPTED
    assert 80 <= count < 160
    np.testing.assert_array_equal(
        found.profile["elevation"], whole.profile["elevation"].isel(distance=slice(0, count))
    )
    assert any("ends at" in note for note in found.notes)


def test_every_other_scan_for_longer_phases(on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
    recording, truth = on_rigid_rail
    found = cross_entropy(recording, QUARTER_CAR, search=replace(TABLE_5, length=0.5))
    assert found.profile.sizes["distance"] == 80
    assert np.corrcoef(found.profile["elevation"], truth[1::2])[0, 1] > 0.99
    coarse = cross_entropy(recording, QUARTER_CAR, search=replace(TABLE_5, length=0.1))
    assert any("not 0.1 m" in note for note in coarse.notes)


def test_dead_channel_is_left_out_and_named(on_ballast: tuple[xr.Dataset, Array]) -> None:
    recording, truth = on_ballast
    dead = recording.copy(deep=True)
    dead["pitch"].values[:] = 0.0
    found = cross_entropy(dead, VELARO, track=BALLASTED)
    assert any(
        "'pitch' is not used: none of its samples is usable (stuck)" in note for note in found.notes
    )
    assert worst(found.profile, truth) < 1e-6


class TestRefused:
    def test_population_too_small_for_an_elite(self) -> None:
        with pytest.raises(ModelError, match="population of at least 15"):
            replace(TABLE_6, population=10)

    @pytest.mark.parametrize(
        "wrong",
        [{"threshold": 0.0}, {"unknowns": 1}, {"elite": 1.5}, {"smoothing": 1.0}, {"length": 0.0},
         {"standard_deviation": float("nan")}, {"runs": 1}],
        ids=str,
    )  # fmt: skip
    def test_impossible_setting(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ModelError, match=next(iter(wrong))):
            replace(TABLE_6, **wrong)  # pyright: ignore[reportArgumentType]

    def test_window_longer_than_the_recording(
        self, on_rigid_rail: tuple[xr.Dataset, Array]
    ) -> None:
        short = on_rigid_rail[0].isel(sample=slice(0, 8))
        with pytest.raises(DataError, match="longer than the recording"):
            cross_entropy(short, QUARTER_CAR)

    def test_missing_sample(self, on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
        broken = on_rigid_rail[0].copy(deep=True)
        broken["acceleration_valid"] = ("sample", np.arange(161) != 40)
        parts = [
            Channel(
                "acceleration", broken["acceleration"].to_numpy(), VERTICAL_ACCELERATION, "bogie", 0.0,
                valid=np.arange(161) != 40,
            )
        ]  # fmt: skip
        recording = build_recording(parts, time=broken["time"], speed=broken["speed"])
        with pytest.raises(
            DataError, match=r"'acceleration' has none in data row 41 \(samples missing"
        ):
            cross_entropy(recording, QUARTER_CAR)

    def test_uneven_time(self, on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
        keep = np.flatnonzero(np.arange(161) != 50)
        with pytest.raises(DataError, match="evenly in time"):
            cross_entropy(on_rigid_rail[0].isel(sample=keep), QUARTER_CAR)

    def test_sensor_that_recorded_nothing_but_zeros(self) -> None:
        with pytest.raises(DataError, match="zero throughout"):
            sensor_weights(np.array([[0.0, 1.0], [0.0, -1.0]]))

    def test_spike(self, on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
        spiked = on_rigid_rail[0].copy(deep=True)
        spiked["acceleration"][100] = 50.0
        with pytest.raises(DataError, match=r"data row 101 \(spike\)"):
            cross_entropy(spiked, QUARTER_CAR)

    def test_sensor_that_meets_the_profile_long_after_the_leading_wheel(self) -> None:
        recording, _ = ridden(whole=True, length=25.0)
        parts = [
            Channel("far", recording["acceleration"].to_numpy(), VERTICAL_ACCELERATION, "trailing bogie", 0.0)
        ]  # fmt: skip
        moved = build_recording(
            parts, time=recording["time"], distance=recording["distance"], speed=recording["speed"]
        )
        with pytest.raises(DataError, match="No channel reacts"):
            cross_entropy(moved, VELARO)

    def test_no_such_body(self, on_rigid_rail: tuple[xr.Dataset, Array]) -> None:
        with pytest.raises(ModelError):
            cross_entropy(on_rigid_rail[0], VELARO)
